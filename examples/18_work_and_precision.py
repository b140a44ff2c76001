"""What accuracy costs: errors and times of a scene at several numbers of frames, and one wanted error that decides them."""

import mechviz as mv
from mechviz.studies.precision import cheapest, ladder

scene = mv.load("crank-rocker")
points = ladder(scene, budget=0.005, only=["frames"])
for p in points:
    print(f"{p.method:<24}{p.value:>12}  relative error {p.error:.1e}  {1e3 * p.seconds:.2f} ms")

wanted = 1e-6
best = cheapest(points, wanted)
assert best is not None
run = mv.run(scene, accuracy=wanted)
print(f"Cheapest measured for {wanted:g}: {best.value}; asked for {wanted:g}, a run takes {len(run.time) - 1} frames.")
