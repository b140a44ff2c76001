"""Solids: closed parts, layers in which nothing collides, and the same picture at every size."""

from __future__ import annotations

import io
import itertools
import random
import subprocess
import sys
from functools import cache

import numpy as np
import pytest
import trimesh
from mechanisms import four_bar, pin, slider_crank
from solid_checks import FRAMES, Poses, check_shapes, in_world, mechanism, meeting_links, moved

import mechviz
from mechcore.spec.mechanism import Mechanism, Prismatic, Revolute, Screw
from mechviz.meshes.layer_order import Post, order_layers
from mechviz.meshes.solids import Solids, build_solids, stl_bytes
from recordings import COVERING, ran, solids


def shown(name: str) -> tuple[Mechanism, Poses, Solids]:
    """A gallery scene as its recording shows it, at a part of its frames."""
    motion = ran(name).motion
    some = slice(None, None, -(-motion.frames // FRAMES))
    return motion.mechanism, {link: np.asarray(motion.pose(link))[some] for link in motion.model.links}, solids(name)


def turning(angle: np.ndarray, x: float = 0.0, y: float = 0.0) -> np.ndarray:
    return np.column_stack([np.full_like(angle, x), np.full_like(angle, y), angle])


TURN = np.linspace(0.0, 2.0 * np.pi, FRAMES, endpoint=False)


def crank_rocker(scale: float = 1e-3) -> tuple[Mechanism, Poses]:
    s = scale
    return moved(four_bar(E=(200 * s, 0.0), AB=60 * s, BD=180 * s, DE=150 * s, coupler_point=(90 * s, 70 * s)))


def parallel_cranks(count: int, spacing: float, length: float) -> tuple[Mechanism, Poses]:
    """Cranks that turn together, each long enough to sweep over its neighbours' ground pivots."""
    points: dict[str, dict[str, tuple[float, float]]] = {"frame": {f"G{k}": (spacing * k, 0.0) for k in range(count)}}
    points |= {f"crank{k}": {f"G{k}": (0.0, 0.0), f"P{k}": (length, 0.0)} for k in range(count)}
    joints = [pin(f"G{k}", "frame", f"crank{k}") for k in range(count)]
    return mechanism(points, *joints), {f"crank{k}": turning(TURN, spacing * k) for k in range(count)}


def turning_guide() -> tuple[Mechanism, Poses]:
    """Whitworth's quick return: the crank runs around the lever's pivot, so one of them needs a bearing in front."""
    r, d = 0.1, 0.04
    x, y = r * np.cos(TURN), r * np.sin(TURN)
    lever = np.arctan2(y + d, x)
    spec = mechanism(
        {
            "frame": {"A": (0.0, 0.0), "O": (0.0, -d)},
            "crank": {"A": (0.0, 0.0), "B": (r, 0.0)},
            "block": {"B": (0.0, 0.0)},
            "lever": {"O": (0.0, 0.0), "C": (-0.06, 0.0)},
        },
        pin("A", "frame", "crank"),
        pin("B", "crank", "block"),
        pin("O", "frame", "lever"),
        Prismatic(name="S", links=("lever", "block"), points=("O", "B")),
    )
    return spec, {
        "crank": turning(TURN),
        "block": np.column_stack([x, y, lever]),
        "lever": turning(lever, 0.0, -d),
    }


def shoe_over_pivot() -> tuple[Mechanism, Poses]:
    """A shoe that slides past the pivot of its bar: a slot would cut the pivot, so it grips the bar from outside."""
    angle, s = 0.3 * np.cos(TURN), 0.12 * np.sin(TURN)
    spec = mechanism(
        {
            "frame": {"O": (0.0, 0.0)},
            "bar": {"O": (0.0, 0.0), "L": (-0.2, 0.0), "R": (0.2, 0.0)},
            "shoe": {"B": (0.0, 0.0)},
        },
        pin("O", "frame", "bar"),
        Prismatic(name="S", links=("bar", "shoe"), points=("O", "B")),
    )
    return spec, {"bar": turning(angle), "shoe": np.column_stack([s * np.cos(angle), s * np.sin(angle), angle])}


def plunger() -> tuple[Mechanism, Poses]:
    """A slider-crank whose slider carries the guide line and runs through a bushing of the frame."""
    r, rod = 0.05, 0.13
    x, y = r * np.cos(TURN), r * np.sin(TURN)
    end = x + np.sqrt(rod**2 - y**2)
    spec = mechanism(
        {
            "frame": {"A": (0.0, 0.0), "G": (0.27, 0.0)},
            "crank": {"A": (0.0, 0.0), "B": (r, 0.0)},
            "rod": {"B": (0.0, 0.0), "C": (rod, 0.0)},
            "plunger": {"C": (0.0, 0.0), "T": (0.2, 0.0)},
        },
        pin("A", "frame", "crank"),
        pin("B", "crank", "rod"),
        pin("C", "rod", "plunger"),
        Prismatic(name="G", links=("plunger", "frame"), points=("C", "G")),
    )
    return spec, {
        "crank": turning(TURN),
        "rod": np.column_stack([x, y, np.arctan2(-y, end - x)]),
        "plunger": np.column_stack([end, 0.0 * x, 0.0 * x]),
    }


CASES = {
    "tiny crank": lambda: moved(slider_crank(r=0.005, l=0.5)),
    "micrometres": lambda: crank_rocker(1e-8),
    "kilometres": lambda: crank_rocker(5.0),
    "turning guide": turning_guide,
    "shoe over pivot": shoe_over_pivot,
    "plunger": plunger,
    "two cranks over each other's pivots": lambda: parallel_cranks(2, 0.06, 0.2),
}


@cache
def built(name: str) -> tuple[Mechanism, Poses, Solids]:
    """A case, or a gallery scene."""
    if name not in CASES:
        return shown(name)
    spec, poses = CASES[name]()
    return spec, poses, build_solids(spec, poses)


def nothing_collides_and_pins_reach_through(name: str) -> None:
    spec, poses, solids = built(name)
    check_shapes(solids, spec)
    assert solids.clashes == ()
    assert meeting_links(spec, poses, solids) == set()
    joined_links_lie_on_different_layers_and_one_pin_reaches_through_both(spec, poses, solids)


@pytest.mark.parametrize("name", CASES)
def test_parts_are_closed_nothing_collides_and_pins_reach_through_the_links_that_they_join(name):
    nothing_collides_and_pins_reach_through(name)


@pytest.mark.sample(12)
@pytest.mark.parametrize("name", COVERING)
def test_nothing_collides_in_a_scene_and_pins_reach_through_the_links_that_they_join(name):
    nothing_collides_and_pins_reach_through(name)


@pytest.mark.parametrize("name", ["loose-coupler-pin"])  # in the process that has run this scene
def test_a_bearing_with_clearance_is_bored_so_wide_that_its_journal_stays_inside(name):
    """The hole in the crank is wider than that of a tight pin, by as much as the journal of the rod leaves its axis."""
    _, poses, solids = built(name)
    crank, rod = (poses[link] for link in ("crank", "rod"))
    away = max(float(np.hypot(*(in_world((0.05, 0.0), c) - q[:2]))) for c, q in zip(crank, rod, strict=True))
    assert away > 0.4e-3
    tight, wide = (np.hypot(*(solids.links["crank"].mesh.vertices[:, :2] - centre).T).min() for centre in ((0.0, 0.0), (0.05, 0.0)))
    assert away < wide - tight < 1.15 * away, "the poses are some of those that the solids were built for"


def joined_links_lie_on_different_layers_and_one_pin_reaches_through_both(spec: Mechanism, poses: Poses, solids: Solids) -> None:
    points = {link.name: link.points for link in spec.links}
    start = {name: poses[name][0] if name != spec.frame else np.zeros(3) for name in solids.links}
    pins = [
        (in_world(part.bounds.mean(axis=0)[:2], start[solid.name]), part.bounds[:, 2])
        for solid in solids.links.values()
        for kind, part in zip(solid.kinds, solid.parts, strict=True)
        if kind == "pin"
    ]
    for joint in spec.joints:
        if not isinstance(joint, Revolute) or any(solids.links[link].spin for link in joint.links):  # a shaft in the plane
            continue
        spans = []
        for link, point in zip(joint.links, joint.points, strict=True):
            if link == spec.frame:
                continue
            solid, at = solids.links[link], points[link][point]
            kinds = ("plate", "block", "wheel")  # the plate first: a block of the same link may lie behind it
            flat = [p for kind in kinds for k, p in zip(solid.kinds, solid.parts, strict=True) if k == kind]
            if any(isinstance(other, Screw) and link == other.links[1] for other in spec.joints):  # its pin ends on the nut's face
                spans.append(np.repeat(flat[0].bounds[1, 2], 2))
                continue
            spans.append(next(p.bounds[:, 2] for p in flat if (p.bounds[0, :2] < at).all() and (at < p.bounds[1, :2]).all()))
        centre = in_world(points[joint.links[0]][joint.points[0]], start[joint.links[0]])
        here = [height for xy, height in pins if np.hypot(*(xy - centre)) < 1e-6 * solids.size]
        assert any(all(pin[0] <= low and high <= pin[1] for low, high in spans) for pin in here), joint.name
        if len(spans) == 2:
            assert spans[0][1] < spans[1][0] or spans[1][1] < spans[0][0], joint.name


def test_mechanisms_of_all_sizes_look_alike():
    reference = build_solids(*crank_rocker(1e-3))
    for scale in (1e-9, 1e-6, 1.0, 1e3):
        solids = build_solids(*crank_rocker(scale))
        assert solids.size == pytest.approx(reference.size * scale / 1e-3)
        for name, solid in solids.links.items():
            expected = reference.links[name]
            np.testing.assert_array_equal(solid.faces, expected.faces)
            np.testing.assert_allclose(solid.vertices / solids.size, expected.vertices / reference.size, atol=1e-6)


def test_the_same_mechanism_gives_the_same_arrays():
    for name in ("jansen-leg", "shaper-quick-return"):
        first, second = (build_solids(*moved(mechviz.load(name).mechanism)) for _ in range(2))
        for link, solid in first.links.items():
            np.testing.assert_array_equal(solid.vertices, second.links[link].vertices)
            np.testing.assert_array_equal(solid.faces, second.links[link].faces)
            assert solid.layer == second.links[link].layer


SIX = {f"p{k}": (0.1 * float(np.cos(k)), 0.07 * float(np.sin(2 * k))) for k in range(6)}
ODD = {
    "one point": {"A": (0.0, 0.0)},
    "coincident points": {"A": (0.0, 0.0), "B": (0.0, 0.0), "C": (0.1, 0.0)},
    "collinear": {"A": (0.0, 0.0), "B": (0.1, 0.0), "C": (0.25, 0.0), "D": (0.05, 0.0)},
    "nearly coincident": {"A": (0.0, 0.0), "B": (1e-7, 0.0), "C": (0.1, 0.0)},
    "six points": {"A": (0.02, 0.01), **SIX},
    "far from its origin": {"A": (10.0, 10.0), "B": (10.1, 10.0)},
}


@pytest.mark.parametrize("points", ODD.values(), ids=list(ODD))
def test_links_of_any_shape(points):
    spec = mechanism({"frame": {"A": (0.0, 0.0)}, "odd": points}, pin("A", "frame", "odd"))
    x, y = points["A"]
    angle = np.linspace(0.0, 1.0, 5)
    c, s = np.cos(angle), np.sin(angle)
    for poses in (None, {"odd": np.column_stack([-c * x + s * y, -s * x - c * y, angle])}):
        check_shapes(build_solids(spec, poses), spec)


def test_nothing_to_go_by_still_gives_solids():
    lone = mechanism({"frame": {}})
    still = mechanism({"frame": {"A": (0.0, 0.0)}, "dot": {"A": (0.0, 0.0)}}, pin("A", "frame", "dot"))
    lost = crank_rocker()[0]
    for spec, poses in (
        (lone, None),
        (still, None),
        (still, {"dot": np.zeros((3, 3))}),
        (lost, {link.name: np.full((4, 3), np.nan) for link in lost.links}),
        (lost, {}),
    ):
        solids = build_solids(spec, poses)
        assert solids.size > 0.0
        check_shapes(solids, spec)


def test_frames_that_could_not_be_assembled_are_left_out():
    spec, poses = crank_rocker()
    broken = {name: pose.copy() for name, pose in poses.items()}
    for pose in broken.values():
        pose[5:9] = np.nan
    solids = build_solids(spec, broken)
    assert np.isfinite(solids.bounds).all()
    assert solids.clashes == ()


@pytest.mark.parametrize("name", ["slider-crank-engine", "shaper-quick-return", "elliptic-trammel", "scotch-yoke"])
def test_rails_cover_the_travel_of_their_block(name):
    spec, poses, solids = built(name)
    frame = solids.links[spec.frame]
    rails = [p.bounds for k, p in zip(frame.kinds, frame.parts, strict=True) if k == "rail"]
    assert len(rails) == 2 * sum(isinstance(p, Prismatic) and spec.frame in p.links for p in spec.joints)
    for link in spec.links:
        solid = solids.links[link.name]
        if not any(isinstance(p, Prismatic) and {link.name, spec.frame} == set(p.links) for p in spec.joints):
            continue
        block = next(p for k, p in zip(solid.kinds, solid.parts, strict=True) if k == "block")
        for x, y, _ in poses[link.name]:
            low, high = block.bounds[:, :2] + (x, y)
            inside = [((b[0, :2] <= low) & (high <= b[1, :2])) for b in rails]
            assert sum(i.any() for i in inside) >= 2, "a block ran out of its rails"


def test_links_that_must_collide_are_reported():
    """Three cranks that sweep over each other's pivots: one bearing may stand in front, the middle one has no way out."""
    spec, poses = parallel_cranks(3, 0.06, 0.2)
    solids = build_solids(spec, poses)
    assert solids.clashes
    assert set(solids.clashes) == meeting_links(spec, poses, solids, every=1)


def test_the_order_of_layers_is_the_best_there_is():
    """Against trying all orders of small random problems."""
    rng = random.Random(7)
    for _ in range(60):
        n = rng.randint(2, 5)
        conflicts = [0] * n
        for a, b in itertools.combinations(range(n), 2):
            if rng.random() < 0.5:
                conflicts[a] |= 1 << b
                conflicts[b] |= 1 << a
        posts = []
        for _ in range(rng.randint(1, 4)):
            groups = tuple(rng.sample(range(n), rng.randint(1, 2)))
            others = sum(1 << g for g in range(n) if g not in groups and rng.random() < 0.4)
            posts.append(Post(groups, ground=len(groups) == 1, hits=others))

        def clashes(layers, conflicts=conflicts, posts=posts):
            joints = itertools.combinations(range(len(layers)), 2)
            same = sum(layers[a] == layers[b] and conflicts[a] >> b & 1 for a, b in joints)
            for post in posts:
                inside = [layers[g] for g in post.groups]
                hit = [layer for g, layer in enumerate(layers) if post.hits >> g & 1]
                same += sum(min(inside) < layer < max(inside) for layer in hit)
                if post.ground:
                    same += min(sum(layer < min(inside) for layer in hit), sum(layer > max(inside) for layer in hit))
            return same

        order = order_layers(conflicts, posts)
        best = min(clashes(layers) for layers in itertools.product(range(n), repeat=n))
        assert order.clashes == clashes(order.layers) == best


def test_stl_is_in_millimetres():
    _, _, solids = built("crank-rocker")
    for solid in solids.links.values():
        mesh = trimesh.load_mesh(io.BytesIO(stl_bytes(solid.mesh)), file_type="stl")
        np.testing.assert_allclose(mesh.bounds, 1000.0 * solid.mesh.bounds, rtol=1e-5, atol=1e-4)


def test_a_finer_tolerance_gives_rounder_circles():
    spec, poses = crank_rocker()
    coarse, fine = (build_solids(spec, poses, tolerance=t).links["crank"] for t in (0.02, 0.0005))
    assert len(fine.vertices) > 2 * len(coarse.vertices)
    assert fine.mesh.volume == pytest.approx(coarse.mesh.volume, rel=0.02)


def test_meshes_are_only_imported_when_asked_for():
    code = "import sys, mechviz; sys.exit(any(m in sys.modules for m in ('trimesh', 'shapely', 'mapbox_earcut')))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
