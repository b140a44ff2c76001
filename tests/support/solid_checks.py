"""Checks of solids: closed shapes, sections, links that meet."""

from __future__ import annotations

import itertools
from collections.abc import Mapping

import numpy as np
import pytest
import shapely
import trimesh
from sections import Sections

from mechcore.joints.registry import build_joints
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion
from mechcore.spec.mechanism import CamJoint, Joint, Link, Mechanism, Screw
from mechviz.meshes.solids import Solids

FRAMES = 48


TOUCH = 2e-5  # [m] the tessellation of cams; how near cam and follower come is tested with the scenes of cams


Poses = dict[str, np.ndarray]


def moved(mechanism: Mechanism) -> tuple[Mechanism, Poses]:
    motion = solve_motion(compile_mechanism(mechanism), default_times(mechanism, FRAMES, 1.0))
    return mechanism, {link: np.asarray(motion.pose(link)) for link in motion.model.links}


def mechanism(points: Mapping[str, Mapping[str, tuple[float, float]]], *joints: Joint) -> Mechanism:
    links = tuple(Link(name=name, points=where) for name, where in points.items())
    return Mechanism(name="test", frame="frame", links=links, joints=joints)


def check_shapes(solids: Solids, spec: Mechanism) -> None:
    """Every link has closed parts, and display arrays that fit them."""
    assert list(solids.links) == list(build_joints(spec).links), "every link, those of cylinders included"
    for name, solid in solids.links.items():
        assert solid.parts, name
        assert len(solid.kinds) == len(solid.parts)
        for kind, part in zip(solid.kinds, solid.parts, strict=True):
            assert part.is_volume, (name, kind)
        assert solid.mesh.is_volume, name
        assert solid.mesh.volume == pytest.approx(sum(part.volume for part in solid.parts), rel=1e-6)
        assert solid.vertices.dtype == solid.normals.dtype == np.float32
        assert solid.faces.dtype == np.uint32
        assert solid.faces.max() < len(solid.vertices) == len(solid.normals) == len(solid.colors)
        assert len(solid.faces) == len(solid.mesh.faces)
        np.testing.assert_allclose(np.linalg.norm(solid.normals, axis=1), 1.0, atol=1e-6)
        a, b, c = (solid.vertices[solid.faces[:, k]].astype(float) / solids.size for k in range(3))
        face = np.cross(b - a, c - a)
        area = np.linalg.norm(face, axis=1)
        thick = area > 1e-7  # a needle has no direction in single precision
        for k in range(3):
            along = (solid.normals[solid.faces[thick, k]] * face[thick]).sum(axis=1) / area[thick]
            assert along.min() > np.cos(np.radians(30.0)), f"{name}: a normal leans too far from its face, or points inwards"
    assert np.isfinite(solids.bounds).all()
    assert (solids.bounds[0] < solids.bounds[1]).all()
    assert solids.z_top > solids.bounds[1, 2]


def placed(shape: shapely.Geometry, poses: np.ndarray, size: float) -> np.ndarray:
    """A shape in the world at some poses (n, 3): geometries (n,)."""
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    turn = np.moveaxis(np.array([[c, s], [-s, c]]), 2, 0)
    points = shapely.get_coordinates(shape) @ turn + poses[:, None, :2] / size
    return shapely.set_coordinates(np.full(len(poses), shape), points.reshape(-1, 2))


def meeting_links(spec: Mechanism, poses: Poses, solids: Solids, every: int = 3) -> set[tuple[str, str]]:
    """Links whose solids cut the same plane in shapes that overlap at some frame: from the final meshes alone."""
    # cams about an axis in the plane do not keep their section: test_cam_spatial_scenes looks at them in space
    meshes = {name: solid.mesh for name, solid in solids.links.items() if solid.spin is None}
    meshes |= without_threads(spec, solids)
    scaled = {name: trimesh.Trimesh(m.vertices / solids.size, m.faces, process=False) for name, m in meshes.items()}
    heights = np.unique(np.round(np.concatenate([m.vertices[:, 2] for m in scaled.values()]), 6))
    still = np.zeros_like(next(iter(poses.values())))
    touching = {frozenset(p.links) for p in spec.joints if isinstance(p, CamJoint)}  # to the tolerance of their tessellation
    screws = [joint for joint in spec.joints if isinstance(joint, Screw)]
    within = {frozenset((joint.links[joint.guide], f"{joint.name}.spindle")) for joint in screws}  # it turns inside rod and bearing
    result = set()
    sections = {name: Sections(mesh) for name, mesh in scaled.items()}
    looked_at = set()
    for z in 0.5 * (heights[1:] + heights[:-1]):
        reached = [name for name, mesh in scaled.items() if mesh.bounds[0, 2] < z < mesh.bounds[1, 2]]
        cut = {name: sections[name].at(z) for name in reached if len(reached) > 1}
        at: dict[str, np.ndarray] = {}
        for a, b in itertools.combinations(cut, 2):
            pair = (a, cut[a][0], b, cut[b][0])
            if (a, b) in result or {a, b} in within or pair in looked_at:
                continue
            looked_at.add(pair)
            for name in {a, b} - at.keys():
                at[name] = placed(cut[name][1], poses.get(name, still)[::every], solids.size)
            first = at[a]
            if {a, b} in touching:
                first = placed(shapely.buffer(cut[a][1], -TOUCH / solids.size), poses.get(a, still)[::every], solids.size)
            if shapely.intersects(first, at[b]).any():
                result.add((a, b))
    return result


def without_threads(spec: Mechanism, solids: Solids) -> dict[str, trimesh.Trimesh]:
    """The meshes of links that guide nuts, without the threaded rods in those: `Solids.clashes` keeps all else off the rods."""
    screws = [joint for joint in spec.joints if isinstance(joint, Screw)]
    meshes = {}
    for name in {joint.links[joint.guide] for joint in screws}:
        parts = [part for kind, part in zip(solids.links[name].kinds, solids.links[name].parts, strict=True) if kind != "rod"]
        meshes[name] = trimesh.util.concatenate(parts)
    return meshes


def in_world(xy: tuple[float, float] | np.ndarray, pose: np.ndarray) -> np.ndarray:
    c, s = np.cos(pose[2]), np.sin(pose[2])
    return np.array([[c, -s], [s, c]]) @ np.asarray(xy) + pose[:2]
