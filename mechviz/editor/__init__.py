"""Editing a scene: parameters, limits, history and solving in the background; no browser inside."""
