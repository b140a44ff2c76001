"""What has happened in the course of a motion: happenings and the energies of impacts."""

from __future__ import annotations

from dataclasses import dataclass

from .happenings import Happening

__all__ = ["Happened", "Log"]


@dataclass(frozen=True)
class Happened:
    """Happenings; time and energy [J] that was ``lost`` in every impact; time and work [J] that prescribed drives did in it."""

    happenings: tuple[Happening, ...]
    lost: tuple[tuple[float, float], ...]
    pushed: tuple[tuple[float, float], ...]


class Log:
    """What has happened, in order of time; `news` is what has not been asked for yet."""

    def __init__(self) -> None:
        self.happenings: list[Happening] = []
        self._lost: list[tuple[float, float]] = []
        self._pushed: list[tuple[float, float]] = []
        self._told = (0, 0, 0)

    def tell(self, happening: Happening) -> None:
        self.happenings.append(happening)

    def lose(self, t: float, energy: float) -> None:
        """Account for the energy [J] that an impact takes."""
        self._lost.append((t, energy))

    def push(self, t: float, work: float) -> None:
        """Account for the work [J] of prescribed drives in an impact."""
        self._pushed.append((t, work))

    def whole(self) -> Happened:
        return self._since(0, 0, 0)

    def news(self) -> Happened:
        """What has happened since this was asked for the last time."""
        since, self._told = self._told, (len(self.happenings), len(self._lost), len(self._pushed))
        return self._since(*since)

    def _since(self, a: int, b: int, c: int) -> Happened:
        return Happened(tuple(self.happenings[a:]), tuple(self._lost[b:]), tuple(self._pushed[c:]))
