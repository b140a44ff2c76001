"""Forces inside links: the bending of a connecting rod at speed, its stress, and the stem of a follower in its guide."""

import mechviz as mv

run = mv.run("connecting-rod-bending")
rod = run.solved.studies.sections["rod"]
k = abs(rod.bending.values).argmax()
print(run.title)
print(f"  largest bending moment {rod.bending.values[k]:.1f} N m, {1e3 * rod.bending.stations[k]:.0f} mm from the crank pin")
print(f"  at {run.time[k]:.4f} s; bending stress up to {run['link.rod.bending_stress'].max():.1f} MPa")
for station, normal, shear, moment in list(zip(rod.stations[k], rod.normal[k], rod.shear[k], rod.moment[k], strict=True))[3::12]:
    print(f"  s = {1e3 * station:5.1f} mm   N = {normal:8.1f} N   V = {shear:8.1f} N   M = {moment:7.2f} N m")

cam = mv.load("cam-friction").changed({("sections",): {"follower": {"section": {"diameter": 12}}}})
run = mv.run(cam)
print(run.title)
print(f"  the stem bends by up to {abs(run['link.follower.bending_moment']).max():.2f} N m")
for end in ("behind", "ahead"):
    print(f"  the end of the guide {end} carries up to {abs(run[f'joint.S.bearing_force_{end}']).max():.0f} N")
