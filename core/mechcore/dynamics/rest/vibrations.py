"""Small vibrations about an equilibrium: the equations of motion M d'' + C d' + K d = 0 of small displacements d of the free
coordinates, their natural frequencies, damping ratios and modes.

M is the reduced inertia, K = -dQ/dq and C = -dQ/dq' of the reduced force Q at rest (inertia forces are of the second order in the
rates and contribute to neither). Modes solve K phi = w^2 M phi with phi' M phi = 1 (Rayleigh; any text on vibrations, such as
Meirovitch, Fundamentals of Vibrations, chapter 7). Where forces have no potential, K is not symmetric, and two w^2 may be a complex
pair: flutter (Ziegler, Principles of Structural Stability, chapter 5). With damping, exponents are eigenvalues of the state matrix.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from mechcore.arrays import Complex, Real
from mechcore.constants import TURN
from mechcore.dynamics.equations.reduced import coordinate_scales, reduce
from mechcore.dynamics.events import EndStop
from mechcore.dynamics.rest.equilibrium import DIFFERENCE_STEP, Equilibrium, Seek, find_equilibrium, force_at_rest
from mechcore.errors import Fault, MechanismError
from mechcore.laws.timed import Free
from mechcore.motion.compiled import Compiled
from mechcore.records import dataclass
from mechcore.spec.loads import Servo
from mechcore.spec.mechanism import Mechanism, joints_with_friction

NEUTRAL_STIFFNESS = 1e-9  # part of the largest stiffness: a mode with less is neutral
LEAST_GROWTH = 1e-7  # part of the fastest frequency: a growth rate, or the frequency of a growing mode, below it is rounding

Kind = Literal["vibration", "neutral", "flutter", "divergence"]


@dataclass(frozen=True, eq=False)
class Mode:
    """One mode of vibration.

    ``shape`` (f,): displacements of the free coordinates [rad or m, per sqrt(kg) m], phi' M phi = 1, the first of its largest parts
    positive; ``square``: square of the undamped natural angular frequency [1/s^2], negative where the stiffness is. Both are
    complex in the two modes of undamped flutter: their coordinates differ in phase, in the motion Re(shape exp(i w t)).
    ``eigenvalues``: the two exponents [1/s] of the damped motion that belong to it. ``kind`` follows from the exponents:
    "vibration", "neutral" (no stiffness: it stays where it is put), "flutter" (grows as it oscillates) or "divergence" (grows
    without).
    """

    shape: Real | Complex
    square: complex
    eigenvalues: tuple[complex, complex]
    kind: Kind

    @property
    def frequency(self) -> float:
        """Undamped frequency [Hz]; 0 of a neutral mode, NaN where the stiffness is negative."""
        root = np.sqrt(complex(self.square))
        return float(root.real) / TURN if self.square.imag or self.square.real >= 0 else float("nan")

    @property
    def damped_frequency(self) -> float:
        """Frequency of the damped motion [Hz]; 0 where it is aperiodic."""
        return abs(self.eigenvalues[0].imag) / TURN

    @property
    def damping_ratio(self) -> float:
        """Damping over critical damping: -(s1 + s2) / (2 sqrt(s1 s2)); above 1 the motion is aperiodic, below 0 it grows. NaN where
        s1 s2 is not positive or the mode is neutral."""
        a, b = self.eigenvalues
        product = (a * b).real
        return -(a + b).real / (2.0 * float(np.sqrt(product))) if self.square and product > 0 else float("nan")

    @property
    def growth(self) -> float:
        """Larger growth rate of the two exponents [1/s]; negative where the motion decays."""
        return max(e.real for e in self.eigenvalues)


@dataclass(frozen=True, eq=False)
class Vibrations:
    """Small vibrations of a mechanism about an equilibrium.

    ``inertia`` M, ``damping`` C, ``stiffness`` K (f, f) in the free coordinates; ``modes`` in the order of their frequencies, those
    of negative and of no stiffness first; ``notes``: what was left out or held, in words.
    """

    equilibrium: Equilibrium
    inertia: Real
    damping: Real
    stiffness: Real
    modes: tuple[Mode, ...]
    notes: tuple[str, ...] = ()

    @property
    def joints(self) -> tuple[str, ...]:
        return self.equilibrium.joints

    @property
    def shapes(self) -> Real:
        """The modes' shapes as columns (f, f): shapes' M shapes = 1 where the stiffness is symmetric."""
        return np.column_stack([m.shape for m in self.modes])

    @property
    def stability(self) -> str:
        """ "stable", "neutral" or "unstable": the response to a small disturbance."""
        kinds = {m.kind for m in self.modes}
        return "unstable" if kinds & {"flutter", "divergence"} else "neutral" if "neutral" in kinds else "stable"


def small_vibrations(mechanism: Mechanism | Compiled, *, seek: Seek = "stable", stops: Sequence[EndStop] = ()) -> Vibrations:
    """Small vibrations about the equilibrium that is reached from the start of the free coordinates.

    ``seek``, ``stops``: as of `find_equilibrium`. Prescribed drives and the time of loads are held at their start, and dry friction
    is left out; the notes list them. Raises `MechanismError` where there is no equilibrium, or a coordinate moves no mass.
    """
    equilibrium = find_equilibrium(mechanism, seek=seek, stops=stops)
    compiled, q = equilibrium.compiled, equilibrium.position
    if "inertia" not in compiled.mechanism.effects:
        raise MechanismError(Fault("effects", "vibrations need masses, and inertia is not named.", 'Add "inertia" to effects.'))
    inertia = reduce(compiled, q[None], np.zeros((1, len(q))), np.zeros(1)).inertia[0]
    scale = coordinate_scales(compiled)
    weighed = np.linalg.eigvalsh(inertia * scale[:, None] * scale)
    if not weighed[0] > 1e-14 * weighed[-1]:
        raise MechanismError(
            Fault(
                "links",
                "a free coordinate moves no mass: it has no frequency.",
                "Give a mass or inertia to the links that it moves.",
            )
        )
    damping = _damping(compiled, q)
    stiffness = equilibrium.stiffness
    skew = float(np.abs(stiffness - stiffness.T).max() / (np.abs(stiffness).max() or 1.0))
    notes = _notes(compiled)
    if skew <= 1e-8:
        stiffness = 0.5 * (stiffness + stiffness.T)
    else:
        notes.append(
            f"some forces have no potential (the stiffness is {skew:.2g} away from symmetric): modes need not be orthogonal, "
            "and two of them may flutter"
        )
    return Vibrations(equilibrium, inertia, damping, stiffness, _modes(inertia, damping, stiffness, scale), tuple(notes))


def _damping(compiled: Compiled, q: Real) -> Real:
    """C = -dQ/dq' at rest (f, f): central differences, extrapolated to a step of zero (a force like v |v| has a slope of zero).

    Raises `MechanismError` where a force jumps as the motion reverses.
    """
    scale, f = coordinate_scales(compiled), len(q)
    steps = DIFFERENCE_STEP * 0.5 ** np.arange(3)
    rates = np.concatenate([sign * h * np.diag(scale) for h in steps for sign in (1.0, -1.0)])
    force = force_at_rest(compiled, np.tile(q, (len(rates), 1)), rates, only="velocities").reshape(3, 2, f, f)
    c = -(force[:, 0] - force[:, 1]) / (2.0 * steps[:, None, None] * scale[:, None])
    if np.abs(c[2]).max() > 2.0 * np.abs(c[0]).max() and np.abs(c[2]).max() * steps[2] > 1e-9 * np.abs(force).max():
        raise MechanismError(
            Fault(
                "loads", "a force jumps as the motion turns round: nothing is linear there.", "Leave that load out, or smooth it."
            )
        )
    once = 2.0 * c[1:] - c[:-1]
    return np.asarray((4.0 * once[1] - once[0]) / 3.0).T


def _notes(compiled: Compiled) -> list[str]:
    mechanism = compiled.mechanism
    notes = []
    rubbing = joints_with_friction(mechanism.joints) if "friction" in mechanism.effects else ()
    if rubbing:
        notes.append(f"dry friction is left out (it holds around the equilibrium, nothing there is linear): {', '.join(rubbing)}")
    held = [d.joint for d in mechanism.drives if not isinstance(d.law, Free)]
    if held:
        notes.append(f"prescribed drives stand still at their start: {', '.join(held)}")
    timed = [load.name for load in mechanism.loads if getattr(getattr(load, "factor", None), "of", None) == "time"]
    if timed:
        notes.append(f"loads that change with time are taken as they are at the start: {', '.join(timed)}")
    servos = [load.name for load in mechanism.loads if isinstance(load, Servo)]
    if servos:
        notes.append(f"servos lead to where they do at the start, and integrate nothing: {', '.join(servos)}")
    return notes


def _modes(inertia: Real, damping: Real, stiffness: Real, scale: Real) -> tuple[Mode, ...]:
    """Modes from the equations x'' + c x' + k x = 0 in the modal coordinates x of the symmetric part of the stiffness."""
    from scipy.linalg import eig, eigh

    both = scale[:, None] * scale
    symmetric = 0.5 * (stiffness + stiffness.T)
    squares, basis = eigh(symmetric * both, inertia * both)
    k = np.diag(squares)
    left = right = np.eye(len(k))
    if not np.array_equal(symmetric, stiffness):
        k = k + basis.T @ ((stiffness - symmetric) * both) @ basis
        squares, left, right = eig(k, left=True)
    none = np.abs(squares) <= NEUTRAL_STIFFNESS * np.abs(squares).max(initial=0.0)
    for i in np.flatnonzero(none & (squares != 0)):
        k = k - (squares[i] * np.outer(right[:, i], left[:, i].conj()) / np.vdot(left[:, i], right[:, i])).real
    squares = np.where(none, 0.0, squares)
    roots = np.sqrt(squares + 0j)
    order = np.lexsort((squares.imag, np.where(squares.imag == 0, roots.real - roots.imag, roots.real)))  # growing modes first
    squares, right = squares[order], right[:, order]
    shapes = basis @ right
    largest = np.argmax(np.abs(shapes) > 0.999 * np.abs(shapes).max(axis=0), axis=0)  # the first of equal ones
    parts = shapes[largest, np.arange(len(squares))]
    shapes = shapes * (parts.conj() / np.abs(parts)) * scale[:, None]
    basis = basis * scale[:, None]
    fastest = float(np.abs(roots).max(initial=0.0)) or 1.0
    exponents = _exponents(squares, right, k, basis.T @ damping @ basis)
    made = []
    for square, shape, pair in zip(squares, shapes.T, exponents, strict=True):
        kind = _kind(square, pair, fastest)
        made.append(Mode(shape, complex(square), pair, kind) if square.imag else Mode(shape.real, float(square.real), pair, kind))
    return tuple(made)


