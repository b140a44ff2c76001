"""Along the configuration curve: groups that are followed go through change points and dead points, on the stated branch."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from change_points import coupled, misses_by
from mechanisms import drawn, four_bar, pin, slider_crank
from scipy.optimize import root

from mechcore.dynamics.equations import curve
from mechcore.errors import MechanismError
from mechcore.laws.timed import ConstantSpeed, Law, Oscillation
from mechcore.motion.reach import reachable_ranges
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion
from mechcore.spec.mechanism import Drive, Gear, Link, Mechanism, Revolute

TURN = 2.0 * np.pi


def with_pinion(m: Mechanism, wheel: str, centre: tuple[float, float], sizes: tuple[int, int] = (20, 30)) -> Mechanism:
    """The mechanism with a pinion that meshes with one of its links, which the frame carries: that link's whole angle is needed."""
    frame = replace(m.links[0], points={**m.links[0].points, "W": centre})
    return replace(
        m,
        links=(frame, *m.links[1:], Link(name="pinion", points={"c": (0.0, 0.0)})),
        joints=(
            *m.joints,
            Revolute(name="W", links=("frame", "pinion"), points=("W", "c")),
            Gear(name="G", links=(wheel, "pinion"), carrier="frame", sizes=sizes),
        ),
    )


def geared_parallelogram(mode: str, sizes: tuple[int, int] = (20, 30)) -> Mechanism:
    return with_pinion(four_bar(E=(2.0, 0.0), AB=1.0, BD=2.0, DE=1.0, start=0.5, mode=mode), "rocker", (3.5, 0.0), sizes)


@pytest.mark.parametrize(
    ("mode", "ratio"), [("left", lambda t: np.ones_like(t)), ("right", lambda t: -3.0 / (5.0 - 4.0 * np.cos(t + 0.5)))]
)
def test_a_wheel_on_a_parallelogram_for_a_thousand_turns(mode, ratio):
    t = np.sort(np.concatenate([np.arange(1, 2001) * np.pi - 0.5, np.linspace(0.0, 1000 * TURN, 20_001)]))
    motion = solve_motion(compile_mechanism(geared_parallelogram(mode)), t)
    assert motion.closure.max() < 1e-12 * motion.model.length_scale
    np.testing.assert_allclose(motion.velocity("rocker")[:, 2], ratio(t), atol=1e-9)
    np.testing.assert_allclose(motion.velocity("pinion")[:, 2], -2.0 / 3.0 * ratio(t), atol=1e-9)
    sense = 1.0 if mode == "left" else -1.0
    way = motion.pose("pinion")[:, 2]
    assert way[-1] - way[0] == pytest.approx(-2.0 / 3.0 * sense * 1000 * TURN, rel=1e-9)
    assert len(motion.singular_points) == 2000 and not any(c.dead for c in motion.singular_points)
    np.testing.assert_allclose([c.time for c in motion.singular_points], np.arange(1, 2001) * np.pi - 0.5, atol=1e-8)


@pytest.mark.parametrize(
    ("modes", "ahead"),
    [
        (("left", "left"), 0.0),
        (("right", "left"), 0.0),
        (("right", "left"), 0.003),
        (("right", "right"), 0.4),
        (("left", "right"), 1.0),
    ],
)
def test_followed_groups_that_are_flat_at_one_instant(modes, ahead):
    """The same as without the gear, where the groups have closed forms."""
    plain = coupled(modes, (0.0, ahead, 0.0), 2.0)
    t = np.linspace(0.0, 2 * TURN, 721)
    a = solve_motion(compile_mechanism(plain), t)
    b = solve_motion(compile_mechanism(with_pinion(plain, "c2", (9.0, 0.0))), t)
    assert b.closure.max() < 1e-12
    assert len(a.singular_points) == len(b.singular_points) == 8
    for link in ("c1", "c2", "k1"):
        np.testing.assert_allclose(b.velocity(link), a.velocity(link), atol=1e-10)
        np.testing.assert_allclose(b.acceleration(link), a.acceleration(link), atol=1e-8)
        np.testing.assert_allclose(np.exp(1j * b.pose(link)[:, 2]), np.exp(1j * a.pose(link)[:, 2]), atol=1e-11)
    np.testing.assert_allclose(b.velocity("pinion")[:, 2], -2.0 / 3.0 * a.velocity("c2")[:, 2], atol=1e-9)


