"""Friction in all joints: the same slider-crank with its friction and without, side by side."""

import mechviz as mv

scene = mv.load("slider-crank-friction")
smooth = scene.changed({("effects",): ["inertia", "gravity"]})

rubbing, frictionless = mv.run(scene, frames=360), mv.run(smooth, frames=360)
a, b = rubbing["drive.O.torque"][:, 0], frictionless["drive.O.torque"][:, 0]
print(f"Driving torque from {b.min():.1f} to {b.max():.1f} N m without friction, {a.min():.1f} to {a.max():.1f} N m with it.")

for key in rubbing:
    if key.endswith("friction_loss"):
        print(f"{rubbing.quantity(key).label}: {rubbing[key].mean():.2f} W on average")
