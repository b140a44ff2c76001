"""Placement of springs for a given effort: a coil spring holds a lid on a hinge so that the force of the hand is a given one.

The lid turns about the origin, its centre of mass is at ``arm e^(i theta)``, the hand acts at a given distance, perpendicular to
the lid. The spring joins P of the frame to ``Q = q e^(i (theta + kappa))`` of the lid; its moment on the lid is
``k (1 - L0/L) Im(conj(Q) P)``. With a free length of zero and P above the hinge the balance would be exact; a real spring
approximates it.
"""

from __future__ import annotations

import numpy as np

from mechcore.arrays import Index, Real
from mechcore.errors import Fault, MechanismError
from mechcore.numerics.newton import fit_all
from mechcore.records import dataclass

EFFORT_ANGLES = 41  # angles at which the effort is compared
START_COUNT = 120  # random starts
SOLID_LENGTH, STRETCHED_LENGTH = 0.5, 1.8  # least and greatest length of a spring over its free length
LENGTH_WEIGHT = 100.0  # penalty of a length beyond these, relative to the moment of the weight
SAME_PLACEMENT = 0.2  # distance of two placements, relative to the box, below which they count as one
# Stiffness in units of the weight's moment over the square of the box; stiffer springs would be at the hinge itself
GREATEST_STIFFNESS = 10.0


@dataclass(frozen=True)
class LidTask:
    """Mass [kg], distances of its centre and of the hand from the hinge [m], first and last angle of the lid [rad].

    ``effort``: required force of the hand perpendicular to the lid [N], upwards positive; ``box``: largest coordinates of P and
    largest distance of Q from the hinge [m]; ``pushes``: a compression spring instead of an extension spring.
    """

    mass: float
    arm: float
    hand: float
    start: float
    end: float
    box: float
    effort: float = 0.0
    pushes: bool = False
    gravity: float = 9.80665

    def __post_init__(self) -> None:
        for name in ("mass", "arm", "hand", "box"):
            value = getattr(self, name)
            if not 0.0 < value < np.inf:
                raise MechanismError(Fault(name, f"{value:g} is not above zero.", "Give a value above zero."))
        if self.start == self.end:
            raise MechanismError(Fault("angles", "the lid does not turn.", "Give two angles that differ."))


@dataclass(frozen=True)
class LidSpring:
    """A spring: P in the frame [m], Q in the lid's frame [m], stiffness [N/m], free length [m]. ``error``: largest deviation of the
    effort [N]."""

    frame_point: complex
    lid_point: complex
    stiffness: float
    free_length: float
    error: float

    def effort(self, task: LidTask, theta: Real) -> Real:
        """Force of the hand (K,) [N] perpendicular to the lid at angles (K,) [rad]."""
        q = self.lid_point * np.exp(1j * theta)
        length = np.abs(self.frame_point - q)
        moment = self.stiffness * (1.0 - self.free_length / length) * np.imag(np.conj(q) * self.frame_point)
        return np.asarray((task.mass * task.gravity * task.arm * np.cos(theta) - moment) / task.hand)

    def lengths(self, theta: Real) -> Real:
        """Length of the spring (K,) [m] at angles of the lid (K,) [rad]."""
        return np.asarray(np.abs(self.frame_point - self.lid_point * np.exp(1j * theta)))


def lid_springs(task: LidTask, seed: int = 0) -> list[LidSpring]:
    """Springs whose effort is closest to the required one over the range in least squares, the best first; ``error`` [N] is their
    largest deviation. Many random starts are refined at once with exact derivatives. Raises MechanismError if none fits.

    Unknowns: P (2) and q over the box, kappa, k in units of the weight's moment over box^2, L0 over the box.
    """
    theta = np.linspace(task.start, task.end, EFFORT_ANGLES)
    weight = task.mass * task.gravity * task.arm
    wanted = np.cos(theta) - task.effort * task.hand / weight
    rng = np.random.default_rng(seed)
    low = np.array([-1.0, -1.0, 0.05, -np.pi, 0.0, 0.05])
    high = np.array([1.0, 1.0, 1.0, np.pi, GREATEST_STIFFNESS, 3.0])
    first = np.array([-1.0, -1.0, 0.2, -np.pi, 0.3, 0.2])
    starts = rng.uniform(first, np.array([1.0, 1.0, 1.0, np.pi, 8.0, 1.5]), (START_COUNT, 6))
    least, most = (SOLID_LENGTH, 1.0) if task.pushes else (1.0, STRETCHED_LENGTH)

    def evaluate(x: Real, _: Index) -> tuple[Real, Real]:
        p = (x[:, 0] + 1j * x[:, 1])[:, None]
        turned = np.exp(1j * (theta + x[:, 3, None]))
        q = x[:, 2, None] * turned
        k, free = x[:, 4, None], x[:, 5, None]
        arm = p - q
        length = np.maximum(np.abs(arm), 1e-9)
        lever, part = np.imag(np.conj(q) * p), 1.0 - free / length
        by = [  # derivatives of lever and length by P, q and kappa
            (-q.imag, arm.real / length),
            (q.real, arm.imag / length),
            (np.imag(np.conj(turned) * p), -np.real(np.conj(arm) * turned) / length),
            (np.imag(np.conj(1j * q) * p), -np.real(np.conj(arm) * 1j * q) / length),
        ]
        moments = np.stack([k * (part * dc + lever * free / length**2 * dl) for dc, dl in by], axis=-1)
        moments = np.concatenate([moments, (part * lever)[..., None], (-k * lever / length)[..., None]], axis=-1)
        slopes = np.stack([np.broadcast_to(dl, length.shape) for _, dl in by], axis=-1)
        slopes = np.concatenate([slopes, np.zeros((*length.shape, 2))], axis=-1)
        unit = np.zeros(6)
        unit[5] = 1.0
        short, long = least * free - length, length - most * free
        rows = [
            (k * part * lever - wanted, moments),
            (LENGTH_WEIGHT * np.maximum(short, 0.0), LENGTH_WEIGHT * (short > 0.0)[..., None] * (least * unit - slopes)),
            (LENGTH_WEIGHT * np.maximum(long, 0.0), LENGTH_WEIGHT * (long > 0.0)[..., None] * (slopes - most * unit)),
        ]
        return np.concatenate([r for r, _ in rows], axis=1), np.concatenate([j for _, j in rows], axis=1)

    fits = fit_all(evaluate, starts, low, high)
    springs: list[LidSpring] = []
    for row in fits.x[np.argsort(fits.cost, kind="stable")]:
        point = task.box * row[2] * np.exp(1j * row[3])
        made = LidSpring(
            complex(row[0], row[1]) * task.box, complex(point), float(row[4]) * weight / task.box**2, float(row[5]) * task.box, 0.0
        )
        lengths = made.lengths(theta) / made.free_length
        if lengths.min() < least - 1e-3 or lengths.max() > most + 1e-3 or made.stiffness <= 0.0:
            continue
        if any(
            max(abs(made.frame_point - o.frame_point), abs(made.lid_point - o.lid_point)) < SAME_PLACEMENT * task.box
            for o in springs
        ):
            continue
        error = float(np.abs(made.effort(task, theta) - task.effort).max())
        springs.append(LidSpring(made.frame_point, made.lid_point, made.stiffness, made.free_length, error))
    if not springs:
        raise MechanismError(Fault("box", f"no spring within {task.box:g} m of the hinge holds this lid.", "Give it more room."))
    return springs
