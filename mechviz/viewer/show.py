"""What the viewer shows, as plain data over all frames: made from a solved run, or read from a recording."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..vectors import Scales
from .quantities import Axis, Quantity

if TYPE_CHECKING:
    from ..coils import Coil
    from ..drawings import Drawing, Ink, Mark
    from ..linkers import Linker
    from ..meshes.spatial import Spin
    from ..record.diagrams import Diagram
    from ..riders import Rider
    from ..run import Run

__all__ = ["ArcTrack", "Arrows", "Body", "DriveWay", "Happening", "Health", "Overlay", "Piece", "Rolling", "Show"]

Real = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Piece:
    """A part of a solid of one colour: ``vertices`` (V, 3) float32 [m] in the link's frame, ``faces`` (N, 3) uint32."""

    vertices: NDArray[np.float32]
    faces: NDArray[np.uint32]
    color: tuple[int, int, int]


@dataclass(frozen=True, eq=False)
class Body:
    """The solid of a link, in pieces of one colour each."""

    pieces: tuple[Piece, ...]
    spin: Spin | None = None  # of a spatial cam: it turns about an axis in the plane


@dataclass(frozen=True, eq=False)
class Arrows:
    """The arrows of a family: ``origins`` and ``values`` (F, n, 2) [m] and in the family's unit, ``heights`` (n,) [m]."""

    items: tuple[str, ...]
    origins: Real
    values: Real
    heights: Real


@dataclass(frozen=True, eq=False)
class ArcTrack:
    """A moment about ``origin`` (F, 2) [m]: ``values`` (F,) [N m], drawn as an arc at a height [m]."""

    family: str
    item: str
    origin: Real
    values: Real
    height: float


@dataclass(frozen=True, eq=False)
class DriveWay:
    """The coordinate ``position`` (F,) [rad or m] of a drive (or of a free coordinate)."""

    name: str
    sliding: bool
    position: Real


@dataclass(frozen=True, eq=False)
class Health:
    """A residual or condition number ``values`` (F,). ``good``: up to here all is well; ``bad``: from here on nothing is."""

    name: str
    unit: str
    values: Real
    good: float
    bad: float

    @property
    def trouble(self) -> Real:
        """0 (well) to 1 (bad), on a logarithmic scale (F,); what is not a number is bad."""
        size = np.abs(self.values)
        with np.errstate(divide="ignore", invalid="ignore"):
            part = np.log(size / self.good) / np.log(self.bad / self.good)
        return np.asarray(np.where(np.isfinite(size), np.clip(np.nan_to_num(part, nan=0.0), 0.0, 1.0), 1.0))


@dataclass(frozen=True, eq=False)
class Rolling:
    """Pole curves of a link as complex numbers (F,) [m]: ``fixed`` in the world, ``moving`` in the link's frame, and an ``outline``
    (n,) of the link in its frame."""

    fixed: NDArray[np.complex128]
    moving: NDArray[np.complex128]
    outline: NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class Overlay:
    """Lines, arrows and points that were drawn on the mechanism of a recording."""

    inks: tuple[Ink, ...]
    marks: tuple[Mark, ...]


@dataclass(frozen=True)
class Happening:
    """An event of the run; ``time`` [s], ``level`` INFO or WARN."""

    time: float
    level: str
    text: str


@dataclass(frozen=True, eq=False)
class Show:
    """Everything that is shown, over the frames at ``time`` (F,) [s]. Poses are x, y, angle (F, 3) [m, m, rad]."""

    title: str
    teaches: str
    time: Real
    cycle: float  # [s]
    drives: tuple[DriveWay, ...]
    frame: str  # the fixed link
    poses: Mapping[str, Real]
    bodies: Mapping[str, Body]
    size: float  # [m]
    bounds: NDArray[np.float64]  # (2, 3) [m]
    z_top: float
    arrows: Mapping[str, Arrows]
    arcs: tuple[ArcTrack, ...]
    scales: Scales
    paths: Mapping[str, Real]  # name of a point -> (F, 3) [m]
    joints: Mapping[str, Real]  # (F, 2) [m]
    quantities: tuple[Quantity, ...]
    axes: tuple[Axis, ...]
    first: tuple[Quantity, ...]  # what is plotted at the start
    health: tuple[Health, ...] = ()
    events: tuple[Happening, ...] = ()
    linkers: tuple[Linker, ...] = ()
    coils: tuple[Coil, ...] = ()
    riders: tuple[Rider, ...] = ()
    opening: int = 0  # the frame to open at
    notes: str = ""  # what was computed and left out, as HTML
    run: Run | None = None  # not of a recording
    spatial: Mapping[str, tuple[Real, Real]] = field(default_factory=dict)
    """Links that do not only turn about z, of a recording: places (F, 3) [m] and turns (F, 4), w first."""
    kinds: Mapping[str, tuple[str, tuple[str, str]]] = field(default_factory=dict)  # of joints, with their two links
    heights: Mapping[tuple[str, str], float] = field(default_factory=dict)  # of arrows and arcs, by family and item
    drawings: Callable[[], Mapping[str, Drawing]] = dict  # plans and polygons, by name; made when they are asked for
    charts: Callable[[], Sequence[Diagram]] = tuple  # one quantity against another
    polodes: Callable[[], Mapping[str, Rolling]] = dict  # by link
    overlays: Callable[[], Mapping[str, Overlay]] = dict  # of a recording, by the words of their switch

    @property
    def frames(self) -> int:
        return len(self.time)

    @property
    def families(self) -> frozenset[str]:
        """Families of arrows of which there is anything."""
        return frozenset([*self.arrows, *(arc.family for arc in self.arcs)])

    def peak(self, label: str) -> float:
        """The largest size of a quantity over the run, NaN where there is none of that label."""
        for q in self.quantities:
            if q.label == label:
                values = np.abs(q.values())
                return float(np.max(values, initial=0.0, where=np.isfinite(values)))
        return float("nan")
