"""Studies requested in addition to motion, forces and metrics; `mechcore.constructions.studies` computes them."""

from __future__ import annotations

from collections.abc import Mapping

from mechcore.arrays import Vec2
from mechcore.records import dataclass

PointPlace = tuple[str, str]  # link, point

POLYGONS: Mapping[str, str] = {
    "velocity": "images of the points, joined by omega x r and sliding velocities",
    "acceleration": "centripetal, tangential, Coriolis and sliding parts",
    "force": "of every group, in the order of the hand method",
    "graph": "links as vertices, joints as edges, loops numbered",
}
"""Graphical constructions that a scene can request; see `mechcore.constructions`."""


@dataclass(frozen=True, kw_only=True)
class SystemStudy:
    """The loads on a link (all, or those named) as one force system, reduced to a point of the link (None: its origin)."""

    name: str
    link: str
    loads: tuple[str, ...] = ()  # none: all
    point: str | None = None
    pole: Vec2 | None = None  # of the funicular polygon, from the start of the force polygon [N]


@dataclass(frozen=True, kw_only=True)
class ShakingStudy:
    """Shaking force, and shaking moment about a point of the world; with ``radii`` [m] also with counterweights."""

    about: Vec2 = (0.0, 0.0)
    radii: tuple[float, float] | None = None  # from the fixed pivots of crank and rocker
    fraction: float = 1.0


@dataclass(frozen=True, kw_only=True)
class SubstituteStudy:
    """Substitute masses of a link: (mass [kg], x, y [m] in the link's frame) of each; None for a value to be determined."""

    link: str
    points: tuple[tuple[float | None, float | None, float | None], ...]
    solution: int = 1  # which of several is shown
    static: bool = False  # two masses at given places, with the body's mass and centre only, and a correction couple


@dataclass(frozen=True, kw_only=True)
class CrossSection:
    """A cross-section: its ``area`` A [m^2] and its section ``modulus`` W [m^3] about the axis normal to the plane of motion."""

    area: float
    modulus: float


@dataclass(frozen=True, kw_only=True)
class SectionStudy:
    """Section forces along a link. Its axis runs through the named ``points``; if there are none, through those of
    `mechcore.forces.section_lines.axis_points`.

    ``masses``: (mass [kg], x, y [m], moment of inertia [kg m^2]) of the parts of the link's mass with known positions; the rest
    is distributed along the axis.
    """

    link: str
    points: tuple[str, ...] = ()
    section: CrossSection | None = None
    masses: tuple[tuple[float, float, float, float], ...] = ()


@dataclass(frozen=True, kw_only=True)
class PenStudy:
    """A point of a link that draws: always, or while the coordinate of ``joint`` is at most, or at least, ``level`` [rad or m]."""

    name: str
    link: str
    point: str
    joint: str | None = None
    level: float = 0.0
    below: bool = True  # draws at or below the level; False: at or above it


@dataclass(frozen=True, kw_only=True)
class Studies:
    """Studies requested in addition to motion, forces and metrics; see `mechcore.constructions.studies`."""

    polygons: tuple[str, ...] = ()  # names from POLYGONS
    centrodes: tuple[str, ...] = ()  # links
    equivalent: tuple[str, ...] = ()  # joints
    systems: tuple[SystemStudy, ...] = ()
    reduced: tuple[tuple[str, str | None], ...] = ()  # (link, point or None)
    shaking: ShakingStudy | None = None
    substitutes: tuple[SubstituteStudy, ...] = ()
    sections: tuple[SectionStudy, ...] = ()
    instant_centres: tuple[str, ...] = ()  # links
    evolutes: tuple[PointPlace, ...] = ()
    inflection: tuple[str, ...] = ()  # links
    percussion: tuple[PointPlace, ...] = ()  # points about which their links turn
    inversion: tuple[str, ...] = ()  # cams
    pens: tuple[PenStudy, ...] = ()

    def items(self) -> tuple[tuple[str, str], ...]:
        """Name and meaning of each requested study."""
        asked = [("contour graph" if name == "graph" else f"{name} polygon", POLYGONS[name]) for name in self.polygons]
        asked += [(f"centrodes of {link}", "paths of the instant centre on the frame and on the link") for link in self.centrodes]
        asked += [
            (f"equivalent {joint}", "the linkage of lower pairs that moves like this higher pair") for joint in self.equivalent
        ]
        asked += [(f"system {s.name}", f"loads on {s.link} reduced, with their funicular polygon") for s in self.systems]
        asked += [
            (f"reduced to {link if point is None else f'{link}.{point}'}", "reduced mass and force of the whole mechanism")
            for link, point in self.reduced
        ]
        if self.shaking is not None:
            asked.append(("shaking", "shaking force and moment" + (", with counterweights" if self.shaking.radii else "")))
        asked += [(f"substitute masses {s.link}", "point masses with the same inertia forces") for s in self.substitutes]
        asked += [(f"section forces {s.link}", "normal force, shear force and bending moment") for s in self.sections]
        if self.instant_centres:
            asked.append(("instant centres", f"of {', '.join(self.instant_centres)}, with Kennedy's lines"))
        asked += [(f"evolute {link}.{point}", "centres of curvature of the path") for link, point in self.evolutes]
        asked += [
            (f"inflection circle {link}", "where paths have inflections; pole tangent by Bobillier") for link in self.inflection
        ]
        asked += [(f"percussion {a}.{b}", "centre of percussion and the line of the inertia resultant") for a, b in self.percussion]
        asked += [(f"pen {s.name}", f"what {s.link}.{s.point} draws") for s in self.pens]
        asked += [(f"inversion {joint}", "profile as the envelope of the follower") for joint in self.inversion]
        return tuple(asked)