def simultaneous(
    start: float, sketch: dict[str, tuple[float, float, float]], drive: str = "C0", law: Law | None = None
) -> Mechanism:
    """Six-bar whose crank C0 moves the coupler of a parallelogram: five links are found at once, in a group of class IV."""
    links = (
        Link(name="frame", points={"A0": (0.0, 0.0), "B0": (3.0, 0.0), "C0": (1.9, 0.6)}),
        Link(name="r1", points={"A0": (0.0, 0.0), "A": (1.0, 0.0)}),
        Link(name="bar", points={"A": (0.0, 0.0), "B": (3.0, 0.0), "P": (1.5, 0.4)}),
        Link(name="r2", points={"B0": (0.0, 0.0), "B": (1.0, 0.0)}),
        Link(name="rod", points={"P": (0.0, 0.0), "C": (1.2, 0.0)}),
        Link(name="crank", points={"C0": (0.0, 0.0), "C": (1.3, 0.0)}),
    )
    joints = (
        pin("A0", "frame", "r1"),
        pin("A", "r1", "bar"),
        pin("B", "bar", "r2"),
        pin("B0", "frame", "r2"),
        pin("P", "bar", "rod"),
        pin("C", "rod", "crank"),
        pin("C0", "frame", "crank"),
    )
    drives = (Drive(joint=drive, law=law or ConstantSpeed(start, 1.0)),)
    return Mechanism(name="six-bar", frame="frame", links=links, joints=joints, drives=drives, sketch=sketch)


@pytest.mark.parametrize("mode", ["left", "right"])
def test_a_simultaneous_group_through_change_points_on_the_parallel_branch(mode):
    """There P moves on a circle about (1.5, 0.4): a four-bar with that rocker moves the same way, and it has no change points."""
    links = (
        Link(name="frame", points={"O": (1.5, 0.4), "C0": (1.9, 0.6)}),
        Link(name="crank", points={"C0": (0.0, 0.0), "C": (1.3, 0.0)}),
        Link(name="rod", points={"P": (0.0, 0.0), "C": (1.2, 0.0)}),
        Link(name="r", points={"O": (0.0, 0.0), "P": (1.0, 0.0)}),
    )
    joints = (pin("C0", "frame", "crank"), pin("C", "crank", "rod"), pin("P", "rod", "r"), pin("O", "frame", "r"))
    drives = (Drive(joint="C0", law=ConstantSpeed(0.7, 1.0)),)
    same = Mechanism(name="four-bar", frame="frame", links=links, joints=joints, drives=drives, modes={"P": mode})
    t = np.linspace(0.0, 3 * TURN, 1081)
    a = solve_motion(compile_mechanism(same), t)
    turn = a.pose("r")[0, 2]
    sketch = {
        "r1": (0.0, 0.0, turn),
        "bar": (np.cos(turn), np.sin(turn), 0.0),
        "r2": (3.0, 0.0, turn),
        "rod": tuple(a.pose("rod")[0]),
    }
    compiled = compile_mechanism(simultaneous(0.7, sketch))
    assert [b.kind for b in compiled.model.blocks] == ["general"]
    b = solve_motion(compiled, t)
    assert b.closure.max() < 1e-12
    assert len(b.singular_points) == 6, "r1 turns once for every turn of the crank"
    for link in ("r1", "r2"):
        np.testing.assert_allclose(b.pose(link)[:, 2], a.pose("r")[:, 2], atol=1e-10)
        np.testing.assert_allclose(b.velocity(link)[:, 2], a.velocity("r")[:, 2], atol=1e-10)
        np.testing.assert_allclose(b.acceleration(link)[:, 2], a.acceleration("r")[:, 2], atol=1e-8)
    np.testing.assert_allclose(b.velocity("bar")[:, 2], 0.0, atol=1e-10)
    exactly = solve_motion(compiled, [c.time for c in b.singular_points])  # frames on the change points themselves
    np.testing.assert_allclose(exactly.velocity("bar")[:, 2], 0.0, atol=1e-10)
    np.testing.assert_allclose(exactly.acceleration("bar")[:, 2], 0.0, atol=1e-8)


