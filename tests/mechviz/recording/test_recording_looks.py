"""What a recording looks like when it is opened: where marks lie, legends, timelines, the frame that the viewer opens at."""

from __future__ import annotations

import numpy as np
import pytest

import mechviz
from mechcore.motion.events import Event
from mechviz.outputs.rerun.blueprint import (
    FIELD_OF_VIEW,
    PICTURE_ASPECT,
    calm_range,
    eye_on,
    legend_place,
    make_blueprint,
    opening_timeline,
    spans_of_plots,
)
from mechviz.outputs.rerun.content import ENTITY_FAMILIES, Content, EntityFamily, find_statics, find_streams
from mechviz.outputs.rerun.entities import Static, Stream, picture_stride
from mechviz.picture.build import picture_of, solids_of
from mechviz.picture.constructions import drawings_of
from mechviz.picture.nodes import Arrow
from mechviz.picture.overlays import overlay_box
from mechviz.picture.proportions import arrow_height, path_height
from mechviz.quantities.events import peak_events
from mechviz.quantities.tables import tables
from mechviz.quantities.vectors import round_value
from mechviz.runs import run_scene
from recordings import vectors_of


@pytest.fixture(scope="module")
def leg():
    return run_scene(mechviz.load("jansen-leg"), frames=61)


@pytest.fixture(scope="module")
def bar():
    return run_scene(mechviz.load("kinetostatic-four-bar"), frames=61)


def content_of(run):
    solids = solids_of(run)
    return Content(run, solids, tables(run), picture_of(run, solids), drawings_of(run, solids.size), picture_stride(run))


def test_marks_lie_on_the_part_that_they_belong_to_and_not_all_before_everything(leg):
    solids = solids_of(leg)
    heights = solids.heights
    for joint in leg.motion.mechanism.joints:
        z = heights.of_joint(joint.name)
        tops = [solids.links[link].mesh.vertices[:, 2].max() for link in joint.links]
        assert solids.bounds[0, 2] < z <= max(tops) + 0.05 * solids.size
        assert z <= solids.z_top
    assert len({round(heights.of_joint(p.name), 6) for p in leg.motion.mechanism.joints}) > 1, "pins end at different layers"
    link, point = leg.motion.mechanism.traced[0]
    assert path_height(leg, heights, link, point) >= solids.links[link].mesh.vertices[:, 2].min()


def test_a_run_far_shorter_than_a_cycle_has_all_its_pictures():
    run = run_scene(mechviz.load("stribeck-block").changed({("joints", "R", "drive", "travel"): 1e29}), frames=60)
    assert run.motion.mechanism.cycle > 1e20 * np.ptp(run.motion.time) and picture_stride(run) == 1


