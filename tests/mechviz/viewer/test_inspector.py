"""Editing in the viewer, without a browser: what can be edited, undo, limits, solids that follow, the health strip."""

from __future__ import annotations

import re
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import trimesh
from patience import PATIENCE
from retold import retold

from mechcore.accuracy import Accuracy
from mechcore.laws.catalogue import RISES
from mechcore.motion.events import Event
from mechviz import scene
from mechviz.editor.history import Draft, History
from mechviz.editor.parameters import find_choices, find_parameters
from mechviz.editor.worker import LatestRequestWorker, assembles, feasible_range
from mechviz.outputs.drawings import Diagram as Chart
from mechviz.outputs.rerun.reader import Recording
from mechviz.outputs.rerun.writer import write_recording
from mechviz.outputs.viewer import words
from mechviz.outputs.viewer.app import Viewer
from mechviz.outputs.viewer.build import Built, build, solid_inputs, view_model_of_recording, view_model_of_run
from mechviz.outputs.viewer.panels import charts
from mechviz.outputs.viewer.panels.diagrams import diagram_svg, diagrams_of
from mechviz.outputs.viewer.panels.saving import file_name
from mechviz.outputs.viewer.panels.timeline import health_svg, shade, worst_in_columns
from mechviz.outputs.viewer.server import ViewerError
from mechviz.outputs.viewer.session import Contribution, EditSession, Status
from mechviz.outputs.viewer.view_model import ColoredPart, LinkSolid
from mechviz.outputs.viewer.viser_adapter import buffer_of
from mechviz.outputs.viewer.world.camera import VIEW_PRESETS, first_preset, fit_view
from mechviz.outputs.viewer.world.constructions import OVERLAY_GROUPS
from mechviz.outputs.viewer.world.handles import Pivots, traced_at, with_traced
from mechviz.outputs.viewer.world.solids import sectioned
from mechviz.outputs.viewer.world.warp import stretched, warped, warped_body
from mechviz.picture.build import picture_of, solids_of
from mechviz.picture.nodes import Body as BodyNode
from mechviz.quantities.catalogue import Health
from mechviz.runs import run_scene
from mechviz.scene.document import value_at, with_values
from mechviz.scene.units import MILLIMETRES
from recordings import gallery_scene


# -- dragging ---------------------------------------------------------------------------------------------------------
def test_while_dragging_the_picture_is_sent_first_and_plots_follow_at_the_latest_when_it_rests(monkeypatch):
    with Viewer(run_scene(scene.load("crank-rocker"), frames=24), port=0) as viewer:
        inspector, session = viewer.inspector, viewer.session
        assert session.wait(until_idle=True)
        shows = [
            view_model_of_run(run_scene(scene.load("crank-rocker"), frames=24), session._built, session.view_model)
            for _ in range(4)
        ]
        done: list[str] = []
        for owner, name in ((inspector.scene, "show"), (viewer.server, "flush"), (inspector.plots, "update")):
            real = getattr(owner, name)
            monkeypatch.setattr(owner, name, lambda *a, _r=real, _n=name: (done.append(_n), _r(*a)))
        inspector.present(shows[0])
        assert done == ["show", "flush", "update", "flush"], "the picture is on its way before the plots are made"
        monkeypatch.setattr(EditSession, "is_superseded", property(lambda _: True))
        monkeypatch.setattr("mechviz.outputs.viewer.inspector.PLOT_INTERVAL", 1e9)
        done.clear()
        for view_model in shows[1:]:
            inspector.present(view_model)
        assert done == ["show", "flush"] * 3, "the next value of the slider waits already"
        inspector.settle()
        assert done.count("update") == 1 and inspector.view_model is shows[3]


def test_the_view_fits_the_edited_mechanism_when_it_rests():
    """Not the one before: its solids are made after the edit is shown."""
    with Viewer(run_scene(scene.load("crank-rocker"), frames=24), port=0) as viewer:
        key = next(key for key in viewer.inspector.controls.sliders if "crank.points.B" in key)
        parameter = next(p for p in viewer.session.parameters if p.key == key)
        for crank in (100.0, 60.0):
            viewer.session.set_value(parameter, crank)
            assert viewer.session.wait(until_idle=True)
            anew = view_model_of_run(viewer.session.run, build(viewer.session.run))
            np.testing.assert_allclose(viewer.scene.current.bounds, anew.bounds, atol=1e-12)
            inside = [viewer.scene.bounds[0] <= anew.bounds[0] + 1e-12, viewer.scene.bounds[1] >= anew.bounds[1] - 1e-12]
            assert np.all(inside), crank


def test_a_value_that_is_no_more_is_refused(session):
    """A slider may be moved after its point has gone by Undo in another browser."""
    kept = session.parameters[0]
    gone = replace(kept, path=("links", "crank", "points", "Q4", 0))
    session.set_value(gone, kept.value)
    assert session.wait() and session.status.fault == "Q4 is no longer in the scene: there is nothing to change."
    session.set_value(kept, kept.value)
    assert session.wait() and not session.status.fault


def test_what_goes_well_is_said_now_and_then_and_once_more_when_it_rests(monkeypatch):
    with Viewer(run_scene(scene.load("crank-rocker"), frames=24), port=0) as viewer:
        controls = viewer.inspector.controls
        assert viewer.session.wait(until_idle=True)
        key = next(iter(controls.sliders))
        said = []
        for seconds in (0.011, 0.022, 0.033):
            viewer.session.status = Status(key=key, seconds=seconds)
            monkeypatch.setattr("mechviz.outputs.viewer.panels.controls.STATUS_INTERVAL", 1e9 if said else -1.0)
            controls.show_status(viewer.session.status)
            said.append(controls.message.content)
        assert "11 ms" in said[0] and said[1] == said[2] == said[0]
        controls.settle()
        assert "33 ms" in controls.message.content
        viewer.session.status = Status("cannot be assembled", key, 1.0)
        controls.show_status(viewer.session.status)
        controls.show_status(Status(key=key, seconds=0.044))
        assert "44 ms" in controls.message.content, "after a fault at once"


