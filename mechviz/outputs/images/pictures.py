"""Pictures and films of a recording: the shared page in headless Chromium, without its plots and controls."""

from __future__ import annotations

import contextlib
import json
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from mechcore.records import dataclass
from mechviz.files import OutputError, check_target, replacing
from mechviz.outputs.images.browser import Chromium
from mechviz.outputs.page.pack import PackProgress, no_progress
from mechviz.outputs.page.page import make_page, playback_speed
from mechviz.outputs.presentation import Presentation
from mechviz.quantities.catalogue import time_at

VIEW_NAMES = ("3d", "front", "iso", "top", "left", "right", "back")
GIF_RATE, VIDEO_RATE = 20, 30  # pictures per second
MOST_GIF_RATE = 50  # a GIF has times in hundredths of a second, and browsers play pictures of a single one ten times as slowly
SETTLED_SCRIPT = "new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"

Begin = Callable[[str], None]
"""Called with the name of the next stage."""


@dataclass(frozen=True)
class Look:
    """Look of a picture: its size [px], the view, dark or light background, and the groups shown (None: as on a page)."""

    width: int = 1280
    height: int = 800
    view: str = "3d"
    dark: bool = False
    shown: tuple[str, ...] | None = None


@dataclass(frozen=True)
class PictureTime:
    """A time of a run [s]; None: that at which a page opens."""

    time: float | None = None


def picture_time(
    shown: Presentation, *, at: float | None = None, frame: int | None = None, angle: float | None = None
) -> PictureTime:
    """The time of a picture: at a time [s], at a frame, or where the drive first reaches an angle [rad], see `time_at`."""
    return PictureTime(time_at(shown.catalogue, at=at, frame=frame, angle=angle))


def shot(
    shown: Presentation,
    path: Path,
    look: Look,
    when: PictureTime,
    *,
    progress: PackProgress = no_progress,
    begin: Begin = lambda _: None,
) -> Path:
    """Write a picture (PNG) of the mechanism. ``progress`` is called while the page is made, ``begin`` with each stage."""
    check_target(path)
    with _stage(shown, look, when.time, progress, begin) as picture, replacing(path) as temporary:
        begin("picture")
        temporary.write_bytes(picture(when.time))
    return path


def film(
    shown: Presentation,
    path: Path,
    look: Look,
    *,
    seconds: float | None = None,
    rate: int | None = None,
    progress: PackProgress = no_progress,
    reading: PackProgress = no_progress,
    begin: Begin = lambda _: None,
) -> Path:
    """Write a film of the whole run, GIF or MP4 by the ending of the name, ``seconds`` [s] long at ``rate`` pictures per second.

    By default a cycle takes as long as on a page. MP4 needs ffmpeg. The pictures are made and written one after the other. Raises
    `OutputError`, also for a GIF of more than `MOST_GIF_RATE` pictures per second.
    ``progress`` is called with the number of pictures made, ``reading`` while the page is made, ``begin`` with each stage.
    """
    check_target(path)
    gif = path.suffix.lower() == ".gif"
    rate = film_rate(path, rate)
    start, end = (float(shown.picture.time[k]) for k in (0, -1))
    seconds = seconds or (end - start) / playback_speed(shown)
    count = max(2, round(seconds * rate))
    times = np.linspace(start, end, count, endpoint=False)
    ffmpeg = None if gif else find_ffmpeg()
    with _stage(shown, look, None, reading, begin, plain=gif) as picture, replacing(path) as temporary:
        begin("pictures")

        def pictures() -> Iterator[bytes]:
            for k, time in enumerate(times):
                yield picture(float(time))
                progress(k + 1, count)

        if ffmpeg is None:
            _write_gif(pictures(), temporary, gif_durations(count, rate))
        else:
            _write_video(pictures(), temporary, rate, ffmpeg)
    return path


