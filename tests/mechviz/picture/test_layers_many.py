"""Orders of layers: costs of many at once are those of each, trains find an order; what meets is what meets at some frame."""

from __future__ import annotations

import random

import numpy as np
import pytest
from shapely import affinity
from shapely.geometry import Point, Polygon, box

from mechcore.motion.solve import compile_mechanism, default_times, solve_motion
from mechviz.meshes.layer_order import (
    COST_WEIGHTS,
    Costs,
    Post,
    greedy,
    improve,
    improve_many,
    natural_ranks,
    order_layers,
    without_empty_layers,
)
from mechviz.meshes.layers import Sweeps
from mechviz.meshes.solids import build_solids
from mechviz.scene.scene import loads


class Puzzle:
    """Random groups and posts."""

    def __init__(self, rng: random.Random, n: int) -> None:
        self.n, self.conflicts = n, [0] * n
        for g in range(n):
            for h in range(g):
                if rng.random() < 0.3:
                    self.conflicts[g] |= 1 << h
                    self.conflicts[h] |= 1 << g
        self.posts = []
        count = rng.randint(0, n)
        for k in range(count):
            groups = tuple(sorted(rng.sample(range(n), rng.randint(1, min(3, n)))))
            hits = sum(1 << g for g in range(n) if g not in groups and rng.random() < 0.4)
            near = tuple(j for j in range(count) if j != k and (j + k) % 3 == 0)
            self.posts.append(Post(groups, rng.random() < 0.5, hits, near))
        self.behind = {g: rng.random() * 5 for g in range(n) if rng.random() < 0.3}
        self.costs = Costs(self.conflicts, self.posts, self.behind, COST_WEIGHTS)

    def cost(self, layers: list[int]) -> float:
        """The cost of one order, counted one by one; groups on layer -1 are not placed."""
        clash, front, height, span = COST_WEIGHTS
        placed = [g for g in range(self.n) if layers[g] >= 0]
        clashes = sum(layers[g] == layers[h] and self.conflicts[g] >> h & 1 for g in placed for h in placed if h < g)
        total = height * max(layers) + sum(price * layers[g] for g, price in self.behind.items() if g in placed)
        ends = []
        for post in self.posts:
            mine = [layers[g] for g in post.groups if g in placed]
            if not mine:
                ends.append((0, 0))
                continue
            low, high = min(mine), max(mine)
            hit = [layers[g] for g in placed if post.hits >> g & 1]
            clashes += sum(low < layer < high for layer in hit)
            behind, before = sum(layer < low for layer in hit), sum(layer > high for layer in hit)
            if post.ground:
                clashes += min(behind, before)
                total += front if before < behind else 0.0
                low, high = (low, max(layers) + 1) if before < behind else (-1, high)
                total += span * (high - low - 1)
            else:
                total += span * max(0, high - low + 1 - len(set(mine)))
            ends.append((low, high))
        for i, post in enumerate(self.posts):
            clashes += sum(min(ends[i][1], ends[j][1]) - max(ends[i][0], ends[j][0]) > 1 for j in post.near if j < i)
        return clash * clashes + total

    def moves(self, layers: list[int]) -> list[list[int]]:
        """All orders one move away."""
        result = [[max(layers) - layer for layer in layers]]
        for g in range(self.n):
            for level in range(max(layers) + 2):
                result.append([level if k == g else old for k, old in enumerate(layers)])
                result.append([level if k == g else old + (old >= level) for k, old in enumerate(layers)])
            for h in range(g):
                result.append(list(layers))
                result[-1][g], result[-1][h] = layers[h], layers[g]
        return [[sorted(set(order)).index(layer) for layer in order] for order in result]