# -- what can be edited -----------------------------------------------------------------------------------------------
@pytest.mark.sample(50)
@pytest.mark.parametrize("name", scene.gallery_names())
def test_every_value_lies_in_its_range_and_written_back_says_the_same(name):
    loaded = gallery_scene(name)
    parameters = find_parameters(loaded)
    assert parameters and len({p.key for p in parameters}) == len(parameters)
    draft = Draft.of(loaded)
    for p in parameters:
        assert p.hard_low <= p.low <= p.value <= p.high <= p.hard_high and p.step > 0.0, p
        assert (p.high - p.low) / p.step <= 10_000, p
        draft = draft.with_value(p.path, p.written(p.value))
    again = find_parameters(draft.scene())
    assert [(p.key, p.title) for p in again] == [(p.key, p.title) for p in parameters]
    np.testing.assert_allclose([p.value for p in again], [p.value for p in parameters], rtol=1e-11)


def test_ranges_are_those_of_the_units_that_values_state():
    """Values in mm and degrees have the same sliders in a scene in mm as in one whose bare numbers are inches and radians."""
    for name in ("cam-roller", "stephenson-six-bar"):
        there = {p.key: p for p in find_parameters(gallery_scene(name))}
        for p in find_parameters(retold(name, length="in", angle="rad")):
            usual = there[p.key]
            if usual.unit == p.unit:
                assert (p.low, p.high) == pytest.approx((usual.low, usual.high), rel=1e-9), p.key


def test_lengths_masses_speeds_springs_and_laws_are_there_with_their_units():
    result = {p.title: p for p in find_parameters(scene.load("cam-roller"))}
    assert {"follower T–E [mm]", "frame G y [mm]", "O speed [rpm]", "K base [mm]", "K lift 1 over [°]"} <= set(result)
    assert {"return spring stiffness [N/mm]", "return spring free length [mm]", "cam mass [kg]", "cam inertia [kg m²]"} <= set(
        result
    )
    assert result["O speed [rpm]"].value == 240.0 and result["O speed [rpm]"].written(250.0) == "250.0 rpm"
    assert result["follower T–E [mm]"].written(80.0) == 80.0
    choices = {c.label: c for c in find_choices(scene.load("cam-roller"))}
    assert choices["K lift 1 law"].value == "cycloidal" and "3-4-5" in choices["K lift 1 law"].options
    assert "D side" in {c.label for c in find_choices(scene.load("kinetostatic-four-bar"))}


@pytest.mark.parametrize(
    ("name", "place"),
    [
        ("cam-roller", ("joints", "K", "profile", "lift", 0, "law")),
        ("gantry-in-step", ("joints", "X", "drive", "segments", 5, "law")),
        ("two-axis-program", ("joints", "Z", "drive", "program", "segments", 0, "law")),
    ],
    ids=["cam", "time", "master angle"],
)
def test_any_law_stands_on_a_cam_over_time_and_over_a_master_angle(name, place):
    """One by name becomes one of least peak, which a table states, and back; what a table states is told, and is no option."""

    def choice(of):
        (found,) = (c for c in find_choices(of) if c.path == place)
        return found

    loaded = scene.load(name)
    assert set(RISES) < set(choice(loaded).options)
    least = loaded.changed(choice(loaded).changes(loaded, "least jerk"))
    assert value_at(least.document, place).least == "jerk"
    assert choice(least).value == "least, as stated" and choice(least).value not in choice(least).options
    again = least.changed(choice(least).changes(least, "modified-sine"))
    assert choice(again).value == "modified-sine"


def test_a_cam_is_judged_by_a_force():
    result = {p.key: p.unit for p in find_parameters(scene.load("cam-roller"))}
    assert result["joints.K.rating.margin"] == "N" and result["joints.K.rating.width"] == "mm"


def test_the_base_of_an_inverse_cam_is_an_angle_where_its_follower_swings():
    for name in ("cam-inverse", "cam-inverse-slide"):
        assert next(p.unit for p in find_parameters(scene.load(name)) if p.key == "joints.K.profile.base") == "°"


def test_a_length_is_shown_positive_whichever_way_its_point_lies():
    loaded = scene.load("toggle-clamp")
    lever = next(p for p in find_parameters(loaded) if p.label == "lever O–B")
    assert lever.value == 120.0 and lever.low > 0.0
    assert value_at(loaded.document, lever.path) == -120.0 and lever.written(130.0) == -130.0


def test_writing_a_value_leaves_the_old_data_alone():
    data, place = {"links": {"crank": {"points": {"B": (1.0, 2.0)}}}}, ("links", "crank", "points", "B")
    new = with_values(data, {(*place, 1): 5.0})
    assert value_at(new, place) == [1.0, 5.0] and value_at(data, place) == (1.0, 2.0)
    assert with_values({}, {("gravity",): [0.0, 1.0]}) == {"gravity": [0.0, 1.0]}
    assert with_values({}, {("gravity", 1): 1.0}) == {"gravity": [0.0, 1.0]}, "the default one with another value"
    assert with_values({"a": 1, "b": {"c": 2}}, {("a",): None, ("b", "c"): None}) == {"b": {}}


def test_only_the_tables_on_the_way_to_a_changed_value_are_made_anew():
    before = scene.load("slider-crank-compressor").document
    after = with_values(before, {("links", "crank", "mass"): "3 kg"})
    assert after.links["crank"].mass == "3 kg" and after.links["crank"] is not before.links["crank"]
    assert after.links["frame"] is before.links["frame"] and after.loads["gas"] is before.loads["gas"]


# -- undo -------------------------------------------------------------------------------------------------------------
def test_undo_redo_and_reset_with_a_drag_as_one_step():
    now = [0.0]
    opened = Draft.of(scene.load("triad"))

    def titled(title: str) -> Draft:
        return opened.with_value(("title",), title)

    history = History(titled("0"), clock=lambda: now[0])
    for v in range(1, 6):
        now[0] += 0.1
        history.change(titled(f"{v}"), "v")
    now[0] += 10.0
    history.change(titled("6"), "v")
    history.change(titled("6 w"), "w")
    assert [history.undo().document.title for _ in range(4)] == ["6", "5", "0", "0"] and not history.can_undo
    assert history.redo() == titled("5") and history.can_redo
    history.change(titled("9"), "v")
    assert not history.can_redo and history.undo() == titled("5")
    assert history.reset() == titled("0") and history.undo() == titled("5")