def test_no_part_lies_before_an_arrow(bar):
    """Checked with the meshes themselves: rays towards the viewer from points of the arrow meet nothing."""
    content = content_of(bar)
    solids, scale = content.solids, content.picture.scales.newtons_per_metre
    count = len(next(iter(solids.heights.poses.values())))
    for vector in vectors_of(bar)[0]["reaction"].values():
        z = arrow_height(bar, solids.heights, vector, scale)
        for frame in (0, count // 2, count - 1):  # among the frames that are looked at
            along = np.linspace(0.05, 0.95, 7)[:, None]
            xy = vector.origin[frame] + along * vector.value[frame] / scale
            for link, solid in solids.links.items():
                x, y, angle = bar.motion.pose(link)[frame]
                c, s = np.cos(angle), np.sin(angle)
                local = (xy - [x, y]) @ np.array([[c, -s], [s, c]])
                assert not covered(solid.mesh.triangles, local, z), (vector.item, link, frame)


def covered(triangles, points, z):
    """Whether a triangle (n, 3, 3) before the height z lies over one of the points (m, 2)."""
    a, b, c = np.moveaxis(triangles[triangles[:, :, 2].min(axis=1) > z][:, :, :2], 1, 0)

    def side(p, q):
        along, away = (q - p)[:, None], points[None] - p[:, None]
        return along[..., 0] * away[..., 1] - along[..., 1] * away[..., 0]

    d = [side(a, b), side(b, c), side(c, a)]
    return bool(np.any(np.all(np.array(d) > 0.0, axis=0) | np.all(np.array(d) < 0.0, axis=0)))


def test_deep_stacks_are_drawn_thinner(leg):
    solids = solids_of(leg)
    depth = solids.bounds[1, 2] - solids.bounds[0, 2]
    assert depth < 0.2 * solids.size
    assert all(part.is_volume for solid in solids.links.values() for part in solid.parts)


@pytest.mark.parametrize("peak", [0.1, 0.5, 0.9])
def test_a_legend_hides_no_curve(peak):
    x = np.linspace(0.0, 1.0, 501)
    values = np.column_stack([np.exp(-(((x - peak) / 0.1) ** 2)), -np.cos(2 * np.pi * x), np.sin(9.0 * x)])
    corner, (low, high) = legend_place(x, values)
    assert low < values.min() and high > values.max()
    near = x >= 0.7 if corner.startswith("Right") else x <= 0.3
    room = (0.04 + 0.085 * 3) * (high - low)
    inside = values[near] > high - room + 1e-9 if corner.endswith("Top") else values[near] < low + room - 1e-9
    assert not inside.any()


def test_legends_of_empty_and_constant_curves():
    assert legend_place(np.arange(3.0), np.full((3, 2), np.nan))[1] == (-1.0, 1.0)
    low, high = legend_place(np.arange(3.0), np.full((3, 2), 4.0))[1]
    assert low < 4.0 < high


def test_a_drive_with_zones_opens_on_its_angle_and_others_on_time():
    assert opening_timeline(run_scene(mechviz.load("contour-lever"), frames=31)) == "drive_mdeg"
    assert opening_timeline(run_scene(mechviz.load("crank-rocker"), frames=31)) == "time"
    assert opening_timeline(run_scene(mechviz.load("five-bar"), frames=31)) == "time"  # it goes to and fro


def test_the_legend_has_every_family_that_is_drawn_and_its_arrows_are_to_scale(bar):
    content = content_of(bar)
    statics = {s.path: s.archetype for s in find_statics(content)}
    drawn = {arrow.group for arrow in content.picture.nodes_of(Arrow)}
    for family in drawn:
        view = "motion" if family in ("velocity", "acceleration") else "forces"
        arrow = statics[f"/legend/{view}/{family}"]
        length = float(np.linalg.norm(arrow.vectors.as_arrow_array().to_pylist()[0]))
        label = statics[f"/legend/{view}/{family}/label"].labels.as_arrow_array().to_pylist()[0]
        value = float(label.split(": ")[1].split()[0])
        assert length * content.picture.scales.per_metre(family) == pytest.approx(value, rel=1e-5)
        assert round_value(value) == pytest.approx(value)


def test_a_family_is_one_entry_of_the_registry(bar, monkeypatch):
    more = EntityFamily("mine", streams=lambda c: [Stream("/mine", lambda frames: None)], statics=lambda c: [Static("/mine", None)])
    monkeypatch.setattr("mechviz.outputs.rerun.content.ENTITY_FAMILIES", (*ENTITY_FAMILIES, more))
    content = content_of(bar)
    assert find_streams(content)[-1].path == "/mine" == find_statics(content)[-1].path


@pytest.mark.parametrize("name", ["slider-crank-compressor", "slider-crank-engine"])
def test_the_viewer_opens_away_from_dead_centres_at_a_large_load(name):
    run = run_scene(mechviz.load(name))
    frame, forces = run.catalogue.opening_frame, run.forces
    assert forces is not None
    drive = run.motion.mechanism.drives[0].joint
    angle = float(np.degrees(run.motion.coordinate(drive)[frame, 0]) % 180.0)
    assert min(angle, 180.0 - angle) > 5.0
    largest = np.max([np.hypot(*forces.reaction(p.name)[:, :2].T) for p in run.motion.mechanism.joints], axis=0)
    assert largest[frame] > 0.4 * largest.max()


def test_a_kinematic_run_opens_an_eighth_of_a_cycle_in(leg):
    turned = np.ptp(leg.motion.coordinate(leg.motion.mechanism.drives[0].joint)[[0, leg.catalogue.opening_frame], 0])
    assert np.degrees(turned) == pytest.approx(45.0, abs=6.0)


def test_the_legend_names_only_what_is_drawn_at_some_frame():
    """In uniform translation nothing is; in rotation about the centre of mass moments alone, which have no value in newtons."""

    def entries(name):
        statics = {s.path: s.archetype for s in find_statics(content_of(run_scene(mechviz.load(name), frames=24)))}
        labels = {path: a.labels.as_arrow_array().to_pylist()[0] for path, a in statics.items() if path.endswith("/label")}
        return {path.split("/")[3]: text for path, text in labels.items() if path.startswith("/legend/forces/")}

    assert entries("inertia-uniform-translation") == {}
    assert entries("inertia-rotation-about-centre") == {"inertia": "Inertia", "drive": "Drive"}
    assert set(entries("inertia-translation")) == {"reaction", "inertia", "drive"}
    assert entries("inertia-translation")["reaction"] == "Reactions", "its guide has a couple only"


def test_springs_are_in_the_picture():
    run = run_scene(mechviz.load("cam-sine-acceleration"), frames=24)
    box = overlay_box(run, solids_of(run))
    assert box[1, 1] >= run.motion.point("frame", "H")[:, 1].max() - 1e-12 > solids_of(run).bounds[1, 1]


def test_plots_of_rounding_show_a_calm_axis():
    """An arm at constant speed: its reaction is constant and its torque zero, but for rounding that would fill the plots."""
    run = run_scene(mechviz.load("inertia-uniform-rotation"), frames=60)
    spans = spans_of_plots(run)
    assert spans["Driving torque [N m]"] == (-1.0, 1.0)
    low, high = next(v for k, v in spans.items() if k.startswith("Joint reactions"))
    size = np.hypot(*run.forces.reaction("A")[0, :2])
    assert (low, high) == pytest.approx((0.9 * size, 1.1 * size))
    assert not [e for e in peak_events(run) if "driving torque" in e.text] and [e for e in peak_events(run) if "reaction" in e.text]
    assert calm_range(np.array([[1.0], [1.5]]), 0.0) is None and calm_range(np.array([[np.nan]]), 0.0) is None


def test_where_nothing_happens_the_notes_are_open(leg):
    """Else the events: health is a line along zero."""
    import rerun.blueprint as rrb

    def open_tab(events):
        bounds = dict.fromkeys(("forces", "motion"), np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 0.1]]))
        left = make_blueprint(leg, bounds, events).root_container.contents[0]
        tabs = next(part for part in left.contents if isinstance(part, rrb.Tabs) and part.contents[-1].name == "Notes")
        return tabs.contents[tabs.active_tab].name

    assert open_tab([]) == "Notes"
    assert open_tab([Event(0.1, "INFO", "A", "dead point")]) == "Events"


