"""The synthesis of cams by inversion, drawn on the cam: base circle, guides turned back, positions of the follower, profile."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from mechcore.arrays import Complex
from mechcore.constructions.inversion import CamInversion
from mechviz.picture.nodes import Color, Lines
from mechviz.picture.overlays import space

if TYPE_CHECKING:
    from mechviz.meshes.solids import Solids
    from mechviz.runs import Run

INVERSION = "inversion"
"""The group of the picture."""
WORDS = "Cams by inversion"
CIRCLES, RAYS, FOLLOWERS, PROFILE = (255, 206, 92), (150, 166, 190), (92, 214, 255), (255, 110, 96)
THIN, THICK = 0.0012, 0.0032  # radii of lines, in sizes of the mechanism
ROUND = np.exp(2j * np.pi * np.linspace(0.0, 1.0, 49))
KNIFE = 0.02  # length of the two lines of a knife's edge, in sizes of the mechanism
PROFILE_POINTS = 361


def inversion_nodes(run: Run, solids: Solids) -> Iterator[Lines]:
    """Lines at rest on the cam's link, of each cam that the scene names."""
    height = solids.z_top + 0.004 * solids.size
    for name, inversion in run.studies.inversion.items():
        for part, (strips, color, width) in _parts(inversion, solids.size).items():
            common: dict[str, Any] = {"owner": ("joint", name), "group": INVERSION, "height": height, "parent": inversion.link}
            yield Lines(
                key=f"{INVERSION}.{name}.{part}",
                entity=("mechanism", "links", inversion.link, f"{INVERSION} {name} {part}"),
                strips=tuple(space(z[None], height) for z in strips),
                colors=(color,),
                radii=(width * solids.size,),
                **common,
            )


def _parts(drawn: CamInversion, size: float) -> dict[str, tuple[Sequence[Complex], Color, float]]:
    """Strips (points,) in the axes of the cam's link, their colour and radius, by what they are."""
    circles = [drawn.centre + drawn.base * ROUND]
    if drawn.carrier > 1e-9 * size:
        circles.append(drawn.centre + drawn.carrier * ROUND)
    ends = zip(drawn.origins, drawn.references, strict=True)
    rays = [np.array([origin, reference]) for origin, reference in ends]
    if drawn.faces is not None:
        followers = list(drawn.faces)
    elif drawn.radius > 0.0:
        followers = [z + drawn.radius * ROUND for z in drawn.references]
    else:
        followers = [z + KNIFE * size * _edge(z - origin) for z, origin in zip(drawn.references, drawn.origins, strict=True)]
    some = np.linspace(0, len(drawn.profile), PROFILE_POINTS).astype(int) % len(drawn.profile)
    return {
        "circles": (circles, CIRCLES, THICK),
        "rays": (rays, RAYS, THIN),
        "followers": (followers, FOLLOWERS, THIN),
        "profile": ([drawn.profile[some]], PROFILE, THICK),
    }


def _edge(along: complex) -> Complex:
    """A knife's edge that points against a direction: two lines of unit length."""
    unit = along / abs(along) if abs(along) > 0.0 else 1j
    return unit * np.array([np.exp(0.35j), 0.0, np.exp(-0.35j)])