def test_effects_and_loads_are_switched_without_losing_their_values():
    draft = Draft.of(scene.load("slider-crank-compressor"))
    without = draft.with_load("gas", False).with_effect("inertia", False)
    assert not without.scene().document.loads and without.scene().effects == ()
    again = without.with_load("gas", True).with_effect("inertia", True)
    assert again.scene() == draft.scene()


# -- limits -----------------------------------------------------------------------------------------------------------
def test_the_reachable_range_is_found_from_the_inside():
    low, high = feasible_range(5.0, 0.0, 20.0, lambda v: 2.0 < v < 7.3)
    assert 2.0 < low < 2.001 and 7.299 < high < 7.3
    assert feasible_range(5.0, 0.0, 20.0, lambda v: True) == (0.0, 20.0)
    assert feasible_range(5.0, 0.0, 20.0, lambda v: True, given_up=lambda: True) is None


def test_a_four_bar_assembles_exactly_as_far_as_grashof_says():
    draft = Draft.of(scene.load("kinetostatic-four-bar"))
    path = ("links", "crank", "points", "B", 0)
    # crank r, frame 0.28, coupler 0.3, rocker 0.25: it turns fully while the distance of the other ends, 0.28 - r to 0.28 + r,
    # stays between 0.3 - 0.25 and 0.3 + 0.25
    _, high = feasible_range(0.1, 0.02, 0.25, lambda r: assembles(draft.with_value(path, r).scene()))
    assert high == pytest.approx(0.23, abs=2e-5)


# -- solids that follow -----------------------------------------------------------------------------------------------
def test_a_stretched_bar_keeps_its_ends_and_its_width():
    before, after = np.array([[0.0, 0.0], [2.0, 0.0]]), np.array([[0.0, 0.0], [3.0, 0.0]])
    xy = np.array([[-0.1, 0.1], [2.1, -0.1], [1.0, 0.1]])
    np.testing.assert_allclose(warped(xy, before, after), [[-0.1, 0.1], [3.1, -0.1], [1.5, 0.1]], atol=1e-12)
    turned = warped(np.array([[2.1, 0.1]]), before, np.array([[0.0, 0.0], [0.0, 2.0]]))
    np.testing.assert_allclose(turned, [[-0.1, 2.1]], atol=1e-12)


def test_places_go_with_the_points_that_they_are_at():
    before = np.array([[0.0, 0.0], [2.0, 0.0], [1.0, 1.0]])
    after = before + np.array([[0.0, 0.0], [0.5, 0.0], [0.0, 0.3]])
    np.testing.assert_allclose(warped(before, before, after), after, atol=1e-9)


def test_a_warped_solid_is_nearly_the_one_that_is_built_for_the_new_length():
    first = run_scene(scene.load("kinetostatic-four-bar"))
    draft = Draft.of(first.scene).with_value(("links", "coupler", "points", "D", 0), 0.33)
    second = run_scene(draft.scene())
    built, fresh = build(first), build(second)
    view_model = view_model_of_run(second, built)
    coupler = np.concatenate([p.vertices for p in view_model.bodies["coupler"].pieces])
    exact = np.concatenate([p.vertices for p in fresh.bodies["coupler"].pieces])
    np.testing.assert_allclose(np.ptp(coupler, axis=0)[:2], np.ptp(exact, axis=0)[:2], atol=0.02 * fresh.solids.size)
    assert view_model.bodies["rocker"] is built.bodies["rocker"], "what has not changed is not touched"
    same = warped_body(built.bodies["rocker"], {"A": (0.0, 0.0)}, {"A": (0.0, 0.0)})
    assert same is built.bodies["rocker"]


def test_a_section_pushes_plates_flat_and_drops_what_lies_before_it():
    boxes = [
        trimesh.creation.box((2.0, 1.0, h), trimesh.transformations.translation_matrix([0, 0, z]))
        for h, z in ((1.0, 0.5), (0.5, 2.0))
    ]
    offset = len(boxes[0].vertices)
    vertices = np.concatenate([b.vertices for b in boxes]).astype(np.float32)
    faces = np.concatenate([boxes[0].faces, boxes[1].faces + offset]).astype(np.uint32)
    body = LinkSolid((ColoredPart(vertices, faces, (10, 200, 30)),))
    for height, volume, top in ((0.25, 0.5, 0.25), (1.5, 2.0, 1.0), (2.0, 2.5, 2.0), (5.0, 3.0, 2.25)):
        pieces = sectioned(body, height).pieces
        mesh = trimesh.util.concatenate([trimesh.Trimesh(piece.vertices, piece.faces, process=False) for piece in pieces])
        assert mesh.volume == pytest.approx(volume) and mesh.vertices[mesh.faces.ravel(), 2].max() == pytest.approx(top)
        cut = [piece for piece in pieces if piece.color != (10, 200, 30)]
        through = any(low < height < high for low, high in ((0.0, 1.0), (1.75, 2.25)))
        assert len(cut) == int(through) and all(piece.color == (8, 160, 24) for piece in cut)
        for piece in cut:  # its area is that of the plate, the walls in it have none
            assert trimesh.Trimesh(piece.vertices, piece.faces, process=False).area == pytest.approx(2.0)
            assert (piece.vertices[:, 2] == np.float32(height)).all()
    assert sectioned(body, -1.0).pieces == ()


def test_a_section_of_a_cam_mechanism_shows_the_cam(monkeypatch):
    run = run_scene(scene.load("cam-roller"), frames=60)
    built = build(run)
    low, high = built.solids.bounds[:, 2]
    for part in (0.2, 0.5, 0.8):
        height = high - part * (high - low)
        for body in built.bodies.values():
            assert all(piece.vertices[piece.faces.ravel(), 2].max() <= height + 1e-9 for piece in sectioned(body, height).pieces)


