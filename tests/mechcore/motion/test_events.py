"""Events of a motion against positions that geometry gives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mechanisms import four_bar

from mechcore.laws.program import CurveOverMaster, Segment, over_time, program
from mechcore.laws.timed import ConstantSpeed, Oscillation, zones
from mechcore.motion import events
from mechcore.motion.events import Event, find_events, strokes, turning_points
from mechcore.motion.metrics import ratio_units
from mechcore.motion.motion import Motion
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion
from mechcore.spec.mechanism import Drive, Link, Mechanism, PinSlot, Prismatic, Revolute

TURN = 2.0 * np.pi


def move(mechanism: Mechanism, frames: int = 90, cycles: float = 1.0) -> Motion:
    return solve_motion(compile_mechanism(mechanism), default_times(mechanism, frames, cycles))


def of(motion: Motion, item: str) -> list[Event]:
    return [e for e in find_events(motion) if e.item == item]


def test_turning_points_of_a_sine_are_found_to_fourth_order():
    errors = []
    for n in (20, 40):
        t = np.linspace(0.0, 2.0, n)
        dead_points = turning_points(t, np.cos(3 * t + 0.2), -3 * np.sin(3 * t + 0.2))
        errors.append(abs(dead_points - (np.array([0.5, 1.5]) * np.pi - 0.2) / 3))
    assert errors[1].max() < 1e-6
    assert np.log2(errors[0].max() / errors[1].max()) > 3.0


def test_no_turning_points_where_nothing_moves_or_after_a_rest():
    t = np.linspace(0.0, 1.0, 11)
    assert len(turning_points(t, np.zeros(11), np.zeros(11))) == 0
    assert len(turning_points(t, np.where(t < 0.35, 1.0, np.where(t > 0.65, -1.0, 0.0)), np.zeros(11))) == 0


@pytest.mark.parametrize("frames", [90, 360])
def test_dead_points_of_a_crank_rocker(frames):
    """The rocker turns back where crank and coupler lie in line: law of cosines in the triangles with sides b + a and b - a."""
    a, b, c, d = 0.06, 0.18, 0.15, 0.2
    motion = move(four_bar(E=(d, 0.0), AB=a, BD=b, DE=c, speed=2.0), frames)
    outer = np.arccos((d**2 + (b + a) ** 2 - c**2) / (2 * d * (b + a)))
    inner = np.pi + np.arccos((d**2 + (b - a) ** 2 - c**2) / (2 * d * (b - a)))
    times = sorted(e.time for e in of(motion, "E"))
    assert times == pytest.approx(sorted([outer / 2.0, inner / 2.0]), abs=1e-6)
    assert all("limit position" in e.text and e.level == "INFO" and "drive A at" in e.text for e in of(motion, "E"))


def slider_crank(law) -> Mechanism:
    return Mechanism(
        name="sc",
        frame="frame",
        links=(
            Link(name="frame", points={"A": (0, 0)}),
            Link(name="crank", points={"A": (0, 0), "B": (0.05, 0)}),
            Link(name="rod", points={"B": (0, 0), "C": (0.2, 0)}),
            Link(name="slider", points={"C": (0, 0)}),
        ),
        joints=(
            Revolute(name="A", links=("frame", "crank"), points=("A", "A")),
            Revolute(name="B", links=("crank", "rod"), points=("B", "B")),
            Revolute(name="C", links=("rod", "slider"), points=("C", "C")),
            Prismatic(name="S", links=("frame", "slider"), points=("A", "C"), along=(1.0, 0.0)),
        ),
        drives=(Drive(joint="A", law=law),),
        modes={"S": "ahead"},
    )


def test_zones_of_a_drive():
    law = zones(start=0.0, speed=2.0, run_up=0.5, steady=1.0, braking=0.25)
    motion = move(slider_crank(law), 100)
    computed = [(e.text.split(" at ")[0], e.time) for e in of(motion, "A")]
    assert [words for words, _ in computed] == [
        "drive starts",
        "zone boundary of the drive's law",
        "zone boundary of the drive's law",
        "drive stops",
    ]
    assert [t for _, t in computed] == pytest.approx([0.0, 0.5, 1.0, 1.25])


KNOCK, JERK = "the velocity jumps, infinite acceleration", "the acceleration jumps, infinite jerk"


@pytest.mark.parametrize("duration", [1.0, 1e-5])
@pytest.mark.parametrize("over", ["time", "a shaft"])
@pytest.mark.parametrize(
    ("name", "jump", "shares"),
    [
        ("constant-velocity", KNOCK, [0.25, 0.5, 0.75, 1.0]),
        ("parabolic", JERK, [0.125, 0.25, 0.5, 0.625, 0.75, 1.0]),
        ("harmonic", JERK, [0.25, 0.5, 0.75, 1.0]),
        ("3-4-5", "", []),
        ("modified-sine", "", []),
    ],
)
def test_jumps_of_a_drive_s_law_are_told_where_it_starts_and_stops_too(name, jump, shares, over, duration):
    """A rise, a dwell, a return, a dwell; the law's first jump of the second cycle is at its beginning. However short it is."""
    part = duration / 4.0
    curve = program([Segment(part, 0.5, name), Segment(part), Segment(part, 0.0, name), Segment(part)], repeats=over != "time")
    law = over_time(curve) if over == "time" else CurveOverMaster(curve, ConstantSpeed(0.0, 1.0))
    told = of(move(slider_crank(law), 160, 2), "A")
    jumps = [e for e in told if "jumps" in e.text]
    places = [e.time / duration for e in jumps if e.time <= duration * (1.0 + 1e-9)]
    assert all(e.text.endswith(jump) and e.level == ("WARN" if jump == KNOCK else "INFO") for e in jumps)
    assert places == pytest.approx(shares, abs=1e-9)
    assert any("drive stops at 28.65°" in e.text for e in told)


