"""``mechviz solve``: tasks of the lectures that need no scene."""

from __future__ import annotations

import cmath
from typing import Annotated, Literal

import typer

from mechviz.commands.common import fail
from mechviz.commands.loading import clear_errors, quantity
from mechviz.scene.units import Units
from mechviz.studies.tasks import LinkTask, SwingTask, link_lines, swing_lines

UNITS = Units(length="m", angle="deg")
"""Of bare numbers; any may carry its own."""


def solve(
    task: Annotated[Literal["link", "swing"], typer.Argument(help="link: from two accelerations; swing: inertia from periods")],
    point: Annotated[
        list[str] | None,
        typer.Option("--point", metavar="NAME=X,Y", help="link: a point; accelerations are known of the first two"),
    ] = None,
    acceleration: Annotated[
        list[str] | None,
        typer.Option("--acceleration", metavar="NAME=SIZE@ANGLE|X,Y", help="link: of the first two points"),
    ] = None,
    mass: Annotated[str | None, typer.Option("--mass", help="its mass [kg]")] = None,
    inertia: Annotated[str | None, typer.Option("--inertia", help="link: its moment of inertia about S [kg m^2]")] = None,
    centre: Annotated[str, typer.Option("--centre", metavar="X,Y", help="link: its centre of mass S")] = "0,0",
    mass_at: Annotated[
        list[str] | None,
        typer.Option(
            "--mass-at", metavar="NAME|X,Y", help="link: a point mass that is to replace it; ? for a coordinate to be found"
        ),
    ] = None,
    period: Annotated[list[str] | None, typer.Option("--period", help="swing: to and fro [s]; twice for two axes")] = None,
    distance: Annotated[str | None, typer.Option("--distance", help="swing: of the centre of mass from the axis [m]")] = None,
    apart: Annotated[
        str | None, typer.Option("--apart", help="swing: distance of two axes [m], S on the line between them")
    ] = None,
    amplitude: Annotated[str, typer.Option("--amplitude", help="swing: from the lowest position [deg]")] = "0",
    gravity: Annotated[str, typer.Option("--gravity", help="swing: acceleration of gravity")] = "9.81 m/s^2",
) -> None:
    """Solve an inverse task of a lecture, without a scene. Bare numbers are in m, s, kg, m/s², degrees.

    link: angular velocity and acceleration of a link from the accelerations of two of its points, those of all others, its inertia
    force and moment as one force, and point masses that replace it. The worked task, S being the origin:

    mechviz solve link --point A=-0.5,0 --point B=0.366,-0.5 --acceleration A=20@50 --acceleration B=30@140
    --mass 10 --inertia 2 --mass-at A --mass-at B --mass-at ?,0.2

    swing: moment of inertia from the period about one axis, or about two, which tell the centre of mass too:

    mechviz solve swing --mass "1.5 kg" --distance "350 mm" --period 1.7544 --amplitude 10
    """
    with clear_errors(task):
        if task == "link":
            print("\n".join(link_lines(_link(point or [], acceleration or [], mass, inertia, centre, mass_at or []))))
            return
        if mass is None or not period:
            fail("a swing needs --mass and --period.")
        if (len(period) == 2) != (apart is not None) or (len(period) == 1) != (distance is not None) or len(period) > 2:
            fail("a swing needs one --period and --distance, or two --period and --apart.")
        found = SwingTask(
            mass=_value(mass, "mass", "mass"),
            periods=tuple(_value(text, "period", "time") for text in period),
            distance=None if distance is None else _value(distance, "distance", "length"),
            apart=None if apart is None else _value(apart, "apart", "length"),
            amplitude=_value(amplitude, "amplitude", "angle"),
            gravity=_value(gravity, "gravity", "gravity"),
        )
        print("\n".join(swing_lines(found)))


def _link(
    stated: list[str], accelerations: list[str], mass: str | None, inertia: str | None, centre: str, mass_at: list[str]
) -> LinkTask:
    points = dict(_named(text, "point", "length") for text in stated)
    known = dict(_named(text, "acceleration", "linear acceleration") for text in accelerations)
    first = list(points)[:2]
    if len(first) < 2 or set(known) != set(first):
        fail("a link needs two points and the accelerations of these: --point A=X,Y --point B=X,Y --acceleration A=... "
             "--acceleration B=...")  # fmt: skip
    if (mass is None) != (inertia is None) or (mass_at and mass is None):
        fail("inertia forces need --mass and --inertia; point masses need both.")
    masses: list[tuple[str, float | None, float | None]] = []
    for text in mass_at:
        if text in points:
            masses.append((text, points[text].real, points[text].imag))
        else:
            x, y = (None if part.strip() == "?" else _value(part, "mass-at", "length") for part in _two(text, "mass-at"))
            masses.append(("", x, y))
    return LinkTask(
        points=points,
        accelerations=(known[first[0]], known[first[1]]),
        centre=complex(*(_value(part, "centre", "length") for part in _two(centre, "centre"))),
        mass=None if mass is None else _value(mass, "mass", "mass"),
        inertia=None if inertia is None else _value(inertia, "inertia", "inertia"),
        masses=masses,
    )


def _named(text: str, option: str, kind: str) -> tuple[str, complex]:
    """``A=1,2`` or ``A=20@50``: a name and a plane vector."""
    name, equals, value = (part.strip() for part in text.partition("="))
    if not name or not equals:
        fail(f"--{option} {text}: a name is missing. Write it like A=1,2.")
    size, polar, angle = value.partition("@")
    if polar:
        return name, cmath.rect(_value(size, option, kind), _value(angle, option, "angle"))
    return name, complex(*(_value(part, option, kind) for part in _two(value, option)))


def _two(text: str, option: str) -> list[str]:
    parts = text.split(",")
    if len(parts) != 2:
        fail(f"--{option} {text}: two coordinates are wanted, such as 0.3,-0.1, or one of the points that are stated.")
    return parts


def _value(text: str, option: str, kind: str) -> float:
    return quantity(UNITS, text.strip(), option, kind)