def _kind(square: complex, exponents: tuple[complex, complex], fastest: float) -> Kind:
    growing = max(exponents, key=lambda s: s.real)
    creeping = abs(growing.imag) <= LEAST_GROWTH * fastest
    if growing.real > (0.0 if creeping and square else LEAST_GROWTH * fastest):  # aperiodic: a simple root, however small
        return "divergence" if creeping else "flutter"
    return "vibration" if square else "neutral"


def _exponents(squares: Complex | Real, modes: Complex | Real, k: Real, c: Real) -> list[tuple[complex, complex]]:
    """Two exponents for each of the ``modes`` (columns), from x'' + c x' + k x = 0. Each belongs to the mode in which it moves
    most."""
    f = len(k)
    own = np.zeros(f) if np.any(k - np.diag(np.diag(k))) else np.diag(c)
    if np.abs(c - np.diag(own)).max() <= 1e-11 * np.abs(c).max():
        return [_roots(own[i], squares[i]) for i in range(f)]
    from scipy.optimize import linear_sum_assignment

    values, vectors = np.linalg.eig(np.block([[np.zeros((f, f)), np.eye(f)], [-k, -c]]))
    share = np.abs(modes.conj().T @ vectors[:f]) ** 2
    share = share / np.maximum((np.abs(vectors[:f]) ** 2).sum(axis=0), 1e-300)
    vibrating = np.flatnonzero(values.imag > 0)
    creeping = np.flatnonzero(values.imag == 0)
    out: list[list[complex]] = [[] for _ in range(f)]
    for row, col in zip(*linear_sum_assignment(-share[:, vibrating].T), strict=True):
        value = complex(values[vibrating[row]])
        out[col] = [value, value.conjugate()]
    rest = [i for i in range(f) if not out[i] for _ in range(2)]
    if rest:
        for row, col in zip(*linear_sum_assignment(-share[rest][:, creeping]), strict=True):
            out[rest[row]].append(complex(values[creeping[col]]))
    return [(a, b) for a, b in out]


def _roots(c: float, k: complex) -> tuple[complex, complex]:
    """The two roots of s^2 + c s + k, the smaller real one without cancellation; for complex k, where c is 0, one root and its
    conjugate."""
    if k.imag:
        root = 1j * complex(np.sqrt(k))
        return root, root.conjugate()
    k = k.real
    inner = 0.25 * c * c - k
    if inner < 0.0:
        root = complex(-0.5 * c, float(np.sqrt(-inner)))
        return root, root.conjugate()
    far = -0.5 * c - float(np.copysign(np.sqrt(inner), c))
    return complex(far), complex(k / far if far else 0.0)
