"""What is said to a user: quantities in the scene's units, paths that the scene has."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from mechcore.errors import Fault
from mechcore.events import Event
from mechcore.texts import Kind, Text, as_angle, as_coordinate, as_force, as_length
from mechviz.quantities.events import events_of
from mechviz.run import run_scene
from mechviz.scene import Scene, gallery_names, load
from mechviz.scene.document import UnitsDocument
from mechviz.scene.units import KINDS, Units

ODD = Units(length="in", angle="turn", force="kgf")
FOREIGN = re.compile(r"(?<![\w'\"])-?[\d.]+(e[+-]?\d+)? ?(mm|cm|m|deg|rad|°)(?![\w²³/^])(?! \w*['\"])")
"""A number with a unit of length or angle other than those of `ODD`."""


def shown_in(scene: Scene, units: Units) -> Scene:
    """The same mechanism from a scene whose bare numbers are counted in other units."""
    return replace(scene, document=scene.document.model_copy(update={"units": UnitsDocument(**vars(units))}))


# --- texts ------------------------------------------------------------------------------------------------------------


def test_a_text_shows_its_quantities_in_the_units_of_its_reader():
    text = Text(f"{as_length(0.0508)} at {as_angle(np.pi / 2, 4)}")
    assert text == "50.8 mm at 90°"
    assert text.in_units(ODD) == "2 in at 0.25 turn"
    assert text.in_units(Units()) == "0.0508 m at 1.571 rad"
    assert Text(f"{as_coordinate(0.0, rotary=True)}, {as_coordinate(-0.0, rotary=False)}") == "0°, 0 mm"
    assert Text(as_force(9.80665)).in_units(ODD) == "1 kgf"


def test_faults_and_events_show_theirs_too():
    fault = Fault("pairs.A", f"{as_length(0.0254)} apart.", f"Give {as_length(0.0127)}.")
    assert str(fault) == "pairs.A: 25.4 mm apart. Give 12.7 mm."
    assert fault.in_units(ODD) == Fault("pairs.A", "1 in apart.", "Give 0.5 in.")
    assert replace(fault, path="pairs.B").in_units(ODD).message == "1 in apart."
    event = Event(0.0, "INFO", "A", f"at {as_angle(np.pi)}")
    assert event.text == "at 180°" and event.in_units(ODD).text == "at 0.5 turn"


def test_the_units_of_a_scene_have_all_kinds_of_quantities_of_texts():
    units = Units(length="mm", angle="deg", force="kN", time="s", torque="kN m")
    shown = {kind: units.show(1.0, kind, 4) for kind in Kind.__args__}
    assert shown == {
        "length": "1000 mm", "angle": "57.3°", "linear speed": "1000 mm/s", "angular speed": "57.3 °/s", "force": "0.001 kN",
        "torque": "0.001 kN m", "stiffness": "1e-06 kN/mm", "torsional stiffness": "1.745e-05 kN m/°",
    }  # fmt: skip
    assert set(shown) <= set(KINDS)


# --- units of what a run says -----------------------------------------------------------------------------------------

QUICK = [name for name in gallery_names() if load(name).simulation is None]


@pytest.mark.parametrize("name", QUICK)
def test_events_and_check_are_in_the_units_of_the_scene(name):
    scene = shown_in(load(name), ODD)
    run = run_scene(scene)
    told = [e.text for e in events_of(run)]
    assert not [text for text in told if FOREIGN.search(text)]
