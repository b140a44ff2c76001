"""Cams in their mechanisms: their geometry in the axes of the links, over a motion."""
