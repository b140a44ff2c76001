"""Solids of gears, racks, belts, wheels, slots, welds and cylinders: teeth that mesh, rods that stay in their barrels."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
import shapely
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from sections import section
from shapely import affinity
from solid_checks import FRAMES, check_shapes, in_world, meeting_links, moved, placed

import mechviz
from mechcore.joints.registry import build_joints
from mechcore.spec.mechanism import Mechanism
from mechviz.meshes.kinds.rims import ADDENDUM, BACKLASH, DEDENDUM, external_wheel, rack_teeth, ring_teeth
from mechviz.meshes.model import scale_mechanism
from mechviz.meshes.shading import BELT_COLOR, PIN_COLOR, components
from mechviz.meshes.solids import Solids, build_solids
from mechviz.scene.builder import SceneBuilder

TURN: Mapping[str, Any] = {"speed": "60 rpm"}
SWAY: Mapping[str, Any] = {"oscillation": {"centre": 7, "amplitude": 90, "frequency": 1}}  # starts off the middle of a tooth
ALPHA = float(np.radians(20.0))


# --- outlines of teeth --------------------------------------------------------------------------------------------------


def turned(shape: shapely.Polygon, angle: float, x: float = 0.0, y: float = 0.0) -> shapely.Polygon:
    return affinity.translate(affinity.rotate(shape, angle, origin=(0.0, 0.0), use_radians=True), x, y)


def roll(first, second) -> None:
    """Two outlines that mesh over a pitch: nowhere into each other, everywhere within the backlash."""
    for turn in np.linspace(0.0, 1.0, 13):
        a, b = first(turn), second(turn)
        assert not a.intersects(b)
        assert 0.7 * BACKLASH < a.distance(b) < 1.2 * BACKLASH


@pytest.mark.parametrize(
    ("z1", "z2", "angle"),
    [*((z1, z2, ALPHA) for z1, z2 in ((8, 8), (8, 40), (12, 30), (18, 54), (24, 18), (30, 80))),
     (18, 54, float(np.radians(14.5))), (8, 20, float(np.radians(25.0)))],
)  # fmt: skip
def test_external_wheels_roll_on_each_other(z1, z2, angle):
    pinion, wheel = external_wheel(z1, angle), external_wheel(z2, angle)
    pitch = 2.0 * np.pi
    roll(
        lambda t: turned(pinion, t * pitch / z1),
        lambda t: turned(wheel, np.pi + np.pi / z2 - t * pitch / z2, 0.5 * (z1 + z2)),
    )


@pytest.mark.parametrize(("z1", "z2"), [(18, 60), (30, 80), (12, 30), (20, 28)])
def test_a_pinion_rolls_in_its_ring(z1, z2):
    pinion, ring = external_wheel(z1, ALPHA), ring_teeth(z2, z1, ALPHA, 0.5 * z2 + 4.0)
    pitch = 2.0 * np.pi
    roll(
        lambda t: turned(pinion, t * pitch / z1, 0.5 * (z2 - z1)),
        lambda t: turned(ring, np.pi / z2 + t * pitch / z2),
    )


@pytest.mark.parametrize("z", [8, 20])
def test_a_pinion_rolls_on_its_rack(z):
    pinion, rack = external_wheel(z, ALPHA), rack_teeth(-20.0, 20.0, 0.5 * np.pi, ALPHA, 3.0)
    roll(
        lambda t: turned(pinion, -0.5 * np.pi + t * 2.0 * np.pi / z, 0.0, 0.5 * z),
        lambda t: turned(rack, 0.0, t * np.pi),
    )


@pytest.mark.parametrize("z", [8, 25, 60])
def test_a_wheel_has_its_teeth_between_tip_and_root(z):
    wheel = external_wheel(z, ALPHA)
    radius = np.hypot(*np.asarray(wheel.exterior.coords).T)
    assert radius.max() == pytest.approx(0.5 * z + ADDENDUM, rel=1e-9)
    assert radius.min() == pytest.approx(0.5 * z - DEDENDUM, abs=0.02)
    pitch_circle = shapely.Point(0.0, 0.0).buffer(0.5 * z, quad_segs=200).exterior
    on_teeth = pitch_circle.intersection(wheel)
    assert len(shapely.line_merge(on_teeth).geoms) in (z, z + 1), "a tooth may be cut where the circle's coordinates start"
    assert on_teeth.length / (z * np.pi) == pytest.approx(0.5 - BACKLASH / np.pi, abs=0.003)
    assert wheel.contains(shapely.Point(0.5 * z + 0.8, 0.0)), "a tooth lies about the x axis"


# --- whole mechanisms ---------------------------------------------------------------------------------------------------


def scene(name: str) -> SceneBuilder:
    return SceneBuilder(name, length="mm", angle="deg")


def planetary() -> SceneBuilder:
    b = scene("sun on the frame").link("frame", O=(0, 0)).link("arm", O=(0, 0), P=(70, 0)).link("planet", P=(0, 0))
    b.revolute("O", "frame", "arm", drive=TURN).revolute("P", "arm", "planet")
    return b.gear("G", "frame", "planet", carrier="arm", teeth=[40, 30])


def turning_ring() -> SceneBuilder:
    b = scene("turning ring").link("frame", P=(60, 0), O=(0, 0)).link("pinion", P=(0, 0)).link("ring", O=(0, 0), K=(50, 0))
    b.revolute("P", "frame", "pinion", drive=TURN).revolute("O", "frame", "ring")
    return b.gear("G", "pinion", "ring", teeth=[20, 60], internal=True)


def welded_ring() -> SceneBuilder:
    b = scene("welded ring").link("frame", O=(0, 0)).link("arm", O=(0, 0), P=(30, 0))
    b.link("planet", P=(0, 0)).link("ring", O=(0, 0))
    b.revolute("O", "frame", "arm", drive=TURN).revolute("P", "arm", "planet").revolute("R", "arm", "ring", at="O")
    return b.weld("W", "frame", "ring", at="O").gear("G", "planet", "ring", carrier="arm", radii=[20, 50], internal=True)


def slot_on_the_frame() -> SceneBuilder:
    b = scene("slot on the frame").link("frame", O=(0, 0)).link("crank", O=(0, 0), B=(40, 0)).link("rod", B=(0, 0), C=(120, 0))
    b.revolute("O", "frame", "crank", drive=TURN).revolute("B", "crank", "rod")
    return b.pin_slot("S", "frame", "rod", at=["O", "C"], branch="ahead")


def pin_on_the_frame() -> SceneBuilder:
    b = scene("pin on the frame").link("frame", O=(0, 0), Q=(90, 0)).link("crank", O=(0, 0), B=(40, 0))
    b.link("rod", B=(0, 0), C=(160, 0))
    b.revolute("O", "frame", "crank", drive=TURN).revolute("B", "crank", "rod")
    return b.pin_slot("S", "rod", "frame", at=["B", "Q"], branch="ahead")


def scotch_yoke() -> SceneBuilder:
    b = scene("scotch yoke").link("frame", O=(0, 0)).link("crank", O=(0, 0), P=(50, 0)).link("yoke", Q=(0, 0))
    b.revolute("O", "frame", "crank", drive=TURN).prismatic("S", "frame", "yoke", at=["O", "Q"])
    return b.pin_slot("A", "yoke", "crank", at=["Q", "P"], along=[0, 1])


def wedge() -> SceneBuilder:
    b = scene("wedge").link("frame", O=(0, 0), B=(100, 0)).link("slide", O=(0, 0), W=(100, 0)).link("block", W=(0, 0), B=(0, 50))
    b.prismatic("S", "frame", "slide", at="O", drive={"speed": -10, "travel": 20})
    b.pin_slot("A", "slide", "block", at="W", along=[0.99, -0.14])
    return b.prismatic("B", "frame", "block", along=[0, 1])


def rack_on_an_arm() -> SceneBuilder:
    b = scene("rack on an arm").link("frame", O=(0, 0)).link("arm", O=(0, 0), A=(60, 0), G=(60, -30))
    b.link("pinion", A=(0, 0)).link("rack", G=(0, 0), E=(40, -25))
    b.revolute("O", "frame", "arm", drive=TURN).revolute("A", "arm", "pinion", drive=SWAY)
    return b.prismatic("S", "arm", "rack", at="G").rack("Z", "pinion", "rack", slider="S", radius=30)


def rolling_on_an_arm() -> SceneBuilder:
    b = scene("rolling on an arm").link("frame", O=(0, 0)).link("arm", O=(0, 0), E=(80, 30)).link("wheel", C=(0, 0))
    b.revolute("O", "frame", "arm", drive=TURN)
    return b.rolling("W", "arm", "wheel", at=["E", "C"], radius=20, drive={"oscillation": {"amplitude": 40, "frequency": 1}})


def welded_chain() -> SceneBuilder:
    b = scene("welded").link("frame", A=(0, 0)).link("a", A=(0, 0), W=(80, 0)).link("b", W=(0, 0), E=(60, 0), F=(20, 30))
    return b.revolute("A", "frame", "a", drive=TURN).weld("W", "a", "b", angle=40)


def welded_to_the_frame() -> SceneBuilder:
    b = scene("welded to the frame").link("frame", A=(0, 0), W=(80, 0)).link("a", A=(0, 0), K=(30, 0))
    b.link("b", W=(0, 0), E=(60, 0))
    return b.revolute("A", "frame", "a", drive=TURN).weld("W", "frame", "b", angle=40)


def long_crank_on_a_gear() -> SceneBuilder:
    b = scene("long crank").link("frame", A=(0, 0), D=(60, 0)).link("g", A=(0, 0), K=(50, 0)).link("h", D=(0, 0))
    b.link("rod", K=(0, 0), E=(30, 0)).revolute("A", "frame", "g", drive=TURN).revolute("D", "frame", "h")
    return b.revolute("K", "g", "rod", drive=TURN).gear("G", "g", "h", radii=[20, 40])


def rack_from_the_right() -> SceneBuilder:
    b = scene("rack from the right").link("frame", A=(0, 0), G=(0, 40)).link("pinion", A=(0, 0)).link("rack", G=(0, 0))
    b.revolute("A", "frame", "pinion", drive=SWAY).prismatic("S", "frame", "rack", at="G", guide="rack", along=[0, 1], angle=-90)
    return b.rack("Z", "pinion", "rack", slider="S", radius=40, side="right")


CASES = {
    case.__name__: case
    for case in (
        planetary, turning_ring, welded_ring, slot_on_the_frame, pin_on_the_frame, scotch_yoke, wedge, rack_on_an_arm,
        rolling_on_an_arm, welded_chain, welded_to_the_frame, long_crank_on_a_gear, rack_from_the_right,
    )
}  # fmt: skip


@pytest.fixture(scope="module")
def built():
    cache: dict[str, tuple[Mechanism, dict[str, np.ndarray], Solids]] = {}

    def get(name: str) -> tuple[Mechanism, dict[str, np.ndarray], Solids]:
        if name not in cache:
            spec = CASES[name]().scene().mechanism if name in CASES else mechviz.load(name).mechanism
            cache[name] = (*moved(spec), build_solids(*moved(spec)))
        return cache[name]

    return get


@pytest.mark.sample(6)
@pytest.mark.parametrize("name", CASES)
def test_parts_are_closed_and_pass_through_nothing(built, name):
    spec, poses, solids = built(name)
    check_shapes(solids, spec)
    assert solids.clashes == ()
    assert meeting_links(spec, poses, solids) == set()


@pytest.mark.parametrize("name", CASES)
def test_without_poses_there_are_solids_too(name):
    spec = CASES[name]().scene().mechanism
    check_shapes(build_solids(spec), spec)


def slices_of(solids: Solids, name: str, poses: np.ndarray, z: float) -> np.ndarray:
    """What a solid cuts out of a plane of constant z, in the world at poses (n, 3), in units of the size: geometries (n,)."""
    mesh = solids.links[name].mesh.copy()
    mesh.apply_scale(1.0 / solids.size)
    return placed(section(mesh, z), poses, solids.size)


def slice_of(solids: Solids, name: str, pose: np.ndarray, z: float) -> shapely.Geometry:
    """The same at one pose (3,)."""
    (result,) = slices_of(solids, name, pose[None], z)
    return result


def layer_height(solids: Solids, name: str, kinds: tuple[str, ...]) -> float:
    """A height within the wheel of a link, off its middle, in units of the size."""
    solid = solids.links[name]
    part = max((p for k, p in zip(solid.kinds, solid.parts, strict=True) if k in kinds), key=lambda p: p.volume)
    low, high = part.bounds[:, 2]
    return float(0.6 * low + 0.4 * high) / solids.size


MESHES = [
    ("planetary-gear", "sun", "planet", 2.0), ("planetary-gear", "sun", "planet2", 2.0), ("planetary-gear", "sun", "planet3", 2.0),
    ("planetary-gear", "planet", "frame", 2.0), ("planetary-gear", "planet2", "frame", 2.0), ("gear-train", "motor", "shaft", 1.5),
    ("gear-train", "shaft", "output", 1.5), ("geared-slider-cranks", "crank", "crank2", 45 / 8),
    ("rack-and-pinion", "pinion", "rack", 4.0),
    ("planetary", "frame", "planet", 2.0), ("turning_ring", "pinion", "ring", 3.0), ("welded_ring", "planet", "ring", 2.5),
    ("rack_on_an_arm", "pinion", "rack", 3.0), ("rack_from_the_right", "pinion", "rack", 4.0),
]  # fmt: skip


@pytest.mark.sample(6)
@pytest.mark.parametrize(("name", "first", "second", "module"), MESHES)
def test_teeth_stand_in_the_gaps_of_each_other_from_the_start_to_the_end(built, name, first, second, module):
    """From the final meshes: at every frame the wheels do not touch, and are nearer to each other than the backlash allows."""
    spec, poses, solids = built(name)
    poses = {spec.frame: np.zeros((FRAMES + 1, 3)), **poses}
    wheel = first if first != spec.frame else second
    z = layer_height(solids, wheel, ("plate", "wheel"))
    if name == "gear-train":  # the shaft has two wheels
        z = layer_height(solids, "motor" if second == "shaft" else "output", ("plate",))
    a, b = (slices_of(solids, link, poses[link][:FRAMES:5], z) for link in (first, second))
    apart = shapely.distance(a, b) * solids.size * 1e3 / module
    assert apart.min() > 0.0 and apart.max() < 1.3 * BACKLASH, apart


def test_numbers_of_teeth_are_the_stated_ones_or_fit_the_radii():
    def wheels(name: str) -> list[tuple[str, str, int]]:
        spec = CASES[name]().scene().mechanism if name in CASES else mechviz.load(name).mechanism
        return [(w.link, w.kind, w.teeth) for w in scale_mechanism(spec, None, 48).wheels.wheels]

    assert wheels("planetary-gear") == [
        ("sun", "gear", 24), ("planet", "gear", 18), ("planet2", "gear", 18), ("planet3", "gear", 18), ("frame", "ring", 60),
    ]  # fmt: skip
    assert wheels("gear-train") == [("motor", "gear", 18), ("shaft", "gear", 54), ("shaft", "gear", 20), ("output", "gear", 60)]
    ((_, _, z1), (_, _, z2)) = wheels("geared-slider-cranks")
    assert z2 == 2 * z1 and 16 <= z1 <= 48
    ((_, _, z1), (_, _, z2)) = wheels("welded_ring")
    assert (z1, z2) == (16, 40)
    b = scene("small numbers").link("frame", A=(0, 0), B=(30, 0)).link("a", A=(0, 0)).link("b", B=(0, 0))
    b.revolute("A", "frame", "a", drive=TURN).revolute("B", "frame", "b").gear("G", "a", "b", teeth=[1, 2])
    result = scale_mechanism(b.scene().mechanism, None, 48).wheels.wheels
    assert [w.teeth for w in result] == [16, 32], "a ratio is no number of teeth"


def test_wheels_of_one_train_share_their_module_where_only_radii_are_stated():
    b = scene("train").link("frame", A=(0, 0), B=(50, 0), C=(110, 0)).link("a", A=(0, 0)).link("b", B=(0, 0)).link("c", C=(0, 0))
    b.revolute("A", "frame", "a", drive=TURN).revolute("B", "frame", "b").revolute("C", "frame", "c")
    b.gear("G", "a", "b", radii=[20, 30]).gear("H", "b", "c", radii=[30, 30])
    result = scale_mechanism(b.scene().mechanism, None, 48).wheels
    assert [w.link for w in result.wheels] == ["a", "b", "c"], "the middle wheel is one wheel"
    assert len({round(w.module, 12) for w in result.wheels}) == 1
    assert [w.teeth for w in result.wheels] == [16, 24, 24]


@pytest.mark.parametrize("name", ["planetary-gear", "planetary", "welded_ring"])
def test_the_arm_lies_behind_its_wheels(built, name):
    _, _, solids = built(name)
    assert all(solids.links["arm"].layer < solid.layer for key, solid in solids.links.items() if key.startswith(("sun", "planet")))


def test_meshing_wheels_share_a_layer_and_a_second_wheel_of_a_link_has_one_of_its_own(built):
    _, _, solids = built("gear-train")
    shaft = solids.links["shaft"]
    assert solids.links["motor"].layer != solids.links["output"].layer
    heights = [p.bounds[:, 2] for k, p in zip(shaft.kinds, shaft.parts, strict=True) if k in ("plate", "wheel")]
    assert len(heights) == 2 and (heights[0][1] < heights[1][0] or heights[1][1] < heights[0][0])
    assert "neck" in shaft.kinds, "a hub joins them"


def parts_of(solids: Solids, link: str, kind: str) -> list[Any]:
    solid = solids.links[link]
    return [part for k, part in zip(solid.kinds, solid.parts, strict=True) if k == kind]


def test_belts_are_closed_bands_in_the_grooves_of_their_pulleys(built):
    _, poses, solids = built("belt-drive")
    belts = parts_of(solids, "frame", "belt")
    assert len(belts) == 2
    loops = []
    for belt in belts:
        z = belt.bounds[:, 2].mean() / solids.size
        mesh = belt.copy()
        mesh.apply_scale(1.0 / solids.size)
        band = section(mesh, z)
        loops.append(len(band.interiors))
        on = [link for link in ("motor", "drum", "fan") if _has_wheel_at(solids, link, z * solids.size)]
        pulleys = [slice_of(solids, link, poses[link][0], z) for link in on]
        assert len(pulleys) == 2
        for pulley in pulleys:
            gap = band.distance(pulley) * solids.size * 1e3
            assert 0.0 < gap < 1.0, "the belt lies on the floor of the groove, without touching it [mm]"
    assert sorted(loops) == [1, 2], "an open belt has one opening, a crossed one two"
    frame = solids.links["frame"]
    assert (frame.colors == BELT_COLOR).all(axis=1).any()


def _has_wheel_at(solids: Solids, link: str, z: float) -> bool:
    return any(part.bounds[0, 2] < z < part.bounds[1, 2] for kind in ("plate", "wheel") for part in parts_of(solids, link, kind))


def test_pulleys_have_flanges_beside_the_belt(built):
    _, poses, solids = built("belt-drive")
    (pulley,) = parts_of(solids, "drum", "plate")
    low, high = pulley.bounds[:, 2] / solids.size
    groove, flange = (slice_of(solids, "drum", poses["drum"][0], low + part * (high - low)) for part in (0.5, 0.3))
    assert groove.area < 0.95 * flange.area


def test_rods_stay_in_their_barrels_and_do_not_touch_the_bottom(built):
    spec, poses, solids = built("excavator-arm")
    assert {"C1.barrel", "C1.rod", "C2.barrel", "C2.rod"} <= set(solids.links)
    for name, first, p, second, q in (("C1", "frame", "P", "boom", "Q"), ("C2", "boom", "U", "stick", "V")):
        barrel, rod = parts_of(solids, f"{name}.barrel", "barrel")[0], parts_of(solids, f"{name}.rod", "rod")[0]
        points = {link.name: link.points for link in spec.links}
        ends = [(points[first][p], _poses(poses, first)), (points[second][q], _poses(poses, second))]
        places = [np.array([in_world(point, pose) for pose in run]) for point, run in ends]
        length = np.hypot(*(places[1] - places[0]).T)
        inner = length + rod.bounds[0, 0]  # where the piston is, from the barrel's pin
        assert barrel.bounds[0, 0] < inner.min(), f"{name}: the piston comes out at the bottom"
        assert inner.max() + 0.02 < barrel.bounds[1, 0], f"{name}: the piston leaves the barrel"
        assert np.ptp(barrel.bounds[:, 1]) == pytest.approx(np.ptp(barrel.bounds[:, 2]), rel=0.02), "round"
        assert np.ptp(rod.bounds[:, 1]) < np.ptp(barrel.bounds[:, 1])
    assert (solids.links["C1.rod"].colors == PIN_COLOR).all(axis=1).any()


def _poses(poses: Mapping[str, np.ndarray], link: str) -> np.ndarray:
    return poses.get(link, np.zeros((FRAMES + 1, 3)))


def test_welded_plates_lie_flush_on_one_layer(built):
    for name, first, second in (("welded_chain", "a", "b"), ("excavator-arm", "stick", "bucket")):
        _, poses, solids = built(name)
        assert solids.links[first].layer == solids.links[second].layer
        (a,), (b,) = parts_of(solids, first, "plate"), parts_of(solids, second, "plate")
        np.testing.assert_allclose(a.bounds[:, 2].mean(), b.bounds[:, 2].mean(), atol=0.01 * solids.size)
        z = float(np.mean([a.bounds[:, 2].mean(), b.bounds[:, 2].mean()])) / solids.size
        gap = slice_of(solids, first, poses[first][0], z).distance(slice_of(solids, second, poses[second][0], z))
        assert 0.0 < gap < 0.004, "a seam"


def test_what_is_welded_to_the_ground_stands_on_it(built):
    _, _, solids = built("welded_to_the_frame")
    assert len(parts_of(solids, "frame", "pedestal")) == 2
    _, _, solids = built("welded_ring")
    assert len(parts_of(solids, "frame", "pedestal")) == 3, "the arm's bearing and two feet under the ring"


@pytest.mark.parametrize(
    ("name", "lever", "pin"),
    [
        ("slotted-lever", "lever", "crank"), ("pin_on_the_frame", "rod", "frame"), ("scotch_yoke", "yoke", "crank"),
        ("wedge", "slide", "block"),
    ],
)  # fmt: skip
def test_the_slot_is_as_long_as_the_way_of_its_pin(built, name, lever, pin):
    spec, poses, solids = built(name)
    joint = next(p for p in spec.joints if p.name in ("A", "S") and type(p).__name__ == "PinSlot")
    where = dict(zip(joint.links, joint.points, strict=True))
    local = {link.name: link.points for link in spec.links}[pin][where[pin]]
    (plate,) = parts_of(solids, lever, "plate")
    z = plate.bounds[:, 2].mean() / solids.size
    for shape, pose in zip(slices_of(solids, lever, _poses(poses, lever), z), _poses(poses, pin), strict=True):
        at = in_world(local, pose) / solids.size
        assert not shape.contains(shapely.Point(at))
        assert shape.convex_hull.contains(shapely.Point(at)), "the pin is inside the slot, not beside the lever"
        assert shape.distance(shapely.Point(at)) < 0.02


@pytest.mark.parametrize(
    ("name", "wheel", "edge", "radius"), [("rolling-wheel", "wheel", "frame", 60.0), ("rolling_on_an_arm", "wheel", "arm", 20.0)]
)
def test_a_wheel_stands_on_its_rail_all_the_way(built, name, wheel, edge, radius):
    _, poses, solids = built(name)
    z = layer_height(solids, wheel, ("plate",))
    disc, rail = (slices_of(solids, link, _poses(poses, link)[::4], z) for link in (wheel, edge))
    gap = shapely.distance(disc, rail) * solids.size * 1e3
    assert gap.min() > 0.0 and gap.max() < 0.02 * radius, gap
    low, high = solids.links[wheel].mesh.bounds[:, 0]
    assert 1e3 * (high - low) == pytest.approx(2.0 * radius, rel=0.03)


@pytest.mark.parametrize("name", ["rolling-wheel", "planetary-gear", "belt-drive", "rack-and-pinion"])
def test_round_parts_have_openings_by_which_their_turning_shows(built, name):
    spec, _, solids = built(name)
    for wheel in scale_mechanism(spec, None, 48).wheels.wheels:
        if wheel.kind == "ring":
            continue
        (part,) = parts_of(solids, wheel.link, "plate")[:1]
        mesh = part.copy()
        mesh.apply_scale(1.0 / solids.size)
        shape = section(mesh, mesh.bounds[:, 2].mean())
        holes = [shapely.Polygon(ring).centroid for ring in shape.interiors]
        away = [hole.distance(shapely.Point(np.array(wheel.centre))) for hole in holes]
        assert sum(distance > 0.2 * wheel.radius for distance in away) >= 3, wheel.link


def test_every_link_that_the_core_knows_has_a_solid(built):
    for name in ("excavator-arm", "planetary-gear", "belt-drive"):
        spec, _, solids = built(name)
        assert set(solids.links) == set(build_joints(spec).links)


def test_a_cylinder_whose_stroke_is_too_long_for_one_barrel_is_drawn_and_reported():
    b = scene("long stroke").link("frame", O=(0, 0), P=(50, 0)).link("boom", O=(0, 0), Q=(45, 0))
    b.revolute("O", "frame", "boom", drive={"oscillation": {"centre": 90, "amplitude": 80, "frequency": 1}})
    spec, poses = moved(b.cylinder("C", "frame", "boom", at=["P", "Q"]).scene().mechanism)
    solids = build_solids(spec, poses)
    check_shapes(solids, spec)
    rod, barrel = parts_of(solids, "C.rod", "rod")[0], parts_of(solids, "C.barrel", "barrel")[0]
    longest = max(np.hypot(*(poses["C.rod"] - poses["C.barrel"])[:, :2].T))
    assert longest + rod.bounds[0, 0] < barrel.bounds[1, 0], "the rod never leaves its barrel"
    assert any("C.rod" in joint for joint in solids.clashes)


def own_cylinder(order: tuple[str, str], driven: bool, **points: tuple[float, float]):
    """A boom on a cylinder made of two links and a sliding joint, in either order; ``points`` of the barrel beside its pin."""
    b = scene("own cylinder").link("frame", O=(0, 0), P=(200, -250)).link("boom", O=(0, 0), Q=(250, 60), E=(500, 0))
    b.link("barrel", P=(0, 0), **points).link("rod", Q=(0, 0), **{f"{name}r": (-x, y) for name, (x, y) in points.items()})
    swing: Mapping[str, Any] = {"oscillation": {"centre": 20, "amplitude": 15, "frequency": 1}}
    sign = 1 if order[0] == "barrel" else -1
    stroke: Mapping[str, Any] = {"oscillation": {"centre": sign * 340, "amplitude": 40, "frequency": 1}}
    b.revolute("O", "frame", "boom", **({} if driven else {"drive": swing})).revolute("P", "frame", "barrel")
    at = ["P", "Q"] if sign > 0 else ["Q", "P"]
    more: Mapping[str, Any] = {"drive": stroke} if driven else {"branch": "ahead" if sign > 0 else "behind"}
    b.revolute("Q", "boom", "rod").prismatic("S", *order, at=at, along=[1, 0], **more)
    if driven:
        b.sketch(boom={"at": [0, 0], "angle": 20}, barrel={"at": [200, -250], "angle": 90}, rod={"at": [210, 140], "angle": 90})
    return moved(b.scene().mechanism)


@pytest.mark.parametrize("points", [{}, {"K": (80, 0)}])
@pytest.mark.parametrize("driven", [False, True])
def test_a_cylinder_of_ones_own_is_drawn_as_one_whichever_link_is_named_first(points, driven):
    drawn = []
    for order in (("barrel", "rod"), ("rod", "barrel")):
        spec, poses = own_cylinder(order, driven, **points)
        solids = build_solids(spec, poses)
        check_shapes(solids, spec)
        assert not solids.clashes
        (barrel,), (rod,) = parts_of(solids, "barrel", "barrel"), parts_of(solids, "rod", "rod")
        drawn.append(barrel.bounds)
        apart = np.hypot(*(poses["rod"] - poses["barrel"])[:, :2].T)
        assert (apart + rod.bounds[0, 0] < barrel.bounds[1, 0]).all(), "the rod never leaves its barrel"
        assert barrel.bounds[1, 0] < apart.min(), "the barrel ends before the rod's pin"
    assert np.allclose(drawn[0], drawn[1])


def test_a_block_on_a_lever_is_no_cylinder(built):
    for name in ("coriolis-lever", "shaper-quick-return", "contour-lever"):
        _, _, solids = built(name)
        assert "block" in solids.links["block"].kinds and not {"barrel", "rod"} & set(solids.links["lever"].kinds), name


def test_a_slider_on_two_guides_is_one_piece(built):
    """A plate joins its two blocks by necks."""
    _, _, solids = built("two-guides")
    assert [solids.links["slider"].kinds.count(kind) for kind in ("block", "neck", "plate")] == [2, 2, 1]
    (plate,) = parts_of(solids, "slider", "plate")
    for block in parts_of(solids, "slider", "block"):
        middle = block.bounds.mean(axis=0)[:2]
        assert (plate.bounds[0, :2] < middle).all() and (middle < plate.bounds[1, :2]).all()


@pytest.mark.parametrize(("count", "edges"), [(1, 0), (60, 40), (900, 800), (900, 3000)])
def test_components_are_numbered_as_scipy_numbers_them(count, edges):
    first, second = np.random.default_rng(edges).integers(0, count, (2, edges))
    graph = coo_matrix((np.ones(edges), (first, second)), shape=(count, count))
    assert np.array_equal(components(count, first, second), connected_components(graph, directed=False)[1])
