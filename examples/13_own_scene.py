"""A scene of your own, built in Python: units are stated once, names join the parts, every fault is told at once."""

import sys
import tempfile
from pathlib import Path

import mechviz as mv

folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp())

b = mv.SceneBuilder("pump", length="mm", angle="deg")
b.link("frame", O=(0, 0))
b.link("crank", O=(0, 0), B=(40, 0), mass="0.6 kg", shape="bar")
b.link("rod", B=(0, 0), C=(150, 0), mass="0.4 kg", shape="bar")
b.link("plunger", C=(0, 0), mass="0.8 kg")
b.revolute("O", "frame", "crank", drive={"speed": "120 rpm"})
b.revolute("B", "crank", "rod")
b.revolute("C", "rod", "plunger")
b.prismatic("S", "frame", "plunger", at=["O", "C"], along=(1, 0), branch="ahead")
b.force("pressure", ("-200 N", 0), on="plunger", at="C").effect("inertia").run(frames=120)
scene = b.scene()

mv.dump(scene, folder / "pump.toml")
print((folder / "pump.toml").read_text(encoding="utf-8"))
print(f"Largest torque {abs(mv.run(scene)['drive.O.torque']).max():.2f} N m")

try:
    b.link("lid", mass="5 mm").scene()
except mv.SceneError as error:
    print(error)
