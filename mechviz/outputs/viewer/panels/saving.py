"""Saving from the browser: the scene as a file, the run as a recording; nothing is overwritten unless confirmed."""

from __future__ import annotations

import dataclasses
import threading
from pathlib import Path
from typing import Any

import viser

from mechviz.editor.saving import saved_scene
from mechviz.files import plain_name
from mechviz.outputs.rerun.writer import write_recording
from mechviz.outputs.viewer import words
from mechviz.outputs.viewer.server import Callback
from mechviz.outputs.viewer.session import EditSession
from mechviz.runs import Run
from mechviz.scene.scene import dump


def file_name(text: str, ending: str, otherwise: str) -> str:
    """A plain file name from a user's text: without folders, not hidden, with the right ending; ``otherwise`` if empty."""
    stem = str(text).strip()
    stem = stem[: -len(ending)] if stem.lower().endswith(ending) else stem
    return plain_name(stem, plain_name(otherwise)) + ending


class Saver:
    """Buttons that save a scene or a recording into ``folder``, and a dialog that asks for the name.

    What is saved is the run of ``session`` when *Save* is pressed, with the comments of the scene that was opened. While a change
    is being solved nothing is saved: it would be the run before.
    """

    def __init__(self, server: viser.ViserServer, session: EditSession, folder: Path, callback: Callback):
        self._server, self._session, self._folder, self._callback = server, session, folder, callback
        self.buttons = server.gui.add_button_group("Save", ("Scene", "Recording"))
        self.buttons.on_click(callback("Saving", lambda event: self._ask(event.client, self.buttons.value)))
        self.last: threading.Thread | None = None
        self._dialogs: dict[int, viser.GuiModalHandle] = {}  # by browser: the open dialog
        server.on_client_disconnect(lambda client: self._dialogs.pop(client.client_id, None))

    def _ask(self, client: viser.ClientHandle, what: str) -> None:
        """Open a dialog in a browser for the name, and for the confirmation before an existing file is replaced."""
        usual, gui = self._session.run.scene.name, client.gui
        self._close(client)
        ending = ".toml" if what == "Scene" else ".rrd"
        with gui.add_modal(f"Save the {what.lower()}") as dialog:
            self._dialogs[client.client_id] = dialog
            gui.add_html(words.hint(f"It goes into the folder {self._folder}."))
            name = gui.add_text("Name of the file", f"{usual}{ending}")
            warning = gui.add_html("")
            save = gui.add_button("Save", icon=viser.Icon.DEVICE_FLOPPY)
            replace = gui.add_button("Replace it", color="red", visible=False)
            stop = gui.add_button("Cancel", color="dark")

        asked: set[Path] = set()  # existing files whose replacement the dialog has asked about

        def go(confirmed: bool) -> None:
            target = self._folder / file_name(name.value, ending, usual)
            if self._session.busy:
                warning.content = words.hint("A change is still being solved. Press the button again when it is shown.")
                return
            if target.exists() and not (confirmed and target in asked):
                asked.add(target)
                warning.content = words.hint(f"{target.name} is there already. Give another name, or replace it.")
                replace.visible = True
                return
            self._close(client)
            run = self._session.run
            scene, kept = saved_scene(self._session.source, run.scene)
            if what == "Scene":
                copies = [path.name for path in dump(scene, target, keep=True)]
                said = f"{target}" if kept else f"{target}, in the standard layout: its file's comments could not be kept."
                said += f" Copied beside it: {', '.join(copies)}." if copies else ""
                client.add_notification("Scene saved", said, color="green", auto_close_seconds=8.0)
            elif self.last is not None and self.last.is_alive():
                raise ValueError("another recording is being written: wait until it is there")
            else:
                self.last = threading.Thread(
                    target=self._record, daemon=True, args=(client, dataclasses.replace(run, scene=scene), target)
                )
                self.last.start()

        save.on_click(self._callback("Saving", lambda _: go(False)))
        replace.on_click(self._callback("Saving", lambda _: go(True)))
        stop.on_click(self._callback("Closing the dialog", lambda _: self._close(client)))

    def _close(self, client: viser.ClientHandle) -> None:
        """Close the open dialog of a browser."""
        dialog = self._dialogs.pop(client.client_id, None)
        if dialog is not None:
            dialog.close()

    def _record(self, client: viser.ClientHandle, run: Run, target: Path) -> None:
        """Write a recording while the viewer keeps running, with its progress as a notification in the browser."""
        note: Any = client.add_notification("Recording", f"{target.name} ...", loading=True, with_close_button=False)

        def progress(done: int, total: int) -> None:
            note.body = f"{target.name}: {done} of {total} frames"

        try:
            summary = write_recording(run, target, progress=progress)
            note.title, note.body, note.color = "Recording saved", f"{target}, {summary.bytes / 1e6:.2f} MB", "green"
        except Exception as error:
            note.title, note.body, note.color = "The recording failed", f"{error}"[:1000], "red"
        note.loading = False
        note.with_close_button = True
