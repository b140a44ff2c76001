"""A motion under forces while it is found: blocks of its frames as soon as they are known, and all frames so far as one run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mechcore.arrays import Real
from mechcore.dynamics.joined import JoinedForces, JoinedMotion
from mechcore.effects.plan import OUTPUTS, make_plan
from mechcore.forces.kinetostatics import Forces
from mechcore.motion.motion import Motion
from mechviz.runs import Run

if TYPE_CHECKING:
    from mechcore.dynamics.simulation import Simulation
    from mechviz.scene.scene import Scene


BLOCKS = 40  # of a run that goes on to its end


@dataclass(frozen=True, eq=False)
class _Block:
    """Frames at ``times`` (F,) [s]: their motion and, where the scene has forces, those."""

    times: Real
    motion: Motion
    forces: Forces | None


class Running:
    """Takes the stretches of a motion in order, as `mechcore.dynamics.simulate` finds them, and makes runs of them.

    Every frame is solved once: a run of all frames so far is put together from the blocks. ``sent``: frames that are known in
    blocks. A block is a fortieth of the run, or, with ``due``, as many frames as there are when that says so.
    """

    def __init__(self, scene: Scene, due: Callable[[], bool] | None = None):
        self.scene = scene
        self.due = due
        self.plan = make_plan(scene.mechanism, set(OUTPUTS))
        self.sent = 0
        self.times: Real = np.zeros(0)  # of all frames of the whole run
        self.duration = 0.0
        self._stretches: list[Simulation] = []
        self._found: tuple[tuple[_Block, ...], Simulation] | None = None  # replaced as one: another thread may ask for it

    def take(self, stretch: Simulation, duration: float) -> Run | None:
        """Take a stretch; the run of the frames that are new, if they are enough for a block. ``duration`` of the whole [s]."""
        if not len(self.times):
            self.duration = duration
            self.times = np.linspace(0.0, duration, self.scene.frames + 1)
        self._stretches.append(stretch)
        known = int(np.searchsorted(self.times, stretch.duration, side="right"))
        enough = max(len(self.times) // BLOCKS, 2)
        if self.due is not None:
            enough = 2 if self.due() else len(self.times)
        if known - self.sent < enough and not (known == len(self.times) and known > self.sent):
            return None
        return self._block(self.times[self.sent : known])

    def _block(self, times: Real) -> Run:
        first, *others = self._stretches
        new = first.followed_by(others)
        self._stretches = []
        motion = new.view(times)
        forces = None
        if self.plan.has("reactions and drive efforts"):
            forces = new.forces(motion)
            _ = new.energies(times)  # its works: the whole then need not find them again
        block = _Block(times, motion, forces)
        if self._found is None:
            self._found = (block,), new
        else:
            self._found = (*self._found[0], block), self._found[1].followed_by([new])
        self.sent += len(times)
        return self._run((block,), self._found[1])

    def so_far(self) -> Run:
        """All frames that are known in blocks, of which there has to be one. Another thread may ask."""
        assert self._found is not None
        return self._run(*self._found)

    def _run(self, blocks: tuple[_Block, ...], whole: Simulation) -> Run:
        assert self._found is not None
        first = blocks[0]
        times = np.concatenate([b.times for b in blocks])
        starts = np.cumsum([0, *(len(b.times) for b in blocks)])
        parts = [(rows + at, m) for b, at in zip(blocks, starts, strict=False) for rows, m in b.motion.parts]
        motion = JoinedMotion(
            times,
            parts,
            mechanism=self._found[0][0].motion.mechanism,  # the same one in all runs, for which solids are made
            again=whole.view,
            coordinates=whole.coordinates(times),
            model=first.motion.model,
        )
        forces: JoinedForces | None = None
        if first.forces is not None:
            solved = [part for b in blocks if b.forces is not None for part in b.forces.parts]
            found = [(rows, f) for (rows, _), (_, f) in zip(parts, solved, strict=True)]
            forces = JoinedForces(motion, found, stops=whole.stops, energies=whole.energies)
        return Run(
            scene=self.scene,
            compiled=whole.compiled,
            motion=motion,
            forces=forces,
            plan=self.plan,
            stages=(),
            simulation=whole,
            accuracy=self.scene.accuracy,
        )
