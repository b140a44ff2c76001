"""The cost of accuracy: errors of a run estimated, frames found for a wanted error, settings measured against each other."""

__all__ = []
