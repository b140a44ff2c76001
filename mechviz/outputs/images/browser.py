"""Headless Chromium, controlled through a pipe (Chrome DevTools Protocol): no port, no driver, no other package."""

from __future__ import annotations

import base64
import contextlib
import fcntl
import json
import os
import select
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from mechviz.files import OutputError

CHROMIUM_VARIABLE = "MECHVIZ_CHROMIUM"
CHROMIUM_NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
RETRY_REMEDY = f"Try again, or with another Chromium, which {CHROMIUM_VARIABLE} names."
ANSWER_PATIENCE = 300.0  # [s] for an answer: a slow machine without a graphics card may need most of it
CHROMIUM_ARGUMENTS = (
    "--headless=new",
    "--remote-debugging-pipe",
    "--no-first-run",
    "--no-default-browser-check",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-extensions",
    "--disable-sync",
    "--hide-scrollbars",
    "--mute-audio",
    "--use-gl=angle",  # software rendering, the same on every machine
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-gpu-compositing",  # otherwise the software renderer also draws the page around the picture: a quarter more work
    "--disable-gpu-rasterization",
)


class ChromiumError(OutputError):
    """Chromium is not installed, or has failed."""

    code = 1


def find_chromium() -> str:
    """The path of Chromium or Chrome; the environment variable MECHVIZ_CHROMIUM has priority. Raises `ChromiumError`."""
    wanted = os.environ.get(CHROMIUM_VARIABLE)
    program = shutil.which(wanted) if wanted else next((path for name in CHROMIUM_NAMES if (path := shutil.which(name))), None)
    if program is None:
        what = (
            f"{CHROMIUM_VARIABLE} names '{wanted}', which is no program."
            if wanted
            else "Pictures need Chromium, which is not installed."
        )
        raise ChromiumError(
            what,
            f"Install it (Debian: apt-get install chromium), or name another Chrome in {CHROMIUM_VARIABLE}; "
            "mechviz share makes a page that any browser shows, and shot -o picture.svg a drawing without one.",
        )
    return program


class Chromium:
    """A headless browser with one page, as a context manager: the exit ends the browser and removes its profile."""

    def __init__(self, width: int, height: int, *, dark: bool = False):
        self._size, self._dark = (width, height), dark
        self._number = 0
        self._rest = b""
        self._session: str | None = None

    def __enter__(self) -> Chromium:
        executable = find_chromium()
        self._profile = tempfile.mkdtemp(prefix="mechviz-chromium-")
        try:
            self._start(executable)
            self._open()
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        process = getattr(self, "_process", None)
        if process is not None:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGTERM)
            try:
                process.wait(5.0)
            except subprocess.TimeoutExpired:
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(process.pid, signal.SIGKILL)
                process.wait()
            for end in (self._to, self._from):
                with contextlib.suppress(OSError):
                    os.close(end)
        shutil.rmtree(self._profile, ignore_errors=True)

    def _start(self, executable: str) -> None:
        """Start Chromium, which reads from its descriptor 3 and writes to 4; without a sandbox for root, as in most containers."""
        theirs, self._to = os.pipe()
        self._from, reply = os.pipe()
        high = [fcntl.fcntl(end, fcntl.F_DUPFD_CLOEXEC, 10) for end in (theirs, reply)]  # not 3 or 4

        def connect() -> None:
            os.dup2(high[0], 3)
            os.dup2(high[1], 4)

        sandbox = ["--no-sandbox"] if os.geteuid() == 0 else []
        try:
            self._process = subprocess.Popen(
                [executable, *CHROMIUM_ARGUMENTS, *sandbox, f"--user-data-dir={self._profile}", "about:blank"],
                preexec_fn=connect,
                close_fds=False,  # it would close 3 and 4; Python's own descriptors are closed anyway
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                start_new_session=True,  # Ctrl-C does not reach the browser: `__exit__` ends it
            )
        finally:
            for end in (theirs, reply, *high):
                os.close(end)

    def _open(self) -> None:
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        width, height = self._size
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if self._dark else "light"}
        self.call("Emulation.setEmulatedMedia", features=[scheme])
        self.call("Page.enable")

    def go(self, page: Path) -> None:
        """Open a file and wait until the page has loaded."""
        self.call("Page.navigate", url=page.resolve().as_uri())
        self._await(lambda message: message.get("method") == "Page.loadEventFired")

    def evaluate(self, expression: str) -> Any:
        """The value of a JavaScript expression in the page; a promise is awaited."""
        answer = self.call("Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True)
        if "exceptionDetails" in answer:
            details = answer["exceptionDetails"]
            words = details.get("exception", {}).get("description", details.get("text", "an error"))
            raise ChromiumError(f"The page failed: {words.splitlines()[0]}.", RETRY_REMEDY)
        return answer["result"].get("value")

    def screenshot(self) -> bytes:
        """The page as PNG."""
        return base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"])

    def call(self, method: str, **parameters: object) -> dict[str, Any]:
        """The result of a method of the protocol. Raises `ChromiumError`."""
        self._number += 1
        message: dict[str, Any] = {"id": self._number, "method": method, "params": parameters}
        if self._session is not None:
            message["sessionId"] = self._session
        data = json.dumps(message).encode() + b"\0"
        try:
            while data:
                data = data[os.write(self._to, data) :]
        except OSError:
            raise self._gone() from None
        answer = self._await(lambda m: m.get("id") == message["id"])
        if "error" in answer:
            raise ChromiumError(f"Chromium refused {method}: {answer['error'].get('message', '')}.", RETRY_REMEDY)
        result: dict[str, Any] = answer["result"]
        return result

    def _await(self, wanted: Any) -> dict[str, Any]:
        for message in self._messages():
            if wanted(message):
                return message
        raise self._gone()

    def _messages(self) -> Iterator[dict[str, Any]]:
        end = time.monotonic() + ANSWER_PATIENCE
        while True:
            text, mark, rest = self._rest.partition(b"\0")
            if mark:
                self._rest = rest
                yield json.loads(text)
                continue
            ready, _, _ = select.select([self._from], [], [], max(0.0, end - time.monotonic()))
            if not ready:
                raise ChromiumError(
                    f"Chromium has not answered for {ANSWER_PATIENCE:.0f} s.", "Try again when the machine is less busy."
                )
            got = os.read(self._from, 1 << 16)
            if not got:
                return
            self._rest += got

    def _gone(self) -> ChromiumError:
        return ChromiumError("Chromium could not be started, or has ended.", "See what `chromium --headless=new about:blank` says.")
