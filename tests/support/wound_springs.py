"""Mechanisms with torsion springs, stops and tables over relative angles."""

from __future__ import annotations

import numpy as np

from mechviz.scene.scene import loads

FOUR_BAR = """
units = {{ length = "mm", angle = "deg" }}
run = {{ frames = 40 }}
[links]
frame   = {{ points = {{ A = [0, 0], E = [{ex!r}, {ey!r}] }} }}
crank   = {{ points = {{ A = [0, 0], B = [60, 0] }} }}
coupler = {{ points = {{ B = [0, 0], D = [180, 0] }} }}
rocker  = {{ points = {{ E = [0, 0], D = [120, 0] }} }}
[joints]
A = {{ revolute = ["frame", "crank"], drive = {{ speed = "60 rpm", start = {start!r} }} }}
B = {{ revolute = ["crank", "coupler"] }}
D = {{ revolute = ["coupler", "rocker"], side = "left" }}
E = {{ revolute = ["frame", "rocker"] }}
[loads]
"""


SPRING = 'spring = { torsion_spring = ["crank", "coupler"], stiffness = "2 N m/rad", free_angle = 20 }'


TABLE = """
push = { torque = "40 N m", on = "rocker", table = { position = [-60, 20, 60], factor = [0, 1, 0.5], joint = "B", smooth = false } }
"""


SLIDER_CRANK = """
units = { length = "mm", angle = "deg" }
effects = ["inertia"]
[links]
frame  = { points = { O = [0, 0], G = [0, 0] } }
crank  = { points = { O = [0, 0], B = [150, 0] }, mass = "1 kg", centre = [75, 0], inertia = "0.002 kg m^2" }
rod    = { points = { B = [0, 0], C = [100, 0] }, mass = "0.5 kg", centre = [50, 0], inertia = "0.001 kg m^2" }
piston = { points = { C = [0, 0] }, mass = "0.3 kg" }
[joints]
"""


AT_REST = """
O = { revolute = ["frame", "crank"], free = { position = 20 } }
B = { revolute = ["crank", "rod"] }
C = { revolute = ["rod", "piston"] }
S = { prismatic = ["frame", "piston"], at = ["G", "C"], along = [1, 0], branch = "behind" }
[loads]
spring = { torsion_spring = ["frame", "rod"], stiffness = "2 N m/rad", free_angle = -150.0 }
[run]
frames = 40
duration = "50 ms"
"""


STOPPED = """
O = { revolute = ["frame", "crank"], free = { position = -10, speed = "1000 deg/s" } }
B = { revolute = ["crank", "rod"], stops = [{ at = 190, side = "upper", restitution = 1 }] }
C = { revolute = ["rod", "piston"] }
S = { prismatic = ["frame", "piston"], at = ["G", "C"], along = [1, 0], branch = "behind" }
[watch]
passed = { joint = "B", at = 185 }
[run]
frames = 100
duration = "100 ms"
"""


FIVE_BAR = """
frame = "f"
units = { length = "mm", angle = "deg", mass = "kg", inertia = "kg mm^2" }
effects = ["inertia", "gravity"]
run = { frames = 40, duration = 0.6 }
[links]
k2 = { points = { D = [0, 0], C = [220, 0] }, mass = 0.22, centre = [110, 0], inertia = 887.3333333333334 }
f  = { points = { A = [0, 0], E = [-160, 0] } }
c1 = { points = { A = [0, 0], B = [140, 0] }, mass = 0.14, centre = [70, 0], inertia = 228.66666666666674 }
k1 = { points = { B = [0, 0], C = [220, 0] }, mass = 0.22, centre = [110, 0], inertia = 887.3333333333334 }
c2 = { points = { E = [0, 0], D = [140, 0] }, mass = 0.14, centre = [70, 0], inertia = 228.66666666666674 }
[joints]
C = { revolute = ["k1", "k2"] }
A = { revolute = ["f", "c1"], free = { position = 53.94928507121888, speed = "57.29577951308232 rpm" } }
D = { revolute = ["c2", "k2"] }
B = { revolute = ["c1", "k1"] }
E = { revolute = ["f", "c2"], free = { position = 128.43379843822592, speed = -343.77467707849394 } }
[loads]
one   = { torsion_spring = ["f", "k1"], stiffness = "0.4 N m/rad", free_angle = 156.28074820123865 }
two   = { torsion_spring = ["f", "c1"], stiffness = "0.3 N m/rad", free_angle = 53.94928507121888 }
three = { torsion_spring = ["f", "c2"], stiffness = "0.3 N m/rad", free_angle = 128.43379843822592 }
[sketch]
c1 = { at = [0.0, 0.0], angle = 53.94928507121888 }
c2 = { at = [-160.0, 0.0], angle = 128.43379843822592 }
k1 = { at = [82.39015641574844, 113.18949653474262], angle = 139.09201434731398 }
k2 = { at = [-247.02539555789303, 109.66576734784769], angle = 42.13371473161277 }
"""


GEARED = (
    FIVE_BAR.replace("B = [140, 0]", "B = [140, 0], W = [60, 0]")
    .replace("[joints]", "w = { points = { W = [0, 0] }, mass = 0.3, centre = [10, 5], inertia = 300 }\n[joints]")
    .replace(
        "[loads]",
        """W = { revolute = ["c1", "w"] }
G = { gear = ["k1", "w"], radii = [50, 30], carrier = "c1" }
[loads]
four = { torsion_spring = ["f", "w"], stiffness = "0.1 N m/rad" }""",
    )
)


def four_bar(load: str, turn: float = 0.0):
    """The four-bar with its frame turned by an angle [deg], the crank's start with it."""
    e = complex(complex(-200.0, 60.0) * np.exp(1j * np.radians(turn)))
    return loads(FOUR_BAR.format(ex=e.real, ey=e.imag, start=170.0 + turn) + load)
