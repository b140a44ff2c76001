"""The tab of effects: a switch for each, its influence on the peak of the driving effort, its computing time; and the plan."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from html import escape
from itertools import pairwise

import viser

from mechcore.effects.plan import Plan, PlannedStage, StageKind
from mechcore.effects.registry import effects_of
from mechcore.records import dataclass
from mechcore.spec.mechanism import EFFECTS, Mechanism
from mechviz.outputs.viewer import words
from mechviz.outputs.viewer.panels.charts import svg_words
from mechviz.outputs.viewer.panels.controls import EditedControls
from mechviz.outputs.viewer.server import Callback
from mechviz.outputs.viewer.session import Contribution, EditSession
from mechviz.outputs.viewer.view_model import ViewModel

MOTION_STAGES = (StageKind.SIMULATION, StageKind.POSITIONS, StageKind.VELOCITIES, StageKind.ACCELERATIONS)
MOST_BOXES = 8  # largest number of boxes of effects and loads; if there are more, the last box stands for the rest

CHART_WIDTH, ROW_HEIGHT, BOX_GAP = 276.0, 25.0, 7.0  # [px]
BOX_COLUMNS = ((1.0, 86.0), (106.0, 76.0), (201.0, 74.0))  # left edges and widths [px]
BOX_LETTERS = (15, 13, 13)  # letters in a line of a box, by column


@dataclass(frozen=True)
class StageBox:
    """A stage of the plan in a column (0: effects and loads, 1: quantities, 2: outputs); ``why`` it is computed or left out."""

    name: str
    label: str
    column: int
    on: bool
    why: str


@dataclass(frozen=True)
class PlanGraph:
    """Boxes, and arrows between them by name: the first needs the second, or the second is computed from the first."""

    boxes: tuple[StageBox, ...]
    arrows: tuple[tuple[str, str], ...]


def plan_graph(mechanism: Mechanism, plan: Plan) -> PlanGraph:
    """Graph of dependencies. An effect's arrow goes to the highest derivative of the motion that it needs; lower ones follow."""
    stages = (*plan.computed, *plan.skipped)
    by_kind = {kind: [s for s in stages if s.kind is kind] for kind in StageKind}
    boxes: list[StageBox] = []
    arrows: list[tuple[str, str]] = []

    def box(parts: Sequence[PlannedStage], label: str, column: int) -> str:
        on = any(s in plan.computed for s in parts)
        boxes.append(StageBox(parts[0].name, label, column, on, "; ".join(dict.fromkeys(s.why for s in parts))))
        return parts[0].name

    named = len(mechanism.effects)  # effects come first, then the loads
    needs = {(StageKind.EFFECT if k < named else StageKind.LOAD, e.name): e.needs for k, e in enumerate(effects_of(mechanism))}
    computed = [kind for kind in MOTION_STAGES if plan.has(kind)]

    def needed(stage: PlannedStage) -> frozenset[str]:
        """The quantities that an effect or a load needs."""
        return frozenset(needs.get((stage.kind, stage.item), ()))

    def level(stage: PlannedStage) -> int:
        return max((k for k, kind in enumerate(MOTION_STAGES) if kind.value in needed(stage)), default=0)

    # in the order of the quantities, so that few arrows cross; stages that are left out come last
    forces = sorted(by_kind[StageKind.EFFECT] + by_kind[StageKind.LOAD], key=lambda s: (s not in plan.computed, level(s)))
    shown, rest = (forces, []) if len(forces) <= MOST_BOXES else (forces[: MOST_BOXES - 1], forces[MOST_BOXES - 1 :])
    for parts in [*([s] for s in shown), *([rest] if rest else [])]:
        source = box(parts, parts[0].item if len(parts) == 1 else f"{len(parts)} more", 0)
        wanted = frozenset().union(*(needed(s) for s in parts if s in plan.computed))
        arrows += [(source, kind.value) for kind in reversed(computed) if kind.value in wanted][:1]
        if "reactions" in wanted:  # computed together with them
            arrows.append((source, StageKind.FORCES.value))
    moving = [box(by_kind[kind], kind.value, 1) for kind in MOTION_STAGES if by_kind[kind]][: len(computed)]
    arrows += list(pairwise(moving))
    box(by_kind[StageKind.HEALTH], StageKind.HEALTH.value, 2)
    if plan.has(StageKind.HEALTH):
        arrows.append((StageKind.POSITIONS.value, StageKind.HEALTH.value))
    for kind, several in ((StageKind.METRIC, "metrics"), (StageKind.STUDY, "diagrams")):
        if parts := by_kind[kind]:
            source = box(parts, parts[0].name if len(parts) == 1 else f"{len(parts)} {several}", 2)
            if parts[0] in plan.computed and StageKind.VELOCITIES in computed:
                arrows.append((StageKind.VELOCITIES.value, source))
    box(by_kind[StageKind.FORCES], StageKind.FORCES.value, 2)
    box(by_kind[StageKind.ENERGY], StageKind.ENERGY.value, 2)
    if plan.has(StageKind.FORCES):
        called = frozenset().union(*(needed(s) for s in forces if s in plan.computed))
        highest = next((kind for kind in reversed(computed) if kind.value in called), StageKind.POSITIONS)
        arrows.append((highest.value, StageKind.FORCES.value))
    if plan.has(StageKind.ENERGY):
        arrows.append((StageKind.FORCES.value, StageKind.ENERGY.value))
    return PlanGraph(tuple(boxes), tuple(dict.fromkeys(arrows)))


