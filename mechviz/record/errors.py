"""What can go wrong with a recording, in words."""

from __future__ import annotations

from ..files import OutputError

__all__ = ["RecordingError", "interruption"]


class RecordingError(OutputError):
    """A recording that could not be written or read: ``message`` says what happened, ``remedy`` what to do."""

    @classmethod
    def of(cls, error: OutputError) -> RecordingError:
        return cls(error.message, error.remedy, error.code)


def interruption(error: BaseException) -> str:
    """What an interrupted recording left behind: the note that the writer put on the exception, or nothing."""
    return "\n".join(getattr(error, "__notes__", ()))