# -- the worker -------------------------------------------------------------------------------------------------------
def test_the_newest_request_wins_and_the_last_one_is_always_done():
    begun, gate, done = threading.Event(), threading.Event(), []

    def work(value: int) -> None:
        begun.set()
        gate.wait(PATIENCE)
        done.append(value)
        if value == 99:
            raise ValueError("out of order")

    failures: list[Exception] = []
    worker = LatestRequestWorker(work, failures.append)
    try:
        worker.submit(0)
        assert begun.wait(PATIENCE)
        for value in range(1, 50):
            worker.submit(value)
        gate.set()
        assert worker.wait(PATIENCE) and done == [0, 49]
        worker.submit(99)
        assert worker.wait(PATIENCE) and len(failures) == 1
        worker.submit(7)
        assert worker.wait(PATIENCE) and done[-1] == 7
    finally:
        gate.set()
        worker.close()


# -- the session -------------------------------------------------------------------------------------------------------
class Screen:
    def __init__(self) -> None:
        self.shows: list = []
        self.report: list[Status] = []
        self.found: list[tuple[Contribution, ...]] = []
        self.failures: list[Exception] = []


@pytest.fixture
def session():
    screen = Screen()
    made = EditSession(
        run_scene(scene.load("kinetostatic-four-bar")),
        screen.shows.append,
        screen.report.append,
        screen.found.append,
        lambda: None,
        screen.failures.append,
    )
    made.screen = screen
    yield made
    made.close()
    assert not screen.failures


def _value(session: EditSession, label: str):
    return next(p for p in session.parameters if p.label == label)


def test_an_edit_solves_the_whole_cycle_anew_and_undo_brings_it_back(session):
    before = session.run.forces.effort("A")
    session.set_value(_value(session, "crank A–B"), 0.11)
    assert session.wait()
    assert session.status.fault == "" and value_at(session.history.present.document, ("links", "crank", "points", "B"))[0] == 0.11
    direct = run_scene(Draft.of(scene.load("kinetostatic-four-bar")).with_value(("links", "crank", "points", "B", 0), 0.11).scene())
    np.testing.assert_allclose(session.run.forces.effort("A"), direct.forces.effort("A"), rtol=1e-12)
    np.testing.assert_allclose(session.screen.shows[-1].poses["coupler"], direct.motion.pose("coupler"), rtol=1e-12)
    session.undo()
    assert session.wait()
    np.testing.assert_allclose(session.run.forces.effort("A"), before, rtol=1e-12)


@contextmanager
def at_work(session: EditSession) -> Iterator[None]:
    """While the session solves something else."""
    begun, done = threading.Event(), threading.Event()
    session.change("another", lambda draft: begun.set() or (done.wait(PATIENCE) and draft))
    assert begun.wait(PATIENCE)
    yield
    done.set()
    assert session.wait() and not session.status.fault


def test_steps_of_the_history_that_wait_are_all_done_in_their_order(session):
    """Undo and redo pressed, and values moved, while an earlier change is being solved: as if each had been waited for."""

    def mass() -> tuple[float, float]:
        shown = _value(session, "crank mass").value
        assert value_at(session.history.present.document, ("links", "crank", "mass")) == shown, "what is shown is what is kept"
        return shown

    slider, values = _value(session, "crank mass"), (1.1, 1.2, 1.3, 1.4)
    for n, value in enumerate(values):
        session.change(f"mass {n}", lambda draft, value=value: draft.with_value(slider.path, value))
        assert session.wait()
    with at_work(session):
        for _ in range(4):  # the other change, then three of the four values
            session.undo()
    assert mass() == 1.1
    with at_work(session):  # a step back from a change that still waits
        session.set_value(slider, 1.7)
        session.set_value(slider, 1.8)
        session.undo()
    assert mass() == 1.1
    with at_work(session):  # a change of what the step leads to
        session.undo()
        session.undo()
        session.set_value(slider, 1.6)
    assert mass() == 1.6
    session.undo()
    assert session.wait() and mass() == 1.1
    with at_work(session):
        session.undo()
        session.set_value(slider, 1.5)
        session.undo()
        session.redo()
    assert mass() == 1.5


def test_solids_are_built_anew_for_lengths_and_not_for_masses(session, monkeypatch):
    built = []
    monkeypatch.setattr("mechviz.outputs.viewer.session.build", lambda run: built.append(run) or build(run))
    session.set_value(_value(session, "crank mass"), 1.3)
    assert session.wait(until_idle=True) and not built
    assert session.screen.shows[-1].bodies["crank"] is session.opened.bodies["crank"]
    session.set_value(_value(session, "crank A–B"), 0.11)
    assert session.wait(until_idle=True) and len(built) == 1
    assert session.screen.shows[-1].bodies["crank"] is not session.opened.bodies["crank"]


def test_what_cannot_be_assembled_leaves_the_last_good_mechanism_and_says_how_far(session):
    shown, run = len(session.screen.shows), session.run
    session.set_value(_value(session, "crank A–B"), 0.9)
    assert session.wait()
    assert "cannot be assembled" in session.status.fault and session.status.value == 0.9
    low, high = session.status.feasible_range
    assert low == pytest.approx(0.02) and high == pytest.approx(0.83, abs=1e-4)  # all the other lengths in line
    assert session.run is run and len(session.screen.shows) == shown and not session.history.can_undo
    session.set_value(_value(session, "crank A–B"), 0.12)
    assert session.wait() and session.status.fault == ""


@pytest.mark.sample(2)
@pytest.mark.parametrize("typed", [99999.0, -3.0, 1e300])
def test_a_typed_value_beyond_all_limits_is_refused_as_it_was_typed(session, typed):
    length, run = _value(session, "crank A–B"), session.run
    session.set_value(length, typed)
    assert session.wait()
    assert "Here it can be" in session.status.fault and session.status.value == typed
    assert session.run is run
    low, high = session.status.feasible_range
    assert length.hard_low <= low <= 0.02 and length.value < high < 0.831