def test_a_simultaneous_group_through_a_change_point_on_the_crossed_branch():
    """The same positions as with the drive on the other side, where the groups have closed forms."""
    by_rocker = simultaneous(0.0, {}, "A0", ConstantSpeed(np.pi - 0.35, 1.0))
    t = np.linspace(0.0, 0.7, 141)
    checked = 0
    for word in ("left", "right"):
        modes = {"B": "right" if np.sin(np.pi - 0.35) > 0 else "left", "C": word}
        a = solve_motion(compile_mechanism(replace(by_rocker, modes=modes)), t)
        assert len(a.singular_points) == 1 and np.abs(a.velocity("bar")[:, 2]).min() > 0.1, "crossed"
        crank = a.coordinate("C0")
        if np.abs(crank[:, 1]).min() < 1e-2:
            continue
        sketch = {k: tuple(a.pose(k)[0]) for k in ("r1", "bar", "r2", "rod")}
        law = ConstantSpeed(float(crank[0, 0]), float(np.sign(crank[0, 1])))
        b = solve_motion(compile_mechanism(simultaneous(0.0, sketch, law=law)), t, drives={"C0": tuple(crank.T)})
        assert b.closure.max() < 1e-12
        for link in ("r1", "bar", "rod"):
            np.testing.assert_allclose(np.exp(1j * b.pose(link)[:, 2]), np.exp(1j * a.pose(link)[:, 2]), atol=1e-10)
            np.testing.assert_allclose(b.velocity(link)[:, 2], a.velocity(link)[:, 2], atol=1e-9)
            np.testing.assert_allclose(b.acceleration(link)[:, 2], a.acceleration(link)[:, 2], atol=1e-7)
        checked += 1
    assert checked


def driven_by_piston(law: Law, mode: str = "left") -> Mechanism:
    m = with_pinion(slider_crank(r=1.0, l=3.0), "crank", (0.0, -2.0))
    return replace(m, drives=(Drive(joint="S", law=law),), modes={"B": mode})


@pytest.mark.parametrize(("mode", "phase"), [("left", 0.0), ("right", 1.2)])
def test_a_followed_group_through_dead_points(mode, phase):
    t = np.linspace(0.0, 3.0, 541)
    motion = solve_motion(compile_mechanism(driven_by_piston(Oscillation(3.0, 1.0, 1.0, phase), mode)), t)
    angle = motion.pose("crank")[:, 2]
    assert abs(abs(angle[-1] - angle[0]) - 3 * TURN) < 1e-9
    assert (np.diff(angle) * np.sign(angle[-1] - angle[0]) > 0).all(), "always on in the same direction"
    np.testing.assert_allclose(motion.pose("pinion")[:, 2] - motion.pose("pinion")[0, 2], -(angle - angle[0]) * 2 / 3, atol=1e-9)
    np.testing.assert_allclose(motion.coordinate("S")[:, 0], np.cos(angle) + np.sqrt(9.0 - np.sin(angle) ** 2), atol=1e-12)
    assert motion.closure.max() < 1e-12
    assert [c.dead for c in motion.singular_points] == [True] * 6
    h = 1e-4
    compiled = compile_mechanism(motion.mechanism)
    low, high = (solve_motion(compiled, t + s * h) for s in (-1.0, 1.0))
    speed = motion.velocity("crank")[:, 2]
    np.testing.assert_allclose((high.pose("crank")[:, 2] - low.pose("crank")[:, 2]) / (2 * h), speed, atol=1e-4, rtol=1e-5)


@pytest.mark.parametrize("beyond", [1e-3, 1e-6, 1e-9])
@pytest.mark.parametrize("frames", [7, 500])
def test_beyond_a_dead_point_is_refused_also_between_frames(beyond, frames):
    law = Oscillation(3.0, 1.0 + beyond, 1.0)
    with pytest.raises(MechanismError, match="cannot be assembled for positions of drive S"):
        solve_motion(compile_mechanism(driven_by_piston(law)), np.linspace(0.0, 1.0, frames))


