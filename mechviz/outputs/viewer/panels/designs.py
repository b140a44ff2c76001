"""Designs: a search for the goal of a scene, shown while it improves; and the designs of a study, chosen from a chart."""

from __future__ import annotations

import threading
import time
from functools import partial
from html import escape
from typing import Any

import numpy as np
import viser
from viser import uplot

from mechcore.arrays import Real
from mechcore.errors import MechanismError
from mechviz.outputs.viewer import words
from mechviz.outputs.viewer.server import Callback, finite
from mechviz.outputs.viewer.session import EditSession
from mechviz.outputs.viewer.view_model import ViewModel
from mechviz.outputs.viewer.viser_adapter import uuid_of
from mechviz.scene.scene import Scene
from mechviz.studies.designs.figures import MISSING, StoredStudy
from mechviz.studies.designs.optimise import Search, optimise, rounded
from mechviz.studies.designs.problem import Problem, problem_of, violation_words
from mechviz.studies.designs.variables import parameters_of

LOOK_INTERVAL = 0.25  # [s] between updates of the best design so far
HISTORY_HEIGHT = 150  # [px]
CHART_WIDTH, CHART_HEIGHT = 350.0, 250.0  # of the chart of a study
MOST_MARKS = 2000
CROSS_SIZE = 0.012  # half size of the crosses on prescribed points, of the mechanism's size
PRESCRIBED_POINTS_COLOR = (214, 40, 90)  # of those crosses
DESIGN_COLOR, CHOSEN_COLOR = "#2563c9", "#d97706"


class Optimiser:
    """A search for a design that meets the scene's goal. The best design so far is shown as it improves, as an edit that can be
    undone; Stop keeps it."""

    def __init__(self, server: viser.ViserServer, folder: viser.GuiFolderHandle, session: EditSession, callback: Callback):
        self._server, self._session = server, session
        self._stopped = threading.Event()
        self._shown = np.zeros(0)
        self._history: list[tuple[float, float]] = []  # number of designs evaluated, and the best objective among them
        self._reported_at = 0.0
        self.thread: threading.Thread | None = None
        gui = server.gui
        fonts: Any = {"font": "11px sans-serif", "labelFont": "12px sans-serif", "labelSize": 18}
        with folder:
            gui.add_html(words.html_rows(goal_words(session.run.scene)))
            self.seed = gui.add_slider("Seed", 0, 99, 1, 0, hint="another one searches on other ways")
            self.start = gui.add_button("Optimise", icon=viser.Icon.TARGET)
            self.stop = gui.add_button("Stop and keep the best", icon=viser.Icon.PLAYER_STOP, visible=False)
            self.report = gui.add_html("")
            self.chart = gui.add_uplot(
                (np.zeros(1), np.zeros(1)),
                (uplot.Series(label="designs"), uplot.Series(label="best", stroke="#2563c9", width=2, points={"show": False})),
                scales={"x": uplot.Scale(time=False)},
                axes=(uplot.Axis(label="designs looked at", size=34, labelGap=-2, **fonts), uplot.Axis(size=60, space=24, **fonts)),
                legend=uplot.Legend(show=False),
                height=HISTORY_HEIGHT,
                padding=(14, 16, 0, 0),  # otherwise the topmost number is cut off
                visible=False,
            )
        self.start.on_click(callback("Optimising", lambda _: self.begin()))
        self.stop.on_click(callback("Stopping the search", lambda _: self._stopped.set()))

        self._way: viser.LineSegmentsHandle | None = None
        self.update(session.view_model)

    def update(self, view_model: ViewModel) -> None:
        """Draw crosses on the prescribed points of the path, if the goal contains a path, in front of the present mechanism."""
        goal, units = self._session.run.scene.document.goal, self._session.run.scene.units
        if goal is None or goal.path is None:
            return
        places = np.array([[units.si(x, "length") for x in place] for place in goal.path.through])
        segments = crosses(places, CROSS_SIZE * view_model.size, view_model.z_top)
        if self._way is None:
            self._way = self._server.scene.add_line_segments(
                "/goal/way", segments, PRESCRIBED_POINTS_COLOR, thickness=2.5, thickness_units="screen"
            )
        else:
            self._way.points = segments

    def begin(self) -> None:
        """Start a search from the present scene in a thread of its own. Raises `MechanismError` if its goal is not possible."""
        if self.thread is not None and self.thread.is_alive():
            return
        problem = problem_of(self._session.run.scene)
        self._stopped.clear()
        self._history, self._shown, self._reported_at = [], problem.start, 0.0
        self.start.visible, self.stop.visible = False, True
        search = Search(problem, int(finite(self.seed.value, 0.0, 1e9, 0.0)))
        search.progress = partial(self._watch, search)
        self.thread = threading.Thread(target=self._search, args=(search,), name="mechviz-search", daemon=True)
        self.thread.start()

    def close(self) -> None:
        """End a search that is running."""
        self._stopped.set()

    def _search(self, search: Search) -> None:
        try:
            begin = search.problem.score(search.problem.start[None])
            if begin.feasible[0]:
                self._draw(search.problem, 0, float(begin.objectives[0, 0]))
            optimum = optimise(search)
            self._take(search.problem, optimum.design, last=True)
            how = "Stopped: the best design so far." if search.interrupted else "Done."
            if self._edited(search.problem):
                how += " Other values were changed meanwhile: the numbers are those of the scene as it was."
            self.report.content = words.html_table(f"{how} {search.evaluations} designs were looked at.", optimum.lines())
        except MechanismError as error:
            self.report.content = words.refusal_words(" ".join(f"{f.message} {f.remedy}" for f in error.faults), None, 0.0, None)
        finally:
            self.start.visible, self.stop.visible = True, False

    def _watch(self, search: Search, stage: str, objective: int, value: float, violation: float) -> None:
        """Show the progress of a search, and an improved best design. Raises KeyboardInterrupt after Stop, to end the search."""
        if self._stopped.is_set():
            raise KeyboardInterrupt
        if time.monotonic() - self._reported_at < LOOK_INTERVAL:
            return
        self._reported_at = time.monotonic()
        term = search.problem.terms[objective]
        missed = violation_words(violation)
        best = term.shown(value) if np.isfinite(value) else "none yet"
        self.report.content = words.hint(
            f"{stage}: {search.evaluations} designs. {term.text}: {best}; {missed or 'all limits are kept'}."
        )
        if not missed and objective == 0:
            self._draw(search.problem, search.evaluations, value)
            self._take(search.problem, rounded(search.problem, search.best(0)[0][None])[0])

    def _draw(self, problem: Problem, evaluations: int, value: float) -> None:
        """Add a point to the chart: the best objective after ``evaluations`` designs."""
        term = problem.terms[0]
        self._history.append((float(evaluations), term.sign * value))
        x, y = np.array(self._history).T
        self.chart.data = x, y
        self.chart.title = f"{term.text} [{term.unit}]" if term.unit else term.text
        self.chart.visible = True

    def _take(self, problem: Problem, design: Real, *, last: bool = False) -> None:
        """Show a design, unless it is shown already; the ``last`` one also where it was, as it may have been undone since."""
        values = {v.name: v.stated(float(x)) for v, x in zip(problem.variables, design, strict=True)}
        if self._differs(values, None) if last else not np.array_equal(design, self._shown):
            self._shown = design
            self._session.change("optimise", lambda draft: draft.with_parameters(values))

    def _edited(self, problem: Problem) -> bool:
        """Whether the scene differs from that of a search in more than what the search varies."""
        start = {v.name: v.stated(float(x)) for v, x in zip(problem.variables, problem.start, strict=True)}
        return self._differs(start, problem.stated.with_parameters(start))

    def _differs(self, values: dict[str, float | str], other: Scene | None) -> bool:
        """Whether the present scene with some values of parameters differs from ``other``, by default from itself."""
        self._session.wait()
        scene = self._session.run.scene
        try:
            return scene.with_parameters(values) != (other or scene)
        except MechanismError:  # after other edits it cannot be put together with these values
            return True


