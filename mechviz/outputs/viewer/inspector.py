"""All panels of the page around the mechanism, and the reactions to their controls and to clicks in the picture."""

from __future__ import annotations

import re
import threading
import time
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import viser

from mechviz.outputs.viewer import words
from mechviz.outputs.viewer.browser import lay_out, open_tab, report_size
from mechviz.outputs.viewer.panels.accuracy import AccuracyTab
from mechviz.outputs.viewer.panels.controls import Controls
from mechviz.outputs.viewer.panels.designs import Optimiser, StudyChart
from mechviz.outputs.viewer.panels.detail import DetailPanel, items_of
from mechviz.outputs.viewer.panels.diagrams import Diagrams
from mechviz.outputs.viewer.panels.effects import EffectsTab
from mechviz.outputs.viewer.panels.plots import OPENED_DESIGN, Plots
from mechviz.outputs.viewer.panels.saving import Saver
from mechviz.outputs.viewer.panels.switches import Switches
from mechviz.outputs.viewer.panels.synthesis import SynthesisTab, is_four_bar
from mechviz.outputs.viewer.panels.timeline import Timeline
from mechviz.outputs.viewer.playback import BrowserPlayback, NumberTrack, PlotTrack, Tracks
from mechviz.outputs.viewer.player import Player
from mechviz.outputs.viewer.server import Callback, report
from mechviz.outputs.viewer.session import Contribution, EditSession, Status
from mechviz.outputs.viewer.view_model import ViewModel
from mechviz.outputs.viewer.viser_adapter import send_now, uuid_of
from mechviz.outputs.viewer.world.handles import Pivots, traced_at, with_traced
from mechviz.outputs.viewer.world.marks import HoverNames
from mechviz.outputs.viewer.world.scene import Scene3D
from mechviz.studies.designs.figures import StoredStudy

SLOW_INTERVAL = 0.25  # [s] between updates of what need not follow every move of a slider
PLOT_INTERVAL = 0.06  # [s] between updates of plots while the next value of a slider is already waiting
SENDING_PATIENCE = 0.01  # [s] to wait for the picture to be sent, before more is computed
DETAIL_TAB = "Look closer"
LEFT_WIDTH, RIGHT_WIDTH = 300, 370  # [px]