def test_an_undercut_cam_is_refused_with_the_range_of_its_base_circle():
    told: list[Status] = []
    made = EditSession(
        run_scene(scene.load("cam-flat"), frames=90), lambda _: None, told.append, lambda _: None, lambda: None, lambda _: None
    )
    try:
        base = _value(made, "K base")
        made.set_value(base, 8.0)
        assert made.wait()
        assert "undercut" in made.status.fault
        low, high = made.status.feasible_range
        assert low == pytest.approx(10.664, abs=0.01), "the least base circle of the theory"
        assert high == base.high
    finally:
        made.close()


def test_each_effect_is_weighed_by_the_peak_without_it(session):
    session.find_contributions(asked=True)
    end = time.monotonic() + PATIENCE
    while not session.screen.found and time.monotonic() < end:
        time.sleep(0.01)
    computed = {c.name: c for c in session.screen.found[-1]}
    assert set(computed) == {"inertia", "gravity", "friction", "P"}
    assert computed["inertia"].on and not computed["gravity"].on
    without = run_scene(Draft.of(session.run.scene).with_effect("inertia", False).scene())
    assert computed["inertia"].peak_with == pytest.approx(np.abs(session.run.forces.effort("A")).max())
    assert computed["inertia"].peak_without == pytest.approx(np.abs(without.forces.effort("A")).max())
    assert np.isnan(computed["friction"].seconds)
    assert computed["friction"].why.startswith("no joint has any friction that could act.")  # the scene does not name it
    assert "friction: no joint has any friction" in words.contribution_table(session.screen.found[-1], "drive torque", MILLIMETRES)


def test_of_a_motion_without_drives_effects_are_weighed_by_the_largest_reaction():
    computed: list[tuple[Contribution, ...]] = []
    run = run_scene(scene.load("pendulum-near-the-top"), frames=20)
    made = EditSession(run, lambda _: None, lambda _: None, computed.append, lambda: None, lambda _: None)
    made.find_contributions(asked=True)
    assert made.wait(until_idle=True)
    made.close()
    gravity = next(c for c in computed[-1] if c.name == "gravity")
    largest = max(np.hypot(*run.forces.reaction(joint.name)[:, :2].T).max() for joint in run.motion.mechanism.joints)
    assert gravity.peak_with == pytest.approx(largest) and gravity.peak_without == pytest.approx(0.0, abs=1e-9)
    assert f"+{largest:.3g} N<" in words.contribution_table(computed[-1], "reaction", MILLIMETRES)
    unasked = [Contribution("inertia", True, 1.0, np.nan, np.nan)]
    assert "press the button" in words.contribution_table(unasked, "reaction", MILLIMETRES)


# -- recordings -------------------------------------------------------------------------------------------------------
@pytest.mark.sample(2)
@pytest.mark.parametrize(
    ("name", "overlays"),
    [
        ("plans-four-bar", ()),
        ("polodes-four-bar", ("Centrodes",)),
        ("instant-centres", ("Instant centres",)),
        ("inflection-circle", ("Evolutes", "Inflection circles")),
        ("four-forces", ("Funicular polygon",)),
        ("compressor-cycle", ()),
        ("cam-equivalent", ("Equivalent linkages",)),
        ("shaking-four-bar", ()),
    ],
)
def test_diagrams_of_a_recording_are_those_of_its_run(name, overlays, tmp_path):
    """Polygons, centrodes and charts, at every frame, as far as 32 bits tell."""
    run = run_scene(scene.load(name), frames=24)
    write_recording(run, tmp_path / "a.rrd")
    recorded, solved = view_model_of_recording(Recording(tmp_path / "a.rrd")), view_model_of_run(run, build(run))
    assert recorded.learning_goal == run.scene.learning_goal and run.scene.learning_goal not in recorded.notes
    assert list(diagrams_of(recorded)) == list(diagrams_of(solved))
    with Viewer(Recording(tmp_path / "a.rrd"), port=0) as played:
        played.set_frame(7)
        assert tuple(name for name in played.scene.polygons.constructions if name in OVERLAY_GROUPS) == overlays
    for key, drawing in solved.drawings().items():
        computed = recorded.drawings()[key]
        assert (computed.title, computed.unit, computed.whole) == (drawing.title, drawing.unit, drawing.whole)
        assert computed.per_metre == pytest.approx(drawing.per_metre)
        np.testing.assert_allclose(computed.bounds, drawing.bounds, atol=1e-6 * solved.size)
        for a, b in zip(computed.arrows, drawing.arrows, strict=True):
            assert (a.label, a.color, a.headless, a.thin) == (b.label, b.color, b.headless, b.thin)
            np.testing.assert_allclose(a.start, b.start, atol=1e-6 * solved.size)
            np.testing.assert_allclose(a.vector, b.vector, atol=1e-6 * solved.size)
        assert [m.label for m in computed.points] == [m.label for m in drawing.points]
    for computed, chart in zip(recorded.charts(), solved.charts(), strict=True):
        assert (computed.title, computed.x_title, computed.y_title, computed.equal) == (
            chart.title,
            chart.x_title,
            chart.y_title,
            chart.equal,
        )
        for a, b in zip(computed.curves, chart.curves, strict=True):
            assert a.name == b.name
            np.testing.assert_allclose(a.x, b.x, atol=1e-5 * np.ptp(chart.ranges[:2]))
            np.testing.assert_allclose(a.y, b.y, atol=1e-5 * np.ptp(chart.ranges[2:]))
    for link, centrodes in solved.centrodes().items():
        np.testing.assert_allclose(recorded.centrodes()[link].fixed, centrodes.fixed, atol=1e-9)
        np.testing.assert_allclose(recorded.centrodes()[link].moving, centrodes.moving, atol=1e-9)


def test_a_spatial_cam_turns_in_its_recording_as_in_its_run(tmp_path):
    run = run_scene(scene.load("cam-barrel"), frames=24)
    write_recording(run, tmp_path / "a.rrd")
    with Viewer(Recording(tmp_path / "a.rrd"), port=0) as played, Viewer(run, port=0) as solved:
        computed, wanted = (v.scene.links.tracks()["/mechanism/cam"] for v in (played, solved))
    np.testing.assert_allclose(computed[0], wanted[0], atol=1e-7)
    np.testing.assert_allclose(np.abs((computed[1] * wanted[1]).sum(axis=1)), 1.0, atol=1e-6)
    assert np.ptp(computed[1][:, 1:3]) > 0.5, "not about z"