@contextmanager
def _stage(
    shown: Presentation, look: Look, keep: float | None, progress: PackProgress, begin: Begin, *, plain: bool = False
) -> Iterator[Callable[[float | None], bytes]]:
    """A context with a function that returns the picture at a time [s] as PNG; None: the time at which the page opens. ``plain``:
    with a background of one colour. Raises `OutputError` for unknown groups."""
    with tempfile.TemporaryDirectory(prefix="mechviz-") as folder:
        page = Path(folder) / "page.html"
        begin("page")
        page.write_text(make_page(shown, keep=keep, plots=False, progress=progress)[0], encoding="utf-8")
        begin("starting Chromium")
        with Chromium(look.width, look.height, dark=look.dark) as browser:
            browser.go(page)
            browser.evaluate("mechviz.ready")
            browser.evaluate(f"document.body.classList.add('bare', '{'plain' if plain else 'shaded'}'); {SETTLED_SCRIPT}")
            if look.shown is not None:
                known = browser.evaluate("[...document.querySelectorAll('#groups button')].map((b) => b.dataset.group)")
                unknown = [name for name in look.shown if name not in known]
                if unknown:
                    raise OutputError(
                        f"--show {unknown[0]}: there is no such thing in this picture.", f"There are: {', '.join(known)}."
                    )
                browser.evaluate(
                    f"for (const g of {json.dumps(known)}) mechviz.player.show(g, {json.dumps(look.shown)}.includes(g))"
                )
            browser.evaluate(f"mechviz.player.stage.resize(); mechviz.player.view({json.dumps(look.view)}); {SETTLED_SCRIPT}")

            def picture(time: float | None) -> bytes:
                seek = "" if time is None else f"mechviz.player.seek({time!r});"
                browser.evaluate(f"{seek} mechviz.player.drawNow(); {SETTLED_SCRIPT}")
                return browser.screenshot()

            yield picture


def film_rate(path: Path, rate: int | None) -> int:
    """Pictures per second of a film, without a ``rate`` the usual one of its format. Raises `OutputError` for a GIF of more than
    `MOST_GIF_RATE`."""
    gif = path.suffix.lower() == ".gif"
    if gif and rate is not None and rate > MOST_GIF_RATE:
        why = f"--rate {rate}: a GIF has at most {MOST_GIF_RATE} pictures a second; programs play faster ones slowly."
        raise OutputError(why, f"Give at most {MOST_GIF_RATE}, or write an .mp4.")
    return rate or (GIF_RATE if gif else VIDEO_RATE)


def gif_durations(count: int, rate: int) -> list[int]:
    """How long each of some pictures of a GIF is shown [ms]: whole hundredths of a second, whose sum is right where ``rate`` does
    not divide 100."""
    ends = np.round(100.0 * np.arange(count + 1) / rate).astype(int)
    return [int(last) for last in 10 * np.diff(ends)]


def _write_gif(pictures: Iterator[bytes], path: Path, durations: Sequence[int]) -> None:
    from PIL import Image

    def opened(data: bytes) -> Any:
        return Image.open(BytesIO(data)).convert("RGB")

    # one palette without dithering: plain areas stay plain, and successive pictures differ only where something moves
    first = opened(next(pictures)).quantize(256, method=Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
    rest = (opened(data).quantize(palette=first, dither=Image.Dither.NONE) for data in pictures)
    with open(path, "wb") as file:
        first.save(file, "GIF", save_all=True, append_images=rest, duration=durations, loop=0, optimize=False)


def find_ffmpeg() -> str:
    """The path of ffmpeg, otherwise of that in the package imageio-ffmpeg, if installed. Raises `OutputError`."""
    program = shutil.which("ffmpeg")
    if program is None:
        try:
            import imageio_ffmpeg  # type: ignore[import-not-found,import-untyped,unused-ignore]  # optional package

            program = str(imageio_ffmpeg.get_ffmpeg_exe())
        except (ImportError, RuntimeError):  # not installed, or without a program for this machine
            program = None
    if program is None:
        raise OutputError(
            "An MP4 needs ffmpeg, which is not installed.",
            "Install it (Debian: apt-get install ffmpeg; or pip install imageio-ffmpeg), or write a .gif.",
            1,
        )
    return program


def _write_video(pictures: Iterator[bytes], path: Path, rate: int, ffmpeg: str) -> None:
    command: Sequence[str] = (
        ffmpeg, "-y", "-loglevel", "error", "-f", "image2pipe", "-framerate", str(rate), "-c:v", "png", "-i", "-",
        "-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2", "-c:v", "libx264", "-pix_fmt", "yuv420p", "-movflags", "+faststart",
        "-f", "mp4", str(path),
    )  # fmt: skip
    with tempfile.TemporaryFile() as errors:  # not a pipe: it would not be read while pictures are made
        process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=errors, start_new_session=True)
        assert process.stdin is not None
        try:
            try:
                for data in pictures:
                    process.stdin.write(data)
                process.stdin.close()
            except BrokenPipeError:
                pass  # the reason follows from its exit code and messages
            if process.wait():
                errors.seek(0)
                words = errors.read().decode(errors="replace").strip()
                why = words.splitlines()[-1] if words else "it gave no reason"
                raise OutputError(f"ffmpeg could not make the film: {why}.", "Write a .gif, which needs no ffmpeg.", 1)
        finally:
            if process.poll() is None:
                process.kill()
                process.wait()
            with contextlib.suppress(OSError):  # buffered data that ffmpeg did not read
                process.stdin.close()