def plan_svg(mechanism: Mechanism, plan: Plan) -> str:
    """A plan as SVG: computed stages in solid lines, stages left out dashed, the reasons as tooltips."""
    graph = plan_graph(mechanism, plan)
    columns = [[b for b in graph.boxes if b.column == c] for c in range(3)]
    rows = max(len(column) for column in columns)
    height = 18.0 + rows * (ROW_HEIGHT + BOX_GAP) + 4.0
    places: dict[str, tuple[float, float, float]] = {}  # left, top, width
    parts = []
    for (left, width), column, head in zip(BOX_COLUMNS, columns, ("effects, loads", "quantities", "outputs"), strict=True):
        parts.append(_text(left + width / 2.0, 10.0, head, 'opacity="0.6"'))
        step = (rows * (ROW_HEIGHT + BOX_GAP)) / max(len(column), 1)
        for k, b in enumerate(column):
            places[b.name] = left, 18.0 + step * k + (step - ROW_HEIGHT - BOX_GAP) / 2.0, width
    for start, end in graph.arrows:
        parts.append(_arrow(places[start], places[end], height - 3.0))
    for b in graph.boxes:
        left, top, width = places[b.name]
        look = (
            'fill="rgba(34,92,160,0.13)" stroke="#3b78be"' if b.on else 'fill="none" stroke="currentColor" stroke-dasharray="3 3"'
        )
        lines = _wrapped(b.label, BOX_LETTERS[b.column])
        words = "".join(
            _text(left + width / 2.0, top + ROW_HEIGHT / 2.0 + 10.5 * (k - (len(lines) - 1) / 2.0), line)
            for k, line in enumerate(lines)
        )
        parts.append(
            f'<g opacity="{1 if b.on else 0.55}" data-on="{int(b.on)}"><title>{escape(f"{b.label}: {b.why}")}</title>'
            f'<rect x="{left:g}" y="{top:.1f}" width="{width:g}" height="{ROW_HEIGHT:g}" rx="4" {look}/>{words}</g>'
        )
    summary = f"{sum(b.on for b in graph.boxes)} of {len(graph.boxes)} stages are computed"
    return (
        f'<div style="padding:0.1em 0.5em 0.3em"><svg role="img" aria-label="Analysis plan: {summary}" '
        f'viewBox="0 0 {CHART_WIDTH:g} {height:g}" style="display:block;width:100%">{"".join(parts)}</svg></div>'
    )


def _arrow(start: tuple[float, float, float], end: tuple[float, float, float], below: float) -> str:
    """An arrow from box to box as SVG: from the right side to the left side, within a column downwards, across a column at the
    height ``below`` all boxes."""
    x0, y0, w0 = start
    x1, y1, w1 = end
    if abs(x0 - x1) < 1.0:
        a, b = (x0 + w0 / 2.0, y0 + ROW_HEIGHT), (x1 + w1 / 2.0, y1)
        path = f"M{a[0]:.1f},{a[1]:.1f} V{b[1] - 3:.1f}"
        tip = f"M{b[0]:.1f},{b[1]:.1f} L{b[0] - 3:.1f},{b[1] - 5:.1f} L{b[0] + 3:.1f},{b[1] - 5:.1f} Z"
    elif x1 - x0 > BOX_COLUMNS[1][0] + BOX_COLUMNS[1][1]:
        a, b = (x0 + w0, y0 + ROW_HEIGHT / 2.0 + 5.0), (x1, y1 + ROW_HEIGHT / 2.0 + 5.0)
        path = f"M{a[0]:.1f},{a[1]:.1f} h6 V{below:.1f} H{b[0] - 10:.1f} V{b[1]:.1f} H{b[0] - 3:.1f}"
        tip = f"M{b[0]:.1f},{b[1]:.1f} L{b[0] - 5:.1f},{b[1] - 3:.1f} L{b[0] - 5:.1f},{b[1] + 3:.1f} Z"
    else:
        a, b = (x0 + w0, y0 + ROW_HEIGHT / 2.0), (x1, y1 + ROW_HEIGHT / 2.0)
        bend = 0.5 * (b[0] - a[0])
        path = f"M{a[0]:.1f},{a[1]:.1f} C{a[0] + bend:.1f},{a[1]:.1f} {b[0] - bend:.1f},{b[1]:.1f} {b[0] - 3:.1f},{b[1]:.1f}"
        tip = f"M{b[0]:.1f},{b[1]:.1f} L{b[0] - 5:.1f},{b[1] - 3:.1f} L{b[0] - 5:.1f},{b[1] + 3:.1f} Z"
    return f'<path d="{path}" fill="none" stroke="currentColor" opacity="0.55"/><path d="{tip}" fill="currentColor" opacity="0.7"/>'


