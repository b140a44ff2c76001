"""Studies of many designs of one scene: sweeps, sensitivities, tolerances, optimisation."""