def crosses(places: Real, size: float, height: float) -> Real:
    """Line segments (2 n, 2, 3) [m] of crosses on points (n, 2) [m] at a height [m]; ``size``: half the width."""
    strokes = size * np.array([[[-1.0, -1.0], [1.0, 1.0]], [[-1.0, 1.0], [1.0, -1.0]]])
    ends = (places[:, None, None, :] + strokes).reshape(-1, 2, 2)
    return np.concatenate([ends, np.full((len(ends), 2, 1), height)], axis=2)


def goal_words(scene: Scene) -> list[str]:
    """The goal of a scene as lines of HTML: objectives, constraints, and the parameters that may vary."""
    goal = scene.document.goal
    assert goal is not None  # otherwise this panel does not exist
    wanted = [f"least {name}" for name in goal.minimise] + [f"greatest {name}" for name in goal.maximise]
    wanted += [f"{goal.follow.quantity} as stated"] if goal.follow is not None else []
    wanted += [f"{goal.path.point} on its stated way"] if goal.path is not None else []
    kept = [
        f"{name} " + " and ".join(f"at {end} {x}" for end, x in (("least", limit.least), ("most", limit.most)) if x is not None)
        for name, limit in goal.limits.items()
    ]
    kept += [f"Grashof's rule ({goal.grashof})"] if goal.grashof is not None else []
    kept += ["all points within a box"] if goal.box is not None else []
    varied = goal.vary or [v.name for v in parameters_of(scene) if np.isfinite(v.high - v.low)]
    rows = [("Sought", wanted), ("Kept", kept), ("May vary", varied)]
    return [f"<b>{title}:</b> {escape(', '.join(names))}" for title, names in rows if names]


