"""Dry friction: where it acts, the normal loads there, and the reactions that follow."""