def test_a_drive_that_swings_reverses_and_its_reversals_are_no_limits_of_others():
    motion = move(slider_crank(Oscillation(1.0, 0.4, 2.0)), 200)
    reversals = [e for e in of(motion, "A") if "reverses" in e.text]
    assert [e.time for e in reversals] == pytest.approx([0.125, 0.375], abs=1e-6)
    assert not of(motion, "S"), "the slider turns back only because its drive does"


def test_limits_of_a_slider_are_named_with_their_side():
    motion = move(slider_crank(zones(start=0.3, speed=1.0, run_up=0.0, steady=2 * np.pi, braking=0.0)), 77)
    limits = {e.text.split(",")[0]: e for e in of(motion, "S")}
    assert limits["limit position: coordinate smallest"].time == pytest.approx(np.pi - 0.3, abs=1e-6)
    assert "150 mm" in limits["limit position: coordinate smallest"].text
    assert "250 mm" in limits["limit position: coordinate largest"].text


@pytest.mark.parametrize("turns", [1, 2])
@pytest.mark.parametrize("frames", [60, 77])
def test_a_limit_at_the_end_of_the_run_is_told_as_one_within(frames, turns):
    """A crank that starts at a dead point is there again after every turn."""
    motion = move(slider_crank(ConstantSpeed(0.0, 2.0)), frames, turns)
    limits = of(motion, "S")
    assert [e.time for e in limits] == pytest.approx(0.5 * np.pi * np.arange(1, 2 * turns + 1), abs=1e-8)
    assert ["largest" in e.text for e in limits] == [False, True] * turns
    assert not of(move(slider_crank(zones(start=0.3, speed=1.0, run_up=0.0, steady=np.pi - 0.5, braking=0.2)), 77), "S"), "it stops"


@pytest.mark.parametrize("frames", [100, 77])
def test_a_drive_starts_and_stops_where_its_law_says_so(frames):
    """A dwell of 0.3 s whose ends lie on no frame."""
    law = over_time(program([Segment(0.35, 1.0), Segment(0.3), Segment(0.35, 0.0)], repeats=False))
    told = {e.text.split(" at ")[0]: e.time for e in of(move(slider_crank(law), frames), "A")[1:-1]}
    assert told == {"drive stops": pytest.approx(0.35, abs=1e-7), "drive starts": pytest.approx(0.65, abs=1e-7)}


@pytest.mark.parametrize(("most", "told"), [(2, 6), (1, 2)])
def test_of_many_different_limits_the_outermost_are_told_with_their_number(most, told, monkeypatch):
    """Three turns have six limit positions, which are two different ones."""
    monkeypatch.setattr(events, "MOST_REPORTED", most)
    law = zones(start=0.3, speed=1.0, run_up=0.0, steady=6 * np.pi, braking=0.0)
    limits = of(move(slider_crank(law), 240), "S")
    assert len(limits) == told
    assert {round(e.value, 9) for e in limits} == {0.15, 0.25}
    assert all((" of 6, " in e.text) == (told == 2) for e in limits)


