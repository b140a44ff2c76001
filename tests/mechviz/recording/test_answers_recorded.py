"""Answers that a scene asks for are in the recording, with events where they become extreme; others are not."""

from __future__ import annotations

import numpy as np

import mechviz
from mechcore.effects.plan import StageKind
from mechcore.motion import metrics as answers
from mechviz.outputs.rerun.reader import Recording
from mechviz.outputs.rerun.writer import write_recording
from mechviz.runs import run_scene


def test_answers_are_recorded_where_they_are_asked_for(tmp_path):
    run = run_scene(mechviz.load("crank-rocker"), frames=72)
    write_recording(run, tmp_path / "a.rrd")
    recording = Recording(tmp_path / "a.rrd")
    motion = run.motion
    for name, compute in (
        ("transmission_angle", answers.transmission_angles),
        ("velocity_ratio", answers.velocity_ratios),
        ("mechanical_advantage", answers.mechanical_advantage),
    ):
        computed = compute(motion)
        assert computed
        for joint, values in computed.items():
            np.testing.assert_array_equal(recording.scalars("data", "answers", name, joint)[1][:, 0], values)
    centres = answers.instant_centres(motion)
    assert len(centres) == 6
    for (a, b), place in centres.items():
        np.testing.assert_array_equal(recording.scalars("data", "answers", "instant_centre", f"{a} {b}")[1], place)
    bend = recording.scalars("data", "answers", "curvature", "coupler.E")[1][:, 0]
    np.testing.assert_array_equal(bend, answers.curvature(motion, "coupler", "E"))
    texts = [e.text for e in recording.events]
    angle = np.degrees(answers.transmission_angles(motion)["C"])
    worst = angle[np.argmax(np.abs(angle - 90.0))]
    assert any(f"worst transmission angle of the run, {worst:.4g}°" in t for t in texts)
    assert any("sharpest bend" in t for t in texts) and any("largest velocity ratio" in t for t in texts)


def test_nothing_is_recorded_that_was_not_asked_for(tmp_path):
    run = run_scene(mechviz.load("watt-six-bar"), frames=24)
    write_recording(run, tmp_path / "b.rrd")
    recording = Recording(tmp_path / "b.rrd")
    assert not any("/answers/" in e for e in recording.entities)
    assert not any("transmission" in e.text for e in recording.events)
    assert not run.plan.has(StageKind.METRIC, "curvature")


def test_passing_a_change_point_is_an_event(tmp_path):
    run = run_scene(mechviz.load("parallelogram"), frames=90, cycles=2)
    write_recording(run, tmp_path / "c.rrd")
    computed = [e for e in Recording(tmp_path / "c.rrd").events if "change point" in e.text]
    assert len(computed) == 4 and all(e.level == "WARN" for e in computed)
    np.testing.assert_allclose([e.time for e in computed], [c.time for c in run.motion.singular_points], atol=1e-8)


def test_indeterminate_joints_are_an_event():
    from mechcore.motion.events import find_events

    run = run_scene(mechviz.load("double-parallelogram"), frames=24)
    (event,) = [e for e in find_events(run.motion) if "indeterminate" in e.text]
    assert "A, B, C, D, E, F" in event.text
