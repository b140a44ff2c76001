"""Solids of links that no drawing can hold are refused by name, not by a fault of the geometry."""

from __future__ import annotations

import pytest
from shapely.geometry import Point

from mechcore.errors import MechanismError
from mechviz.meshes.outline import MOST_RIBS, hatched_bar, largest
from mechviz.meshes.solids import shaped
from mechviz.picture import build
from mechviz.picture.build import solids_of
from mechviz.runs import run_scene
from recordings import gallery_scene


@pytest.mark.parametrize(("name", "link", "point"), [("planetary-gear", "planet2", "Q"), ("valve-spring", "frame", "H")])
def test_wheels_and_springs_of_many_light_years_are_refused(name, link, point):
    run = run_scene(gallery_scene(name).changed({("links", link, "points", point): [0.0, 1e29]}), frames=8)
    with pytest.raises(MechanismError, match=r"the solids cannot be made: points lie farther than 1e\+12 m"):
        solids_of(run)


def test_a_figure_of_many_light_years_is_refused():
    scene = gallery_scene("pecking-bird")
    outline = [*scene.document.links["neck"].outline[1:], [1e29, 0.0]]
    run = run_scene(scene.changed({("links", "neck", "outline"): outline}), frames=8)
    with pytest.raises(MechanismError, match=r"the solids cannot be made: points lie farther than 1e\+12 m"):
        solids_of(run)


def test_a_link_of_many_light_years_is_named():
    scene = gallery_scene("rack-and-pinion")
    x, _ = scene.document.links["rack"].points["R"]
    run = run_scene(scene.changed({("links", "rack", "points", "R"): [x, 1e29]}), frames=8)
    with pytest.raises(MechanismError, match="the solids cannot be made") as error:
        solids_of(run)
    assert error.value.faults[0].remedy


def test_a_centre_of_mass_and_a_motion_of_many_light_years_are_named(monkeypatch):
    far = gallery_scene("kinetostatic-four-bar").changed({("links", "rocker", "centre"): [5e12, 0.0]})
    with pytest.raises(MechanismError, match=r"links.rocker: .* points lie farther than 1e\+12 m away, one 5e\+12 m"):
        solids_of(run_scene(far, frames=8))
    monkeypatch.setattr(build, "FARTHEST_POINT", 0.2)
    with pytest.raises(MechanismError, match=r"links.rocker: it goes as far as 0.28 m away; up to 0.2 m are drawn"):
        solids_of(run_scene(gallery_scene("kinetostatic-four-bar"), frames=8))


def test_a_rack_with_thousands_of_teeth_is_refused_with_their_number():
    run = run_scene(gallery_scene("rack-and-pinion").changed({("links", "rack", "points", "E"): [160_000.0, 0.0]}), frames=8)
    with pytest.raises(MechanismError, match=r"its rack would have 12,7.. teeth, more than 1,000"):
        solids_of(run)


def test_the_ribs_of_a_long_rail_are_as_many_as_can_be_seen():
    ribs = [hatched_bar((0.0, 0.0), (length, 0.0), 1.0, thickness=0.5) for length in (900.0, 1e6)]
    assert [shape.geom_type for shape in ribs] == ["Polygon", "Polygon"]
    few, many = (len(shape.exterior.coords) for shape in ribs)
    assert 3000 < few < 1.1 * 4 * 900 / 0.95 and many < 1.1 * 4 * MOST_RIBS


def test_a_part_of_which_nothing_is_left_is_a_message():
    mechanism = run_scene(gallery_scene("crank-rocker"), frames=8).motion.mechanism
    with pytest.raises(MechanismError, match=r"nothing is left of the outline of a part; this link is .* long"), shaped(mechanism):
        largest(Point(0.0, 0.0).buffer(1.0).difference(Point(0.0, 0.0).buffer(2.0)))


def test_a_cam_whose_flank_is_lost_in_rounding_is_refused_without_a_warning():
    """Its arm is a million kilometres long: numbers of the flank are divided by zero."""
    scene = gallery_scene("cam-barrel-arm")
    _, y = scene.document.links["arm"].points["P"]
    run = run_scene(scene.changed({("links", "arm", "points", "P"): [1e12, y]}), frames=8)
    with pytest.raises(MechanismError, match=r"links\.arm: the solids cannot be made"):
        solids_of(run)


def test_a_lift_of_many_light_hours_is_refused():
    scene = gallery_scene("cam-constant-acceleration-general")
    lift = [scene.document.joints["K"].profile.lift[0].model_copy(update={"to": 1e17}), scene.document.joints["K"].profile.lift[1]]
    run = run_scene(scene.changed({("joints", "K", "profile", "lift"): lift}), frames=8)
    with pytest.raises(MechanismError, match=r"joints\.K: .* its profile reaches 1e\+14 m"):
        solids_of(run)
