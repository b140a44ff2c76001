"""A motion over frames and what is derived from it: events, extremes, reach, structure, kinematic metrics."""