def test_near_singular_frames_warn():
    motion = move(four_bar(E=(0.2, 0.0), AB=0.06, BD=0.18, DE=0.15), 4)
    motion.__dict__["condition"] = np.array([1.0, 1e12, np.inf, 1.0, 3e9])  # as if the mechanism were singular there
    events = [e for e in find_events(motion) if e.level == "WARN"]
    assert [e.time for e in events] == [motion.time[1], motion.time[4]]
    assert "condition number inf" in events[0].text and "condition number 3.0e+09" in events[1].text


# -- between the frames -----------------------------------------------------------------------------------------------------
CRANK_ROCKER = {"a": 0.06, "b": 0.18, "c": 0.15, "d": 0.2}


def crank_rocker(start: float = 0.013, **more) -> Mechanism:
    g = CRANK_ROCKER
    m = four_bar(E=(g["d"], 0.0), AB=g["a"], BD=g["b"], DE=g["c"], start=start, speed=2.0, coupler_point=(0.09, 0.05))
    return replace(
        m, metrics=("transmission_angle", "velocity_ratio", "mechanical_advantage", "curvature"), traced=(("coupler", "P"),), **more
    )


@pytest.mark.parametrize("frames", [12, 37, 360])
def test_extremes_between_frames(frames):
    """Against geometry and against a search over single positions, far better than a millionth of the cycle."""
    from scipy.optimize import minimize_scalar

    from mechcore.motion import metrics as answers

    m = crank_rocker()
    motion = move(m, frames)
    compiled = compile_mechanism(m)
    events = find_events(motion)
    tiny = 1e-7 * motion.time[-1]

    def only(item: str, words: str) -> Event:
        (computed,) = (e for e in events if e.item == item and words in e.text)
        return computed

    def search(quantity, near: float) -> tuple[float, float]:
        computed = minimize_scalar(
            lambda t: -quantity(solve_motion(compiled, [t]))[0],
            bounds=(near - 0.05, near + 0.05),
            method="bounded",
            options={"xatol": 1e-11},
        )
        return float(computed.x), -float(computed.fun)

    g = CRANK_ROCKER
    worst = only("D", "worst transmission angle")  # crank and frame in line, the crank towards E
    assert worst.time == pytest.approx((TURN - 0.013) / 2.0, abs=tiny)
    exact = np.arccos((g["b"] ** 2 + g["c"] ** 2 - (g["d"] - g["a"]) ** 2) / (2 * g["b"] * g["c"]))
    assert worst.value == pytest.approx(exact, abs=1e-10)
    ratio = only("E", "largest velocity ratio")
    t, value = search(lambda x: np.abs(answers.velocity_ratios(x)["E"]), ratio.time)
    assert ratio.time == pytest.approx(t, abs=tiny) and abs(ratio.value) == pytest.approx(value, rel=1e-11)
    least = only("E", "smallest mechanical advantage")
    assert least.time == ratio.time and least.value == pytest.approx(1.0 / value, rel=1e-11)
    bend = only("coupler.P", "sharpest bend")
    t, value = search(lambda x: np.abs(answers.curvature(x, "coupler", "P")), bend.time)
    assert bend.time == pytest.approx(t, abs=tiny) and bend.value == pytest.approx(value, rel=1e-10)
    a, b, c, d = (g[k] for k in "abcd")
    outer = np.arccos((d**2 + (b + a) ** 2 - c**2) / (2 * d * (b + a)))
    inner = np.pi + np.arccos((d**2 + (b - a) ** 2 - c**2) / (2 * d * (b - a)))
    stops = sorted([(outer - 0.013) / 2.0, (inner - 0.013) / 2.0])
    for words in ("limit position", "toggle"):
        assert [e.time for e in events if e.item == "E" and words in e.text] == pytest.approx(stops, abs=tiny)
    swing = [e.value for e in events if e.item == "E" and "limit position" in e.text]
    at_limit = solve_motion(compiled, stops).coordinate("E")[:, 0]
    np.testing.assert_allclose(swing, at_limit, atol=1e-9)


