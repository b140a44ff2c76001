"""Events: dead points, limits, peaks, contacts and jams are found between the frames and told with their times."""

import mechviz as mv

for name in ("slider-crank-compressor", "double-rocker", "cam-constant-acceleration"):
    run = mv.run(name, frames=90)
    print(run.title)
    for event in run.events:
        print(f"  {event.level:<4}  {event.time:9.5f} s  {event.item}: {event.text}")