def test_short_of_a_dead_point_the_motion_turns_back():
    motion = solve_motion(compile_mechanism(driven_by_piston(Oscillation(3.0, 1.0 - 1e-3, 1.0))), np.linspace(0.0, 1.0, 361))
    assert not motion.singular_points
    angle = motion.pose("crank")[:, 2]
    assert abs(angle[-1] - angle[0]) < 1e-9 and np.ptp(angle) < np.pi


@pytest.mark.parametrize("margin", [1e-3, 1e-6, 1e-9])
def test_a_sliver_on_a_walk_is_refused(margin):
    m = with_pinion(misses_by(margin), "rocker", (4.0, 0.0))
    with pytest.raises(MechanismError, match="cannot be assembled for positions of drive A") as e:
        solve_motion(compile_mechanism(m), default_times(m, 90))
    end = np.degrees(np.arccos((10.0 - (4.0 - margin) ** 2) / 6.0))
    high = float(str(e.value).split("keep the drive within [")[1].split("]")[0].replace("°", "").split(",")[1])
    assert high == pytest.approx(end, abs=1e-2 * (180.0 - end) + 1e-4)
    free = with_pinion(misses_by(-margin), "rocker", (4.0, 0.0))
    assert solve_motion(compile_mechanism(free), default_times(free, 90)).closure.max() < 1e-12


STARTS = (("left", 0.0, 1.0), ("right", 0.0, -1.0), ("left", np.pi, -1.0), ("right", np.pi, 1.0))
BESIDE = (0.0, 1e-12, 1e-7, -1e-7, 1e-6, -1e-6, 1e-3, -1e-3, 0.02)


@pytest.mark.sample(6)
@pytest.mark.parametrize(  # each beside two of the starts
    ("mode", "at", "speed", "off"), [(*s, off) for k, off in enumerate(BESIDE) for j, s in enumerate(STARTS) if (j - k) % 4 < 2]
)
def test_a_walk_that_starts_on_a_change_point_or_beside_it_goes_the_stated_way(mode, at, speed, off):
    """A wheel on the rocker has its group followed; without one the same group is solved by its closed form."""
    base = four_bar(E=(2.0, 0.0), AB=1.0, BD=2.0, DE=1.0, start=at + off, mode=mode)
    base = replace(base, drives=(Drive(joint="A", law=ConstantSpeed(at + off, speed)),))
    t = np.linspace(0.0, 2.0 * TURN, 91)
    plain = solve_motion(compile_mechanism(base), t)
    geared = solve_motion(compile_mechanism(with_pinion(base, "rocker", (3.5, 0.0))), t)
    assert geared.closure.max() < 1e-13
    for computed in ("pose", "velocity", "acceleration"):
        want, got = (getattr(m, computed)("rocker") for m in (plain, geared))
        turns = (
            TURN * np.round((got[0, 2] - want[0, 2]) / TURN) if computed == "pose" else 0.0
        )  # -180 and 180 degrees are one start
        np.testing.assert_allclose(got - [0.0, 0.0, turns], want, rtol=0, atol=1e-6 if computed == "acceleration" else 1e-7)
    wheel = geared.pose("pinion")[:, 2] - geared.pose("pinion")[0, 2]
    np.testing.assert_allclose(wheel, -(geared.pose("rocker")[:, 2] - geared.pose("rocker")[0, 2]) * 2 / 3, atol=1e-9)


def test_a_walk_whose_start_leaves_the_way_open_is_refused():
    sketch = {"r1": (0.0, 0.0, 0.0), "bar": (1.0, 0.0, 0.0), "r2": (3.0, 0.0, 0.0), "rod": (2.5, 0.4, 1.0)}
    with pytest.raises(MechanismError, match="singular position"):
        at = 1.9 + 0.6j  # the crank's angle at which P is at (2.5, 0.4): cosine rule about C0
        way = 2.5 + 0.4j - at
        start = float(np.angle(way) + np.arccos((1.3**2 + abs(way) ** 2 - 1.2**2) / (2 * 1.3 * abs(way))))
        solve_motion(compile_mechanism(simultaneous(start, sketch)), np.linspace(0.0, 1.0, 11))


