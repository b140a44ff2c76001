"""Orders of layers of mechanisms with many links: the costs of many orders at once are those of each, and trains find an order."""

from __future__ import annotations

import random

import numpy as np
import pytest

from mechcore import compile_mechanism, default_times, solve_motion
from mechviz import loads
from mechviz.meshes import build_solids
from mechviz.meshes.layers import Post, _packed, _Search
from mechviz.meshes.many_layers import improve


def puzzle(rng: random.Random, n: int) -> _Search:
    """Random groups and posts."""
    conflicts = [0] * n
    for g in range(n):
        for h in range(g):
            if rng.random() < 0.3:
                conflicts[g] |= 1 << h
                conflicts[h] |= 1 << g
    posts = []
    count = rng.randint(0, n)
    for k in range(count):
        groups = tuple(sorted(rng.sample(range(n), rng.randint(1, min(3, n)))))
        hits = sum(1 << g for g in range(n) if g not in groups and rng.random() < 0.4)
        near = tuple(j for j in range(count) if j != k and (j + k) % 3 == 0)
        posts.append(Post(groups, rng.random() < 0.5, hits, near))
    return _Search(conflicts, posts, {g: rng.random() * 5 for g in range(n) if rng.random() < 0.3})


@pytest.mark.parametrize("seed", range(40))
def test_many_costs_at_once_are_the_costs_of_each(seed):
    rng = random.Random(seed)
    search = puzzle(rng, rng.randint(1, 9))
    orders = [_packed([rng.randint(0, 4) for _ in range(search.n)]) for _ in range(20)]
    assert search.costs(np.array(orders, np.int16)) == pytest.approx([search.cost(order) for order in orders])


@pytest.mark.parametrize("seed", range(8))
def test_moves_in_bulk_end_where_no_single_move_helps(seed):
    search = puzzle(random.Random(100 + seed), 7)
    start = search.greedy(search.natural_ranks())
    found = improve(search.costs, start)
    cost = search.cost(found)
    assert cost <= search.cost(_packed(start)) + 1e-9 and found == _packed(found)
    assert all(search.cost(_packed(trial)) >= cost - 1e-6 for trial in search._moves(found))


def chain(count: int) -> str:
    """A train of crank-rockers, each driven by the rocker before."""
    lines = ['units = { length = "mm", angle = "deg" }', "[links]"]
    lines.append(f"frame = {{ points = {{ {', '.join(f'D{k} = [{200 * k}, 0]' for k in range(count + 1))} }} }}")
    lines.append("rocker0 = { points = { D0 = [0, 0], B1 = [60, 0] } }")
    for k in range(1, count + 1):
        lines.append(f"coupler{k} = {{ points = {{ B{k} = [0, 0], C{k} = [190, 0] }} }}")
        lines.append(f"rocker{k} = {{ points = {{ D{k} = [0, 0], C{k} = [120, 0], B{k + 1} = [90, 20] }} }}")
    lines += ["[pairs]", 'D0 = { revolute = ["frame", "rocker0"], drive = { speed = "60 rpm" } }']
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
