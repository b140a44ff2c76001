"""Links of barrel, end and globoid cams turn about a shaft in the plane: what holds for them, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from cam_scenes import changed, refused, solved, text_of

from mechcore.constructions.centres import kennedy
from mechcore.constructions.studies import compute
from mechcore.errors import MechanismError
from mechcore.motion.metrics import instant_centres, metric_items
from mechviz.scene.scene import loads

OWN = 'mass = "3.0 kg", inertia = "0.003 kg m^2"'
SWINGS = changed(
    text_of("cam-barrel").replace(', "friction"', ', "gravity"'),
    'speed = "200 rpm", start = 0',
    'oscillation = { amplitude = 40, period = "0.2 s", centre = 60 }',
)
WELDED = changed(
    changed(text_of("cam-barrel"), "[joints]\n", '[joints]\nW = { weld = ["shaft", "cam"], at = ["A", "O"] }\n'),
    'revolute = ["frame", "cam"]',
    'revolute = ["frame", "shaft"], at = ["O", "A"]',
)


def on_shaft(text: str, more: str) -> str:
    """A scene with a link that is welded to the cam: the shaft."""
    return changed(text, "[links]\n", f"[links]\nshaft = {{ points = {{ A = [10, 0] }}, {more} }}\n")


def test_a_mass_about_a_shaft_in_the_plane_shakes_only_by_what_the_follower_weighs():
    """The carriage slides along y over O: a moment about [50, 0] mm of -0.05 m times its force, none of the cam's J alpha."""
    motion, forces = solved(SWINGS + "\n[shaking]\nabout = [50, 0]\n", 90)
    shaken = compute(motion, forces).shaking
    fall = -0.9 * motion.coordinate("S")[:, 2]
    np.testing.assert_allclose(shaken.force, np.column_stack([0.0 * fall, fall]), atol=1e-9 * np.abs(fall).max())
    np.testing.assert_allclose(shaken.moment, -0.05 * fall, atol=1e-9 * np.abs(fall).max())


def test_its_own_drive_still_turns_its_moment_of_inertia():
    """J alpha of the oscillation, and what the carriage asks for by its weight and inertia; gravity does no work on the cam."""
    motion, forces = solved(SWINGS, 90)
    speed, alpha = motion.coordinate("O")[:, 1:].T
    turn = 2.0 * np.pi / 0.2
    np.testing.assert_allclose(alpha, -np.radians(40) * turn**2 * np.sin(turn * motion.time), atol=1e-9 * turn**2)
    lifted = 0.9 * (motion.coordinate("S")[:, 2] + 9.81) * motion.coordinate("S")[:, 1]
    np.testing.assert_allclose(forces.effort("O") * speed, 0.003 * alpha * speed + lifted, atol=1e-9)


@pytest.mark.parametrize(
    ("name", "pair", "place"), [("cam-barrel", "carriage", (np.inf, np.inf)), ("cam-globoid", "arm", (0.11, 0))]
)
def test_instant_centres_are_those_of_links_in_the_plane(name, pair, place):
    motion, _ = solved(text_of(name), 12)
    assert metric_items("instant_centre", motion.model) == [("frame", pair)]
    (centres,) = instant_centres(motion).values()
    turns = np.isfinite(centres).all(axis=1)
    assert turns.any() == np.isfinite(place).all()
    np.testing.assert_allclose(centres[turns], np.broadcast_to(place, centres[turns].shape), atol=1e-12)
    assert [centre.links for centre in kennedy(motion).values()] == [("frame", pair)]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (OWN, f"{OWN}, centre = [10, 0]", ["links.cam.centre", "centre of mass lies 10 mm off its pin", "Give the centre"]),
        (OWN, f"{OWN}, centre = [0, 10]", ["links.cam.centre", "lies 10 mm off its pin"]),
        (OWN, f'{OWN}, point_masses = [{{ mass = "1 kg", at = [8, 6] }}]', ["links.cam.point_masses[0]", "lies 10 mm off"]),
        (
            OWN, f'{OWN}, point_masses = [{{ mass = "1 kg", at = [0, 5] }}, {{ mass = "1 kg", at = [0, -5] }}]',
            ["links.cam.point_masses[0]", "links.cam.point_masses[1]", "lies 5 mm off"],
        ),
        ("cam      = { points = { O = [0, 0] }", "cam = { points = { O = [0, 0], A = [0, 7] }, centre = [0, 0]",
         ["links.cam.points.A", "its point 'A' lies 7 mm off its pin"]),
        ("[links]\n", '[loads]\nf = { force = ["1 N", 0], on = "cam", at = "O", axes = "link" }\n[links]\n',
         ["loads.f", "Fix its direction"]),
        ("[links]\n", '[loads]\nf = { force = ["1 N", 0], on = "carriage", at = "E", against = "cam" }\n[links]\n',
         ["loads.f", "cannot act against it"]),
        ("effects =", 'centrodes = ["cam"]\neffects =', ["centrodes[0]", "centrodes do not apply"]),
        ("effects =", 'instant_centres = ["carriage", "cam"]\neffects =', ["instant_centres[1]", "do not apply"]),
        ("effects =", 'inflection = ["cam"]\neffects =', ["inflection[0]", "do not apply"]),
        ("[links]\n", '[systems]\ns = { on = "cam" }\n[links]\n', ["systems.s", "do not apply"]),
        ("[links]\n", "[substitutes]\ncam = { masses = [{ at = \"O\" }, { x = 10 }] }\n[links]\n", ["do not apply"]),
    ],
)  # fmt: skip
def test_what_would_leave_the_plane_is_refused(old, new, words):
    refused(changed(text_of("cam-barrel"), old, new), ["turns about a shaft in the plane", *words])


def test_what_is_on_the_shaft_may_stay():
    text = changed(text_of("cam-barrel"), OWN, f'{OWN}, centre = [0, 0], point_masses = [{{ mass = "1 kg", at = "O" }}]')
    solved(
        changed(
            text,
            "[links]\n",
            '[loads]\nf = { force = ["1 N", "2 N"], on = "cam", at = "O" }\nt = { torque = "1 N m", on = "cam" }\n[links]\n',
        ),
        12,
    )
    solved(on_shaft(WELDED, 'mass = "1 kg", centre = [10, 0], inertia = "1e-4 kg m^2"'), 12)


def test_what_is_welded_to_the_cam_turns_with_it():
    refused(
        on_shaft(WELDED, 'mass = "1 kg", centre = [0, 0], inertia = "1e-4 kg m^2"'), ["links.shaft.centre", "10 mm off its pin"]
    )


def test_the_refusal_is_in_the_units_of_the_scene():
    text = changed(text_of("cam-barrel"), OWN, f'{OWN}, point_masses = [{{ mass = "1 kg", at = ["1 in", 0] }}]')
    with pytest.raises(MechanismError, match=r"2\.54 cm off its pin"):
        loads(changed(text, 'length = "mm"', 'length = "cm"'))
