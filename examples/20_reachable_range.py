"""A crank that cannot turn fully: refused with the range it has, or run through that range and back."""

import mechviz as mv

links = {
    "frame": {"points": {"A": (0, 0), "D": (200, 0)}},
    "crank": {"points": {"A": (0, 0), "B": (120, 0)}},
    "coupler": {"points": {"B": (0, 0), "C": (150, 0)}},
    "rocker": {"points": {"D": (0, 0), "C": (140, 0)}},
}
b = mv.SceneBuilder("no-grashof", length="mm", angle="deg")
for name, link in links.items():
    b.link(name, link["points"])
b.revolute("A", "frame", "crank", drive={"speed": "60 rpm", "start": 40})
b.revolute("B", "crank", "coupler").revolute("C", "coupler", "rocker", side="left").revolute("D", "rocker", "frame")
scene = b.scene()

try:
    mv.run(scene)
except ValueError as error:
    print(error)

run = mv.run(scene.changed({("joints", "A", "drive", "range"): "reachable"}), frames=120)
angle = run["joint.A.angle"][:, 0]
print(f"With range = 'reachable' the crank swings from {angle.min():.2f}° to {angle.max():.2f}°.")
