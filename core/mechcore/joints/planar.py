"""A planar pair: two slides and a pin in a row, which leave the second link all its freedoms."""

from __future__ import annotations

from mechcore.joints.base import Builder, Joint, point_of
from mechcore.spec.mechanism import Link, Planar


def build(pair: Planar, builder: Builder) -> None:
    (first, second), (x, y) = pair.links, pair.made
    for name in (x, y):
        builder.links[name] = Link(name=name, points={})
    b = 0j if pair.point is None else point_of(builder.links[second], pair.point)
    builder.joints += [
        Joint(name=x, kind="planar", links=(first, x), a=0j, b=0j, turns=False, slide=1 + 0j),
        Joint(name=y, kind="planar", links=(x, y), a=0j, b=0j, turns=False, slide=1j),
        Joint(name=pair.name, kind="planar", links=(y, second), a=0j, b=b, turns=True),
    ]
