"""The kinds of joints, loads, drives and studies of a scene: their keys and their translation to the core."""