@pytest.mark.parametrize("frames", [24, 90])
def test_toggles_while_the_drives_pivot_moves_too(frames):
    """A crank-rocker whose crank turns on a slide that swings: the ratio changes with both drives, so does the toggle's place."""
    g = CRANK_ROCKER
    moving = {"slide": {"A": 0.0}, "crank": {"A": 0.0, "B": g["a"]}, "coupler": {"B": 0.0, "D": g["b"]}}
    links = {"frame": {"F": 0.0, "E": g["d"]}, **moving, "rocker": {"E": 0.0, "D": g["c"]}}
    pins = {"A": ("slide", "crank"), "B": ("crank", "coupler"), "D": ("coupler", "rocker"), "E": ("frame", "rocker")}
    m = Mechanism(
        name="sliding crank-rocker",
        frame="frame",
        links=tuple(Link(name=k, points={p: (x, 0.0) for p, x in points.items()}) for k, points in links.items()),
        joints=(
            Prismatic(name="S", links=("frame", "slide"), points=("F", "A"), along=(1.0, 0.0)),
            *(Revolute(name=k, links=ends, points=(k, k)) for k, ends in pins.items()),
        ),
        drives=(Drive(joint="A", law=ConstantSpeed(0.013, 2.0)), Drive(joint="S", law=Oscillation(0.0, 0.02, 0.7))),
        modes={"D": "left"},
        metrics=("mechanical_advantage",),
    )
    motion = solve_motion(compile_mechanism(m), np.linspace(0.0, np.pi, frames + 1))
    times = np.array([e.time for e in find_events(motion) if "toggle" in e.text])
    at = motion.at_times(times)
    crank, base = at.pose("crank")[:, 2], at.coordinate("S")[:, 0]
    away = g["d"] - base  # where crank and coupler lie in line the rocker's pin is b +- a from the crank's
    far = [np.sqrt(away**2 + r**2 - 2.0 * away * r * np.cos(crank)) for r in (g["b"] + g["a"], g["a"] - g["b"])]
    assert len(times) == 2 and np.abs(np.array(far) - g["c"]).min(axis=0) == pytest.approx(0.0, abs=1e-12)


def test_extremes_in_time_do_not_depend_on_the_law():
    """A swinging drive meets the same worst angle at the same place of the drive."""
    swings = replace(crank_rocker(), drives=(Drive(joint="A", law=Oscillation(0.3, 0.8, 0.7)),))
    events = find_events(move(swings, 50))
    worst = next(e for e in events if "worst transmission" in e.text)
    assert float(swings.drives[0].law(worst.time)[0]) == pytest.approx(0.0, abs=1e-7)


def test_the_worst_transmission_angle_at_a_change_point():
    """Flat there: the angle is 0 or 180 degrees, and the instant is that of the change."""
    m = replace(four_bar(E=(0.3, 0.0), AB=0.1, BD=0.3, DE=0.1, start=0.5), metrics=("transmission_angle",))
    motion = move(m, 50)
    worst = next(e for e in find_events(motion) if "worst transmission" in e.text)
    assert worst.level == "WARN" and abs(np.cos(worst.value)) == pytest.approx(1.0, abs=1e-12)
    assert min(abs(worst.time - c.time) for c in motion.singular_points) < 1e-7 * motion.time[-1]


def test_the_velocity_ratio_at_a_dead_point_is_named_without_bound():
    m = four_bar(E=(0.3, 0.0), AB=0.22, BD=0.16, DE=0.21)
    limit = float(np.arccos((0.22**2 + 0.3**2 - 0.37**2) / (2 * 0.22 * 0.3)))
    m = replace(m, metrics=("velocity_ratio",), drives=(Drive(joint="A", law=Oscillation(0.0, limit, 0.25)),))
    motion = solve_motion(compile_mechanism(m), np.linspace(0.0, 2.0, 203))
    computed = next(e for e in find_events(motion) if e.item == "E" and "velocity ratio" in e.text)
    assert "without bound" in computed.text and computed.time == pytest.approx(1.0, abs=1e-6)


def test_a_time_ratio_is_that_of_one_limit_position_and_the_other():
    """A rocking crank that brings the slider to its outer end twice in a cycle: to and fro take equally long."""
    rocking = strokes(move(slider_crank(Oscillation(0.0, np.radians(40.0), 0.5)), 360))
    assert all(np.isnan(stroke.time_ratio) for stroke in rocking)
    (turning,) = strokes(move(four_bar(E=(0.2, 0.0), AB=0.06, BD=0.18, DE=0.15, speed=2.0), 360))
    outer = np.arccos((0.2**2 + 0.24**2 - 0.15**2) / (2 * 0.2 * 0.24))
    inner = np.pi + np.arccos((0.2**2 + 0.12**2 - 0.15**2) / (2 * 0.2 * 0.12))
    there = inner - outer
    assert turning.time_ratio == pytest.approx(max(there, TURN - there) / min(there, TURN - there), rel=1e-6)


