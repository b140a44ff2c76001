"""The panel below the mechanism: position in the run, scrubbing, play and pause, steps, speed, events, health."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from html import escape
from typing import Any

import numpy as np
import viser

from mechcore.arrays import Real
from mechcore.motion.events import Event
from mechviz.outputs.viewer import words
from mechviz.outputs.viewer.playback import NumberTrack
from mechviz.outputs.viewer.player import Player
from mechviz.outputs.viewer.server import Callback, finite
from mechviz.outputs.viewer.view_model import ViewModel
from mechviz.quantities.catalogue import Health, time_decimals

STRIP_COLUMNS = 240
WRONG_SHARE = 0.5  # severity (0: sound, 1: bad, logarithmic scale) from which a run is reported as wrong
SHADE_COUNT = 20  # number of shades from green to red
STRIP_WIDTH, ROW_HEIGHT, ROW_GAP, EVENTS_HEIGHT = 1000.0, 11.0, 3.0, 15.0
NAMES_WIDTH, BOX_WIDTH = 103, 55  # [px] to the left and right of the track of the slider above
GOOD_COLOR, FAIR_COLOR, BAD_COLOR = (46, 160, 96), (230, 168, 23), (208, 48, 48)


def shade(severity: float) -> str:
    """Colour of a severity: green (0) through amber to red (1)."""
    part = min(max(severity, 0.0), 1.0) * 2.0
    low, high = (GOOD_COLOR, FAIR_COLOR) if part <= 1.0 else (FAIR_COLOR, BAD_COLOR)
    part = part if part <= 1.0 else part - 1.0
    return "#" + "".join(f"{round(a + (b - a) * part):02x}" for a, b in zip(low, high, strict=True))


def worst_in_columns(severity: Real, count: int = STRIP_COLUMNS) -> Real:
    """The maximum in each of ``count`` equal intervals of frames: a single bad frame stays visible."""
    edges = np.linspace(0, len(severity), min(count, len(severity)) + 1).astype(int)
    return np.maximum.reduceat(severity, edges[:-1])


def health_svg(health: Sequence[Health], events: Sequence[Event], time: Real) -> str:
    """A row for each health quantity, and below them a mark for every event, with texts for tooltips and screen readers.

    The rows are aligned with the track of the timeline's slider above.
    """
    start, length = float(time[0]), max(float(time[-1] - time[0]), 1e-300)
    height = len(health) * (ROW_HEIGHT + ROW_GAP) + EVENTS_HEIGHT
    rows, names = [], []
    for k, h in enumerate(health):
        said = health_text(h)
        y = k * (ROW_HEIGHT + ROW_GAP)
        row = [f"<title>{escape(said)}</title>"]
        steps = np.round(worst_in_columns(h.severity) * SHADE_COUNT).astype(int)
        starts = np.flatnonzero(np.diff(steps, prepend=-1))
        per = STRIP_WIDTH / len(steps)
        for first, after in zip(starts, [*starts[1:], len(steps)], strict=True):
            left, wide, fill = per * first, per * (after - first), shade(steps[first] / SHADE_COUNT)
            row.append(f'<rect x="{left:.1f}" y="{y:g}" width="{wide + 0.4:.1f}" height="{ROW_HEIGHT:g}" fill="{fill}"/>')
        rows.append(f"<g>{''.join(row)}</g>")
        names.append(
            f'<div title="{escape(said)}" style="height:{ROW_HEIGHT + ROW_GAP:g}px;white-space:nowrap">{escape(h.name)}</div>'
        )
    base = len(health) * (ROW_HEIGHT + ROW_GAP)
    for e in events:
        x = STRIP_WIDTH * float(np.clip((e.time - start) / length, 0.0, 1.0))
        color = "#d03030" if e.level == "WARN" else "#2563c9"
        said = escape(f"{e.time:.4g} s: {e.item}: {e.text}")
        rows.append(f'<g><title>{said}</title><path d="M{x:.1f},{base + 1:g} l9,12 h-18 z" fill="{color}"/></g>')
    names.append(f'<div style="height:{EVENTS_HEIGHT:g}px">{len(events)} event{"" if len(events) == 1 else "s"}</div>')
    words = "Health of the run: " + "; ".join([*map(health_text, health), f"{len(events)} events"])
    return (
        '<div style="display:flex;font-size:0.74em;line-height:1.15;align-items:flex-start">'
        f'<div style="flex:none;width:{NAMES_WIDTH}px;opacity:0.75;overflow:hidden">{"".join(names)}</div>'
        f'<svg class="mechviz-health" role="img" aria-label="{escape(words)}" viewBox="0 0 {STRIP_WIDTH:g} {height:g}" '
        f'preserveAspectRatio="none" style="flex:1;min-width:0;height:{height:g}px;overflow:visible;margin-right:{BOX_WIDTH}px">'
        f'{"".join(rows)}<line class="mechviz-now" x1="0" x2="0" y1="-2" y2="{height:g}" stroke="#c2255c" stroke-width="3.5"/>'
        "</svg></div>"
    )


def _health(view_model: ViewModel, svg: str) -> str:
    """HTML of a dot for the state of the run, which opens the strips; they are open at first if something is wrong."""
    worst = max((float(h.severity.max(initial=0.0)) for h in view_model.health), default=0.0)
    warned = any(e.level == "WARN" for e in view_model.events)
    word = "health: something is wrong" if worst >= WRONG_SHARE else "health: see the warnings" if warned else "health: all is well"
    color, warnings = shade(max(worst, 0.5 if warned else 0.0)), words.warnings_html(h.warning() for h in view_model.health)
    return (
        f'<div class="mechviz-strip" style="padding:0.1em 0.85em"><details{" open" if worst >= WRONG_SHARE else ""}>'
        f'<summary title="{word}" aria-label="{word}" style="cursor:pointer;list-style:none;font-size:0.78em;white-space:nowrap">'
        f'<span style="display:inline-block;width:1em;height:1em;border-radius:50%;'
        f'margin-right:0.45em;background:{color}"></span>'
        f"{word if worst >= WRONG_SHARE else ''}</summary>{warnings}{svg}</details></div>"
    )


def health_text(h: Health) -> str:
    """Text of the largest value of a health quantity: "closure: at most 3e-17 m"."""
    worst = float(np.max(np.abs(h.values), initial=0.0, where=np.isfinite(h.values)))
    lost = int((~np.isfinite(h.values)).sum())
    return f"{h.name}: at most {worst:.2g}{words.unit_suffix(h.unit)}" + (f", {lost} frames without a finite value" if lost else "")


TIMELINE_WIDTH = 600  # [px]
CYCLE_SECONDS = (32.0, 16.0, 8.0, 4.0, 2.0, 1.0)  # wall time of one cycle of the drive
USUAL_CYCLE = 8.0
START_LABEL, BACK_LABEL, PLAY_LABEL, PAUSE_LABEL, FORWARD_LABEL = "Start", "◂ Step", "Play", "Pause", "Step ▸"
LOOP_LABEL, ONCE_LABEL = "Loop ✓", "Loop ✗"
MOVES_A_SECOND = 12.0  # updates per second of slider and numbers while playing: faster ones could not be read
NO_EVENT = "nothing happens"
LONGEST_EVENT = 90


class Speeds:
    """Choices of speed by the wall time of a cycle, each with its ratio to real time."""

    def __init__(self, cycle: float):
        """``cycle``: duration of a cycle of the drive [s]."""
        self._rates = {self._label(seconds, cycle): cycle / seconds for seconds in CYCLE_SECONDS}
        self.first = self._label(USUAL_CYCLE, cycle)
        real = "real time"
        self._rates[real] = 1.0

    @property
    def labels(self) -> tuple[str, ...]:
        return tuple(self._rates)

    def rate(self, label: str) -> float:
        """Run time per wall time; for an unknown label that of the first choice."""
        return self._rates.get(label, self._rates[self.first])

    @staticmethod
    def _label(seconds: float, cycle: float) -> str:
        return f"{seconds:g} s a cycle ({cycle / seconds:.2g}×)"


class Timeline:
    """The panel below the mechanism; ``show`` brings it to a frame, ``update`` takes another run."""

    def __init__(self, server: viser.ViserServer, view_model: ViewModel, player: Player, callback: Callback):
        gui = server.gui
        self._player = player
        self._last = view_model.frames - 1
        panel = gui.add_panel(order=-1.0)  # first in the drawer of a phone
        with panel.add_tab("Timeline", viser.Icon.PLAYER_PLAY):
            self._legend = gui.add_html("")
            self._place = gui.add_html("")
            self.slider = gui.add_slider("Frame", 0, max(view_model.frames - 1, 1), 1, 0)
            self.buttons = gui.add_button_group("Playback", (START_LABEL, BACK_LABEL, PLAY_LABEL, FORWARD_LABEL, LOOP_LABEL))
            self.speed = gui.add_dropdown("Speed", ("",))
            self.events = gui.add_dropdown("Jump to event", (NO_EVENT,))
            self.strip = gui.add_html("")
        panel.float(x=0, y=-1, width=TIMELINE_WIDTH)
        panel.expand()  # also in the drawer of a phone
        self._view_model, self._svg = view_model, ""
        self._options: tuple[str, ...] = ()
        self._moved = 0.0
        self._events_by_label: dict[str, Event] = {}
        self._speeds, self._cycle = Speeds(view_model.cycle), float("nan")
        self.update(view_model)
        self.slider.on_update(callback("Scrubbing", lambda _: self._scrub()))
        self.buttons.on_click(callback("Playback", lambda _: self._press(self.buttons.value)))
        self.speed.on_update(callback("Changing the speed", lambda _: self._set_speed()))
        self.events.on_update(callback("Jumping to an event", lambda _: self._jump()))
        keys: tuple[tuple[str, Any, Callable[[], None]], ...] = (
            ("Play or pause", "space", player.toggle),
            ("Step forward", "arrowright", partial(player.step, 1)),
            ("Step back", "arrowleft", partial(player.step, -1)),
            ("Ten steps forward", "arrowup", partial(player.step, 10)),
            ("Ten steps back", "arrowdown", partial(player.step, -10)),
            ("To the start", "home", partial(player.seek, 0)),
            ("To the end", "end", lambda: player.seek(self._last)),
            ("To the next event", "e", lambda: self._next_event()),
        )
        for label, key, action in keys:
            gui.add_command(label, hotkey=key).on_trigger(callback(label, partial(_ignoring_event, action)))

    def update(self, view_model: ViewModel) -> None:
        """Take another run: other frames, another cycle, other events."""
        before, self._view_model = self._view_model, view_model
        self._last = view_model.frames - 1
        if self.slider.max != max(self._last, 1):
            self.slider.max = max(self._last, 1)
        if view_model.cycle != self._cycle:
            chosen = list(self._speeds.labels).index(self.speed.value) if np.isfinite(self._cycle) else -1
            self._cycle, self._speeds = view_model.cycle, Speeds(view_model.cycle)
            self.speed.options = self._speeds.labels
            self.speed.value = self._speeds.labels[chosen] if chosen >= 0 else self._speeds.first
            self._player.set_rate(self._speeds.rate(self.speed.value))
        if view_model is before or view_model.events != before.events:
            self._events_by_label = {_event_label(k, e): e for k, e in enumerate(view_model.events)}
            self.events.options = (self._none, *self._events_by_label)
            self.events.value = self._none
        svg = health_svg(view_model.health, view_model.events, view_model.time)
        if svg != self._svg:
            self._svg = svg
            self.strip.content = _health(view_model, svg)

    def explain(self, legend: str) -> None:
        """Show the legend of the arrows."""
        self._legend.content = legend

    @property
    def _none(self) -> str:
        count = len(self._events_by_label)
        return f"{count} event{'s' if count > 1 else ''}" if count else NO_EVENT

    def place(self, view_model: ViewModel, frame: int) -> None:
        """Show the position in another run."""
        self._place.content = words.place_in_run(view_model, frame)
        if self.slider.max != max(view_model.frames - 1, 1):
            self.update(view_model)
        if self.slider.value != frame:  # with another number of frames, the same fraction of the run has another frame
            self.slider.value = frame

    def show(self, frame: int, playing: bool) -> None:
        """Move the numbers, the slider, the buttons and the cursor of the strip to a frame; during playing at a limited rate."""
        options = (
            START_LABEL,
            BACK_LABEL,
            PAUSE_LABEL if playing else PLAY_LABEL,
            FORWARD_LABEL,
            LOOP_LABEL if self._player.loop else ONCE_LABEL,
        )
        if options != self._options:
            self.buttons.options = self._options = options
        now = time.perf_counter()
        if playing and now - self._moved < 1.0 / MOVES_A_SECOND:
            return
        self._moved = now
        self._place.content = words.place_in_run(self._view_model, frame)
        self.slider.value = frame

    def tracks(self) -> Iterator[NumberTrack]:
        """Tracks of the numbers above the slider."""
        for k, d in enumerate(self._view_model.drives):
            yield NumberTrack(f"drive:{k}", d.position, d.decimals, words.unit_suffix(d.unit))
        yield NumberTrack("time", self._view_model.time, time_decimals(self._view_model.time), " s")
        yield NumberTrack("frame", np.arange(self._view_model.frames), 0)

    def frame_at(self, time: float) -> int:
        """The frame nearest to a time [s]."""
        return int(np.argmin(np.abs(self._view_model.time - time)))

    def _scrub(self) -> None:
        self._player.seek(round(finite(self.slider.value, 0, self._last, self._player.frame)))

    def _set_speed(self) -> None:
        if self.speed.value not in self._speeds.labels:
            self.speed.value = self._speeds.first
        self._player.set_rate(self._speeds.rate(self.speed.value))

    def _jump(self) -> None:
        event = self._events_by_label.get(self.events.value)
        if event is not None:
            self._player.seek(self.frame_at(event.time))

    def _next_event(self) -> None:
        later = sorted({self.frame_at(e.time) for e in self._view_model.events})
        if later:
            self._player.seek(next((frame for frame in later if frame > self._player.frame), later[0]))

    def _press(self, name: str) -> None:
        actions: dict[str, Callable[[], None]] = {
            START_LABEL: lambda: self._player.seek(0),
            BACK_LABEL: lambda: self._player.step(-1),
            PLAY_LABEL: self._player.play,
            PAUSE_LABEL: self._player.pause,
            FORWARD_LABEL: lambda: self._player.step(1),
            LOOP_LABEL: lambda: self._player.set_loop(False),
            ONCE_LABEL: lambda: self._player.set_loop(True),
        }
        if name in actions:
            actions[name]()


def _event_label(k: int, event: Event) -> str:
    text = f"{k + 1}. {'⚠ ' if event.level == 'WARN' else ''}{event.time:.4g} s  {event.item}: {event.text}"
    return text if len(text) <= LONGEST_EVENT else f"{text[: LONGEST_EVENT - 1]}…"


def _ignoring_event(action: Callable[[], None], _: object) -> None:
    action()