def test_a_path_is_followed_once(monkeypatch):
    """Frames that a path covers already cost no second one."""
    from mechcore.branches import paths

    compiled = compile_mechanism(geared_parallelogram("left"))
    solve_motion(compiled, np.linspace(0.0, 4 * TURN, 100))
    monkeypatch.setattr(paths, "continuation_path", None)
    solve_motion(compiled, np.linspace(0.1, 50 * TURN, 100))


def test_one_frame_of_a_followed_group():
    motion = solve_motion(compile_mechanism(geared_parallelogram("left")), [0.0])
    assert motion.closure.max() < 1e-14 and motion.pose("rocker")[0, 2] == pytest.approx(0.5)


@pytest.mark.parametrize("seed", range(6))
def test_a_wheel_on_a_rocker_that_comes_close_to_its_limit_keeps_its_turn(seed):
    """Next to a limit speeds have no bounds; the angle must not jump by a turn there."""
    rng = np.random.default_rng(seed)
    low, high = 0.0, TURN
    while high - low > TURN - 1e-6:
        a, b, c, d = rng.uniform(0.3, 1.5, 4)
        base = with_pinion(four_bar(E=(d, 0.0), AB=a, BD=b, DE=c, start=0.0), "rocker", (d + 2.0, 0.0))
        try:
            low, high = reachable_ranges(compile_mechanism(replace(base, drives=(Drive(joint="A", law=ConstantSpeed(1.0, 1.0)),))))[
                0
            ]
        except MechanismError:
            continue
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    m = replace(base, drives=(Drive(joint="A", law=Oscillation(middle, half * (1.0 - 1e-7), 1.0)),))
    t = np.linspace(0.0, 1.0, 401)
    motion = solve_motion(compile_mechanism(m), t)
    assert motion.closure.max() < 1e-12
    for link in ("rocker", "pinion"):
        assert np.abs(np.diff(motion.pose(link)[:, 2])).max() < 0.5


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_geared_crank_that_is_back_only_after_three_turns(side):
    """Two antiparallelograms, the second crank geared 2 : 3: their change points fall at other places in every turn."""
    first = coupled(("right",), (0.0, 0.0), 2.0)
    frame = replace(first.links[0], points={**first.links[0].points, "W": (-3.0, 0.0), "V": (-5.0, 0.0)})
    second = [
        Link(name="w", points={"A": (0.0, 0.0), "B": (1.0, 0.0)}),
        Link(name="bar", points={"B": (0.0, 0.0), "C": (2.0, 0.0)}),
        Link(name="v", points={"A": (0.0, 0.0), "C": (1.0, 0.0)}),
    ]
    pins = [("W", "frame", "w", "W", "A"), ("B", "w", "bar", "B", "B"), ("C", "bar", "v", "C", "C"), ("V", "frame", "v", "V", "A")]
    m = replace(
        first,
        links=(frame, *first.links[1:], *second),
        joints=(
            *first.joints,
            *(Revolute(name=n, links=(a, b), points=(p, q)) for n, a, b, p, q in pins),
            Gear(name="G", links=("c0", "w"), carrier="frame", sizes=(20, 30)),
        ),
        modes={**first.modes, "C": side},
        sketch={"w": (-3.0, 0.0, 0.5)},
    )
    t = np.linspace(0.0, 7 * TURN, 2001)
    motion = solve_motion(compile_mechanism(m), t)
    assert motion.closure.max() < 1e-12 * motion.model.length_scale
    w = motion.pose("w")[:, 2]
    np.testing.assert_allclose(motion.velocity("w")[:, 2], -2.0 / 3.0, rtol=1e-12)
    parallel = np.abs(motion.velocity("v")[0, 2] + 2.0 / 3.0) < 1e-9
    ratio = 1.0 if parallel else -3.0 / (5.0 - 4.0 * np.cos(w + np.pi))  # its frame points the other way
    np.testing.assert_allclose(motion.velocity("v")[:, 2], -2.0 / 3.0 * ratio * np.ones_like(t), atol=1e-9)
    np.testing.assert_allclose(motion.velocity("c1")[:, 2], -3.0 / (5.0 - 4.0 * np.cos(t + 0.5)), atol=1e-9)


