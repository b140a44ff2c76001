"""Recordings: a solved scene written as a rerun file, and read back."""
