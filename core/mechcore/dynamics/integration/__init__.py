"""Collocation of equations of motion in windows of time, and many windows at once."""
