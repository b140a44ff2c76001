"""Statics: a drive that stands still holds its joint; the effort is what holding takes, the reactions are those at rest."""

import mechviz as mv

scene = mv.load("kinetostatic-four-bar")
drive = scene.mechanism.drives[0].joint  # the joint that is driven

for angle in (30, 60, 90):
    held = scene.changed({("joints", drive, "drive"): {"speed": 0, "start": f"{angle} deg"}})
    run = mv.run(held)
    print(f"held at {angle}°: {run[f'drive.{drive}.torque'][0, 0]:9.3f} N m; {len(run.time)} frame")
