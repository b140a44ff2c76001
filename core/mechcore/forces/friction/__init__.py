"""Dry friction: where it acts, what presses there, and the reactions that follow."""