@pytest.mark.parametrize("frames", [160, 153])
def test_toggles_are_where_the_output_rests_and_not_at_dead_points_of_the_drive(frames):
    """A rocker that drives to its limits and through them: there the ratio changes its sign without bounds, at a frame or not."""
    a, b, c, d = 0.22, 0.16, 0.21, 0.3
    limit = np.arccos((a**2 + d**2 - (b + c) ** 2) / (2 * a * d))
    m = four_bar(E=(d, 0.0), AB=a, BD=b, DE=c)
    m = replace(m, drives=(Drive(joint="A", law=Oscillation(0.0, limit, 0.25)),), metrics=("mechanical_advantage",))
    told = of(move(m, frames, 2), "E")
    toggles, limits = ([e.time for e in told if e.text.startswith(words)] for words in ("mechanical advantage", "limit position"))
    assert len(limits) == 4 and toggles == pytest.approx(limits, abs=1e-8)


@pytest.mark.parametrize("frames", [160, 153])
def test_a_joint_beside_the_group_at_its_dead_point_has_a_largest_ratio(frames):
    """A scotch yoke on the same rocker: its ratio a sin(angle) is largest where the rocker turns back, but bounded."""
    a, b, c, d = 0.22, 0.16, 0.21, 0.3
    limit = np.arccos((a**2 + d**2 - (b + c) ** 2) / (2 * a * d))
    m = four_bar(E=(d, 0.0), AB=a, BD=b, DE=c)
    yoke = (
        PinSlot(name="Q", links=("yoke", "crank"), points=("Q", "B"), along=(0.0, 1.0)),
        Prismatic(name="T", links=("frame", "yoke"), points=("A", "Q"), along=(1.0, 0.0)),
    )
    m = replace(
        m,
        links=(*m.links, Link(name="yoke", points={"Q": (0.0, 0.0)})),
        joints=(*m.joints, *yoke),
        drives=(Drive(joint="A", law=Oscillation(0.0, limit, 0.25)),),
        metrics=("velocity_ratio", "mechanical_advantage"),
    )
    motion = move(m, frames)
    (ratio,), (advantage,) = ([e.value for e in of(motion, "T") if words in e.text] for words in ("velocity ratio", "smallest"))
    assert abs(ratio) == pytest.approx(a * np.sin(limit), rel=1e-6) and advantage == pytest.approx(1.0 / abs(ratio))
    assert any("velocity ratio without bound" in e.text for e in of(motion, "E"))


def test_of_equal_extremes_the_first_is_told():
    told = [find_events(move(crank_rocker(), 97, cycles)) for cycles in (1, 3)]
    once, thrice = ([e.time for e in events if "of the run" in e.text] for events in told)
    assert len(once) >= 3 and thrice == pytest.approx(once, abs=1e-6)


def test_ratios_of_a_slide_to_a_crank_have_units():
    """Of a Scotch yoke: r metres a radian, and the force per torque."""
    a = 0.05
    m = Mechanism(
        name="yoke",
        frame="frame",
        links=(
            Link(name="frame", points={"O": (0.0, 0.0)}),
            Link(name="crank", points={"O": (0.0, 0.0), "A": (a, 0.0)}),
            Link(name="yoke", points={"Q": (0.0, 0.0)}),
        ),
        joints=(
            Revolute(name="O", links=("frame", "crank"), points=("O", "O")),
            Prismatic(name="S", links=("frame", "yoke"), points=("O", "Q"), along=(1.0, 0.0)),
            PinSlot(name="A", links=("yoke", "crank"), points=("Q", "A"), along=(0.0, 1.0)),
        ),
        drives=(Drive(joint="O", law=ConstantSpeed(0.1, 1.0)),),
        metrics=("velocity_ratio", "mechanical_advantage", "curvature"),
        traced=(("crank", "A"), ("yoke", "Q")),
    )
    events = find_events(move(m))
    said = [e.text for e in events]
    assert any("largest velocity ratio of the run, -0.05 m/rad" in text for text in said)
    assert any("smallest mechanical advantage of the run, 20 1/m" in text for text in said)
    assert any(text == "the path of yoke.Q is a straight line" for text in said)
    assert any("sharpest bend of the path of crank.A, radius 50 mm" in text for text in said)
    assert ratio_units(compile_mechanism(m).model, "O") == ("1", "1")
    other = replace(m, drives=(Drive(joint="S", law=Oscillation(0.0, 0.04, 1.0)),), modes={"A": "ahead"})
    assert ratio_units(compile_mechanism(other).model, "O") == ("rad/m", "m")
