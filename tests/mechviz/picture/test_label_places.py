"""Labels of drawings in the viewer: none over another, none far from what it names."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

import mechviz
from mechviz.outputs.viewer.world.labels import LabelPlacer, corners, half_sizes
from mechviz.outputs.viewer.world.marks import joint_groups
from mechviz.picture.constructions import drawings_of
from mechviz.runs import run_scene

PIXEL = 1.0 / 300.0  # a mechanism of the size 1 m in 300 pixels


def overlaps(places, halves) -> int:
    boxes = [(z, h) for z, h in zip(places, halves, strict=True) if np.isfinite(z)]
    return sum(
        bool(abs((a - b).real) < 0.999 * (g + h)[0] and abs((a - b).imag) < 0.999 * (g + h)[1])
        for (a, g), (b, h) in itertools.combinations(boxes, 2)
    )


@pytest.mark.parametrize("name", ["plans-four-bar", "cam-equivalent", "coriolis-lever"])
def test_labels_of_small_plans_do_not_hide_each_other(name):
    """At all frames, for plans in 300 pixels; in their middles, where they would stand otherwise, many do."""
    run = run_scene(mechviz.load(name), frames=40)
    drawings = drawings_of(run, 1.0)
    assert drawings
    plain = left = 0
    for drawing in drawings.values():
        named = [i for i in drawing.arrows if i.label]
        halves = half_sizes([i.label for i in named], PIXEL), half_sizes([m.label for m in drawing.points], PIXEL)
        stand = LabelPlacer(*halves, 3.0 * PIXEL)
        starts, vectors = (np.array([getattr(i, key) for i in named]) for key in ("start", "vector"))
        marks = np.array([m.position for m in drawing.points])
        for f in range(run.motion.frames):
            shown = np.where(np.abs(vectors[:, f]) >= 0.035, starts[:, f], np.nan)
            sides, points = stand(shown, vectors[:, f], marks[:, f])
            assert (np.isfinite(sides) == np.isfinite(shown)).all() and (np.isfinite(points) == np.isfinite(marks[:, f])).all()
            every = np.concatenate(halves)
            left += overlaps(np.concatenate([sides, points]), every)
            plain += overlaps(np.concatenate([shown + 0.5 * vectors[:, f], marks[:, f]]), every)
            near = np.abs(sides - (shown + 0.5 * vectors[:, f]))
            assert np.nanmax(near, initial=0.0) < 0.6
    assert plain > 20 and left <= 0.03 * plain


def test_a_label_stays_where_it_is_while_the_place_is_free():
    stand = LabelPlacer(half_sizes(["v_B"], PIXEL), half_sizes(["b"], PIXEL), 0.01)
    vector = np.array([1.0 + 0.0j])
    first, _ = stand(np.zeros(1, complex), vector, vector)
    for turn in np.linspace(0.0, 0.5, 20):
        sides, points = stand(np.zeros(1, complex), vector * np.exp(1j * turn), vector * np.exp(1j * turn))
        assert abs(sides[0] - first[0] * np.exp(1j * turn)) < 0.06 and abs(points[0]) > 1.0


def test_between_two_lines_a_label_stands_nearer_to_its_own():
    starts, vectors = np.zeros(2, complex), np.array([1.0 + 1.0j, 1.2 + 0.9j])
    stand = LabelPlacer(half_sizes(["a_T", "a_D"], PIXEL), np.zeros((0, 2)), 0.01)
    sides, _ = stand(starts, vectors, np.zeros(0, complex))
    for own, other in ((0, 1), (1, 0)):
        distance = [abs(np.imag(np.conj(v / abs(v)) * sides[own])) for v in (vectors[own], vectors[other])]
        assert distance[0] < distance[1]


def test_nothing_finite_nothing_placed():
    stand = LabelPlacer(half_sizes(["a"], PIXEL), half_sizes(["b"], PIXEL), 0.01)
    sides, points = stand(np.array([np.nan + 0j]), np.array([1.0 + 0j]), np.array([np.nan + 0j]))
    assert np.isnan(sides).all() and np.isnan(points).all()


def test_names_of_near_joints_stand_at_corners_where_they_hide_each_other_least():
    """At the crank of the theatre five joints lie together, of which cams carry three about."""
    run = run_scene(mechviz.load("theatre"), frames=60)
    groups = joint_groups({j.name: run.motion.joint_position(j.name) for j in run.motion.mechanism.joints}, 1e-6)
    places = np.array([xyz[:, 0] + 1j * xyz[:, 1] for _, xyz in groups])
    gap, halves = 0.008, half_sizes([", ".join(names) for names, _ in groups], 0.45 / 600.0)  # as in the viewer

    def hidden(sides) -> float:
        offsets = (np.array(sides) * (gap + halves)) @ np.array([1.0, 1j])
        return float(np.mean([overlaps(z, halves) for z in (places + offsets[:, None]).T]))

    assert hidden(corners(places, halves, gap)) < 0.2 < 2.0 < hidden([(1, 1)] * len(groups))
    assert corners(places[:1], halves[:1], gap) == [(1, 1)], "with room enough, above on the right"
