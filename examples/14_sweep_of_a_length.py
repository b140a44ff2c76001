"""A sweep: the swing of the rocker over the length of the crank; a thousand four-bars in one call of the core."""

import numpy as np

import mechviz as mv
from mechcore import compile_mechanism, default_times
from mechcore.motion.sweep import sweep

mechanism = mv.load("crank-rocker").mechanism
cranks = np.linspace(0.030, 0.160, 1000)  # [m]
ends = np.column_stack([cranks, np.zeros_like(cranks)])  # where pin B is on each of them

designs = sweep(
    compile_mechanism(mechanism),
    {("crank", "B"): ends},
    default_times(mechanism, frames=90),
    lambda motion: {"rocker": motion.pose("rocker")[..., 2]},
)
swing = np.degrees(np.ptp(designs.results["rocker"], axis=1))
print(
    f"{designs.assembled.sum()} of {len(cranks)} designs turn fully: cranks of up to {1e3 * cranks[designs.assembled].max():.1f} mm"
)
for k in np.flatnonzero(designs.assembled)[::150]:
    print(f"crank {1e3 * cranks[k]:6.2f} mm  swing {swing[k]:6.2f}°")