@pytest.mark.parametrize("seed", range(40))
def test_many_costs_at_once_are_the_costs_of_each(seed):
    rng = random.Random(seed)
    puzzle = Puzzle(rng, rng.randint(1, 9))
    orders = [[rng.randint(0, 4) for _ in range(puzzle.n)] for _ in range(20)]
    orders = without_empty_layers(np.array(orders, np.int16))
    assert puzzle.costs(orders) == pytest.approx([puzzle.cost(order) for order in orders.tolist()])
    some = np.where(np.array([[rng.random() < 0.4 for _ in order] for order in orders]), -1, orders)
    some[:, rng.randrange(puzzle.n)] = 0
    assert puzzle.costs(some, partial=True) == pytest.approx([puzzle.cost(order) for order in some.tolist()])


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("bulk", [improve, improve_many])
@pytest.mark.parametrize("n", [7, 13])
def test_moves_in_bulk_end_where_no_single_move_helps(bulk, n, seed):
    puzzle = Puzzle(random.Random(100 + seed), n)
    ranks = [natural_ranks(puzzle.conflicts, puzzle.posts), list(range(n))]
    start = without_empty_layers(greedy(puzzle.costs, np.array(ranks)))
    assert start.tolist() == [placed_one_by_one(puzzle, order) for order in ranks]
    result = bulk(puzzle.costs, start).tolist()
    costs = [puzzle.cost(order) for order in result]
    assert min(costs) <= min(puzzle.cost(order) for order in start.tolist()) + 1e-9
    assert result == without_empty_layers(np.array(result, np.int16)).tolist()
    for order, cost in zip(result, costs, strict=True):
        assert all(puzzle.cost(trial) >= cost - 1e-6 for trial in puzzle.moves(order))


def placed_one_by_one(puzzle: Puzzle, ranks: list[int]) -> list[int]:
    """Each group where it costs least so far."""
    layers = [-1] * puzzle.n
    for g in ranks:
        trials = [[level if k == g else old for k, old in enumerate(layers)] for level in range(max(layers) + 2)]
        layers = min(trials, key=puzzle.cost)
    return [sorted(set(layers)).index(layer) for layer in layers]


def test_the_order_is_the_cheapest_that_any_start_leads_to():
    puzzle = Puzzle(random.Random(5), 6)
    puzzle.behind = {2: 1.0}
    puzzle.costs = Costs(puzzle.conflicts, puzzle.posts, puzzle.behind, COST_WEIGHTS)
    layers = order_layers(puzzle.conflicts, puzzle.posts, puzzle.behind)
    cost = puzzle.cost(list(layers.layers))
    assert layers.clashes == cost // COST_WEIGHTS[0]
    rng = random.Random(0)
    for _ in range(200):
        assert (
            cost
            <= puzzle.cost(without_empty_layers(np.array([[rng.randint(0, 5) for _ in range(6)]], np.int16))[0].tolist()) + 1e-9
        )


def outline(rng: np.random.Generator) -> Polygon:
    """A disc, a plate with a hole, or a hook."""
    kind, size = rng.integers(4), rng.uniform(0.05, 0.4)
    at = rng.uniform(-0.5, 0.5, 2)
    if kind == 0:
        return Point(at).buffer(size)
    plate = box(-2.0 * size, -size, 2.0 * size, size)
    if kind == 1:
        plate = plate.difference(Point(0.5 * size, 0.0).buffer(0.7 * size)).difference(Point(-size, 0.0).buffer(0.3 * size))
    elif kind == 2:
        plate = plate.difference(box(-size, -0.5 * size, 3.0 * size, 0.5 * size))
    return affinity.translate(affinity.rotate(plate, rng.uniform(0.0, 360.0)), *at)


def placed(shape: Polygon, pose: np.ndarray) -> Polygon:
    c, s = np.cos(pose[2]), np.sin(pose[2])
    return affinity.affine_transform(shape, [c, -s, s, c, pose[0], pose[1]])


