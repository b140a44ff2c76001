"""Fixtures of springs and stops: where they stand, and that no link runs into them; flywheels, fans and spindles."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
import shapely

from mechcore.spec.loads import Spring
from mechviz import scene
from mechviz.meshes.extrude import Shell
from mechviz.meshes.model import world_points
from mechviz.meshes.solids import Solid, Solids
from mechviz.picture.base import BASE_COLOR
from mechviz.picture.build import picture_of, solids_of
from mechviz.picture.fixtures import find_fixtures
from mechviz.picture.nodes import Mesh, Picture
from mechviz.picture.springs import find_coils
from mechviz.runs import Run, run_scene
from mechviz.scene.faults import SceneError


@cache
def shown(name: str, frames: int = 120) -> tuple[Run, Solids, Picture]:
    run = run_scene(scene.load(name), frames=frames)
    solids = solids_of(run)
    return run, solids, picture_of(run, solids)


def outline(mesh: Mesh) -> shapely.Polygon:
    """What of a plane is covered by a mesh, seen from the front."""
    return shapely.union_all(shapely.buffer(shapely.polygons(mesh.vertices[mesh.faces][:, :, :2].astype(float)), 1e-9))


def standing(run: Run, picture: Picture) -> list[Mesh]:
    """What is fixed to the ground, but the bars and posts that bear it."""
    return [mesh for mesh in picture.fixtures[run.motion.mechanism.frame] if tuple(mesh.colors[0]) != BASE_COLOR[:3]]


@pytest.mark.sample(3)
@pytest.mark.parametrize(
    "name", ["cam-roller", "valve-train", "valve-spring", "toggle-press-stop", "lifted-boom", "shaper-quick-return"]
)
def test_no_link_runs_into_what_stands_on_the_ground(name):
    run, solids, picture = shown(name)
    frame = run.motion.mechanism.frame
    standing = [(outline(mesh), mesh.vertices[:, 2]) for mesh in picture.fixtures[frame]]
    assert standing
    for link, poses in picture.poses.items():
        for shape, low, high in solids.heights.flat_outlines(link) if link != frame else ():
            for fixed, z in standing:
                if low < z.max() and high > z.min():
                    ring = np.asarray(shape.exterior.coords)
                    moved = shapely.polygons(world_points(ring, poses[::3]))
                    assert not shapely.intersects(fixed.buffer(-1e-6 * solids.size), moved).any(), (name, link)


@pytest.mark.sample(3)
@pytest.mark.parametrize("name", ["stephenson-six-bar", "slider-crank-compressor", "valve-train", "word-writer", "trip-hammer"])
def test_all_that_stands_on_the_ground_hangs_together(name):
    """From each part of the ground others that it touches lead to every other one."""
    run, solids, picture = shown(name)
    frame = run.motion.mechanism.frame
    whole = [(outline(mesh), mesh.vertices[:, 2].min(), mesh.vertices[:, 2].max()) for mesh in picture.fixtures[frame]]
    whole += [part for parts in solids.heights.parts(frame, ("pedestal", "rail")) for part in parts]
    near = 1e-3 * solids.size
    result, left = [whole[0]], whole[1:]
    while touching := [
        part
        for part in left
        if any(part[1] < high + near and part[2] > low - near and part[0].distance(shape) < near for shape, low, high in result)
    ]:
        result += touching
        left = [part for part in left if not any(part is other for other in touching)]
    assert not left
    assert min(low for _, low, _ in whole) < float(solids.bounds[0, 2]), "the bars lie behind all links"


@pytest.mark.parametrize("name", ["word-writer", "theatre", "cam-conjugate"])
def test_one_shaft_goes_through_all_cams_that_turn_on_it(name):
    run, solids, _ = shown(name)
    joint = next(joint for joint in run.motion.mechanism.joints if joint.name == "O")
    cam = next(link for link in joint.links if link != run.motion.mechanism.frame)
    shaft = [(low, high) for parts in solids.heights.parts(cam, ("pin",)) for _, low, high in parts]
    cams = [(low, high) for parts in solids.heights.parts(cam, ("plate", "wheel")) for _, low, high in parts[:1]]
    assert len(cams) > 1
    assert min(shaft)[0] <= min(cams)[0] and max(high for _, high in shaft) >= max(high for _, high in cams)


@pytest.mark.parametrize("name", ["cam-roller", "valve-spring"])
def test_a_seat_of_the_ground_lies_beyond_the_end_of_its_spring_and_across_it(name):
    run, solids, picture = shown(name)
    spring = next(load for load in run.motion.mechanism.loads if isinstance(load, Spring))
    end = spring.links.index(run.motion.mechanism.frame)
    at, other = (run.motion.point(spring.links[k], spring.points[k])[0] for k in (end, 1 - end))
    into = (other - at) / np.hypot(*(other - at))
    ground = [mesh.vertices[:, :2] - at for mesh in standing(run, picture)]
    reach = np.concatenate(ground) @ into
    assert reach.max() == pytest.approx(0.0, abs=1e-6 * solids.size) and reach.min() < -0.005 * solids.size
    face = np.concatenate([xy[np.abs(xy @ into) < 1e-6 * solids.size] for xy in ground])
    assert np.ptp(face @ [-into[1], into[0]]) > 0.04 * solids.size


def test_a_hammer_rests_on_its_anvil():
    """At the angle of its stop the lever touches the anvil, and one degree further it would be inside."""
    run, solids, picture = shown("trip-hammer")
    (anvil,) = (outline(mesh) for mesh in standing(run, picture))
    lever = shapely.union_all([shape for shape, _, _ in solids.heights.flat_outlines("hammer")])

    def turned(degrees: float) -> shapely.Polygon:
        return shapely.affinity.rotate(lever, degrees, origin=(0.0, 0.0))

    assert 0.0 < anvil.distance(turned(0.0)) < 2e-3 * solids.size
    assert anvil.intersects(turned(-1.0)) and not anvil.intersects(turned(1.0))


def test_a_spring_that_is_pressed_has_a_washer_on_its_link_and_one_that_hangs_has_none():
    assert {"frame", "follower"} <= set(shown("cam-roller")[2].fixtures)
    assert set(shown("toggle-press-stop")[2].fixtures) == {"frame"}


def test_a_flywheel_and_a_fan_turn_with_their_link_behind_everything():
    run, solids, picture = shown("engine-start-up")
    wheel, fan, shaft = picture.fixtures["crank"]
    spec = next(link for link in run.motion.mechanism.links if link.name == "crank")
    radius = np.hypot(*wheel.vertices[:, :2].T).max()
    assert radius == pytest.approx(1.1 * np.sqrt(spec.inertia / spec.mass), rel=1e-4)  # about A, the origin
    assert np.hypot(*fan.vertices[:, :2].T).max() < radius
    assert max(mesh.vertices[:, 2].max() for mesh in (wheel, fan)) < solids.bounds[0, 2]
    assert shaft.vertices[:, 2].max() == pytest.approx(solids.bounds[0, 2], rel=1e-6)
    at = run.motion.joint_position("A")[0]
    assert (picture.bounds[0, :2] <= at - 0.999 * radius).all() and (picture.bounds[1, :2] >= at + 0.999 * radius).all()
    assert set(find_fixtures(*shown("kinetostatic-four-bar")[:2], [])) == {"frame"}, "no wheels where none are named"


def test_a_spindle_guides_its_sleeve_instead_of_rails():
    _, solids, _ = shown("flyball-governor")
    assert "rail" not in solids.links["frame"].kinds and "rod" in solids.links["frame"].kinds and not solids.clashes


def test_a_screw_has_its_spindle_between_the_rails():
    """As long as the nut travels, from the bearing on; its thread has the lead."""
    run, solids, _ = shown("screw-jack")
    kinds = solids.links["frame"].kinds
    assert {"rod", "rail", "block"} <= set(kinds) and not solids.clashes
    nut = run.motion.joint_position("S.slide")[:, 0]
    vertices = solids.links["frame"].vertices
    x = np.unique(vertices[np.abs(vertices[:, 1] + 0.02) < 1e-6, 0].round(6))  # on the spindle, in the plane through its axis
    assert x[0] < 0.1 and x[-1] > nut.max()
    crests = x[(x > 0.13) & (x < nut.max())]
    assert np.median(np.diff(crests)) == pytest.approx(0.0025, rel=0.05), "a crest and a root in each lead of 5 mm"


def test_a_nut_is_bored_for_its_spindle_and_its_pin_ends_on_its_face():
    _, solids, _ = shown("screw-jack")
    frame, nut = solids.links["frame"], solids.links["nut"]
    spindle = frame.shells[frame.kinds.index("rod")].vertices
    axis = 0.5 * (spindle.min(axis=0) + spindle.max(axis=0))[1:]
    crest = np.hypot(*(spindle[:, 1:] - axis).T).max()
    (body,) = (shell for shell, kind in _parts(nut) if kind == "block")
    away = np.hypot(body.vertices[:, 1], body.vertices[:, 2] - axis[1])  # the nut's own axes lie on the spindle's
    assert crest < away.min() < 1.1 * crest
    hollow = nut.parts[nut.kinds.index("block")]
    size = np.ptp(body.vertices, axis=0)
    assert hollow.is_watertight
    assert hollow.volume == pytest.approx(size[0] * (size[1] * size[2] - np.pi * away.min() ** 2), rel=3e-3)
    at = [shell.vertices for link in ("nut", "rod") for shell, kind in _parts(solids.links[link]) if kind == "pin"]
    assert min(vertices[:, 2].min() for vertices in at) > axis[1] + crest


def _parts(solid: Solid) -> list[tuple[Shell, str]]:
    return list(zip(solid.shells, solid.kinds, strict=True))


@pytest.mark.parametrize(
    ("link", "looks", "why"),
    [
        ("coupler", "flywheel", "turns on a shaft in the ground; this link has none"),
        ("crank", "spindle", "is of the fixed link"),
        ("frame", ["fan"], "is on the shaft of a moving link"),
        ("crank", "fly-wheel", "flywheel"),
    ],
)
def test_what_cannot_be_drawn_is_refused_at_its_link(link, looks, why):
    document = scene.load("kinetostatic-four-bar").document.model_dump(exclude_defaults=True)
    document["links"][link]["looks"] = looks
    with pytest.raises(SceneError) as error:
        scene.Scene.build(name="named", **document)
    assert f"links.{link}.looks" in str(error.value) and why in str(error.value)


def test_coils_of_one_place_share_a_bracket():
    run, solids, picture = shown("lifted-boom")
    assert len(standing(run, picture)) == 3  # two stops, and one bracket of the gas spring and its damper
    assert find_coils(run, solids) == []
