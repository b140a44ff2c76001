"""Dimensional and number synthesis: mechanisms from tasks, as pure functions over arrays. Plane vectors are complex numbers."""
