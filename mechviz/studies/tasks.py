"""``mechviz solve``: textbook inverse problems of dynamics that need no scene, and their solutions as text."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field

from mechcore.records import dataclass
from mechcore.reduction.bodies import single_resultant
from mechcore.reduction.inverse import PlaneRates, inertia_from_swing, inertia_from_two_swings, rates_from_accelerations
from mechcore.reduction.substitute import PointMass, substitute_masses


@dataclass(frozen=True)
class LinkTask:
    """A link with known accelerations [m/s^2] of the first two of its ``points`` [m]; all are complex numbers x + i y.

    ``mass`` [kg] and moment of ``inertia`` [kg m^2] about the ``centre`` of mass [m]: given where inertia forces are to be found.
    ``masses``: substitute point masses as (name or "", x, y) [m]; a coordinate that is None is an unknown.
    """

    points: Mapping[str, complex]
    accelerations: tuple[complex, complex]
    centre: complex = 0j
    mass: float | None = None
    inertia: float | None = None
    masses: Sequence[tuple[str, float | None, float | None]] = field(default=())


def link_lines(task: LinkTask) -> list[str]:
    """Rates of a link from the accelerations of two of its points, as lines of text. Raises `MechanismError` where no rigid body
    has these accelerations."""
    (a, b), (of_a, of_b) = list(task.points.values())[:2], task.accelerations
    return list(_of_link(task, rates_from_accelerations(a, b, of_a, of_b)))


def _of_link(task: LinkTask, rates: PlaneRates) -> Iterator[str]:
    size = rates.omega_squared**0.5
    yield f"omega^2 = {rates.omega_squared:.6g} rad²/s²: omega = ±{size:.6g} rad/s"
    yield f"alpha = {rates.alpha:.6g} rad/s², counter-clockwise positive"
    for name, place in {**task.points, "S": task.centre}.items():
        yield f"a_{name} = {_vector(rates.at(place))} m/s², {abs(rates.at(place)):.6g} m/s²"
    yield "no point is without acceleration" if rates.pole is None else f"the point without acceleration: {_vector(rates.pole)} m"
    if task.mass is None or task.inertia is None:
        return
    force, moment = -task.mass * rates.at(task.centre), -task.inertia * rates.alpha
    yield f"inertia force {_vector(force)} N, {abs(force):.6g} N; inertia moment {moment:.6g} N m"
    at, far = single_resultant((force.real, force.imag), moment, (task.centre.real, task.centre.imag))
    if abs(force) > 0.0:
        yield f"both as one force: on the line through {_vector(complex(*at))} m, {float(far):.6g} m from S"
    yield from _point_masses(task, rates) if task.masses else ()


def _point_masses(task: LinkTask, rates: PlaneRates) -> Iterator[str]:
    assert task.mass is not None and task.inertia is not None
    s = task.centre
    places = [PointMass(None, None if x is None else x - s.real, None if y is None else y - s.imag) for _, x, y in task.masses]
    substitution = substitute_masses(task.mass, task.inertia, places)
    yield f"point masses instead: {substitution.message}"
    for number, (masses, from_s) in enumerate(substitution.solutions, 1):
        yield f"  {number}."
        for (name, _, _), m, xy in zip(task.masses, masses, from_s, strict=True):
            place = s + complex(*xy)
            force = -float(m) * rates.at(place)
            words = f"{m:.6g} kg at {f'{name} ' if name else ''}{_vector(place)} m: acceleration {_vector(rates.at(place))} m/s²"
            yield f"     {words}, inertia force {_vector(force)} N, {abs(force):.6g} N"


@dataclass(frozen=True)
class SwingTask:
    """A physical pendulum of a ``mass`` [kg] with one or two ``periods`` [s].

    One period: about an axis at a ``distance`` [m] from the centre of mass. Two periods: about two axes that are ``apart`` [m] from
    each other. ``amplitude`` of the swing [rad]; ``gravity`` [m/s^2].
    """

    mass: float
    periods: tuple[float, ...]
    distance: float | None = None
    apart: float | None = None
    amplitude: float = 0.0
    gravity: float = 9.81


def swing_lines(task: SwingTask) -> list[str]:
    """The moment of inertia of a physical pendulum, as lines of text. Raises `MechanismError` where no body has these periods."""
    if task.apart is None:
        assert task.distance is not None
        about, central = inertia_from_swing(task.mass, task.distance, task.periods[0], task.amplitude, task.gravity)
        lines = [f"moment of inertia about the axis {about:.6g} kg m²"]
    else:
        first, second = task.periods
        distance, central = inertia_from_two_swings(task.mass, task.apart, (first, second), task.amplitude, task.gravity)
        lines = [
            f"centre of mass {1e3 * distance:.6g} mm from the first axis, {1e3 * (task.apart - distance):.6g} mm from the second"
        ]
    return [
        *lines,
        f"moment of inertia about S {central:.6g} kg m², radius of gyration {1e3 * (central / task.mass) ** 0.5:.6g} mm",
    ]


def _vector(z: complex) -> str:
    return f"({z.real:.6g}, {z.imag:.6g})"
