"""Derivatives of forces of cams that rub, by what their place of contact, and how they slide there, follow from."""

from __future__ import annotations

import numpy as np
import pytest
from cases import side_by_side
from test_driven_cams import CAM, DRAG_LINK, FRAMES, RISING, agree

from mechviz.runs import run_scene
from mechviz.scene.scene import load, loads
from mechviz.studies.designs.sensitivity import sensitivity
from mechviz.studies.designs.variables import variables_of

BARREL = ["drive.O.torque", "joint.K.reaction", "joint.O.reaction", "joint.S.reaction"]


@pytest.mark.parametrize("number", ["joints.K.profile.base", "joints.K.profile.lift[0].to", "joints.K.friction.coefficient"])
def test_a_cam_under_a_knife_that_rubs(number):
    """Where it touches turns the friction, too."""
    scene = load("cam-friction").changed({("run", "frames"): FRAMES})
    agree(scene, number, 1e-4, ["drive.O.torque", "joint.K.reaction", "joint.S.reaction"])


@pytest.mark.parametrize("number, step", [("links.crank.points.B[0]", 0.01), ("joints.K.follower.roller", 0.01)])
def test_a_roller_whose_pin_rubs_on_a_cam_that_a_linkage_turns(number, step):
    rubs = "friction = { coefficient = 0.1, radius = 3 }"
    text = DRAG_LINK + RISING + CAM.format(face="roller = 10", closure=rubs, base=38, rise=22)
    agree(loads(text.replace('"gravity"]', '"gravity", "friction"]'), "drag"), number, step, ["drive.A.torque", "joint.K.reaction"])


@pytest.mark.sample(2)
@pytest.mark.parametrize(
    ("number", "effects"),
    side_by_side(
        ["links.carriage.mass", "joints.K.profile.barrel.radius", "joints.K.profile.base", "joints.K.follower.roller"],
        [["inertia", "friction"], ["inertia"]],
    ),
)
def test_a_barrel_cam(number, effects):
    """Its shaft lies in the plane, so that its bearings carry a couple."""
    scene = load("cam-barrel").changed({("effects",): effects, ("run", "frames"): FRAMES})
    agree(scene, number, 1e-3 if "mass" in number else 1e-2, BARREL)


def test_a_screw_whose_thread_rubs():
    """Its shaft lies in the plane, too, and it is no cam. All goes straight with the mass that it lifts."""
    scene = load("screw-jack").changed({("run", "frames"): 8})
    (mass,) = variables_of(scene, ["links.table.mass"])
    run, heavier = run_scene(scene), run_scene(mass.changed(scene, mass.value + 1.0))
    for key in ("drive.S.torque", "joint.S.reaction[Fy]"):
        one = sensitivity(run, key, [mass.name])
        beside = heavier.catalogue[one.quantity.key].values()[:, one.measure.column(one.quantity)]
        np.testing.assert_allclose(one.slopes[0], beside - one.curve, atol=1e-11 * np.abs(one.curve).max())
