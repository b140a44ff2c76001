"""A motion over frames and what is read from it: events, extremes, reach, structure, kinematic metrics."""
