"""A scene that bounces for a while, to be watched while it is computed."""

from __future__ import annotations

BOUNCING = """
units = { length = "mm", angle = "deg" }
effects = ["inertia", "gravity"]
run = { frames = 90, duration = "3 s" }
[links]
frame = { points = { O = [0, 0] } }
bar = { points = { O = [0, 0], E = [400, 0] }, mass = "1 kg", shape = "bar" }
[joints.O]
revolute = ["frame", "bar"]
free = { position = -30, speed = "10 rpm" }
stops = [{ at = -100, side = "lower", restitution = 0.5 }, { at = 80, side = "upper", name = "roof" }]
"""
