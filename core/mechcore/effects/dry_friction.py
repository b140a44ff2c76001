"""Dry friction in joints: it depends on the reactions, and these on it, so that both are solved together (`solve`)."""

from __future__ import annotations

from mechcore.effects.base import Effect


class DryFriction(Effect):
    """Stands for the friction of all joints where effects are listed; what it adds comes with the reactions, see `needs`."""

    cause = "dry friction"
    needs = frozenset({"positions", "velocities", "reactions"})
