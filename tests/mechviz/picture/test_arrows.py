"""Arrows and arcs that would lie on each other stand apart, in a run as in its recording; loads are drawn where they act."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mechviz.picture.build import picture_of
from mechviz.picture.nodes import Arrow, Body, MomentArc
from mechviz.picture.proportions import ARROW_HEAD_RADIUS
from mechviz.quantities import tables
from recordings import made, ran, solids

FRAMES = 24


def test_arrows_along_one_line_are_apart_in_recordings():
    m = made("cam-friction", FRAMES)
    picture = picture_of(m.run, m.solids)
    arrow = next(a for a in picture.nodes_of(Arrow, "friction") if a.vector.item == "K")
    rows = m.recording.rows("vectors", "friction", "K", component="Arrows3D:origins")
    shown = rows.lengths.astype(bool)
    away = rows.values[:, :2] - arrow.vector.origin[shown]
    along = arrow.vector.value[shown] / np.hypot(*arrow.vector.value[shown].T)[:, None]
    assert np.abs((away * along).sum(axis=1)).max() < 1e-6 * picture.size, "beside its own place, across the line"
    assert np.hypot(*away.T).min() > 0.9 * abs(arrow.offset) > 0.01 * picture.size
    assert np.all(rows.values[:, 2] == np.float32(arrow.height))


def test_forces_from_two_places_that_lie_on_each_other_are_drawn_side_by_side():
    """A spring pushes along the line of the joint's force, from a seat below it."""
    m = made("valve-spring", FRAMES)
    picture = picture_of(m.run, m.solids)
    spring, joint = (next(a for a in picture.nodes_of(Arrow) if a.key == key) for key in ("applied.return_spring", "reaction.T"))
    away = np.abs(spring.vector.origin - joint.vector.origin)[:, 0]
    assert np.mean(away < 1e-9) > 0.5, "one line while the valve is shut"
    assert np.abs(spring.vector.origin - joint.vector.origin)[:, 1].min() > 0.01 * picture.size, "two places"
    assert abs(spring.offset - joint.offset) > 2.0 * ARROW_HEAD_RADIUS * picture.size, "and their heads have room, too"
    train = picture_of(ran("valve-train"), solids("valve-train"))
    arrows = {a.key: a for a in train.nodes_of(Arrow)}
    drawn = [arrows[key].origin[16, 0] for key in ("reaction.O", "applied.valve_spring", "inertia.valve")]  # all upright
    assert np.diff(np.sort(drawn)).min() > 2.0 * ARROW_HEAD_RADIUS * train.size, "one pushes up, one down, for a short while"
    cam = made("cam-roller", FRAMES)
    assert all(a.offset == 0.0 for a in picture_of(cam.run, cam.solids).nodes_of(Arrow, "reaction")), "through contact and bearing"


def test_couples_about_one_place_have_circles_of_their_own_behind_the_forces():
    m = made("belt-slip", FRAMES)
    picture = picture_of(m.run, m.solids)
    arcs = {f"{a.moment.family} {a.moment.item}": a for a in picture.nodes_of(MomentArc)}
    drive = arcs["drive A"]
    same = [a for a in arcs.values() if a is not drive and np.allclose(a.moment.origin, drive.moment.origin)]
    assert same and all(abs(a.radius - drive.radius) > 0.02 * picture.size for a in same)
    for arc in picture.nodes_of(MomentArc):
        assert all(a.height >= arc.height for a in picture.nodes_of(Arrow) if a.owner == arc.owner)


def test_the_force_of_a_spring_on_the_ground_is_drawn_on_the_link_that_it_pulls():
    m = made("toggle-press-stop", FRAMES)
    picture, motion = picture_of(m.run, m.solids), m.run.motion
    spring = next(load for load in motion.mechanism.loads if hasattr(load, "free_length"))
    ends = dict(zip(spring.links, spring.points, strict=True))
    assert spring.links[0] == motion.mechanism.frame
    arrow = next(a for a in picture.nodes_of(Arrow, "applied") if a.vector.item == spring.name)
    fixed, moved = (motion.point(link, point) for link, point in ends.items())
    np.testing.assert_allclose(arrow.vector.origin, moved, atol=1e-12)
    stretch = np.hypot(*(fixed - moved).T) - spring.free_length
    towards = ((fixed - moved) * arrow.vector.value).sum(axis=1)
    assert np.array_equal(np.sign(towards), np.sign(stretch)), "it pulls the link towards the ground where it is stretched"
    coil = next(b for b in picture.nodes_of(Body, "springs") if b.owner == ("load", spring.name))
    assert arrow.height > coil.height


@pytest.mark.parametrize("name", ["cam-friction", "slider-crank-compressor"])
def test_numbers_that_are_not_kept_make_the_same_tables_and_picture(name, monkeypatch):
    m = made(name, FRAMES)
    monkeypatch.setattr(tables, "MOST_KEPT", 0)
    thrifty = replace(m.run)  # has no numbers yet
    table = thrifty.numbers.tables["data", "joints", next(iter(thrifty.numbers.joints)), "reaction"]
    assert not thrifty.numbers.cached and table.values is not table.values, "else this run keeps what it computes"
    for path, kept in m.run.numbers.tables.items():
        np.testing.assert_array_equal(thrifty.numbers.tables[path].values, kept.values)
    picture, other = picture_of(m.run, m.solids), picture_of(thrifty, m.solids)
    assert picture.by_key.keys() == other.by_key.keys() and picture.scales == other.scales
    for arrow in picture.nodes_of(Arrow):
        twin = other.by_key[arrow.key]
        np.testing.assert_array_equal(twin.origin, arrow.origin)
        np.testing.assert_array_equal(twin.vector.value, arrow.vector.value)
    for arc in picture.nodes_of(MomentArc):
        np.testing.assert_array_equal(other.by_key[arc.key].moment.value, arc.moment.value)
