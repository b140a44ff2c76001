"""Shared by all commands: messages and exit codes, scenes as arguments, solving and its doubts."""
