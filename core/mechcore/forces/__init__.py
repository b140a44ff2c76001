"""Reactions and drive efforts of a motion: kinetostatics, dry friction, powers, the flywheel, cams under load."""
