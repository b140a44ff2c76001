"""A cylinder between two points: barrel and rod, pinned at their ends, sliding in each other."""

from __future__ import annotations

from mechcore.joints.base import Builder, Joint, point_of
from mechcore.spec.mechanism import Cylinder, Link


def build(pair: Cylinder, builder: Builder) -> None:
    first, second = builder.ends(pair)
    barrel, rod = f"{pair.name}.barrel", f"{pair.name}.rod"
    builder.links[barrel] = Link(name=barrel, points={"base": (0.0, 0.0)})
    builder.links[rod] = Link(name=rod, points={"eye": (0.0, 0.0)})

    def pin(name: str, link: str, at: complex, own: str) -> Joint:
        return Joint(name=f"{pair.name}.{name}", kind="revolute", links=(link, own), a=at, b=0j, turns=True)

    builder.joints += [
        pin("base", pair.links[0], point_of(first, pair.points[0]), barrel),
        pin("eye", pair.links[1], point_of(second, pair.points[1]), rod),
        Joint(name=pair.name, kind="prismatic", links=(barrel, rod), a=0j, b=0j, turns=False, slide=1 + 0j, guide=0),
    ]
