"""Recordings: write a solved scene as a rerun file, read it back, tell what is in it.

summary = write_recording(run, "recordings/crank-rocker.rrd")
print(format_inspection(inspect("recordings/crank-rocker.rrd")))
"""

from mechviz.outputs.rerun.inspection import Inspection, format_inspection, inspect
from mechviz.outputs.rerun.reader import Recording
from mechviz.outputs.rerun.stream_file import RecordingError, interruption
from mechviz.outputs.rerun.writer import RecordingSummary, write_recording

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