def test_solids_follow_the_settings_of_the_accuracy():
    """The viewer draws what a recording of the same run holds, and other settings ask for other solids."""
    plain, fine = (run_scene(scene.load("cam-roller"), frames=4, accuracy=a) for a in (None, Accuracy(chord=1e-5, profile=2160)))
    faces = {name: sum(len(p.faces) for p in body.pieces) for name, body in build(fine).bodies.items()}
    assert faces == {body.parent: len(body.mesh.faces) for body in picture_of(fine, solids_of(fine)).nodes_of(BodyNode, "solids")}
    assert sum(faces.values()) > 1.5 * sum(len(solid.faces) for solid in solids_of(plain).links.values())
    first, same, finer = (run_scene(scene.load("crank-rocker"), frames=4, accuracy=Accuracy(chord=c)) for c in (1e-4, 1e-4, 1e-5))
    built = build(first)
    assert built.fits(same) and not built.fits(finer)


@pytest.mark.parametrize(
    ("name", "before", "after", "fits"),
    [
        ("cam-roller", 'mass = "1.1 kg"', 'mass = "1.3 kg"', True),
        ("cam-roller", "240 rpm", "120 rpm", True),
        ("cam-roller", "to = 20", "to = 21", False),
        ("cam-roller", '"3-4-5"', '"cycloidal"', False),
        ("cam-roller", "3 N/mm", "4 N/mm", True),
        ("cam-roller", '"follower.E", "frame.H"', '"follower.E", "frame.O"', False),
        ("cam-roller", "return_spring", "# return_spring", False),
        ("pendulum-near-the-top", "free = {", "stops = [{ at = 7e3, side = 'upper' }], free = {", False),
        ("crank-rocker", 'mass = "0.4 kg"', 'mass = "0.4 kg", looks = "nothing"', False),
        ("cam-drawing", "", "", True),
        ("kinetostatic-four-bar", "[-150, -60]", "[-150, 60]", True),
        ("kinetostatic-four-bar", 'on = "rocker", at = "P"', 'on = "rocker", at = "D"', False),
    ],
)
def test_solids_are_built_anew_only_where_something_else_is_drawn(name, before, after, fits):
    """Also beside laws and profiles of cams, which hold arrays; what a force acts on may be drawn for its sake."""
    opened = scene.load(name)
    text = opened.to_toml()
    assert before in text
    edited = scene.loads(text.replace(before, after), name) if before else scene.load(name)
    old, new = (run_scene(s, frames=4) for s in (opened, edited))
    poses = {link.name: old.motion.pose(link.name) for link in old.motion.mechanism.links}
    nothing: Any = None  # solids are not looked at
    assert Built(old.motion.mechanism, old.accuracy, nothing, {}, poses, {}, solid_inputs(old)).fits(new) == fits


def test_a_recording_is_played_without_computing_anything(tmp_path, monkeypatch):
    write_recording(run_scene(scene.load("kinetostatic-four-bar"), frames=60), tmp_path / "a.rrd")

    def never(*_: object, **__: object) -> None:
        raise AssertionError("something was computed")

    for name in (
        "mechcore.motion.solve.solve_motion",
        "mechviz.runs.solve_motion",
        "mechviz.runs.solve_forces",
        "mechviz.runs.compile_mechanism",
    ):
        monkeypatch.setattr(name, never)
    monkeypatch.setattr("mechviz.outputs.viewer.build.solids_of", never)
    with Viewer(Recording(tmp_path / "a.rrd"), port=0) as shown:
        shown.set_frame(17)
        x, y, _ = shown.inspector.view_model.poses["coupler"][17]
        assert shown.server.scene.get_handle_by_name("/mechanism/coupler").position[:2] == pytest.approx((x, y))
        with pytest.raises(ViewerError, match="Edit"):
            _ = shown.session


# -- tracing ----------------------------------------------------------------------------------------------------------
def test_a_click_traces_a_near_point_or_makes_one():
    run = run_scene(scene.load("kinetostatic-four-bar"))
    view_model = view_model_of_run(run, build(run))
    x, y, angle = run.motion.pose("coupler")[40]
    z = complex(x, y) + (0.1 + 0.02j) * np.exp(1j * angle)
    top = max(float(p.vertices[:, 2].max()) for p in view_model.bodies["coupler"].pieces)
    start = np.array([z.real + 0.3, z.imag, top + 1.0])
    spot = traced_at(view_model, "coupler", 40, start, np.array([z.real, z.imag, top]) - start)
    assert spot[:2] == pytest.approx((0.1, 0.02), abs=1e-9)
    draft = with_traced(Draft.of(run.scene), "coupler", spot)
    assert run_scene(draft.scene()).motion.mechanism.traced == (("coupler", "T1"),)
    assert tuple(value_at(draft.document, ("links", "coupler", "points", "T1"))) == (0.1, 0.02)
    near = with_traced(draft, "coupler", (0.3, 0.001, 0.01))
    assert near.document.trace == ["coupler.T1", "coupler.D"]
    assert with_traced(near, "coupler", (0.3, 0.001, 0.01)).document.trace == ["coupler.T1"], "a second click ends it"


def test_the_base_circle_of_a_disc_has_a_positive_range_and_the_place_of_a_barrel_has_not():
    disc, barrel = (
        next(p for p in find_parameters(scene.load(name)) if p.path[-1] == "base") for name in ("cam-flat", "cam-barrel")
    )
    assert 0.0 < disc.hard_low <= disc.low < disc.value and barrel.low < 0.0


