"""Accuracy of a run: estimates of its errors, and the settings that a target error needs."""

__all__ = []
