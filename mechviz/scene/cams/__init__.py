"""Cams of a scene: profiles, followers, files, ratings."""
