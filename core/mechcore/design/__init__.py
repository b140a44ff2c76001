"""Dimensional and number synthesis: mechanisms for tasks, as pure functions over arrays. Plane vectors are complex numbers."""
