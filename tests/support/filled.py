"""Scenes of which the viewer's picture has to be full, and all places that their solids reach."""

from __future__ import annotations

from functools import cache

import numpy as np

from mechcore.arrays import Real
from mechviz.picture.build import solid_nodes
from recordings import ran, solids

SCENES = (
    "crank-rocker", "stephenson-six-bar", "slider-crank-compressor", "cam-roller", "jansen-leg", "scissor-lift",
    "gear-train", "cam-conjugate", "valve-train", "peaucellier",
)  # fmt: skip


@cache
def solid_points(name: str) -> Real:
    """Places (n, 3) [m] of corners of all solids over the run."""
    run, spots = ran(name), []
    for body in solid_nodes(run, solids(name)):
        xyz, pose = body.mesh.vertices[::7].astype(float), run.motion.pose(body.parent)[::15]
        world = (xyz[:, 0] + 1j * xyz[:, 1]) * np.exp(1j * pose[:, 2:]) + (pose[:, 0] + 1j * pose[:, 1])[:, None]
        spots.append(np.column_stack([world.real.ravel(), world.imag.ravel(), np.tile(xyz[:, 2], len(pose))]))
    return np.concatenate(spots)


def arrows_box(name: str) -> Real:
    """The box (2, 3) [m] around solids and as much as arrows may widen the view."""
    shapes = solids(name)
    return np.asarray(shapes.bounds, float) + 0.15 * shapes.size * np.array([[-1.0, -1.0, 0.0], [1.0, 1.0, 0.0]])
