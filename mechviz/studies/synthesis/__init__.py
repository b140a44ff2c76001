"""Synthesis of linkages: tasks to solutions, each a scene with its characteristic numbers and its defects."""
