"""The panels: explanation and switches on the left, plots on the right, the timeline below the mechanism."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import viser

from ..run import Run
from ..vectors import FAMILIES
from . import words
from .player import Player
from .scene3d import Scene3D

__all__ = ["Speeds", "Switches", "Timeline", "finite"]

Callback = Callable[[str, Callable[[Any], None]], Callable[[Any], Any]]

LEFT_WIDTH = 290  # [px]
RIGHT_WIDTH = 360
TIMELINE_WIDTH = 580
CYCLE_SECONDS = (32.0, 16.0, 8.0, 4.0, 2.0, 1.0)  # wall time of one cycle of the drive
USUAL_CYCLE = 8.0
START, BACK, PLAY, PAUSE, ON = "Start", "◂ Step", "Play", "Pause", "Step ▸"
LOOP, ONCE = "Loop ✓", "Loop ✗"


def finite(value: Any, low: float, high: float, otherwise: float) -> float:
    """A number from a browser brought into its range; what is not a finite number becomes ``otherwise``."""
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError):
        return otherwise
    return float(np.clip(number, low, high)) if np.isfinite(number) else otherwise


class Speeds:
    """Choices of speed by the wall time that a cycle takes, each with its ratio to real time."""

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
        """Run time per wall time; an unknown label gives the first choice's."""
        return self._rates.get(label, self._rates[self.first])

    @staticmethod
    def _label(seconds: float, cycle: float) -> str:
        return f"{seconds:g} s a cycle ({cycle / seconds:.3g} × real time)"


class Switches:
    """The left panel: what the scene is about, which arrows and marks are drawn, what was computed and left out."""

    def __init__(self, server: viser.ViserServer, run: Run, scene: Scene3D, player: Player, callback: Callback):
        gui = server.gui
        self._scene, self._player = scene, player
        gui.main_panel.dock_left()
        gui.main_panel.set_width(LEFT_WIDTH)
        gui.add_html(words.heading(run))
        self.families: dict[str, viser.GuiCheckboxHandle] = {}
        self.marks: dict[str, viser.GuiCheckboxHandle] = {}
        if scene.arrows.families:
            with gui.add_folder("Arrows"):
                for name in scene.arrows.families:
                    label, hint = FAMILIES[name].label, FAMILIES[name].meaning
                    self.families[name] = gui.add_checkbox(label, scene.arrows.is_on(name), hint=hint)
                    self.families[name].on_update(callback(f"Switching {label}", partial(self._switch, name)))
                self.size = gui.add_slider("Arrow size", 0.1, 5.0, 0.1, 1.0, hint="times the size at which the largest fits")
                self.size.on_update(callback("Changing the arrow size", lambda _: self._enlarge()))
        with gui.add_folder("View"):
            for name in scene.marks:
                self.marks[name] = gui.add_checkbox(name, True)
                self.marks[name].on_update(callback(f"Switching {name}", partial(self._mark, name)))
            front = gui.add_button("View from the front", icon=viser.Icon.HOME)
            front.on_click(callback("Moving the camera", lambda event: scene.look_from_front(event.client)))
        with gui.add_folder("Legend"):
            self._legend = gui.add_html("")
        with gui.add_folder("What was computed"):
            gui.add_html(words.plan_list(run))
        self._explain()

    def _mark(self, name: str, _: Any) -> None:
        self._scene.switch_mark(name, bool(self.marks[name].value))
        self._player.refresh()

    def _switch(self, family: str, _: Any) -> None:
        self._scene.arrows.switch(family, bool(self.families[family].value))
        self._explain()
        self._player.refresh()

    def _enlarge(self) -> None:
        value = finite(self.size.value, 0.1, 5.0, 1.0)
        if value != self.size.value:
            self.size.value = value
        self._scene.arrows.enlarge(value)
        self._explain()
        self._player.refresh()

    def _explain(self) -> None:
        arrows = self._scene.arrows
        shown = [f for f in arrows.families if arrows.is_on(f)]
        self._legend.content = words.legend(shown, self._scene.traced, self._scene.scales, arrows.factor, self._scene.size)


class Timeline:
    """The panel below the mechanism: where in the run it is, scrubbing, play and pause, steps, speed."""

    def __init__(self, server: viser.ViserServer, run: Run, player: Player, callback: Callback):
        gui = server.gui
        self._run, self._player = run, player
        self._last = run.motion.frames - 1
        mechanism = run.motion.mechanism
        cycle = mechanism.drives[0].law.duration if mechanism.drives else float(run.motion.time[-1])
        self._speeds = Speeds(cycle if np.isfinite(cycle) and cycle > 0.0 else 1.0)
        player.set_rate(self._speeds.rate(self._speeds.first))
        panel = gui.add_panel()
        with panel.add_tab("Timeline", viser.Icon.PLAYER_PLAY):
            self._place = gui.add_html("")
            self.slider = gui.add_slider("Frame", 0, max(self._last, 1), 1, 0)
            self.buttons = gui.add_button_group("Playback", (START, BACK, PLAY, ON, LOOP))
            self.speed = gui.add_dropdown("Speed", self._speeds.labels, initial_value=self._speeds.first)
        panel.float(x=20, y=-14, width=TIMELINE_WIDTH)
        self.slider.on_update(callback("Scrubbing", lambda _: self._scrub()))
        self.buttons.on_click(callback("Playback", lambda _: self._press(self.buttons.value)))
        self.speed.on_update(callback("Changing the speed", lambda _: self._set_speed()))
        keys: tuple[tuple[str, Any, Callable[[], None]], ...] = (
            ("Play or pause", "space", player.toggle),
            ("Step forward", "arrowright", partial(player.step, 1)),
            ("Step back", "arrowleft", partial(player.step, -1)),
            ("Ten steps forward", "arrowup", partial(player.step, 10)),
            ("Ten steps back", "arrowdown", partial(player.step, -10)),
            ("To the start", "home", partial(player.seek, 0)),
            ("To the end", "end", partial(player.seek, self._last)),
        )
        for label, key, action in keys:
            gui.add_command(label, hotkey=key).on_trigger(callback(label, partial(_ignoring_event, action)))

    def show(self, frame: int, playing: bool) -> None:
        self._place.content = words.place_in_run(self._run, frame)
        self.slider.value = frame
        options = (START, BACK, PAUSE if playing else PLAY, ON, LOOP if self._player.loop else ONCE)
        self.buttons.options = options

    def _scrub(self) -> None:
        frame = round(finite(self.slider.value, 0, self._last, self._player.frame))
        self._player.seek(frame)

    def _set_speed(self) -> None:
        if self.speed.value not in self._speeds.labels:
            self.speed.value = self._speeds.first
        self._player.set_rate(self._speeds.rate(self.speed.value))

    def _press(self, name: str) -> None:
        actions: dict[str, Callable[[], None]] = {
            START: lambda: self._player.seek(0),
            BACK: lambda: self._player.step(-1),
            PLAY: self._player.play,
            PAUSE: self._player.pause,
            ON: lambda: self._player.step(1),
            LOOP: lambda: self._player.set_loop(False),
            ONCE: lambda: self._player.set_loop(True),
        }
        if name in actions:
            actions[name]()


def _ignoring_event(action: Callable[[], None], _: Any) -> None:
    action()