def test_a_cam_follows_its_values_while_they_are_dragged():
    """Stretched, its rim is that of the solid which is built at rest; its hub stays, and so does a follower's body."""
    opened = run_scene(scene.load("cam-flat"), frames=60)
    built = build(opened)
    draft = Draft.of(opened.scene)
    parameter = next(p for p in find_parameters(opened.scene) if p.key == "joints.K.profile.base")
    dragged = run_scene(draft.with_value(parameter.path, parameter.written(1.15 * parameter.value)).scene(), frames=60)
    shown, exact = view_model_of_run(dragged, built, view_model_of_run(opened, built)).bodies, build(dragged).bodies["cam"]

    def rim(body: LinkSolid) -> np.ndarray:
        """The largest radius of the disc by angle."""
        z = np.concatenate([p.vertices for p in body.pieces]).astype(float) @ [1.0, 1.0j, 0.0]
        z = z[np.argsort(np.angle(z))]
        sector = np.floor((np.angle(z) + np.pi) / (2.0 * np.pi) * 90.0).astype(int)
        return np.array([np.abs(z[sector == k]).max() for k in range(90)])

    change = 0.15 * 1e-3 * parameter.value
    assert np.abs(rim(shown["cam"]) - rim(exact)).max() < 0.03 * change < 0.5 * np.abs(rim(built.bodies["cam"]) - rim(exact)).min()
    old, new = (np.concatenate([p.vertices for p in b.pieces]) for b in (built.bodies["cam"], shown["cam"]))
    hub = np.hypot(old[:, 0], old[:, 1]) < 0.3e-3 * parameter.value
    assert hub.sum() > 100 and np.allclose(old[hub], new[hub], atol=1e-8)
    assert shown["follower"] is built.bodies["follower"]
    folded = np.exp(2j * np.pi * np.linspace(0.0, 1.0, 40)[:-1]) * np.exp(0.3j * np.sin(np.arange(39) * 2.0))
    assert stretched(folded, folded, 1.1 * folded) is None, "a profile that runs back on itself is left until the rest"


def test_a_pivot_that_is_dragged_away_and_back_ends_where_it_began(session, monkeypatch):
    """Though nothing of it has been drawn yet."""
    asked = []
    monkeypatch.setattr(session, "set_value", lambda parameter, value: asked.append((parameter.key, value)))
    server = SimpleNamespace(scene=SimpleNamespace(add_transform_controls=lambda *_, **__: SimpleNamespace(on_update=callable)))
    pivots = Pivots(server, session, lambda _name, run: run)
    pivots.switch(True)
    for phase, by in (("start", 0.0), ("update", 0.01), ("update", 0.0), ("end", 0.0)):
        place = np.array([0.28 + by, 0.0, 0.0])
        pivots._dragged("E", SimpleNamespace(phase=phase, target=SimpleNamespace(position=place)))
    values = [value for key, value in asked if key.endswith("E[0]")]
    assert values == pytest.approx([0.29, 0.28]) and len(values) == len(asked)


# -- health -----------------------------------------------------------------------------------------------------------
def test_a_single_bad_frame_is_seen_in_the_strip():
    values = np.full(5000, 1e-16)
    values[1234] = 1.0
    health = Health("closure", "m", values, 1e-12, 1e-6)
    assert health.severity.max() == 1.0 and health.severity[0] == 0.0
    row = worst_in_columns(health.severity)
    assert row[int(1234 / 5000 * len(row))] == 1.0 and row.sum() == 1.0
    text = health_svg([health], [Event(0.5, "WARN", "A", "<b>dead</b>")], np.linspace(0.0, 1.0, 5000))
    assert shade(1.0) in text and shade(0.0) in text and "&lt;b&gt;" in text and "<b>dead" not in text
    assert Health("condition", "1", np.array([np.inf, np.nan, 1.0]), 30.0, 1e8).severity.tolist() == [1.0, 1.0, 0.0]


# -- diagrams ---------------------------------------------------------------------------------------------------------
def test_diagrams_move_with_the_frame_and_lie_within_their_picture():
    run = run_scene(scene.load("plans-four-bar"), frames=24)
    diagrams = diagrams_of(view_model_of_run(run, build(run)))
    assert {"Velocity polygon", "Acceleration polygon", "Force polygon"} <= set(diagrams) and any(
        t.startswith("Path of") for t in diagrams
    )
    for title, diagram in diagrams.items():
        first, later = diagram_svg(diagram, 3), diagram_svg(diagram, 15)
        assert first != later and title in first
        numbers = [float(v) for spots in re.findall(r'points="([^"]*)"', first) for v in re.split("[ ,]", spots)]
        assert all(-20.0 <= v <= 350.0 for v in numbers), title
        assert (diagram.y_title if isinstance(diagram, Chart) else diagram.unit) in first, "the unit of its scale"


def test_a_cam_has_diagrams_of_its_pressure_angle_and_curvature():
    run = run_scene(scene.load("cam-roller"), frames=72)
    view_model = view_model_of_run(run, build(run))
    computed = {title: d for title, d in diagrams_of(view_model).items() if title.endswith("of cam K")}
    assert list(computed) == ["Pressure angle [°] of cam K", "Curvature [1/m] of cam K"]
    angle = computed["Pressure angle [°] of cam K"].curves[0]
    quantity = next(q for q in view_model.quantities if q.label == "cam K: pressure angle")
    np.testing.assert_array_equal(angle.y, quantity.values()[:, 0])
    assert angle.x[-1] == pytest.approx(360.0) and np.ptp(angle.y) > 20.0
    assert ">270<" in diagram_svg(computed["Pressure angle [°] of cam K"], 10), "quarter turns"


def test_labels_of_a_diagram_stand_apart_and_are_written_as_by_hand():
    run = run_scene(scene.load("plans-four-bar"), frames=36)
    diagram = diagrams_of(view_model_of_run(run, build(run)))["Acceleration polygon"]
    inks = dict(diagram.drawing.legend)
    assert list(inks) == ["absolute", "normal", "tangential"]
    for stroke in diagram.drawing.arrows:
        kind = {"ⁿ": "normal", "ᵗ": "tangential"}.get(stroke.label[-1], "absolute")
        assert stroke.color == inks[kind], stroke.label
    for frame in (0, 12, 30):
        picture = diagram_svg(diagram, frame)
        assert all(f">{words}</text>" in picture for words in inks), "the legend of the colours"
        assert re.search(r'>a<tspan dy="3" font-size="8.5">DB</tspan><tspan dy="-3">ᵗ</tspan><', picture)
        drawn = re.findall(r'<text x="([\d.-]+)" y="([\d.-]+)" font-size="11" text-anchor="middle"[^>]*>(.*?)</text>', picture)
        boxes = [(float(x), float(y), 3.0 * len(re.sub("<.*?>", "", text)), 5.0) for x, y, text in drawn]
        for k, (x, y, across, up) in enumerate(boxes):
            for x2, y2, across2, up2 in boxes[:k]:
                assert abs(x - x2) > 0.8 * (across + across2) or abs(y - y2) > 0.8 * (up + up2), (frame, drawn[k])


