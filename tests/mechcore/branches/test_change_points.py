"""Change points and dead points: the motion goes through on its branch, exactly, for as long as one likes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from change_points import coupled, misses_by
from comparison_columns import close, column
from mechanisms import case, four_bar, move, slider_crank

from mechcore.kinematics.positions import place_block
from mechcore.kinematics.singular_interpolation import NEAR_STEPS, smoothed
from mechcore.kinematics.state import initial_state
from mechcore.laws.timed import ConstantSpeed, Oscillation
from mechcore.motion.solve import compile_mechanism, solve_motion
from mechcore.spec.mechanism import Drive

TURN = 2.0 * np.pi


def parallelogram(mode: str, start: float = 0.5):
    return four_bar(E=(0.3, 0.0), AB=0.1, BD=0.3, DE=0.1, start=start, mode=mode)


def test_parallelogram_through_its_change_points_against_the_reference():
    c = case("linkages", "parallelogram-change-point")
    i, rows = c["inputs"], c["expected"]
    theta = column(rows, "theta_1")
    m = four_bar(E=(i["d"], 0.0), AB=i["r"], BD=i["d"], DE=i["r"], start=theta[0], mode="right", speed=i["omega_1"])
    motion = move(m, theta, i["omega_1"], i["eps_1"])
    scale = i["omega_1"] ** 2  # of angular accelerations, several of which are exactly 0 or 2 here
    close(motion.point("coupler", "D"), column(rows, "D"), 1e-13)
    close(motion.point("coupler", "D", 1), column(rows, "v_D"), 1e-11)
    for link, k in (("coupler", 2), ("rocker", 3)):
        assert np.abs(motion.velocity(link)[:, 2] - column(rows, f"omega_{k}")).max() < 1e-11 * i["omega_1"]
        assert np.abs(motion.acceleration(link)[:, 2] - column(rows, f"eps_{k}")).max() < 1e-10 * scale
    assert motion.closure.max() < 1e-13


def test_antiparallelogram_against_the_reference():
    c = case("linkages", "antiparallelogram")
    i, rows = c["inputs"], c["expected"]
    theta = column(rows, "theta_1")
    m = four_bar(E=(i["d"], 0.0), AB=i["r"], BD=i["d"], DE=i["r"], start=theta[0], mode="right", speed=i["omega_1"])
    motion = move(m, theta, i["omega_1"])
    close(motion.point("coupler", "D"), column(rows, "D"))
    close(motion.velocity("rocker")[:, 2], column(rows, "omega_3"))


@pytest.mark.parametrize(
    ("mode", "ratio"), [("left", lambda t: np.ones_like(t)), ("right", lambda t: (0.01 - 0.09) / (0.1 - 0.06 * np.cos(t)))]
)
def test_both_branches_for_a_thousand_turns(mode, ratio):
    """Rocker speed by the closed form of the branch, at every frame of 1,000 turns, the flat positions among them."""
    t = np.concatenate([np.arange(0, 2001) * np.pi - 0.5, np.linspace(0.0, 1000 * TURN, 30_001)])
    t = np.sort(t[t >= 0.0])
    motion = solve_motion(compile_mechanism(parallelogram(mode)), t)
    np.testing.assert_allclose(motion.velocity("rocker")[:, 2], ratio(t + 0.5), atol=1e-10)
    assert motion.closure.max() < 1e-12 * motion.model.length_scale
    assert len(motion.singular_points) == 2000
    assert not any(c.dead for c in motion.singular_points)
    np.testing.assert_allclose([c.time for c in motion.singular_points], np.arange(1, 2001) * np.pi - 0.5, atol=1e-9)


def test_kite_goes_through_where_its_pins_coincide():
    m = four_bar(E=(0.2, 0.0), AB=0.2, BD=0.3, DE=0.3, start=0.5)
    motion = solve_motion(compile_mechanism(m), np.linspace(0.0, 2 * TURN, 1441))
    assert motion.closure.max() < 1e-12
    assert np.abs(np.diff(motion.velocity("rocker")[:, 2])).max() < 0.02, "no kink"
    assert np.abs(motion.velocity("rocker")[-1] - motion.velocity("rocker")[0]).max() < 1e-9
    assert np.abs(motion.pose("rocker")[720, 2] - motion.pose("rocker")[0, 2]) > 1.0, "one turn of the crank is half its cycle"


def test_no_change_where_there_is_a_margin():
    """Grashof margins down to rounding: a true crank-rocker keeps its mode, and conditioning is reported honestly."""
    previous = 1.0
    for margin in 10.0 ** -np.arange(1, 15):
        # frame + crank = coupler + rocker - margin: never flat on the far side; rocker and coupler of different length
        m = four_bar(E=(3.0, 0.0), AB=1.0, BD=2.5, DE=1.5 + margin, start=0.3)
        compiled = compile_mechanism(m)
        assert not compiled.singular_points.points, margin
        motion = solve_motion(compiled, np.linspace(0.0, TURN, 73) - 0.3)
        side = np.imag(np.conj(motion.of_point(2, 2.5 + 0j) - motion.of_point(2, 0j)) * (3.0 - motion.of_point(2, 0j)))
        assert (side < 0).all(), "D stays on the left of B -> E"
        assert motion.closure.max() < 1e-12 * 3
        worst = motion.condition.max()
        assert worst > previous
        assert worst == pytest.approx(motion.condition[36], rel=1e-6) and 0.1 < worst * np.sqrt(margin) < 10.0
        previous = worst


def test_positions_near_a_flat_position_are_right_to_the_conditioning_limit():
    """Against 60-digit arithmetic: the error is at most a few rounding errors times the condition number."""
    from decimal import Decimal, getcontext

    getcontext().prec = 60
    for margin in (1e-1, 1e-4, 1e-8, 1e-12, 1e-14):
        rocker = 1.5 + margin
        m = four_bar(E=(3.0, 0.0), AB=1.0, BD=2.5, DE=rocker, start=np.pi)
        motion = move(m, [np.pi])
        b, e, r2, r3 = Decimal(-1), Decimal(3), Decimal("2.5"), Decimal(rocker)
        d = e - b
        along = (d * d + r2 * r2 - r3 * r3) / (2 * d)
        across = (r2 * r2 - along * along).sqrt()
        got = motion.point("coupler", "D")[0]
        error = max(abs(got[0] - float(b + along)), abs(got[1] - float(across)))
        assert error < 8e-16 * motion.condition[0] * 3.0, (margin, error, motion.condition[0])


@pytest.mark.parametrize("speed", [1.0, -2.0])
def test_piston_drives_the_crank_through_its_dead_points(speed):
    m = slider_crank(r=1.0, l=3.0)
    law = Oscillation(3.0, 1.0, abs(speed))  # reaches both limits, 2 and 4, exactly
    driven = replace(m, drives=(Drive(joint="S", law=law),), modes={"B": "left" if speed > 0 else "right"})
    motion = solve_motion(compile_mechanism(driven), np.linspace(0.0, 3.0 / abs(speed), 541))
    angle = motion.pose("crank")[:, 2]
    assert abs(abs(angle[-1] - angle[0]) - 3 * TURN) < 1e-9, "three strokes to and fro are three turns"
    assert (np.diff(angle) * np.sign(angle[-1] - angle[0]) > 0).all(), "always on in the same direction"
    assert motion.closure.max() < 1e-12
    assert [c.dead for c in motion.singular_points] == [True] * 6
    s = np.cos(angle) + np.sqrt(9.0 - np.sin(angle) ** 2)
    np.testing.assert_allclose(motion.coordinate("S")[:, 0], s, atol=1e-12)


def test_a_drive_that_would_go_beyond_its_dead_point_is_refused_with_the_range():
    m = slider_crank(r=1.0, l=3.0)
    beyond = replace(m, drives=(Drive(joint="S", law=Oscillation(3.0, 1.01, 1.0)),), modes={"B": "left"})
    with pytest.raises(Exception, match=r"keep the drive within \[2000 mm, 4000 mm\]"):
        solve_motion(compile_mechanism(beyond), np.linspace(0.0, 1.0, 361))


def test_starting_on_a_change_point_continues_on_the_stated_side():
    m = parallelogram("left", start=0.0)
    motion = solve_motion(compile_mechanism(m), np.linspace(0.0, 2 * TURN, 721))
    np.testing.assert_allclose(motion.velocity("rocker")[:, 2], 1.0, atol=1e-9)


def test_reversing_drive_comes_back_the_same_way():
    m = parallelogram("left")
    there = replace(m, drives=(Drive(joint="A", law=Oscillation(0.5, 4.0, 1.0)),))
    motion = solve_motion(compile_mechanism(there), np.linspace(0.0, 1.0, 721))
    np.testing.assert_allclose(motion.pose("rocker")[:, 2], motion.pose("crank")[:, 2], atol=1e-12)
    assert isinstance(m.drives[0].law, ConstantSpeed)


def test_double_rocker_goes_through_its_limits():
    """Driven exactly to the limit angle of the reference: dead points, the motion goes on to the other side and comes back."""
    limit = next(c for c in case("linkages", "fourbar-limits")["expected"] if c["AB"] == 0.22)["crank_angle_limit_stretched"]
    m = four_bar(E=(0.3, 0.0), AB=0.22, BD=0.16, DE=0.21)
    driven = replace(m, drives=(Drive(joint="A", law=Oscillation(0.0, limit, 0.25)),))
    motion = solve_motion(compile_mechanism(driven), np.linspace(0.0, 8.0, 1601))
    assert motion.closure.max() < 1e-12
    assert [c.dead for c in motion.singular_points] == [True] * 4
    np.testing.assert_allclose([c.time for c in motion.singular_points], [1.0, 3.0, 5.0, 7.0], atol=1e-6)
    speed = motion.velocity("rocker")[:, 2]
    assert np.abs(speed[180:220]).min() > 0.5, "the driven rocker swings on while the drive turns back"
    acceleration = motion.acceleration("rocker")[:, 2]
    by_difference = (speed[2:] - speed[:-2]) / (motion.time[2:] - motion.time[:-2])
    assert np.abs(by_difference - acceleration[1:-1])[150:250].max() < 1e-3, "without a kink"
    beyond = replace(m, drives=(Drive(joint="A", law=Oscillation(0.0, limit + 1e-3, 0.25)),))
    with pytest.raises(Exception, match="keep the drive within"):
        solve_motion(compile_mechanism(beyond), np.linspace(0.0, 8.0, 1601))


def chain(n: int):
    """The linkage of the IFToMM benchmark: n unit parallelograms in a row, all flat at the same instant."""
    from mechcore.spec.mechanism import Link, Mechanism, Revolute

    links = [Link(name="frame", points={f"A{i}": (float(i), 0.0) for i in range(n + 1)})]
    joints = []
    for i in range(n + 1):
        links.append(Link(name=f"v{i}", points={"A": (0.0, 0.0), "B": (0.0, 1.0)}))
        joints.append(Revolute(name=f"A{i}", links=("frame", f"v{i}"), points=(f"A{i}", "A")))
    for i in range(n):
        links.append(Link(name=f"h{i}", points={"L": (0.0, 0.0), "R": (1.0, 0.0)}))
        joints.append(Revolute(name=f"L{i}", links=(f"v{i}", f"h{i}"), points=("B", "L")))
        joints.append(Revolute(name=f"R{i}", links=(f"h{i}", f"v{i + 1}"), points=("R", "B")))
    sketch = {f"v{i}": (float(i), 0.0, 0.0) for i in range(n + 1)} | {f"h{i}": (float(i), 1.0, 0.0) for i in range(n)}
    drive = Drive(joint="A0", law=ConstantSpeed(0.0, 1.0))
    return Mechanism(name="chain", frame="frame", links=tuple(links), joints=tuple(joints), drives=(drive,), sketch=sketch)


@pytest.mark.parametrize(("n", "frames"), [(1, 721), (8, 721), (40, 145), (300, 9)])
def test_chain_of_parallelograms_through_its_singular_position(n, frames):
    """Every upright turns with the first, every coupler stays level, also at the frames where all of them lie flat."""
    motion = solve_motion(compile_mechanism(chain(n)), np.linspace(0.0, TURN, frames))
    assert {b.kind for b in motion.model.blocks} == {"theta_theta"} and len(motion.model.blocks) == n
    assert motion.closure.max() < 1e-12
    assert len(motion.singular_points) == 2 * n
    np.testing.assert_allclose(motion.velocity(f"v{n}")[:, 2], 1.0, atol=1e-10)
    np.testing.assert_allclose(motion.velocity(f"h{n - 1}")[:, 2], 0.0, atol=1e-10)
    np.testing.assert_allclose(motion.acceleration(f"v{n}")[:, 2], 0.0, atol=1e-8)


@pytest.mark.parametrize(
    ("modes", "turns", "frame"),
    [
        (("right", "left"), (0.0, 0.0, 0.0), 2.0),  # both at the same instant, the second up to nine times as fast
        (("right", "left"), (0.0, 0.7, 0.0), 2.0),
        (("right", "right"), (0.0, 0.01, 0.0), 2.0),  # almost at the same instant
        (("right", "left", "right"), (0.0, 0.0, 0.0, 0.0), 2.0),  # 27 times as fast
        (("right", "right"), (0.7, 0.0, 0.0), 1.3),
        (("left", "right"), (0.0, np.pi / 2, 0.0), 2.0),
    ],
)
def test_coupled_antiparallelograms(modes, turns, frame):
    """Speeds and accelerations by the closed form stage after stage, also where a group is singular next to another one."""
    t = np.unique(
        np.concatenate([np.linspace(0.0, 2 * TURN, 1441), np.arange(1, 4) * np.pi - 0.5, np.arange(1, 4) * np.pi - 0.501])
    )
    motion = solve_motion(compile_mechanism(coupled(modes, turns, frame)), t)
    assert motion.closure.max() < 1e-12 * motion.model.length_scale
    angle, speed, acceleration = t + 0.5, np.ones_like(t), np.zeros_like(t)
    for i in range(len(modes)):
        angle = angle + turns[i]
        got, w, a = (f(f"c{i + 1}")[:, 2] for f in (motion.pose, motion.velocity, motion.acceleration))
        on_parallel = np.abs(np.exp(1j * got[0]) - np.exp(1j * angle[0])) < 1e-6
        if not on_parallel:  # tan(out/2) = -(d + r)/(d - r) tan(in/2)
            below = frame**2 + 1.0 - 2.0 * frame * np.cos(angle)
            ratio = (1.0 - frame**2) / below
            bend = -(1.0 - frame**2) * 2.0 * frame * np.sin(angle) / below**2
            acceleration = bend * speed**2 + ratio * acceleration
            speed = ratio * speed
            whole = TURN * np.round(angle / TURN)
            angle = -whole - 2.0 * np.arctan((frame + 1.0) / (frame - 1.0) * np.tan(0.5 * (angle - whole)))
        np.testing.assert_allclose(np.exp(1j * got), np.exp(1j * angle), atol=1e-11)
        np.testing.assert_allclose(w, speed, atol=1e-9 * np.abs(speed).max())
        np.testing.assert_allclose(a, acceleration, atol=1e-8 * max(1.0, np.abs(acceleration).max()))
    assert motion.singular_points


def test_ten_thousand_turns_through_change_points_close_as_the_first():
    t = np.sort(np.concatenate([np.arange(1, 20_001) * np.pi - 0.5 + x for x in (0.0, 1e-3, 1e-6, 0.2)]))
    motion = solve_motion(compile_mechanism(coupled(("right",), (0.0, 0.0), 2.0)), t)
    assert motion.closure.max() < 1e-12
    np.testing.assert_allclose(motion.velocity("c1")[:, 2], -3.0 / (5.0 - 4.0 * np.cos(t + 0.5)), atol=1e-10)


# -- narrow ranges that cannot be assembled --------------------------------------------------------------------------------


@pytest.mark.parametrize("margin", [1e-3, 1e-5, 1e-7, 1e-9, 1e-11, 1e-12])
@pytest.mark.parametrize(
    "law", [None, ConstantSpeed(0.3, 1.0, travel=7.0), Oscillation(2.5, 1.5, 0.5)], ids=["turns", "goes", "swings"]
)
def test_a_sliver_between_frames_is_refused_with_its_range(margin, law):
    from mechcore.errors import MechanismError
    from mechcore.motion.solve import default_times

    m = misses_by(margin)
    m = m if law is None else replace(m, drives=(replace(m.drives[0], law=law),))
    with pytest.raises(MechanismError, match="cannot be assembled for positions of drive A") as e:
        solve_motion(compile_mechanism(m), default_times(m, 90))
    end = np.degrees(np.arccos((10.0 - (4.0 - margin) ** 2) / 6.0))
    low, high = (float(x) for x in str(e.value).split("keep the drive within [")[1].split("]")[0].replace("°", "").split(","))
    assert high == pytest.approx(end, abs=6e-5) and low == pytest.approx(-end, abs=6e-5)


@pytest.mark.parametrize("margin", [1e-3, 1e-7, 1e-11])
def test_next_to_a_sliver_all_is_well(margin):
    from mechcore.motion.solve import default_times

    m = misses_by(-margin)
    compiled = compile_mechanism(m)
    assert not compiled.singular_points.points and not compiled.singular_points.unreachable
    solve_motion(compiled, default_times(m, 7))
    short = replace(misses_by(margin), drives=(Drive(joint="A", law=Oscillation(1.5, 1.5, 1.0)),))
    motion = solve_motion(compile_mechanism(short), np.linspace(0.0, 1.0, 91))
    assert motion.closure.max() < 1e-12


def test_a_mechanism_that_turns_fully_is_not_looked_at_between_frames_again(monkeypatch):
    """What compiling has found once costs nothing per run."""
    from mechcore.branches import singular_points

    compiled = compile_mechanism(misses_by(-1e-3))
    monkeypatch.setattr(singular_points, "dead_point_margin", None)
    solve_motion(compiled, np.linspace(0.0, TURN, 8))


def test_samples_next_to_a_change_point_follow_those_beside_it():
    """A crank and a connecting rod of equal length: at a right angle the slider is at the pivot, and both modes meet."""
    compiled = compile_mechanism(slider_crank(r=1.0, l=1.0))
    model, (block,), (point, *_) = compiled.model, compiled.model.blocks, compiled.singular_points.points
    step, at = np.radians(0.5), point.time + np.radians(0.1)  # not on a sample
    time = point.time + step * np.arange(-60, 61)
    near = np.abs(time - at) < (NEAR_STEPS - 1.0) * step

    def sampled(beyond):
        """Positions that are wrong next to the change point and unknown beyond some distance from it."""
        state = initial_state(model, [time])
        place_block(model, block, state, compiled.assembly.modes[0] * compiled.singular_points.signs(0, time))
        solved = state.rot[model.angles.classes_of[block.angles[0]][0]], state.slide[block.slides[0]]
        for x in solved:
            x[near] = 7.0
            x[np.abs(time - at) > beyond] = np.nan
        return state, solved

    state, (rod, slide) = sampled(np.inf)
    found = smoothed(model, block, state, time, [at], step)
    found.into(model, block, state)
    assert found.tail < 1e-12
    np.testing.assert_allclose(rod, np.exp(-1j * time), atol=1e-12)
    np.testing.assert_allclose(slide, 2.0 * np.cos(time), atol=1e-12)
    state, _ = sampled(30.0 * step)
    assert smoothed(model, block, state, time, [at], step).tail < 1e-12
    assert smoothed(model, block, state, time, [at], 2.0 * step).tail == np.inf
    assert smoothed(model, block, state, time, [at], 4.0 * step) is None


@pytest.mark.parametrize("mode", ["left", "right"])
def test_kite_on_both_branches_for_a_thousand_turns(mode):
    """Frame and crank 2, the others 3: D lies on the line of symmetry through A, at half the crank's angle."""
    m = four_bar(E=(2.0, 0.0), AB=2.0, BD=3.0, DE=3.0, start=0.5, mode=mode)
    t = np.sort(np.concatenate([np.linspace(0.0, 1000 * TURN, 20_001), np.arange(1, 1001) * TURN - 0.5]))
    motion = solve_motion(compile_mechanism(m), t)
    half = 0.5 * (t + 0.5)
    far = 1.0 if motion.point("coupler", "D")[0] @ [np.cos(half[0]), np.sin(half[0])] > 0 else -1.0
    assert far == (1.0 if mode == "left" else -1.0)
    along = 2.0 * np.cos(half) + far * np.sqrt(9.0 - 4.0 * np.sin(half) ** 2)
    d = along * np.exp(1j * half)
    np.testing.assert_allclose(motion.point("coupler", "D"), np.stack([d.real, d.imag], axis=-1), atol=1e-9)
    assert motion.closure.max() < 1e-12 * motion.model.length_scale
    assert len(motion.singular_points) == 1000