def _wrapped(text: str, letters: int) -> list[str]:
    """A label in at most two lines; lines that are too long are cut."""
    lines = [""]
    for word in text.split():
        longer = f"{lines[-1]} {word}".strip()
        if len(longer) <= letters or not lines[-1]:
            lines[-1] = longer
        else:
            lines.append(word)
    lines = [*lines[:1], " ".join(lines[1:])] if len(lines) > 2 else lines
    return [line if len(line) <= letters + 1 else f"{line[:letters]}…" for line in lines]


def _text(x: float, y: float, text: str, more: str = "") -> str:
    return svg_words(x, y, escape(text), 9.5, look=more)


class EffectsTab:
    """A checkbox for every effect and load; ``show_contributions`` shows their contributions, ``update`` takes another run."""

    def __init__(self, server: viser.ViserServer, tab: viser.GuiTabHandle, session: EditSession, callback: Callback):
        gui = server.gui
        self._session, self._edited = session, EditedControls(session, callback)
        self.effects: dict[str, viser.GuiCheckboxHandle] = {}
        self.loads: dict[str, viser.GuiCheckboxHandle] = {}
        with tab:
            with gui.add_folder("Effects"):
                for name, meaning in EFFECTS.items():
                    box = gui.add_checkbox(name, name in session.run.scene.effects, hint=meaning)
                    self._edited.listen(f"effect {name}", box, name, partial(self._switch_effect, name))
                    self.effects[name] = box
            loads = list(session.history.present.document.loads)
            if loads:
                with gui.add_folder("Loads"):
                    for name in loads:
                        box = gui.add_checkbox(name, name not in session.history.present.disabled_loads)
                        self._edited.listen(f"load {name}", box, name, partial(self._switch_load, name))
                        self.loads[name] = box
            self.table = gui.add_html(words.hint("What each effect contributes is found when the mechanism rests."))
            weigh = gui.add_button("Weigh the effects", hint="find out what each contributes and costs")
            weigh.on_click(callback("Weighing the effects", lambda _: session.find_contributions(asked=True)))
            with gui.add_folder("What was computed"):
                self.diagram = gui.add_html(self._diagram(session.view_model))
                self.plan = gui.add_html(session.view_model.notes)

    def update(self, view_model: ViewModel) -> None:
        """Take the switches and the plan of another run."""
        assert view_model.run is not None
        for name, box in self.effects.items():
            self._edited.follow(f"effect {name}", box, name in view_model.run.scene.effects)
        for name, box in self.loads.items():
            self._edited.follow(f"load {name}", box, name in view_model.run.scene.document.loads)
        diagram = self._diagram(view_model)
        if self.diagram.content != diagram:
            self.diagram.content = diagram
        if self.plan.content != view_model.notes:
            self.plan.content = view_model.notes

    @staticmethod
    def _diagram(view_model: ViewModel) -> str:
        assert view_model.run is not None
        return plan_svg(view_model.run.motion.mechanism, view_model.run.plan)

    def show_contributions(self, shares: tuple[Contribution, ...]) -> None:
        """Show the table of contributions."""
        drives = self._session.view_model.drives
        effort = "reaction" if not drives else "drive force" if drives[0].sliding else "drive torque"
        self.table.content = words.contribution_table(shares, effort, self._session.view_model.units)

    def _switch_effect(self, name: str, on: object) -> None:
        self._session.change(f"effect {name}", lambda draft: draft.with_effect(name, bool(on)))

    def _switch_load(self, name: str, on: object) -> None:
        self._session.change(f"load {name}", lambda draft: draft.with_load(name, bool(on)))
