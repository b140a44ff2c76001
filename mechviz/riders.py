"""What rides on a link and moves by itself, so that one sees it move: marks on rollers that roll and on belts that run."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from .turns import about_z

if TYPE_CHECKING:
    from .meshes import Solids
    from .run import Run

__all__ = ["KINDS", "Kind", "Rider", "find_riders"]

Real = NDArray[np.float64]

Kind = Literal["roller", "belt"]
KINDS: tuple[Kind, ...] = get_args(Kind)
COLORS: dict[Kind, tuple[int, int, int]] = {"roller": (60, 66, 74), "belt": (236, 196, 64)}


@dataclass(frozen=True, eq=False)
class Rider:
    """A mark below a link: the mesh about ``centre`` (x, y, z) [m] in the link's axes, or about the places ``path`` (F, 3) [m] that
    it goes to; turned by ``angle`` (F) [rad] against the link, about z or about the direction ``axis`` in the plane."""

    kind: Kind
    name: str
    link: str
    centre: tuple[float, float, float]
    angle: Real
    vertices: NDArray[np.float32]  # (V, 3) [m]
    faces: NDArray[np.uint32]  # (N, 3)
    normals: NDArray[np.float32]  # (V, 3)
    axis: tuple[float, float] | None = None
    path: Real | None = None

    @property
    def title(self) -> str:
        """Kind and name: what it is called below its link."""
        return f"{self.kind} {self.name}"

    @property
    def color(self) -> tuple[int, int, int]:
        return COLORS[self.kind]

    def turns(self) -> Real:
        """Quaternions x, y, z, w (F, 4)."""
        if self.axis is None:
            return about_z(self.angle)
        c, s = np.cos(0.5 * self.angle), np.sin(0.5 * self.angle)
        return np.column_stack([self.axis[0] * s, self.axis[1] * s, np.zeros_like(s), c])

    def places(self) -> Real:
        """Where it is in the link's axes (F, 3) [m]."""
        return np.tile(np.array(self.centre, float), (len(self.angle), 1)) if self.path is None else self.path


def find_riders(run: Run, solids: Solids) -> list[Rider]:
    """All that rides on the links of a run."""
    from .belts import find_belt_marks
    from .rollers import find_rollers

    return [*find_rollers(run, solids), *find_belt_marks(run, solids)]
