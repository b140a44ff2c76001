"""One picture and one catalogue: what a run shows is what its recording shows, for scenes that have all kinds of things."""

from __future__ import annotations

import json
from dataclasses import fields
from typing import Any

import numpy as np
import pytest
from page_content import content

from mechviz.outputs.page.page import make_page
from mechviz.outputs.presentation import presentation_of
from mechviz.outputs.rerun.nodes import nodes_json
from mechviz.outputs.rerun.recorded import picture_in, recorded_numbers
from mechviz.outputs.viewer.build import build, view_model_of_recording, view_model_of_run
from mechviz.picture.build import picture_of, solids_of
from mechviz.picture.nodes import ArrowSet
from mechviz.quantities.catalogue import Catalogue
from mechviz.quantities.events import events_of
from mechviz.runs import run_scene
from mechviz.scene.scene import load
from recordings import COVERING, Made, made


def alike(a: Any, b: Any, where: str) -> None:
    """Two nodes, or parts of them, are equal in all they hold; numbers as recorded."""
    if hasattr(a, "__dataclass_fields__"):
        assert type(a) is type(b), where
        for f in fields(a):
            alike(getattr(a, f.name), getattr(b, f.name), f"{where}.{f.name}")
    elif isinstance(a, np.ndarray):
        assert a.shape == b.shape and a.dtype == b.dtype, where
        np.testing.assert_allclose(b, a, rtol=1e-12, atol=0.0, err_msg=where)
    elif isinstance(a, dict):
        assert a.keys() == b.keys(), where
        for k in a:
            alike(a[k], b[k], f"{where}.{k}")
    elif isinstance(a, tuple | list):
        assert len(a) == len(b), where
        for k, (x, y) in enumerate(zip(a, b, strict=True)):
            alike(x, y, f"{where}[{k}]")
    elif isinstance(a, float):
        assert b == pytest.approx(a, rel=1e-6, abs=1e-9), where
    else:
        assert a == b, where


def test_recordings_name_kinds_of_nodes_as_ever() -> None:
    """Readers of other programs know them, whatever the classes of the program are called."""
    run = run_scene(load("andrews-squeezer"), frames=4)
    kinds = {node["key"]: node["kind"] for node in json.loads(nodes_json(picture_of(run, solids_of(run))))}
    some = {"link.K1": "body", "path.K3.D": "lines", "joint.O": "points", "reaction.O": "arrow", "applied.motor.moment": "arc"}
    assert some.items() <= kinds.items() and set(kinds.values()) == set(some.values())
    assert ArrowSet.KIND == "arrowset"


@pytest.mark.parametrize("name", ["slider-crank-friction", "scissor-lift", "valve-train"])
def test_the_viewer_shows_of_a_recording_what_it_shows_of_the_run(name: str) -> None:
    m = made(name)
    solved, recorded = view_model_of_run(m.run, build(m.run)), view_model_of_recording(m.recording)
    assert recorded.run is None and recorded.bodies.keys() == solved.bodies.keys() and recorded.families == solved.families
    for link, body in solved.bodies.items():
        for a, b in zip(body.pieces, recorded.bodies[link].pieces, strict=True):
            assert a.color == b.color
            np.testing.assert_array_equal(a.vertices, b.vertices)
    assert recorded.learning_goal == solved.learning_goal and recorded.title == solved.title
    assert [d.name for d in recorded.drives] == [d.name for d in solved.drives]
    assert not any("(t = " in e.text for e in (*recorded.events, *solved.events)), "an event tells its time once"


def test_bodies_that_a_joint_brings_along_are_drawn() -> None:
    lift = made("scissor-lift")
    view_model = view_model_of_run(lift.run, build(lift.run))
    brought = set(view_model.numbers.links) - {link.name for link in lift.mechanism.links}
    assert brought and brought <= set(view_model.bodies), "barrel and rod of its cylinder"


@pytest.mark.sample(12)
@pytest.mark.parametrize("name", COVERING)
def test_a_recording_holds_the_picture_and_the_catalogue_of_its_run(name: str) -> None:
    the_picture_is_that_of_the_run(made(name))
    the_catalogue_is_that_of_the_run(made(name))


def the_picture_is_that_of_the_run(m: Made) -> None:
    run, recording = picture_of(m.run, m.solids), picture_in(m.recording, recorded_numbers(m.recording))
    assert [node.key for node in recording.nodes] == [node.key for node in run.nodes]
    assert len(run.by_key) == len(run.nodes), "keys are unique"
    assert (recording.frame, recording.size, recording.top) == (run.frame, run.size, run.top)
    alike(recording.scales, run.scales, "scales")
    np.testing.assert_array_equal(recording.bounds, run.bounds)
    for link, pose in run.poses.items():
        np.testing.assert_array_equal(recording.poses[link], pose)
    for a, b in zip(run.nodes, recording.nodes, strict=True):
        alike(a, b, a.key)


def the_catalogue_is_that_of_the_run(m: Made) -> None:
    run, recording = m.run.catalogue, Catalogue(recorded_numbers(m.recording))
    assert [(q.key, q.label, q.unit, q.curves) for q in recording.quantities] == [
        (q.key, q.label, q.unit, q.curves) for q in run.quantities
    ]
    assert len(run.by_key) == len({q.title for q in run.quantities}) == len(run.quantities), "keys and titles are unique"
    for q in run.quantities:
        values = q.values()
        assert values.shape == (m.run.motion.frames, len(q.curves)), q.key
        np.testing.assert_array_equal(recording[q.key].values(), values, err_msg=q.key)
    assert [q.key for q in recording.initial_quantities] == [q.key for q in run.initial_quantities]
    assert [a.title for a in recording.axes] == [a.title for a in run.axes]
    assert [h.name for h in recording.health] == [h.name for h in run.health]
    assert [(h.good, h.bad) for h in recording.health] == [(h.good, h.bad) for h in run.health]
    assert recording.opening_frame == run.opening_frame and recording.numbers.cycle == run.numbers.cycle
    events = events_of(m.run)
    assert [(e.level, e.item, e.text) for e in m.recording.events] == [(e.level, e.item, e.text) for e in events]
    assert [e.time for e in m.recording.events] == pytest.approx([e.time for e in events], abs=1e-9)


@pytest.mark.sample(3)
@pytest.mark.parametrize(
    "name", ["slider-crank-friction", "valve-train", "shaking-four-bar", "four-forces", "cam-barrel", "stick-slip-feed"]
)
def test_a_page_of_a_run_is_that_of_its_recording(name: str) -> None:
    """Notes alone differ: they tell what each stage cost."""
    m = made(name)
    (solved, a), (recorded, b) = (content(make_page(shown)[0]) for shown in (presentation_of(m.run), m.shown))
    told = ("notes", "arrays")
    alike({k: v for k, v in solved.items() if k not in told}, {k: v for k, v in recorded.items() if k not in told}, name)
    assert len(a) == len(b)
    for x, y in zip(a, b, strict=True):
        np.testing.assert_allclose(y, x, rtol=1e-6, atol=1e-5 * np.nanmax(np.abs(x), initial=0.0))
