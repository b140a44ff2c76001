"""Studies of a scene for people: reports, cost, cams, balancing, vibrations, the shaking force."""
