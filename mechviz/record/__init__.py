"""Recordings: write a solved scene as a rerun file, read it back, tell what is in it.

summary = write_recording(run, "recordings/crank-rocker.rrd")
print(format_inspection(inspect("recordings/crank-rocker.rrd")))
"""

from __future__ import annotations

from .errors import RecordingError, interruption
from .inspection import Inspection, format_inspection, inspect
from .reader import Recording
from .writer import RecordingSummary, write_recording

__all__ = [
    "Inspection",
    "Recording",
    "RecordingError",
    "RecordingSummary",
    "format_inspection",
    "inspect",
    "interruption",
    "write_recording",
]
