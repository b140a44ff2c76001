"""View model: the picture and the catalogue of a solved run or a recording, and the data that only the viewer needs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mechcore.arrays import Complex, Real, Single
from mechcore.motion.events import Event
from mechcore.records import dataclass
from mechviz.picture.nodes import Lines, Picture, Points
from mechviz.quantities.catalogue import Axis, Catalogue, Health, Quantity
from mechviz.quantities.numbers import Numbers
from mechviz.quantities.vectors import VECTOR_FAMILIES, Scales
from mechviz.scene.units import Units

if TYPE_CHECKING:
    from mechviz.outputs.drawings import Diagram
    from mechviz.picture.constructions import Drawing
    from mechviz.runs import Run


@dataclass(frozen=True, eq=False)
class ColoredPart:
    """A part of a solid of one colour: ``vertices`` (V, 3) float32 [m] in the link's frame, ``faces`` (N, 3) uint32."""

    vertices: Single
    faces: NDArray[np.uint32]
    color: tuple[int, int, int]


@dataclass(frozen=True, eq=False)
class LinkSolid:
    """The solid of a link, in pieces of one colour each."""

    pieces: tuple[ColoredPart, ...]
    whole: bool = False  # it turns about an axis in the plane of motion: sections leave it whole


@dataclass(frozen=True, eq=False)
class DriveCoordinate:
    """The coordinate ``position`` (F,) of a drive, or of a free coordinate, in the display ``unit``, shown with ``decimals``."""

    name: str
    sliding: bool
    position: Real
    unit: str
    decimals: int


@dataclass(frozen=True, eq=False)
class RollingCentrodes:
    """Centrodes of a link as complex numbers (F,) [m]: ``fixed`` in the world, ``moving`` in the link's frame; ``outline`` (n,) of
    the link in its frame."""

    fixed: Complex
    moving: Complex
    outline: Complex


@dataclass(frozen=True, eq=False)
class ViewModel:
    """Everything that is shown, of a run or of a recording."""

    title: str
    learning_goal: str
    picture: Picture
    bodies: Mapping[str, LinkSolid]  # by link; deformed to the new length while a length is dragged
    catalogue: Catalogue
    exact: bool = True  # the solids were built for this motion; False while a length is dragged
    events: tuple[Event, ...] = ()
    opens_at: int | None = None  # the frame to open at; None: that of the catalogue
    notes: str = ""  # what was computed and left out, as HTML
    run: Run | None = None  # None for a recording
    drawings: Callable[[], Mapping[str, Drawing]] = dict  # drawings beside the mechanism, by name; made on request
    charts: Callable[[], Sequence[Diagram]] = tuple  # diagrams of one quantity over another
    centrodes: Callable[[], Mapping[str, RollingCentrodes]] = dict  # by link

    @property
    def numbers(self) -> Numbers:
        return self.catalogue.numbers

    @property
    def time(self) -> Real:
        """Times of the frames (F,) [s]."""
        return self.picture.time

    @property
    def cycle(self) -> float:
        """Duration of a cycle [s]."""
        return self.numbers.cycle

    @property
    def frame(self) -> str:
        """The fixed link."""
        return self.picture.frame

    @property
    def poses(self) -> Mapping[str, Real]:
        """x, y, angle (F, 3) [m, m, rad] of all links."""
        return self.picture.poses

    @property
    def size(self) -> float:
        """Size of the mechanism [m]."""
        return self.picture.size

    @property
    def bounds(self) -> Real:
        """The box (2, 3) [m] around all solids over the run."""
        return self.picture.bounds

    @property
    def z_top(self) -> float:
        """The height z [m] above which there is no solid."""
        return self.picture.top

    @property
    def units(self) -> Units:
        """Display units."""
        return self.numbers.units

    @property
    def scales(self) -> Scales:
        return self.picture.scales

    @cached_property
    def drives(self) -> tuple[DriveCoordinate, ...]:
        ways = []
        for name in self.numbers.drives:
            slides = self.numbers.is_sliding(name)
            si = "m" if slides else "rad"
            unit, factor = self.units.display_unit(si)
            ways.append(DriveCoordinate(name, slides, factor * self.catalogue.coordinate(name), unit, self.units.decimals(si)))
        return tuple(ways)

    @cached_property
    def paths(self) -> Mapping[str, Real]:
        """Positions (F, 3) [m] of traced points by name, of those whose path has a position for every frame."""
        drawn = {node.owner[1]: np.asarray(node.strips[0][0], float) for node in self.picture.nodes_of(Lines, "paths")}
        return {name: places for name, places in drawn.items() if len(places) == self.frames}

    @cached_property
    def joints(self) -> Mapping[str, Real]:
        """Positions (F, 3) [m] of joints by name."""
        return {node.owner[1]: np.asarray(node.places[:, 0], float) for node in self.picture.nodes_of(Points, "joints")}

    @property
    def frames(self) -> int:
        return len(self.time)

    @property
    def families(self) -> frozenset[str]:
        """Families of arrows that the picture contains."""
        return frozenset(node.group for node in self.picture.nodes if node.group in VECTOR_FAMILIES)

    @property
    def opening(self) -> int:
        """The frame to open at."""
        return self.catalogue.opening_frame if self.opens_at is None else self.opens_at

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        return self.catalogue.quantities

    @property
    def axes(self) -> tuple[Axis, ...]:
        return self.catalogue.axes

    @property
    def first(self) -> tuple[Quantity, ...]:
        """Quantities that are plotted when the viewer opens."""
        return self.catalogue.initial_quantities

    @property
    def health(self) -> tuple[Health, ...]:
        return self.catalogue.health
