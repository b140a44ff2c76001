"""The flywheel that evens out a machine's speed: its inertia from the excess work of the torque over a cycle.

A motor of constant torque drives a machine whose constant speed would need the torque T(phi); the flywheel takes up the
difference. J = (greatest - least excess work) / (delta omega^2), delta = (omega_max - omega_min) / omega_mean, as in any text on
the theory of machines (Wittenbauer's problem in its usual approximation, good for small delta).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mechcore.arrays import Real
from mechcore.effects.prescribed import breaks_of
from mechcore.errors import Fault, MechanismError
from mechcore.forces.kinetostatics import Forces
from mechcore.spec.loads import GasPressure, Load, Prescribed


@dataclass(frozen=True)
class Flywheel:
    """``inertia`` [kg m^2] for the stated ``fluctuation``; ``mean`` torque [N m], ``excess`` work [J], and the drive's positions
    [rad] at which the machine then runs fastest and slowest."""

    inertia: float
    fluctuation: float
    mean: float
    excess: float
    fastest: float
    slowest: float


def flywheel(forces: Forces, fluctuation: float, drive: str | None = None, *, smooth: bool | None = None) -> Flywheel:
    """The flywheel on a drive (the first, if not named) that turns at constant speed over one or more whole cycles.

    ``smooth``: the torque is a cubic spline through the frames, else straight lines (for torques that jump); not said: straight
    lines where gas presses on a piston or a table is not smooth. Raises `MechanismError` where the drive does not turn at constant
    speed or the fluctuation is not positive.
    """
    motion = forces.motion
    joints = [d.joint for d in motion.mechanism.drives]
    joint = joints[0] if drive is None else drive
    if joint not in joints:
        raise MechanismError(Fault("flywheel", f"joint '{joint}' has no drive.", f"Driven joints: {', '.join(joints)}."))
    if motion.model.joints[motion.model.joint_index[joint]].coordinate != "angle":
        raise MechanismError(Fault("flywheel", f"the drive of '{joint}' does not turn.", "A flywheel needs a shaft that turns."))
    position, speed, _ = motion.drives[joints.index(joint)]
    omega = float(speed[0])
    if omega == 0.0 or np.ptp(speed) > 1e-9 * abs(omega):
        raise MechanismError(
            Fault("flywheel", f"the drive of '{joint}' does not run at constant speed.", "Give it a constant speed.")
        )
    if smooth is None:
        smooth = not any(_jumps(load) for load in motion.mechanism.loads)
    return flywheel_of_torque(position, forces.effort(joint), omega, fluctuation, smooth=smooth)


def _jumps(load: Load) -> bool:
    """Whether a load may jump or have a kink."""
    factor = load.factor if isinstance(load, Prescribed) else None
    bent = factor is not None and not getattr(factor.function, "smooth", True)
    return isinstance(load, GasPressure) or bent or bool(breaks_of(factor))


def flywheel_of_torque(position: Real, torque: Real, omega: float, fluctuation: float, *, smooth: bool = True) -> Flywheel:
    """The same from positions (F,) [rad] over whole cycles and the torque (F,) [N m] that the machine needs there."""
    from scipy.interpolate import CubicSpline, PPoly, make_interp_spline

    if not fluctuation > 0.0:
        raise MechanismError(
            Fault("flywheel", f"a coefficient of fluctuation of {fluctuation:g}.", "Give a positive one, such as 0.02.")
        )
    sense = 1.0 if omega > 0.0 else -1.0
    x, y = sense * np.asarray(position, float), sense * np.asarray(torque, float)
    if len(x) < 3:
        raise MechanismError(Fault("flywheel", f"a torque at {len(x)} positions.", "Compute more frames."))
    if smooth:
        closed = abs(y[-1] - y[0]) <= 1e-6 * np.abs(y).max(initial=1e-300)
        if closed:
            y = np.append(y[:-1], y[0])
        curve: PPoly = CubicSpline(x, y, bc_type="periodic" if closed else "not-a-knot")
    else:
        line = make_interp_spline(x, y, k=1)
        curve = PPoly.from_spline((line.t, line.c, 1))
    work = curve.antiderivative()
    total = float(work(x[-1]) - work(x[0]))
    mean = total / (x[-1] - x[0])
    turning = curve.solve(mean, extrapolate=False)  # the excess is extreme where the torque is its mean
    places = np.concatenate([x, turning[np.isfinite(turning)]])  # the frames too: there the torque may jump past its mean
    excess = mean * (places - x[0]) - (work(places) - work(x[0]))  # what the motor has given more than was taken
    top, bottom = int(np.argmax(excess)), int(np.argmin(excess))
    span = float(excess[top] - excess[bottom])
    return Flywheel(
        inertia=span / (fluctuation * omega**2),
        fluctuation=fluctuation,
        mean=sense * mean,
        excess=span,
        fastest=sense * float(places[top]),
        slowest=sense * float(places[bottom]),
    )
