"""The rise laws of the literature by name, all normalised: 0 -> 1 over 0 -> 1."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from mechcore.errors import Fault, MechanismError
from mechcore.laws.curve import MotionCurve, Piece
from mechcore.records import dataclass

_NO_WAVES = np.zeros((0, 3))


def acceleration_zones(zones: Sequence[float]) -> MotionCurve:
    """Rise with seven zones of acceleration, given by their shares of the range (sum 1; a share of 0 leaves a zone out).

    1 quarter sine up from zero, 2 constant, 3 quarter cosine down to zero, 4 constant velocity, 5 quarter sine down, 6 constant
    deceleration, 7 quarter cosine back to zero. The two amplitudes follow from rest at both ends, the stroke is one.
    """
    share = np.asarray(zones, float)
    if share.shape != (7,) or not np.all(np.isfinite(share)) or np.any(share < 0.0) or abs(share.sum() - 1.0) > 1e-9:
        raise MechanismError(
            Fault("law.zones", f"shares {list(zones)} of the zones.", "Give seven shares, none negative, that add up to 1.")
        )
    share = share / share.sum()
    quarter = 2.0 / np.pi
    gain = np.array([quarter, 1.0, quarter])
    up, down = float(gain @ share[:3]), float(gain @ share[4:])
    if up <= 0.0 or down <= 0.0:
        raise MechanismError(
            Fault(
                "law.zones",
                f"shares {list(zones)}: no acceleration" if up <= 0.0 else f"shares {list(zones)}: no deceleration",
                "Give zones 1-3 and zones 5-7 some of the range.",
            )
        )
    sizes = (1.0 / up, 1.0 / up, 1.0 / up, 0.0, -1.0 / down, -1.0 / down, -1.0 / down)
    pieces = []
    for k, (length, a) in enumerate(zip(share, sizes, strict=True)):
        if length <= 0.0:
            continue
        w = 0.5 * np.pi / length
        if k in (0, 4):
            pieces.append(Piece(float(length), np.zeros(1), np.array([[w, a, 0.0]])))
        elif k in (2, 6):
            pieces.append(Piece(float(length), np.zeros(1), np.array([[w, 0.0, a]])))
        else:
            pieces.append(Piece(float(length), np.array([a]), _NO_WAVES))
    raw = MotionCurve(tuple(pieces)).integrated().integrated()
    return _at_rest_at_the_end(raw.scaled(0.0, 1.0, 0.0, 1.0 / raw.advance))


def _at_rest_at_the_end(curve: MotionCurve) -> MotionCurve:
    """The curve with an exact value at the end; the rounding error of the velocity there (about 1e-17) remains."""
    last = curve.pieces[-1]
    error = 1.0 - float(last.at(last.length, 0)[0])
    return MotionCurve((*curve.pieces[:-1], last.raised(error)), curve.start)


def scca(sine: float, constant: float, cosine: float) -> MotionCurve:
    """Sine-constant-cosine acceleration with Norton's shares b, c, d (b + c + d = 1) of the whole range.

    b is shared by the two sine ends, c by the two constant zones, d is the cosine middle. Members: (0, 1, 0) parabolic,
    (1/4, 1/2, 1/4) modified trapezoid, (1/4, 0, 3/4) modified sine, (0, 0, 1) simple harmonic, (1/2, 0, 1/2) cycloidal.
    """
    b, c, d = 0.5 * sine, 0.5 * constant, 0.5 * cosine
    return acceleration_zones((b, c, d, 0.0, d, c, b))


def harmonic_sum(linear: float, sines: Mapping[float, float], cosines: Mapping[float, float]) -> MotionCurve:
    """``linear x + sum a_k sin(pi k x) + sum b_k (1 - cos(pi k x))`` on 0 ... 1, by k."""
    keys = sorted({*sines, *cosines})
    waves = np.array([[np.pi * k, sines.get(k, 0.0), -cosines.get(k, 0.0)] for k in keys]).reshape(-1, 3)
    poly = np.array([sum(cosines.values()), linear])
    return MotionCurve((Piece(1.0, poly, waves),))


@dataclass(frozen=True)
class Rise:
    """An entry of the catalogue: how the law is made, its parameters with their defaults, one line about it."""

    make: Callable[..., MotionCurve]
    about: str
    parameters: dict[str, float]


def _poly(*coefficients: float) -> MotionCurve:
    return MotionCurve.of((0.0, 1.0), [coefficients])


def _share(value: float, name: str, law: str) -> float:
    if not 0.0 < value < 1.0:
        raise MechanismError(Fault(f"{law}.{name}", f"{value:g} is no share of the range.", "Give a number between 0 and 1."))
    return value


def _parabolic(skew: float) -> MotionCurve:
    x = _share(skew, "skew", "parabolic")
    return MotionCurve.of((0.0, x, 1.0), [(0.0, 0.0, 1.0 / x), (x, 2.0, -1.0 / (1.0 - x))])


def _trapezoidal_velocity(run_up: float, braking: float) -> MotionCurve:
    a, b = _share(run_up, "run_up", "trapezoidal-velocity"), _share(braking, "braking", "trapezoidal-velocity")
    if a + b > 1.0 + 1e-12:
        raise MechanismError(
            Fault(
                "trapezoidal-velocity",
                f"run_up {a:g} and braking {b:g} together exceed the range.",
                "Give shares that add up to less than 1.",
            )
        )
    return acceleration_zones((0.0, a, 0.0, max(1.0 - a - b, 0.0), 0.0, b, 0.0))


def _coasting(law: str, sine: float, constant: float, cosine: float) -> Callable[[float], MotionCurve]:
    """A rise with constant velocity over the share ``coast`` of its range; ``sine``, ``constant``, ``cosine``: shares of the zones
    at either end."""

    def make(coast: float) -> MotionCurve:
        end = 0.5 * (1.0 - _share(coast, "coast", law))
        a, b, c = sine * end, constant * end, cosine * end
        return acceleration_zones((a, b, c, coast, c, b, a))

    return make


def _trapezoidal(ramp: float) -> MotionCurve:
    a = _share(ramp, "ramp", "trapezoidal")
    if a > 0.25:
        raise MechanismError(Fault("trapezoidal.ramp", f"four ramps of {a:g} exceed the range.", "Give at most 0.25."))
    top = 1.0 / (0.5 * (0.5 - a))  # the velocity at the middle is 2 by symmetry
    rows = [
        (a, (0.0, top / a)),
        (0.5 - 2.0 * a, (top,)),
        (2.0 * a, (top, -top / a)),
        (0.5 - 2.0 * a, (-top,)),
        (a, (-top, top / a)),
    ]
    rows = [row for row in rows if row[0] > 0.0]
    knots = np.concatenate([[0.0], np.cumsum([length for length, _ in rows])])
    return _at_rest_at_the_end(MotionCurve.of(knots.tolist(), [poly for _, poly in rows]).integrated().integrated())


def _sine_squared() -> MotionCurve:
    waves = np.array([[4.0 * np.pi, 0.0, -4.0]])  # 8 sin^2(2 pi x) = 4 - 4 cos(4 pi x)
    halves = (Piece(0.5, np.array([4.0]), waves), Piece(0.5, np.array([-4.0]), -waves * (-1.0, 1.0, 1.0)))
    return _at_rest_at_the_end(MotionCurve(halves).integrated().integrated())


def three_harmonics(first: float, second: float) -> MotionCurve:
    """Acceleration ``A1 sin 2 pi x + A2 sin 4 pi x + A3 sin 6 pi x``; A3 follows from the stroke: A1 + A2/2 + A3/3 = 2 pi."""
    amplitudes = (first, second, 3.0 * (2.0 * np.pi - first - 0.5 * second))
    return harmonic_sum(1.0, {2 * k: -a / (2.0 * np.pi * k) ** 2 for k, a in enumerate(amplitudes, 1)}, {})


def _freudenstein_135() -> MotionCurve:
    m = 1125.0 / 1192.0 / (2.0 * np.pi)
    return harmonic_sum(1.0, {2: -m, 6: -m / 54.0, 10: -m / 1250.0}, {})


RISES: dict[str, Rise] = {
    "constant-velocity": Rise(lambda: _poly(0.0, 1.0), "s = x: velocity steps at both ends", {}),
    "parabolic": Rise(_parabolic, "constant acceleration, then deceleration; skew: share of the acceleration", {"skew": 0.5}),
    "constant-acceleration": Rise(
        lambda entry: _poly(0.0, entry, 1.0 - entry),
        "one acceleration throughout; entry: velocity at the start over the mean one (0: from rest, 2: to rest)",
        {"entry": 0.0},
    ),
    "harmonic": Rise(lambda: harmonic_sum(0.0, {}, {1: 0.5}), "simple harmonic, (1 - cos pi x)/2", {}),
    "double-harmonic": Rise(
        lambda: harmonic_sum(0.0, {}, {1: 0.5, 2: -0.125}), "acceleration zero at the start, steps at the end (rise-return)", {}
    ),
    "cosine-1-3": Rise(
        lambda: harmonic_sum(0.0, {}, {1: 9.0 / 16.0, 3: -1.0 / 16.0}),
        "cos pi x and cos 3 pi x, no acceleration at either end",
        {},
    ),
    "three-harmonics": Rise(
        three_harmonics,
        "acceleration of sin 2 pi x, sin 4 pi x, sin 6 pi x; first and second: two amplitudes, the third follows",
        {"first": 2.0 * np.pi, "second": 0.0},
    ),
    "triple-harmonic-modified-trapezoid": Rise(
        lambda: three_harmonics(6.04, 0.0), "triple harmonic of amplitudes 6.04, 0, 0.7296: close to the modified trapezoid", {}
    ),
    "triple-harmonic-modified-sine": Rise(
        lambda: three_harmonics(5.1968, 1.769),
        "triple harmonic of amplitudes 5.1968, 1.769, 0.6057: close to the modified sine",
        {},
    ),
    "triple-harmonic-zero-jerk": Rise(
        lambda: three_harmonics(2.25 * np.pi, 0.0),
        "triple harmonic 3 pi sin^3(2 pi x): no jerk at the ends and where the acceleration changes its sign",
        {},
    ),
    "cycloidal": Rise(lambda: harmonic_sum(1.0, {2: -0.5 / np.pi}, {}), "x - sin(2 pi x)/(2 pi)", {}),
    "modified-trapezoid": Rise(lambda: scca(0.25, 0.5, 0.25), "least peak acceleration with finite jerk among the common laws", {}),
    "modified-sine": Rise(lambda: scca(0.25, 0.0, 0.75), "low peak velocity and torque", {}),
    "modified-constant-velocity": Rise(
        _coasting("modified-constant-velocity", 0.25, 0.0, 0.75),
        "modified sine with constant velocity over the share coast (Neklutin; 0.5: MCV50)",
        {"coast": 0.5},
    ),
    "cycloidal-constant-velocity": Rise(
        _coasting("cycloidal-constant-velocity", 0.5, 0.0, 0.5),
        "cycloidal with constant velocity over the share coast",
        {"coast": 0.5},
    ),
    "modified-trapezoid-constant-velocity": Rise(
        _coasting("modified-trapezoid-constant-velocity", 0.25, 0.5, 0.25),
        "modified trapezoid with constant velocity over the share coast",
        {"coast": 0.5},
    ),
    "trapezoidal": Rise(
        _trapezoidal, "trapezoids of acceleration, each ramp over the share ramp (0.125: one eighth)", {"ramp": 0.125}
    ),
    "sine-squared": Rise(_sine_squared, "acceleration 8 sin^2(2 pi x): no jerk at the ends and in the middle", {}),
    "scca": Rise(
        scca, "sine-constant-cosine acceleration, shares b, c, d of the range", {"sine": 0.25, "constant": 0.5, "cosine": 0.25}
    ),
    "2-3": Rise(lambda: _poly(0, 0, 3, -2), "polynomial with the velocity zero at the ends, constant jerk (cubic)", {}),
    "3-4-5": Rise(lambda: _poly(0, 0, 0, 10, -15, 6), "polynomial with velocity and acceleration zero at the ends", {}),
    "3-4-5-6": Rise(
        lambda: _poly(0, 0, 0, 8, -12, 6, -1),
        "rise of a rise and return 64 (x^3 - 3 x^4 + 3 x^5 - x^6): acceleration steps at its end",
        {},
    ),
    "4-5-6-7": Rise(lambda: _poly(0, 0, 0, 0, 35, -84, 70, -20), "polynomial with jerk zero at the ends too", {}),
    "5-6-7-8-9": Rise(
        lambda: _poly(0, 0, 0, 0, 0, 126, -420, 540, -315, 70), "polynomial with the fourth derivative zero at the ends too", {}
    ),
    "gutman": Rise(
        lambda: harmonic_sum(1.0, {2: -15.0 / (32.0 * np.pi), 6: -1.0 / (96.0 * np.pi)}, {}),
        "Gutman 1-3 harmonic: first terms of the parabolic law's series",
        {},
    ),
    "freudenstein": Rise(
        lambda: harmonic_sum(1.0, {2: -27.0 / (56.0 * np.pi), 6: -1.0 / (168.0 * np.pi)}, {}), "Freudenstein 1-3 harmonic", {}
    ),
    "freudenstein-1-3-5": Rise(_freudenstein_135, "Freudenstein 1-3-5 harmonic", {}),
    "trapezoidal-velocity": Rise(
        _trapezoidal_velocity, "uniform run-up, constant velocity, uniform braking", {"run_up": 0.25, "braking": 0.25}
    ),
}

FORMER_NAMES = {"triple-harmonic": "cosine-1-3"}
"""Former names of laws, which stay valid. This one was renamed as the literature calls other laws triple harmonics."""


def rise(name: str, **parameters: float) -> MotionCurve:
    """A law of the catalogue, 0 -> 1 over 0 -> 1. Raises ``MechanismError`` for an unknown name or parameter."""
    entry = RISES.get(FORMER_NAMES.get(name, name))
    if entry is None:
        near = difflib.get_close_matches(name, RISES, 1, 0.5)
        hint = f"Did you mean '{near[0]}'?" if near else f"Known are {', '.join(RISES)}."
        raise MechanismError(Fault("law", f"'{name}' is no law of motion.", hint))
    for key in parameters:
        if key not in entry.parameters:
            known = ", ".join(entry.parameters) or "none"
            raise MechanismError(Fault(f"law.{key}", f"'{name}' has no parameter '{key}'.", f"Its parameters: {known}."))
    return entry.make(**{**entry.parameters, **parameters})
