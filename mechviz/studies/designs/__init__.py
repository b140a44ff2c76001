"""Studies of many designs of one scene: sweeps, and what tolerances do."""
