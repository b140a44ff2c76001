"""Derivatives of forces of cams that rub, by what their place of contact, and how they slide there, follow from."""

from __future__ import annotations

import pytest
from test_driven_cams import CAM, DRAG_LINK, FRAMES, RISING, agree

from mechviz.scene.scene import load, loads

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


@pytest.mark.parametrize("effects", [["inertia"], ["inertia", "friction"]])
@pytest.mark.parametrize(
    "number", ["links.carriage.mass", "joints.K.profile.barrel.radius", "joints.K.profile.base", "joints.K.follower.roller"]
)
def test_a_barrel_cam(number, effects):
    """Its shaft lies in the plane, so that its bearings carry a couple."""
    scene = load("cam-barrel").changed({("effects",): effects, ("run", "frames"): FRAMES})
    agree(scene, number, 1e-3 if "mass" in number else 1e-2, BARREL)