@pytest.mark.parametrize(("scale", "shift"), [(1e-6, 0.0), (1e3, 0.0), (1.0, 1e4), (1e-3, 0.0)])
@pytest.mark.parametrize("mode", ["left", "right"])
def test_change_points_at_every_scale_and_far_from_the_origin(scale, shift, mode):
    t = np.linspace(0.0, 2 * TURN, 361)
    base = solve_motion(compile_mechanism(parallelogram(mode)), t)
    m = parallelogram(mode)
    links = tuple(
        replace(k, points={n: (scale * x + (k.name == "frame") * shift, scale * y - (k.name == "frame") * shift)
                           for n, (x, y) in k.points.items()}) for k in m.links
    )  # fmt: skip
    motion = solve_motion(compile_mechanism(replace(m, links=links)), t)
    assert len(motion.singular_points) == 4
    tolerance = 1e-8 if shift else 1e-11  # 10 km away a micrometre has nine digits left
    np.testing.assert_allclose(motion.velocity("rocker")[:, 2], base.velocity("rocker")[:, 2], atol=tolerance)
    np.testing.assert_allclose(
        motion.point("coupler", "D") - [shift, -shift], scale * base.point("coupler", "D"), atol=tolerance * scale
    )


def test_a_single_frame_on_a_change_point_whose_nodes_run_over_another_one():
    """The neighbour's change is not near any frame, yet the interpolation must not use its ill-conditioned positions."""
    compiled = compile_mechanism(coupled(("right", "right"), (0.0, 0.1, 0.0), 2.0))
    dense = solve_motion(compiled, np.linspace(0.0, TURN, 1441))
    for change in dense.singular_points:
        alone = solve_motion(compiled, [change.time])
        around = solve_motion(compiled, change.time + np.linspace(-0.3, 0.3, 241))
        assert alone.closure.max() < 1e-12
        for link in ("c1", "c2"):
            np.testing.assert_allclose(alone.velocity(link)[0, 2], around.velocity(link)[120, 2], atol=1e-10)
            np.testing.assert_allclose(alone.acceleration(link)[0, 2], around.acceleration(link)[120, 2], atol=1e-8)
