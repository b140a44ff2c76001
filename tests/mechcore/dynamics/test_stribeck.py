"""Friction that falls with the sliding speed (Stribeck): prescribed motions, stick-slip and decay against scipy, faults."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import mechviz
from mechcore.dynamics.simulate import simulate
from mechcore.forces.kinetostatics import solve_forces
from mechcore.motion.solve import compile_mechanism, solve_motion

BELT = """
units = { length = "mm", angle = "deg" }
effects = ["inertia", "gravity", "friction"]
RUN
[links]
frame = { points = { G = [0, 0], H = [-300, 0] } }
belt = { points = { P = [0, 0] }, mass = "1 kg", shape = "point" }
mass = { points = { P = [0, 0] }, mass = "2 kg", shape = "point" }
[joints]
belt = { prismatic = ["frame", "belt"], at = ["G", "P"], drive = { speed = "100 mm/s", travel = 1000 } }
S = { prismatic = ["belt", "mass"], at = "P", friction = { coefficient = 0.2, static = 0.35, stribeck = "60 mm/s" }, MOTION }
[loads]
spring = { spring = ["frame.H", "mass.P"], stiffness = "100 N/m", free_length = 300 }
damper = { damper = ["frame.H", "mass.P"], linear = "DAMPING N s/m" }
"""
NORMAL = 2.0 * 9.81


def curve(speed: Any, low: float = 0.2, high: float = 0.35, stribeck: float = 0.06) -> Any:
    return low + (high - low) * np.exp(-((speed / stribeck) ** 2))


@pytest.mark.parametrize("damping", [0.5, 3.0])
def test_stick_slip_on_a_belt(damping):
    """The limit cycle of a mass on a spring, against an integration of its own from event to event."""
    text = BELT.replace("RUN", 'run = { duration = "4 s", tolerance = 1e-10 }').replace("MOTION", "free = {}")
    run = simulate(mechviz.loads(text.replace("DAMPING", str(damping))).mechanism, 4.0, tolerance=1e-10)
    t, belt, end = np.linspace(0.0, 4.0, 801), 0.1, 4.0
    expected, events = np.zeros_like(t), []
    now, x, sticks = 0.0, 0.0, True
    while now < end - 1e-12:
        begin = now
        if sticks:
            now = min(begin + ((0.35 * NORMAL - damping * belt) / 100.0 - x) / belt, end)
            here = (t >= begin) & (t <= now)
            expected[here], x = x + belt * (t[here] - begin), x + belt * (now - begin)
        else:

            def faster(time, y, begin=begin):
                return y[1] - belt if time > begin + 1e-3 else -1.0

            faster.terminal, faster.direction = True, 1
            solution = solve_ivp(
                lambda _, y: [y[1], (-100.0 * y[0] - damping * y[1] + curve(y[1] - belt) * NORMAL) / 2.0],
                (begin, end), [x, belt], events=faster, method="DOP853", rtol=1e-12, atol=1e-13, dense_output=True,
            )  # fmt: skip
            now, x = float(solution.t[-1]), float(solution.y[0, -1])
            here = (t > begin) & (t <= now)
            expected[here] = solution.sol(t[here])[0]
        sticks = not sticks
        events += [now] if now < end else []
    assert run.motion(t).point("mass", "P")[:, 0] == pytest.approx(expected, abs=1e-10)
    told = [h.time for h in run.events if h.kind in ("stick", "slip") and h.time > 0.0]
    assert len(events) > 4 and told == pytest.approx(events, abs=1e-9)
    assert np.abs(run.drift(t)).max() < 1e-8
    loss = run.forces(run.view(t)).friction.losses("S")
    rate = run.view(t).coordinate("S")[:, 1]
    sliding = np.abs(rate) > 1e-6
    assert loss[sliding] == pytest.approx((curve(rate) * NORMAL * np.abs(rate))[sliding], rel=1e-8)


def test_a_prescribed_slide_pays_the_friction_of_its_speed():
    motion = 'drive = { oscillation = { amplitude = 20, frequency = "1 Hz", phase = 25 } }'
    text = BELT.replace("RUN", "").replace("MOTION", motion).replace("DAMPING", "3").replace('"100 mm/s"', '"1e-9 mm/s"')
    mechanism = mechviz.loads(text.replace("travel = 1000", "travel = 1e-9")).mechanism
    t = np.linspace(0.0, 1.0, 41)
    forces = solve_forces(solve_motion(compile_mechanism(mechanism), t))
    w, phase = 2.0 * np.pi, np.radians(25.0)
    x, v = 0.02 * np.sin(w * t + phase), 0.02 * w * np.cos(w * t + phase)
    expected = -2.0 * w * w * x + 100.0 * x + 3.0 * v + curve(v) * NORMAL * np.sign(v)
    assert forces.effort("S") == pytest.approx(expected, abs=1e-9)
    assert np.ptp(curve(v)) > 0.1
    assert np.abs(forces.power_balance).max() < 1e-12


def test_a_pin_slows_down_by_the_speed_of_its_surface():
    """A flywheel that runs down in a loaded bearing: the moment is mu(r w) r |R|, the reaction its weight."""
    text = """
    units = { length = "mm", angle = "deg" }
    effects = ["inertia", "gravity", "friction"]
    run = { duration = "7 s", tolerance = 1e-10 }
    [links]
    frame = { points = { A = [0, 0] } }
    wheel = { points = { A = [0, 0] }, mass = "30 kg", centre = "A", inertia = "0.4 kg m^2" }
    [joints.A]
    revolute = ["frame", "wheel"]
    free = { speed = "40 rpm" }
    friction = { coefficient = 0.05, static = 0.3, stribeck = "30 mm/s", radius = 20, EXACT }
    """
    for exact in (False, True):
        run = simulate(mechviz.loads(text.replace("EXACT", f"exact = {str(exact).lower()}")).mechanism, 7.0, tolerance=1e-10)
        t = np.linspace(0.0, 2.0, 41)

        def slower(_, y, exact=exact):
            mu = curve(0.02 * y[0], 0.05, 0.3, 0.03)
            return -(mu / np.sqrt(1.0 + mu * mu) if exact else mu) * 0.02 * 30.0 * 9.81 / 0.4

        expected = solve_ivp(slower, (0.0, 2.0), [4.0 * np.pi / 3.0], method="DOP853", rtol=1e-12, atol=1e-13, t_eval=t).y[0]
        assert run(t)[1][:, 0] == pytest.approx(expected, abs=1e-9)
        assert run.events[-1].kind == "stick" and run(7.0)[1][0, 0] == 0.0


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            "static = 0.35, ",
            "",
            "friction.stribeck: the curve falls from static to 0.2, and static is missing. Add static = 0.3",
        ),
        ("static = 0.35", "static = 0.2", "and static is no greater. Add static = 0.3, or leave stribeck out."),
        ('"60 mm/s"', '"60 mm"', "joints.S.friction.stribeck"),
        ('"60 mm/s"', "0", "joints.S.friction.stribeck: 0 is zero. Give a positive value."),
        (
            "coefficient = 0.2, static = 0.35, stribeck",
            "brake = 3, stribeck",
            "there is no coefficient of sliding to which the curve falls. Add",
        ),
    ],
)
def test_what_is_wrong_with_a_stribeck_speed_is_said(old, new, words):
    text = BELT.replace("RUN", 'run = { duration = "4 s" }').replace("MOTION", "free = {}").replace("DAMPING", "3")
    with pytest.raises(mechviz.SceneError) as error:
        mechviz.loads(text.replace(old, new))
    assert words in "\n".join(map(str, error.value.faults))


def test_wheels_have_no_stribeck_speed():
    text = """
    [links]
    frame = { points = { A = [0, 0] } }
    wheel = { points = { A = [0, 0] } }
    [joints]
    A = { rolling = ["frame", "wheel"], radius = 1, friction = { lever = 0.01, stribeck = 1 }, drive = { speed = 1, travel = 1 } }
    """
    with pytest.raises(mechviz.SceneError, match="stribeck does not go with the friction of a rolling joint"):
        mechviz.loads(text)
