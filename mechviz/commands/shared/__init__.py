"""Shared by all commands: messages and exit codes, scenes as arguments, solving and warnings about results."""
