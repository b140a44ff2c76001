"""Solids of cams on their shafts: bores with keyways, keys, and what turns with what."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from sections import section
from shapely import affinity
from shapely.geometry import Point, Polygon, box

import mechviz
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion
from mechviz.meshes.outline import key_outline, keyed_bore, keyway_reach
from mechviz.meshes.solids import build_solids


def built(name: str, frames: int = 9):
    scene = mechviz.load(name)
    motion = solve_motion(compile_mechanism(scene.mechanism), default_times(scene.mechanism, frames, 1))
    return build_solids(motion.mechanism, {k: motion.pose(k) for k in motion.model.links})


def parts_of(solid, kind):
    return [p for k, p in zip(solid.kinds, solid.parts, strict=True) if k == kind]


def slotted(radius: float, reach: float, half: float, sides: int, towards: float = 0.0) -> Polygon:
    """A bore with its slot at an angle, drawn anew."""
    angle = 2.0 * np.pi * np.arange(sides) / sides
    ring = Polygon(radius * np.column_stack([np.cos(angle), np.sin(angle)]))
    return ring.union(affinity.rotate(box(0.0, -half, reach, half), towards, origin=(0, 0), use_radians=True))


def test_the_bore_is_a_circle_with_a_slot_and_the_key_fits_it():
    bore = keyed_bore((3.0, -1.0), 0.5, 0.52, (0.6, 0.8), 64)
    wanted = affinity.translate(slotted(0.52, 0.67, 0.135, 64, np.arctan2(0.8, 0.6)), 3.0, -1.0)
    assert bore.area == pytest.approx(wanted.area, rel=1e-12)
    assert bore.symmetric_difference(wanted).area < 1e-12
    key = key_outline((3.0, -1.0), 0.5, (0.6, 0.8), 64)
    assert bore.buffer(1e-12).contains(key) and key.distance(Point(3.0, -1.0)) > 0.5
    assert keyway_reach(0.5) > 0.67


@pytest.mark.parametrize("name", ["cam-groove", "cam-eccentric"])
def test_a_cams_section_is_its_profile_less_bore_and_keyway(name):
    """Areas exactly: profile less circle and slot in the cam's plate and in its hub; shaft and key in between, both the cam's."""
    solids = built(name)
    cam = solids.links["cam"]
    assert all(p.is_volume for p in cam.parts) and not solids.clashes
    plate = parts_of(cam, "plate")[0]
    (shaft,) = parts_of(cam, "pin")
    key = parts_of(cam, "key")[0]
    low, high = plate.bounds[:, 2]
    middle, near_top = 0.493 * low + 0.507 * high, high - 0.02 * (high - low)
    turned = section(shaft, middle)
    radii = np.hypot(*(np.asarray(turned.exterior.coords)[1:] - np.asarray(turned.centroid.coords)).T)
    radius = float(radii.max())
    sides = int((radii > (1.0 - 1e-6) * radius).sum())  # between two corners the section has points on the chord
    bore = slotted(1.04 * radius, 1.34 * radius, 0.27 * radius, sides)
    for z in (middle, near_top):
        cut = section(plate, z)
        assert Polygon(cut.exterior).area - cut.area == pytest.approx(bore.area, rel=1e-6)
        assert cut.distance(section(key, z)) > 0.0
    hub = section(plate, near_top)
    outer = np.hypot(*(np.asarray(hub.exterior.coords) - np.asarray(turned.centroid.coords)).T)
    assert outer.max() < 2.1 * radius  # near its top there is the hub alone
    assert section(key, middle).area == pytest.approx(
        box(0.0, -0.97 * 0.27 * radius, (1.0 + 0.97 * 0.34) * radius, 0.97 * 0.27 * radius)
        .difference(slotted(1.004 * radius, 0.0, 0.0, sides))
        .area,
        rel=1e-3,  # where the corners of the circle lie
    )
    assert key.bounds[1, 2] == pytest.approx(high)  # seen from before the hub
    assert shaft.bounds[1, 2] >= high - 1e-12


@pytest.mark.parametrize("name", ["cam-barrel", "cam-globoid"])
def test_spatial_cams_are_bored_and_keyed(name):
    """Cut across the axis beside the groove: the disc of the end less bore and slot."""
    solids = built(name)
    cam = solids.links["cam"]
    assert cam.kinds == ("wheel", "pin", "key") and all(p.is_volume for p in cam.parts)
    origin, along = np.array(cam.spin.origin), np.array([*cam.spin.along, 0.0])
    body, shaft, key = cam.parts
    across = np.array([along[1], -along[0], 0.0])
    axes = np.column_stack([across, np.cross(along, across), along])
    turned = [trimesh.Trimesh((p.vertices - origin) @ axes, p.faces, process=False) for p in (body, shaft, key)]
    z = turned[0].bounds[0, 2] + 0.002 * np.ptp(turned[0].bounds[:, 2])
    disc, bar, wedge = (section(p, z) for p in turned)
    radius = float(np.hypot(*turned[1].vertices[:, :2].T).max())
    bore = slotted(radius / 0.995, 1.34 * radius, 0.27 * radius, 48)
    assert Polygon(disc.exterior).area - disc.area == pytest.approx(bore.area, rel=1e-6)
    assert bar.area == pytest.approx(24 * radius**2 * np.sin(2 * np.pi / 48), rel=1e-6)
    assert 0.0 < wedge.area < bore.area - bar.area and disc.distance(wedge) > 0.0


CRANK_WITH_CAM = """
units = { length = "mm", angle = "deg" }
[links]
frame = { points = { A = [0, 0], G = [0, 90] } }
crank = { points = { A = [0, 0], B = [60, 0] } }
follower = { points = { T = [0, 0] } }
[joints]
A = { revolute = ["frame", "crank"], drive = { speed = "60 rpm" } }
S = { prismatic = ["frame", "follower"], at = ["G", "T"], along = [0, 1] }
[joints.K]
cam = ["crank", "follower"]
profile = { base = 30, lift = [{ over = 180, to = 12 }, { over = 180, to = 0 }] }
follower = { roller = 8, guide = "S", point = "T" }
"""


@pytest.mark.parametrize(("point", "chord"), [("60, 0", 5e-4), ("60, 0", 1e-3), ("60, 0", 2.85e-3), ("2, 0", None), ("2, 0", 5e-3)])
def test_a_keyed_boss_on_a_crank_is_built_with_facets_of_any_size(point, chord):
    """The chamfer of the boss once cut off the corners of the keyway: its end face could not be divided into triangles."""
    scene = mechviz.loads(CRANK_WITH_CAM.replace("60, 0", point))
    crank = build_solids(scene.mechanism, chord=chord, profile=90).links["crank"]
    assert parts_of(crank, "key") and all(part.is_watertight for part in crank.parts)
    assert sum(part.volume for part in crank.parts) == pytest.approx(crank.mesh.volume) and min(p.volume for p in crank.parts) > 0.0