def plate_on_three_rods() -> Mechanism:
    """A group of class III whose crank goes to a limit either way."""
    points = {"A": (0, 0), "B": (0.3, 0.1), "C": (1, 2), "D": (2.2, 1.9), "E": (1.5, 3.1), "G": (2.9, 0.2), "H": (3.3, 3.3)}
    links = {"crank": "AB", "plate": "CDE", "a": "BC", "b": "GD", "c": "HE"}
    return drawn(points, links, "AGH", drive="A", law=ConstantSpeed(0.0, 1.0))


def test_limits_of_a_followed_group_are_exact():
    """Against the distances of the rods' ends and their determinant, solved together for plate and crank."""
    m = plate_on_three_rods()
    compiled = compile_mechanism(m)
    (ends,) = reachable_ranges(compiled)
    at = {name: complex(*xy) for name, xy in (("B", (0.3, 0.1)), ("C", (1, 2)), ("D", (2.2, 1.9)), ("E", (1.5, 3.1)))}
    foot = {"D": 2.9 + 0.2j, "E": 3.3 + 3.3j}

    def equations(z):
        c, turn = complex(z[0], z[1]), np.exp(1j * z[2])
        rows, left = [], []
        for p, ref in (("C", at["B"] * np.exp(1j * z[3])), *foot.items()):
            arm = (at[p] - at["C"]) * turn
            d = c + arm - ref
            left.append(abs(d) - abs(at[p] - (at["B"] if p == "C" else ref)))
            rows.append([d.real, d.imag, (np.conj(d) * 1j * arm).real])
        return [*left, np.linalg.det(np.array(rows))]

    for end in ends:
        beside = end * (1.0 - 1e-4)
        near = solve_motion(compiled, [0.0], drives={"A": ([beside], [0.0], [0.0])})
        start = [*near.point("plate", "C")[0], near.pose("plate")[0, 2], beside]
        want = root(equations, start, tol=1e-14).x
        assert abs(np.array(equations(want))).max() < 1e-12
        assert end == pytest.approx(want[3], abs=1e-12)
    # up to the limits there is a motion, beyond them there is none
    close = np.array([ends[0] + 1e-10, ends[1] - 1e-10])
    assert solve_motion(compiled, [0.0, 1.0], drives={"A": (close, 0 * close, 0 * close)}).closure.max() < 1e-12
    for end, beyond in zip(ends, (-1e-8, 1e-8), strict=True):
        with pytest.raises(MechanismError, match="cannot be assembled for positions of drive A"):
            solve_motion(compiled, [0.0], drives={"A": ([end + beyond], [0.0], [0.0])})


def test_limits_of_closed_forms_that_are_followed_are_exact():
    """A wheel on the rocker has both its links followed: B and E are then as far apart as coupler and rocker are long."""
    m = with_pinion(four_bar(E=(1.0, 0.0), AB=0.9, BD=0.6, DE=0.7, start=0.4), "rocker", (1.0, 0.8))
    edge = np.arccos((0.81 + 1.0 - 1.69) / 1.8)
    (low, high), *_ = reachable_ranges(compile_mechanism(m))
    assert high == pytest.approx(edge, abs=1e-11) and low == pytest.approx(-edge, abs=1e-11)


def test_conditions_that_are_noise_do_not_gather_ever_more_positions(monkeypatch):
    """Next to a change point of many equal loops rounding decides all of them: a gallery scene so spoilt took 24 GB."""
    rng = np.random.default_rng(0)
    monkeypatch.setattr(curve, "_unit", lambda _, q: SimpleNamespace(condition=10.0 ** rng.uniform(2.0, 9.0, len(q))))
    monkeypatch.setattr(curve, "reached", lambda _, q: np.ones(len(q), bool))
    x = curve.beside_singular(None, np.linspace(-1.0, 1.0, 201))
    assert 201 < len(x) <= curve.MOST_TIMES * 201 and np.all(np.diff(x) > 0.0)
