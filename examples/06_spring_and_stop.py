"""Motion under forces: a spring straightens a toggle until its ram hits a stop, bounces, and is held."""

import mechviz as mv

run = mv.run("toggle-press-stop", frames=200)

for event in run.events:
    if event.item == "die":
        print(f"{event.time:.6f} s  {event.item}: {event.text}")

slide = run["joint.S.displacement"][:, 0]
assert slide.max() <= 318.0 + 1e-6  # the stop of the scene, in mm
print(f"The ram ends at {slide[-1]:.3f} mm; the energy drifts by {abs(run['health.energy_drift']).max():.1e} of what is exchanged.")
