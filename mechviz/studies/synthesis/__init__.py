"""Synthesis: scenes from tasks, every solution with its numbers and its defects."""