@pytest.mark.parametrize("seed", range(5))
def test_sweeps_meet_where_the_outlines_do_at_some_frame(seed):
    rng = np.random.default_rng(seed)
    links = ["a", "b", "c"]
    t = np.linspace(0.0, rng.uniform(0.05, 2.0), 60)
    poses = {
        name: np.column_stack(
            [rng.uniform(-1, 1) + 0.2 * np.cos(k + t), rng.uniform(-1, 1) + 0.2 * np.sin(t), rng.uniform(0, 6) + t]
        )
        for k, name in enumerate(links)
    }
    shapes = [outline(rng) for _ in range(12)]
    owners = [links[k % 3] for k in range(12)]
    joints = [(i, j) for i in range(12) for j in range(i) if owners[i] != owners[j]]
    true = [
        any(placed(shapes[i], poses[owners[i]][k]).intersects(placed(shapes[j], poses[owners[j]][k])) for k in range(60))
        for i, j in joints
    ]
    assert 0 < sum(true) < len(true)
    sweeps = Sweeps(shapes, owners, poses)
    assert sweeps.meet(np.array(joints)).tolist() == true
    questions = np.arange(len(joints)) // 5
    assert sweeps.meet(np.array(joints), questions).tolist() == [any(true[k : k + 5]) for k in range(0, len(true), 5)]


def test_a_pin_in_its_hole_meets_nothing_until_the_hole_is_too_narrow_or_it_leaves():
    ring = Point(0.3, 0.1).buffer(0.3).difference(Point(0.3, 0.1).buffer(0.1))
    angle = np.linspace(0.0, 7.0, 361)
    turn = np.column_stack([0.3 - 0.3 * np.cos(angle), 0.1 - 0.3 * np.sin(angle), angle])
    still = np.zeros((361, 3))
    for radius, away, met in ((0.09, 0, False), (0.1001, 0, True), (0.09, 0.02, True), (0.01, 0.095, True), (0.01, 0.35, False)):
        moved = turn + np.outer(np.arange(361) == 200, (away, 0.0, 0.0))
        sweeps = Sweeps([ring, Point(0.3, 0.0).buffer(radius)], ["plate", "pin"], {"plate": still, "pin": moved})
        assert sweeps.meet(np.array([[0, 1]])).tolist() == [met]
        assert sweeps.meet(np.array([[1, 0]])).tolist() == [met]


def test_no_joints_are_no_question():
    sweeps = Sweeps([box(0, 0, 1, 1)], ["a"], {"a": np.zeros((3, 3))})
    assert sweeps.meet(np.zeros((0, 2), int)).tolist() == []


def chain(count: int) -> str:
    """A train of crank-rockers, each driven by the rocker before."""
    lines = ['units = { length = "mm", angle = "deg" }', "[links]"]
    lines.append(f"frame = {{ points = {{ {', '.join(f'D{k} = [{200 * k}, 0]' for k in range(count + 1))} }} }}")
    lines.append("rocker0 = { points = { D0 = [0, 0], B1 = [60, 0] } }")
    for k in range(1, count + 1):
        lines.append(f"coupler{k} = {{ points = {{ B{k} = [0, 0], C{k} = [190, 0] }} }}")
        lines.append(f"rocker{k} = {{ points = {{ D{k} = [0, 0], C{k} = [120, 0], B{k + 1} = [90, 20] }} }}")
    lines += ["[joints]", 'D0 = { revolute = ["frame", "rocker0"], drive = { speed = "60 rpm" } }']
    for k in range(1, count + 1):
        lines.append(f'B{k} = {{ revolute = ["rocker{k - 1}", "coupler{k}"] }}')
        lines.append(f'C{k} = {{ revolute = ["coupler{k}", "rocker{k}"], side = "left" }}')
        lines.append(f'D{k} = {{ revolute = ["rocker{k}", "frame"] }}')
    return "\n".join(lines)


def test_a_train_of_many_links_is_drawn_in_an_order_without_clashes():
    """Its links are short beside the whole: they are drawn so narrow that they clear each other."""
    mechanism = loads(chain(14)).mechanism
    motion = solve_motion(compile_mechanism(mechanism), default_times(mechanism, frames=60))
    solids = build_solids(mechanism, {link: motion.pose(link) for link in motion.model.links})
    assert solids.clashes == ()
    assert max(solid.layer for name, solid in solids.links.items() if name != "frame") <= 4