def test_the_moving_centrode_rolls_with_its_link_and_touches_the_fixed_one():
    run = run_scene(scene.load("polodes-four-bar"), frames=72)
    diagram = diagrams_of(view_model_of_run(run, build(run)))["Centrodes of coupler"]
    link, fixed, moving = diagram.curves
    for frame in (0, 17, 50):
        known = np.isfinite(moving.points)
        assert known.sum() > 60
        carried, still = moving.points_at(frame), fixed.points_at(frame)
        assert carried[frame] == pytest.approx(still[frame], abs=1e-12), "both go through the instant centre"
        assert moving.at[frame] == pytest.approx(still[frame], abs=1e-12)
        near = slice(frame - 1, frame + 2) if frame else slice(0, 2)
        along, other = np.diff(carried[near]), np.diff(still[near])
        assert np.abs(along).sum() == pytest.approx(np.abs(other).sum(), rel=0.02), "it rolls: both have gone as far"
        place = run.motion.point("coupler", next(iter(run.motion.mechanism.links[2].points)))[frame]
        assert link.points_at(frame)[0] == pytest.approx(complex(*place))
    assert diagram_svg(diagram, 0) != diagram_svg(diagram, 17)


def test_the_indicator_diagram_shows_pressure_against_displacement_where_the_run_is():
    run = run_scene(scene.load("compressor-cycle"), frames=72)
    chart = next(d for t, d in diagrams_of(view_model_of_run(run, build(run))).items() if t.startswith("Indicator diagram"))
    first, later = diagram_svg(chart, 10), diagram_svg(chart, 40)
    dot = [float(v) for v in re.search(r'<circle cx="([\d.]+)" cy="([\d.]+)"', first).groups()]
    x0, x1, y0, y1 = chart.ranges
    assert (dot[0] - charts.AXES_LEFT) / charts.AXES_WIDTH == pytest.approx((chart.curves[0].x[10] - x0) / (x1 - x0), abs=1e-3)
    assert (dot[1] - charts.AXES_TOP) / charts.AXES_HEIGHT == pytest.approx((y1 - chart.curves[0].y[10]) / (y1 - y0), abs=1e-3)
    assert first != later and "displacement [mm]" in first and "[MPa]" in first


# -- cameras, names ---------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("name", list(VIEW_PRESETS))
def test_every_preset_sees_the_whole_box(name):
    bounds = np.array([[-0.1, 0.3, -0.02], [0.5, 0.5, 0.04]])
    preset = VIEW_PRESETS[name]
    view = fit_view(bounds, 1.3, preset)
    away = (view.position - view.look_at) / view.distance
    right = np.cross([0.0, 1.0, 0.0], away)
    right /= np.linalg.norm(right)
    up = np.cross(away, right)
    corners = np.array([[bounds[i, 0], bounds[j, 1], bounds[k, 2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    depth = view.distance - (corners - view.look_at) @ away
    half = np.tan(preset.fov / 2.0)
    assert (np.abs((corners - view.look_at) @ up / depth) < half).all()
    assert (np.abs((corners - view.look_at) @ right / depth) < 1.3 * half).all()
    assert np.dot(away, preset.direction) > 0.0


def test_a_stack_of_cams_is_looked_at_from_an_angle_at_first():
    """From the front its first follower hides the eleven behind it; of a flat mechanism the front shows most."""
    deep, flat = (np.asarray(solids_of(run_scene(scene.load(name), frames=6)).bounds) for name in ("wave-machine", "theatre"))
    assert (first_preset(deep), first_preset(flat)) == ("angled", "front")


def test_2d_is_nearly_without_perspective():
    bounds = np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 0.1]])
    view = fit_view(bounds, 1.0, VIEW_PRESETS["flat"])
    assert 0.1 / view.distance < 0.003  # how much larger the front of the plates is drawn than their back


def test_notes_of_a_foreign_recording_are_text(tmp_path, monkeypatch):
    """No picture is loaded for them, neither by the page nor by the server, and nothing in them is markup of the page."""
    write_recording(run_scene(scene.load("crank-rocker"), frames=12), tmp_path / "a.rrd")
    pictures = "![a](http://127.0.0.1:9/a.png) ![b](../../../../etc/passwd) <img src=x onerror=alert(1)>"
    hostile = f"{pictures} [c](javascript:alert(2)) {{alert(3)}}"
    monkeypatch.setattr(Recording, "notes", property(lambda self: f"# Title\n\n{hostile}\n\n## What was computed\n\n- {hostile}\n"))
    shown = view_model_of_recording(Recording(tmp_path / "a.rrd"))
    assert not re.findall(r"<(?!/?(?:div|h\d|p|ul|li|b|code|table|tr|td|th)\b)", shown.notes) and "![a](http" in shown.notes
    with Viewer(Recording(tmp_path / "a.rrd"), port=0) as played:
        kinds = {type(m).__name__ for m in buffer_of(played.server).message_from_id.values()}
        assert "GuiHtmlMessage" in kinds and "GuiMarkdownMessage" not in kinds


def test_names_of_files_have_no_folders():
    assert file_name("../../etc/passwd", ".toml", "x") == "_.._etc_passwd.toml"
    assert file_name(" crank 2.TOML ", ".toml", "x") == "crank 2.toml" and file_name("", ".rrd", "x") == "x.rrd"
    assert file_name("", ".rrd", "../../evil") == "_.._evil.rrd" and file_name("..", ".rrd", "..") == "scene.rrd"
    assert "/" not in file_name("a/b\\c\0d", ".rrd", "x") and file_name(".hidden", ".rrd", "x") == "hidden.rrd"
