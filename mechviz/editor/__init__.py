"""Editing of scenes: parameters, limits, history and solving in the background; independent of the browser."""
