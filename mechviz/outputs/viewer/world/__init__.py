"""Content of the 3D view: solids, arrows, lines, marks, constructions, the camera."""
