"""Drafts of links before heights are known: pieces of links in groups, each of which will lie on one layer."""

from __future__ import annotations

from dataclasses import field
from typing import TYPE_CHECKING

from shapely.geometry import Polygon

from mechcore.arrays import Vec2
from mechcore.records import dataclass
from mechviz.meshes.extrude import Profile

if TYPE_CHECKING:
    from mechviz.meshes.model import ScaledMechanism


@dataclass(frozen=True, eq=False)
class PlacedPart:
    """A part of a link on the layer of its group."""

    link: str
    outline: Polygon
    group: str
    kind: str  # "plate", "wheel", "block", "rail", "belt", "barrel" or "rod"
    mates: frozenset[str] = frozenset()  # joints in which it meshes: parts with a common joint do not clash
    height: tuple[float, float] = (0.0, 1.0)  # from the bottom to the top of the layer's plates
    groove: float = 0.0  # depth of a groove for a belt around it
    profile: Profile = ()  # of a barrel or rod, which is not flat: (radius, distance along its line)
    line: tuple[Vec2, Vec2] = ((0.0, 0.0), (1.0, 0.0))  # of a barrel, rod or bore: a point and a unit direction
    bore: float = 0.0  # radius of the hole along the line through a nut


@dataclass(frozen=True, eq=False)
class Neck:
    """A neck that joins a plate to a block or another part of the same link on another layer."""

    link: str
    outline: Polygon
    groups: tuple[str, str]  # of the plate and of the block


@dataclass
class SolidsDraft:
    """All pieces of a mechanism and the names of their groups."""

    pieces: list[PlacedPart] = field(default_factory=list)
    necks: list[Neck] = field(default_factory=list)
    fixed_blocks: list[tuple[Vec2, str]] = field(default_factory=list)  # blocks that stand on the ground: centre, group
    groups: dict[str, str] = field(default_factory=dict)  # moving link -> group of its plate
    wheels: list[str] = field(default_factory=list)  # group of every wheel
    cams: list[str] = field(default_factory=list)  # group of every cam
    through: dict[int, set[str]] = field(default_factory=dict)  # axle -> further groups that its pin passes

    def merge(self, old: str, new: str) -> None:
        """Move everything of group ``old`` to group ``new``, so that both lie on one layer."""
        self.groups.update({name: new for name, group in self.groups.items() if group == old})
        self.wheels[:] = [new if group == old else group for group in self.wheels]
        self.cams[:] = [new if group == old else group for group in self.cams]
        for k, reached in self.through.items():
            self.through[k] = {new if group == old else group for group in reached}

    def groups_on_axle(self, model: ScaledMechanism, axle: int) -> tuple[str, ...]:
        """Groups that the pin of an axle passes."""
        own = {self.groups[name] for name in model.axles[axle].centres if name != model.frame}
        return tuple(sorted(own | self.through.get(axle, set())))

    @property
    def group_names(self) -> list[str]:
        return sorted({piece.group for piece in self.pieces})


def share_a_pin(model: ScaledMechanism, draft: SolidsDraft, a: str, b: str) -> bool:
    """Whether a pin passes through links of both groups, which therefore need different layers."""
    ours = {name for name, group in draft.groups.items() if group == a}
    theirs = {name for name, group in draft.groups.items() if group == b}
    return any(ours & set(axle.centres) and theirs & set(axle.centres) for axle in model.axles)