class StudyChart:
    """A chart of a study with one mark per design. The design that is clicked, or chosen by its number, is shown, as an edit that
    can be undone."""

    def __init__(
        self, server: viser.ViserServer, folder: viser.GuiFolderHandle, study: StoredStudy, session: EditSession, callback: Callback
    ):
        self._study, self._session = study, session
        self._columns = {**study.variables, **{title: _number(values) for title, values in study.results.items()}}
        names, results = tuple(study.variables), tuple(study.results)
        gui = server.gui
        with folder:
            gui.add_html(words.hint(f"{len(study.reasons)} designs, {study.feasible.sum()} with values. Click on one to see it."))
            self.across = gui.add_dropdown("Across", (*names, *results), initial_value=names[0])
            self.up = gui.add_dropdown("Upwards", (*results, *names), initial_value=results[0])
            self.chart = gui.add_html("")
            self.design = gui.add_slider("Design", 0, max(len(study.reasons) - 1, 1), 1, 0)
            self.report = gui.add_html("")
        for choice in (self.across, self.up):
            choice.on_update(callback("Drawing the study", lambda _: self._draw()))
        self.design.on_update(callback("Choosing a design", lambda _: self.choose(self.number)))
        self._draw()

    @property
    def number(self) -> int:
        """The number of the chosen design."""
        return int(finite(self.design.value, 0.0, len(self._study.reasons) - 1.0, 0.0))

    def choose(self, k: int) -> None:
        """Show design number ``k``."""
        values = self._study.stated(k)
        self._session.change("study", lambda draft: draft.with_parameters(values))
        self._draw()

    def _draw(self) -> None:
        x, y = (self._columns[str(choice.value)] for choice in (self.across, self.up))
        k, uuid = self.number, uuid_of(self.design)
        self.chart.content = scatter(x, y, (str(self.across.value), str(self.up.value)), k, uuid)
        rows = [f"{escape(title)}: <b>{words.format_number(float(column[k]))}</b>" for title, column in self._columns.items()]
        why = self._study.reasons[k]
        self.report.content = words.html_rows([f"Design {k}", *rows, *([escape(why)] if why else [])])


def _number(values: Real) -> Real:
    """One number (D,) per design: the values (D,), or the largest magnitude of curves (D, F)."""
    if values.ndim == 1:
        return values
    return np.asarray(np.max(np.abs(values), axis=1))


def scatter(x: Real, y: Real, titles: tuple[str, str], chosen: int, picks: str) -> str:
    """A chart of designs (D,) as SVG; designs without values are crosses below. A click on a mark sets the control ``picks`` to its
    number (see `mechviz.outputs.viewer.browser`)."""
    left, right, top, low, below = 46.0, CHART_WIDTH - 8.0, 8.0, CHART_HEIGHT - 46.0, CHART_HEIGHT - 36.0
    known = np.isfinite(y)

    def scaled(values: Real, start: float, end: float) -> tuple[Real, float, float]:
        some = values[np.isfinite(values)]
        least, most = (float(some.min()), float(some.max())) if len(some) else (0.0, 1.0)
        return start + (end - start) * (values - least) / ((most - least) or 1.0), least, most

    across, *ends = scaled(x, left, right)
    up, *heights = scaled(np.where(known, y, np.nan), low, top)
    step = max(1, len(x) // MOST_MARKS)
    marks = []
    for k in sorted({*range(0, len(x), step), chosen}):
        at = (across[k], up[k]) if known[k] else (across[k], below)
        shape = f'<circle cx="{at[0]:.1f}" cy="{at[1]:.1f}" r="{5 if k == chosen else 3}"/>'
        if not known[k]:
            shape = f'<path d="M{at[0] - 3:.1f},{at[1] - 3:.1f} l6,6 m0,-6 l-6,6" stroke="{MISSING}"/>'
        color = CHOSEN_COLOR if k == chosen else DESIGN_COLOR
        said = f"<title>{escape(f'{k}: {words.format_number(float(x[k]))}, {words.format_number(float(y[k]))}')}</title>"
        marks.append((k == chosen, f'<g data-mv-pick="{picks}:{k}" fill="{color}" style="cursor:pointer">{said}{shape}</g>'))
    text = 'font-size="10" fill="currentColor"'
    axes = [
        f'<path d="M{left},{top} V{low} H{right}" fill="none" stroke="currentColor" stroke-opacity="0.4"/>',
        *(f'<text x="{p}" y="{CHART_HEIGHT - 18}" text-anchor="{a}" {text}>{words.format_number(v)}</text>'
          for p, a, v in ((left, "start", ends[0]), (right, "end", ends[1]))),
        *(f'<text x="{left - 4}" y="{p}" text-anchor="end" {text}>{words.format_number(float(f"{v:.4g}"))}</text>'
          for p, v in ((low, heights[0]), (top + 8.0, heights[1]))),
        f'<text x="{0.5 * (left + right)}" y="{CHART_HEIGHT - 5}" text-anchor="middle" {text}>{escape(titles[0])}</text>',
    ]  # fmt: skip
    drawn = "".join(mark for _, mark in sorted(marks, key=lambda m: m[0]))
    label = escape(f"{titles[1]} over {titles[0]}", quote=True)
    box = f"0 0 {CHART_WIDTH} {CHART_HEIGHT}"
    return f'<svg viewBox="{box}" role="img" aria-label="{label}" style="width:100%">{"".join(axes)}{drawn}</svg>'
