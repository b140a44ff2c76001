"""Editing: changes of the scene are solved in a thread of their own, newer ones replace older ones, and a change that cannot be
built leaves the last good mechanism in place."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from mechcore.errors import MechanismError
from mechcore.numerics.frames import give_back_memory
from mechcore.records import dataclass
from mechcore.spec.mechanism import EFFECTS
from mechviz.editor.history import Draft, History
from mechviz.editor.parameters import Parameter, find_parameters
from mechviz.editor.worker import LatestRequestWorker, assembles, feasible_range
from mechviz.outputs.viewer.build import Built, build, view_model_of_run
from mechviz.outputs.viewer.view_model import ViewModel
from mechviz.runs import Run, run_scene
from mechviz.scene.assembly.simulation import oscillating_drives, oscillation_changes

DraftChange = Callable[[Draft], Draft]

QUICK_RUN = 0.05  # [s] contributions are computed automatically only if a run takes less than this
TIMING_REPEATS = 5


@dataclass(frozen=True)
class Status:
    """Result of the last change. ``fault``: why it could not be built, empty if it could; ``key``: of the changed value;
    ``value``: the number refused; ``feasible_range``: where it can be moved, in its unit, if known; ``seconds``: solution time;
    ``oscillating_drives``: those that oscillate over their reachable range."""

    fault: str = ""
    key: str = ""
    value: float = float("nan")
    feasible_range: tuple[float, float] | None = None
    seconds: float = 0.0
    oscillating_drives: tuple[str, ...] = ()


@dataclass(frozen=True)
class Contribution:
    """Contribution of an effect or load: the peak of the driving effort (in a motion without drives: of the reactions) with and
    without it, and its computing time ``seconds`` [s]. NaN where not known; ``why``: the reason."""

    name: str
    on: bool
    peak_with: float
    peak_without: float
    seconds: float
    why: str = ""


@dataclass(frozen=True)
class _Value:
    """A slider was moved."""

    parameter: Parameter
    value: float

    def written(self) -> float | int | str:
        """The value as written in the scene. Raises ValueError beyond the limits for typed values."""
        p = self.parameter
        if not p.hard_low <= self.value <= p.hard_high:
            raise ValueError(f"Here it can be {p.text(p.hard_low)} to {p.text(p.hard_high)}; the scene file takes more.")
        return p.written(self.value)


class EditSession:
    """A scene that is being edited.

    The session calls from its own threads: ``present(view_model)`` to show a new run, ``report(status)`` with the result of a
    change, ``contributed(...)`` with the contributions of the effects, ``settled()`` when nothing has been changed for a while,
    and ``failed(error)`` with an unexpected error.
    """

    def __init__(
        self,
        run: Run,
        present: Callable[[ViewModel], None],
        report: Callable[[Status], None],
        contributed: Callable[[tuple[Contribution, ...]], None],
        settled: Callable[[], None],
        failed: Callable[[Exception], None],
    ):
        self._present, self._report, self._contributed, self._settled = present, report, contributed, settled
        self._lock = threading.RLock()
        self._asking = threading.Lock()  # held only briefly: browsers wait for it
        self._pending: list[tuple[str, DraftChange | _Value | str]] = []  # in the order of the requests
        self._working: frozenset[str] = frozenset()  # keys of the changes being solved and not yet shown
        own = None if run.accuracy == run.scene.accuracy else run.accuracy
        self.history = History(replace(Draft.of(run.scene), accuracy=own))
        self._built: Built = build(run)
        self.run = run
        self.source = run.scene  # as opened, with the text of its file
        self.opened = self.view_model = view_model_of_run(run, self._built)
        self.status = Status(oscillating_drives=oscillating_drives(run.scene))
        self._patient = False
        self._builder: LatestRequestWorker[Run] = LatestRequestWorker(self._build, failed, idle_time=0.0)
        self._worker: LatestRequestWorker[None] = LatestRequestWorker(self._work, failed, self._settle)

    # -- requests, from any thread ------------------------------------------------------------------------------------
    def set_value(self, parameter: Parameter, value: float) -> None:
        """Set a value of the scene."""
        self._ask(parameter.key, _Value(parameter, value))

    def change(self, key: str, change: DraftChange) -> None:
        """Apply a function to the draft; ``key`` names what it changes."""
        self._ask(key, change)

    def undo(self) -> None:
        self._ask("", "undo")

    def redo(self) -> None:
        self._ask("", "redo")

    def reset(self) -> None:
        """Return to the scene as opened; this can be undone."""
        self._ask("", "reset")

    def find_contributions(self, asked: bool = False) -> None:
        """Compute the contribution of each effect and load; unless the user ``asked`` for it, only if a run is quick."""
        self._patient = asked
        self._builder.submit(self.run)

    def wait(self, timeout: float = 600.0, *, until_idle: bool = False) -> bool:
        """Wait until all changes so far are shown, ``until_idle``: with the solids of the last one; False after ``timeout`` [s]."""
        return self._worker.wait(timeout, until_idle=until_idle) and (not until_idle or self._builder.wait(timeout))

    @property
    def is_superseded(self) -> bool:
        """Whether a newer change waits for the one being solved."""
        return self._worker.is_superseded

    def is_pending(self, key: str) -> bool:
        """Whether a requested change of this value is neither shown nor refused yet."""
        with self._asking:
            return key in self._working or any(key == waiting for waiting, _ in self._pending)

    @property
    def busy(self) -> bool:
        """Whether a requested change is neither shown nor refused yet."""
        with self._asking:
            return bool(self._pending or self._working)

    def close(self) -> None:
        self._worker.close()
        self._builder.close()

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The current values that can be edited, without those of loads that are switched off."""
        return find_parameters(self.run.scene, self.source.document)

    # -- the worker's thread ------------------------------------------------------------------------------------------
    def _ask(self, key: str, what: DraftChange | _Value | str) -> None:
        with self._asking:
            steps = [n for n, (_, other) in enumerate(self._pending) if isinstance(other, str)]
            first = len(self._pending) if isinstance(what, str) else steps[-1] + 1 if steps else 0
            older, newer = self._pending[:first], self._pending[first:]  # replaces one after the last step
            self._pending = [*older, *(other for other in newer if other[0] != key), (key, what)]
        self._worker.submit(None)

    def _work(self, _: None) -> None:
        with self._asking:
            pending, self._pending = self._pending, []
            self._working = frozenset(key for key, _ in pending)
        start = time.perf_counter()
        history = self.history.copied()
        draft, moved = history.present, None
        changed: list[str] = []  # since the last step of the history
        key = "+".join(dict.fromkeys(key for key, _ in pending))
        try:
            for name, what in pending:
                if isinstance(what, str):
                    if changed:
                        history.change(draft, "+".join(changed))
                        changed = []
                    draft = {"undo": history.undo, "redo": history.redo, "reset": history.reset}[what]()
                    continue
                changed.append(name)
                if isinstance(what, _Value):
                    moved = what
                    draft = draft.with_value(what.parameter.path, what.written())
                else:
                    draft = what(draft)
            draft, run = self._solved(draft)
            with self._lock:
                view_model = view_model_of_run(run, self._built, self.view_model)
                before = self.run, self.view_model
                self.run, self.view_model, self._working = run, view_model, frozenset()
                try:
                    self._present(view_model)
                except Exception:
                    self.run, self.view_model = before
                    self._present(self.view_model)  # instead of the half-drawn new one
                    raise
            if changed:
                history.change(draft, "+".join(changed))
            self.history = history
            self._report_to(Status(key=key, seconds=time.perf_counter() - start, oscillating_drives=oscillating_drives(run.scene)))
        except (MechanismError, ValueError) as error:
            self._report_to(Status(_words(error), key, moved.value if moved else float("nan")))
            if moved is not None and len(pending) == 1:
                self._find_range(moved, _words(error))
        except Exception as error:
            self._report_to(Status(f"{type(error).__name__}: {error}", key))
            raise

    def _solved(self, draft: Draft) -> tuple[Draft, Run]:
        """A draft and its run. If a drive cannot make full turns, the draft is changed: it oscillates over its reachable range."""
        try:
            return draft, run_scene(draft.scene(), accuracy=draft.accuracy)
        except MechanismError as error:
            changes = oscillation_changes(draft.document)
            if not changes:
                raise
            try:
                swung = draft.changed(changes)
                return swung, run_scene(swung.scene(), accuracy=draft.accuracy)
            except MechanismError:
                raise error from None

    def _find_range(self, moved: _Value, fault: str) -> None:
        """Report the range in which a value can be moved, unless a newer change waits."""
        p, present = moved.parameter, self.history.present

        def holds(value: float) -> bool:
            try:
                draft = present.with_value(p.path, p.written(value))
                return assembles(draft.changed(oscillation_changes(draft.document)).scene())
            except (MechanismError, ValueError):
                return False

        good = next((q.value for q in self.parameters if q.key == p.key), p.value)
        low, high = (min(max(v, p.hard_low), p.hard_high) for v in (min(p.low, moved.value, good), max(p.high, moved.value, good)))
        reach = feasible_range(good, low, high, holds, lambda: self._worker.is_superseded)
        if reach is not None:
            self._report_to(Status(fault, p.key, moved.value, reach))

    def _report_to(self, status: Status) -> None:
        self.status, self._working = status, frozenset()
        self._report(status)

    def _settle(self) -> None:
        """Build the solids anew after a while without changes."""
        self._settled()
        self._builder.submit(self.run)

    # -- the builder's thread -----------------------------------------------------------------------------------------
    def _build(self, run: Run) -> None:
        if self._built.mechanism is not run.motion.mechanism:
            built = replace(self._built, mechanism=run.motion.mechanism) if self._built.fits(run) else build(run)
            with self._lock:
                self._built = built
                self.view_model = view_model_of_run(self.run, built, self.view_model)
                self._present(self.view_model)
            if not self._worker.is_superseded:  # otherwise it rests later
                self._settled()  # the events and all else that comes with the solids
        draft = self.history.present
        if run is self.run:
            shares = self._contributions(draft, run)
            if shares is not None and run is self.run:
                self._contributed(shares)
        give_back_memory()

    def _contributions(self, draft: Draft, run: Run) -> tuple[Contribution, ...] | None:
        """The contribution of each effect and load, from a run with it and one without it; None if a newer change waits."""
        spent = sum(stage.seconds for stage in run.stages)
        quick = spent < QUICK_RUN or self._patient
        self._patient = False
        loads = list(draft.document.loads)
        named = set(run.scene.effects)
        shares = []
        items = [(e, e in named, draft.with_effect(e, e not in named)) for e in EFFECTS]
        items += [(name, name not in draft.disabled_loads, draft.with_load(name, name in draft.disabled_loads)) for name in loads]
        here = _peak(run)
        before = _cost(run.scene) if quick else float("nan")
        for name, on, other in items:
            if self._builder.is_superseded or self._worker.is_superseded:
                return None
            peak = seconds = float("nan")
            why = ""
            if quick:
                try:
                    scene = other.scene()
                    peak = _peak(run_scene(scene))
                    cost = _cost(scene)
                    seconds = before - cost if on else cost - before
                except (MechanismError, ValueError) as error:
                    why = _words(error)  # the scene cannot be built without it, or friction has no coefficient
            shares.append(Contribution(name, on, here if on else peak, peak if on else here, max(seconds, 0.0), why))
        return tuple(shares)


def _cost(scene: Any) -> float:
    """Processor time of a run [s]: the minimum of `TIMING_REPEATS` runs, which other processes hardly affect."""
    times = []
    for _ in range(TIMING_REPEATS):
        start = time.thread_time()
        run_scene(scene)
        times.append(time.thread_time() - start)
    return min(times)


def _peak(run: Run) -> float:
    """The largest driving torque [N m] or force [N] of the first drive of a run, without drives the largest reaction [N]; 0 if no
    forces are computed."""
    forces, drives = run.forces, run.motion.mechanism.drives
    if forces is None:
        return 0.0
    efforts = [forces.effort(d.joint) for d in drives[:1]] or [
        np.hypot(*forces.reaction(joint.name)[:, :2].T) for joint in run.motion.mechanism.joints
    ]
    return max((float(np.max(np.abs(e), initial=0.0, where=np.isfinite(e))) for e in efforts), default=0.0)


def _words(error: Exception) -> str:
    """The text of an error for the user: its faults with their remedies, one after the other."""
    faults: Any = getattr(error, "faults", ())
    texts = [f"{f.message} {f.remedy}".strip() for f in faults]
    return " ".join(texts) or str(error)
