"""Where a four-bar is: solve a scene of the gallery and read positions and angles by name."""

import mechviz as mv

run = mv.run("crank-rocker", frames=72)

angle = run["link.rocker.angle"][:, 0]  # one column, in degrees
path = run["point.coupler.E.position"]  # x and y of the traced point, in mm
print(run)
print(f"The rocker swings between {angle.min():.2f}° and {angle.max():.2f}°.")
print(f"The coupler point is {path[:, 1].max() - path[:, 1].min():.1f} mm tall from end to end of its path.")

# the core's own results are in SI units: poses (F, 3), points with their first and second derivatives by time (F, 2)
acceleration = run.motion.point("coupler", "E", 2)
print(f"Largest acceleration of E: {abs(acceleration).max():.3f} m/s². Loops close to {run.motion.closure.max():.1e} m.")
