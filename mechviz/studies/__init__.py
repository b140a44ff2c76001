"""Studies of a scene: text reports, cost, cams, balancing, vibrations, shaking force."""