class Inspector:
    """The panels: editing and switches on the left, plots on the right, the timeline below.

    ``session`` is None if nothing can be edited (a recording that is played). ``compared``: other designs by name, for comparison;
    ``study``: designs of the scene to choose from. ``draw(frame, playing)`` brings everything to a frame, ``present(view_model)``
    shows another run.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        view_model: ViewModel,
        player: Player,
        session: EditSession | None,
        folder: Path,
        callback: Callback,
        playback: BrowserPlayback,
        note: str = "",
        edit: Any = None,
        compared: Mapping[str, ViewModel] | None = None,
        study: StoredStudy | None = None,
    ):
        self._server, self._player, self._session = server, player, session
        self._lock = threading.RLock()
        self._tracing = self._closed = False
        self.compare: dict[str, viser.GuiCheckboxHandle] = {}
        self._slow, self._followed = 0.0, view_model
        self._drew, self._plotted = 0.0, view_model
        self.playback = playback
        gui = server.gui
        lay_out(server)

        def drawn(what: str, action: Callable[[Any], None]) -> Callable[[Any], Any]:
            """A callback that changes the picture itself, under the lock."""
            return callback(what, partial(self._alone, action))

        gui.main_panel.dock_left()
        gui.main_panel.set_width(LEFT_WIDTH)
        self._designs = {**({OPENED_DESIGN: session.opened} if session is not None else {}), **(compared or {})}
        clicked = self._guarded("Looking closer", self._clicked_link), self._guarded("Looking closer", self._clicked_joints)
        self.scene = Scene3D(server, view_model, *clicked, self._designs)
        self._note = words.hint(note) if note else ""
        self._heading = gui.add_html(words.heading(view_model.title, view_model.learning_goal) + self._note)
        if edit is not None:
            self.edit = gui.add_button("Edit this scene", icon=viser.Icon.EDIT, hint="solve the recorded scene, and change it")
            self.edit.on_click(callback("Opening the scene", lambda _: edit()))
        self.saver = None
        if session is not None:
            self.saver = Saver(server, session, folder, callback)
        tabs = gui.add_tab_group()
        self.controls: Controls | None = None
        self.effects: EffectsTab | None = None
        self.pivots: Pivots | None = None
        self.accuracy: AccuracyTab | None = None
        self.synthesis: SynthesisTab | None = None
        self.optimiser: Optimiser | None = None
        self.study: StudyChart | None = None
        if session is not None:
            tab = tabs.add_tab("Edit", viser.Icon.ADJUSTMENTS)
            with tab:
                self._offer_comparison("Compare with the scene as opened", OPENED_DESIGN, callback)
                self.handles = gui.add_checkbox("Drag pivots", False, hint="handles on the points of the fixed link")
            self.handles.on_update(callback("Showing handles", lambda _: self._handles(bool(self.handles.value))))
            self.controls = Controls(server, tab, session, callback)
            self.pivots = Pivots(server, session, callback)
            self.effects = EffectsTab(server, tabs.add_tab("Effects", viser.Icon.SCALE), session, callback)
            self.accuracy = AccuracyTab(server, tabs.add_tab("Accuracy"), session, callback)
        view = tabs.add_tab("View", viser.Icon.EYE)
        with view:
            for name in compared or {}:
                self._offer_comparison(f"Compare with {name}", name, callback)
        self.switches = Switches(server, view, self.scene, player, drawn, self._changed, self._darken)
        with self.switches.arrows:
            self.values = gui.add_checkbox("Values beside arrows", False, hint="at the ends of all arrows that are drawn")
        self.values.on_update(callback("Writing values beside arrows", lambda _: self.hover.show_values(bool(self.values.value))))
        if session is None:
            with tabs.add_tab("About", viser.Icon.INFO_CIRCLE):
                gui.add_html(view_model.notes)
        with view, gui.add_folder("Legend"):
            self._legend = gui.add_html("")
        with view:
            self.screen = gui.add_text("Size of the picture", "", visible=False)
        self.screen.on_update(callback("Fitting the drawings", self._fit))
        report_size(server, uuid_of(self.screen))
        right = gui.add_panel()
        self.plots = Plots(server, right.add_tab("Plots", viser.Icon.CHART_LINE), view_model, callback)
        self.detail = DetailPanel(server, right.add_tab(DETAIL_TAB, viser.Icon.ZOOM_IN), view_model, drawn, self._picked)
        if session is not None:
            with self.detail.tab:
                self.trace = gui.add_checkbox("Trace the point that I click", False, hint="adds a point to the link, and its path")
            self.trace.on_update(callback("Tracing", lambda _: self._trace(bool(self.trace.value))))
        self.diagrams = Diagrams(server, right.add_tab("Diagrams", viser.Icon.VECTOR), view_model, callback, session)
        sought = session is not None and session.run.scene.document.goal is not None
        if session is not None and (sought or study is not None):
            with right.add_tab("Designs", viser.Icon.TARGET):
                if study is not None:
                    self.study = StudyChart(server, gui.add_folder("Study"), study, session, callback)
                if sought:
                    self.optimiser = Optimiser(server, gui.add_folder("Optimisation"), session, callback)
        if session is not None and is_four_bar(session.run.scene.mechanism):
            self.synthesis = SynthesisTab(server, right.add_tab("Synthesis"), session, callback, self.scene.cameras.release)
        right.dock_right()
        right.set_width(RIGHT_WIDTH)
        self.timeline = Timeline(server, view_model, player, callback)
        self.hover = HoverNames(server, view_model, self.scene.arrows)
        self.plots.changed = self._changed
        server.on_client_connect(self._on_connect)
        server.on_client_disconnect(playback.forget)
        server.on_client_disconnect(self.diagrams.forget)
        for client in server.get_clients().values():  # browsers that have shown something else so far
            self.scene.cameras.start_fitting(client)
            self.scene.cameras.set_preset(client, "front")
        if compared:
            self._draw_compared()
        self._explain()

    @property
    def view_model(self) -> ViewModel:
        """The view model shown now."""
        return self.scene.current

    def draw(self, frame: int, playing: bool) -> None:
        """Bring the picture, the plots and the timeline to a frame. Runs in the player's thread."""
        with self._lock:
            frame = min(frame, self.view_model.frames - 1)
            with self._server.atomic():
                self.scene.show(frame)
                self._panels(frame, playing)
            self._server.flush()

    def present(self, view_model: ViewModel) -> None:
        """Show another run of the same scene. The picture changes in one step and is sent first; plots and numbers follow, or come
        with the next run if that is already waiting."""
        with self._lock:
            self.playback.play_on_server(True)
            self._player.retime(view_model.time)
            frame = min(self._player.frame, view_model.frames - 1)
            with self._server.atomic():
                self.scene.update(view_model)
                if self.pivots is not None:
                    self.pivots.update(view_model)
                for tab in (self.synthesis, self.optimiser):
                    if tab is not None:
                        tab.update(view_model)
                self.scene.show(frame)
            if view_model.exact:
                self.scene.refit()
            send_now(self._server, SENDING_PATIENCE)
            hurried = self._session is not None and self._session.is_superseded and view_model.frames == self._plotted.frames
            if not hurried or time.perf_counter() - self._drew > PLOT_INTERVAL:
                with self._server.atomic():
                    self._plot(view_model, frame)
                    if time.perf_counter() - self._slow > SLOW_INTERVAL or view_model.frames != self._followed.frames:
                        self._follow(view_model, frame)
                    self._explain()
                self._server.flush()
            if self._player.is_remote:
                self._player.refresh()

    def _plot(self, view_model: ViewModel, frame: int) -> None:
        """Update plots and numbers."""
        self._drew, self._plotted = time.perf_counter(), view_model
        self.plots.update(view_model, frame)
        self.timeline.place(view_model, frame)

    def _follow(self, view_model: ViewModel, frame: int) -> None:
        """Update what need not follow every move of a slider: the detail panel, diagrams, health and events, switches."""
        self._slow = time.perf_counter()
        self._followed = view_model
        self.detail.update(view_model, frame)
        self.detail.show(frame, False)
        self.diagrams.update(view_model, frame)
        self.diagrams.show(frame, False)
        self.timeline.update(view_model)
        self.switches.update(view_model)
        self.hover.update(view_model)
        if self.effects is not None:
            self.effects.update(view_model)

    def tracks(self) -> Tracks | None:
        """Everything that moves while the run is played; None if only the server can draw it."""
        with self._lock:
            scene = self.scene.tracks()
            if scene is None:
                return None
            others = [*self.timeline.tracks(), *self.plots.tracks(), *self.detail.tracks()]
            return Tracks(
                self.view_model.time,
                uuid_of(self.timeline.slider),
                *scene,
                tuple(t for t in others if isinstance(t, NumberTrack)),
                tuple(t for t in others if isinstance(t, PlotTrack)),
                uuid_of(self.diagrams.seen),
            )

    def show_remotely(self, frame: int) -> None:
        """Draw what only the server can draw, a diagram that is seen, while the browsers play on their own and are at a frame."""
        if self.diagrams.watched:
            with self._lock:
                self.diagrams.show(min(frame, self.view_model.frames - 1), True)

    def show_status(self, status: Status) -> None:
        """Show the result of an edit."""
        if self.controls is not None:
            with self._lock:
                self.controls.show_status(status)
                if status.fault and status.key not in self.controls.sliders:
                    self._refuse(status)
            self._server.flush()

    def _refuse(self, status: Status) -> None:
        """Set a refused switch back, and show the reason, whichever tab is open."""
        self.diagrams.mirror(self.view_model)
        if self.effects is not None:
            self.effects.update(self.view_model)
        why = f"{status.fault[:1].upper()}{status.fault[1:]}"
        for client in self._server.get_clients().values():
            client.add_notification("Not possible", why, color="red", auto_close_seconds=12.0)

    def settle(self) -> None:
        """Update everything after a while without edits."""
        with self._lock:
            frame = min(self._player.frame, self.view_model.frames - 1)
            with self._server.atomic():
                if self._plotted is not self.view_model:
                    self._plot(self.view_model, frame)
                if self._followed is not self.view_model:
                    self._follow(self.view_model, frame)
            self.plots.settle(self.view_model)
            if self.accuracy is not None:
                self.accuracy.update()  # its estimates take longer than the run itself
            if self.controls is not None:
                self.controls.settle()
            if self.pivots is not None:
                self.pivots.update(self.view_model)
            for tab in (self.synthesis, self.optimiser):
                if tab is not None:
                    tab.update(self.view_model)
            self.playback.play_on_server(False)
        self._server.flush()
        if self._player.playing:
            self._player.refresh()

    def show_contributions(self, contributions: tuple[Contribution, ...]) -> None:
        """Show what each effect contributes."""
        if self.effects is not None:
            with self._lock:
                self.effects.show_contributions(contributions)

    def close(self) -> None:
        """Stop the optimiser and the cameras: the browsers will be shown something else."""
        self._closed = True
        if self.optimiser is not None:
            self.optimiser.close()
        self.scene.cameras.close()

    # -- inside -------------------------------------------------------------------------------------------------------
    async def _on_connect(self, client: viser.ClientHandle) -> None:
        if not self._closed:
            self.playback.send_to(client, self._player.clock)

    def _alone(self, action: Callable[..., None], *arguments: object) -> None:
        with self._lock:
            action(*arguments)

    def _guarded(self, what: str, action: Callable[[Any, Any], None]) -> Callable[[Any, Any], None]:
        """A reaction to a click; its failure is shown to the user who clicked."""

        def guarded(item: Any, event: Any) -> None:
            try:
                action(item, event)
            except Exception as error:
                report(self._server, what, error, event.client)

        return guarded

    def _panels(self, frame: int, playing: bool) -> None:
        self.timeline.show(frame, playing)
        self.plots.show(frame, playing)
        self.detail.show(frame, playing)
        self.diagrams.show(frame, playing)

    def _changed(self) -> None:
        """Draw what is chosen now, and update the legend."""
        self._explain()
        self.hover.update(self.view_model)
        self.playback.change()
        self._player.refresh()

    def _explain(self) -> None:
        arrows, view_model = self.scene.arrows, self.view_model
        heading = words.heading(view_model.title, view_model.learning_goal) + self._note
        if heading != self._heading.content:  # synthesis has replaced the scene
            self._heading.content = heading
        shown = [f for f in arrows.families if arrows.is_on(f)]
        names = [name.split(".", 1)[1] for name in view_model.paths]
        content = words.legend(shown, names, view_model.scales, arrows.factor, view_model.size, view_model.units)
        if content != self._legend.content:
            self._legend.content = content
            self.timeline.explain(
                words.legend_line(shown, names, view_model.scales, arrows.factor, view_model.size, view_model.units)
            )

    def _offer_comparison(self, words: str, name: str, callback: Callback) -> None:
        """Add a checkbox that draws another design behind the mechanism, and its curves beside those of the mechanism."""
        self.compare[name] = self._server.gui.add_checkbox(words, name != OPENED_DESIGN)  # those ``compared`` are on at first
        self.compare[name].on_update(callback("Comparing", lambda _: self._compare()))

    def _compare(self) -> None:
        self._draw_compared()
        self.playback.change()
        self._player.refresh()

    def _draw_compared(self) -> None:
        chosen = {name: view_model for name, view_model in self._designs.items() if self.compare[name].value}
        with self._lock:
            for name, ghost in self.scene.ghosts.items():
                if ghost.on is not (name in chosen):
                    ghost.switch(name in chosen)
            self.plots.compare(chosen)

    def _fit(self, event: Any) -> None:
        """Fit the drawings to the size of its picture [px] that a browser has sent."""
        if event.client_id is not None and re.fullmatch(r"[1-9]\d{1,4}x[1-9]\d{1,4}", self.screen.value):
            width, height = map(int, self.screen.value.split("x"))
            with self._lock, self._server.atomic():
                self.scene.fit(event.client_id, (width, height))
            self._player.refresh()

    def _handles(self, on: bool) -> None:
        assert self.pivots is not None
        with self._lock:
            self.pivots.switch(on)

    def _darken(self, dark: bool) -> None:
        theme(self._server, dark)
        self.scene.darken(dark)

    def _trace(self, on: bool) -> None:
        self._tracing = on

    def _picked(self, item: str) -> None:
        """Highlight the item chosen in the detail panel."""
        self.playback.change()
        kind, _, name = item.partition(" ")
        self.scene.joints.pick([name] if kind in ("joint", "drive", "cam") else [])
        self.scene.links.pick(name if kind == "link" else "")

    def _clicked_link(self, link: str, event: viser.SceneNodePointerEvent[viser.MeshHandle]) -> None:
        if self._tracing and self._session is not None:
            point = traced_at(self.view_model, link, self._player.frame, event.ray_origin, event.ray_direction)
            self._session.change(f"trace {link}", lambda draft: with_traced(draft, link, point))
            return
        known = items_of(self.view_model)
        cams = [j.name for j in self.view_model.numbers.joints.values() if j.links[0] == link and f"cam {j.name}" in known]
        item = f"cam {cams[0]}" if cams else f"link {link}"
        if item in known:
            self._alone(self.detail.look_at, item)
            open_tab(event.client, DETAIL_TAB)

    def _clicked_joints(self, names: tuple[str, ...], event: Any) -> None:
        known = items_of(self.view_model)
        for name in names:
            for kind in ("cam", "joint", "drive"):
                if f"{kind} {name}" in known:
                    self._alone(self.detail.look_at, f"{kind} {name}")
                    open_tab(event.client, DETAIL_TAB)
                    return


def theme(server: viser.ViserServer, dark: bool) -> None:
    """Set the colours of the page; viser's logo and share button are off."""
    brand = (74, 136, 216) if dark else (27, 78, 140)  # legible on its background, and white is legible on it
    server.gui.configure_theme(show_logo=False, show_share_button=False, brand_color=brand, dark_mode=dark)