def test_a_figure_has_most_of_the_room():
    """Of a scene without marks: plots, events, health and notes stand in one narrow column."""
    import rerun.blueprint as rrb

    run = run_scene(mechviz.load("pecking-bird"), frames=12)
    bounds = dict.fromkeys(("forces", "motion"), np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 0.1]]))
    body = make_blueprint(run, bounds, []).root_container
    assert isinstance(body, rrb.Horizontal) and body.column_shares == [3, 1]
    assert body.contents[0].name == "Mechanism"
    assert body.contents[1].contents[-1].contents[-1].name == "Notes"


def test_what_is_deep_is_seen_at_an_angle_and_all_of_it():
    """The pin hole camera's projection of the corners of a box that is as deep as it is high, by homogeneous coordinates."""
    box = np.array([[0.1, -0.2, 0.0], [0.4, 0.2, 0.4]])
    eye, target = eye_on(box)
    away = (eye - target) / np.linalg.norm(eye - target)
    assert np.degrees(np.arccos(away[2])) > 30.0
    right = np.cross([0.0, 1.0, 0.0], away) / np.hypot(away[0], away[2])
    camera = np.stack([right, np.cross(away, right), away])
    corners = np.array(np.meshgrid(*box.T)).reshape(3, -1).T
    x, y, z = camera @ (corners - eye).T
    seen = np.abs(np.stack([x / PICTURE_ASPECT, y]) / -z) / np.tan(0.5 * FIELD_OF_VIEW)
    assert 0.85 < seen.max() < 1.0
    flat, ahead = eye_on(np.array([[0.1, -0.2, 0.0], [0.4, 0.2, 0.1]]))
    assert flat[0] == ahead[0]
