"""``mechviz share``, ``shot`` and ``film``: a page that plays a mechanism anywhere, pictures, films."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated

import typer

from mechviz.commands.common import check_targets, fail, interruptible, say
from mechviz.commands.loading import SetOpt, SourceArg, clear_errors, load_scene
from mechviz.commands.recording import open_recording
from mechviz.commands.solving import KeepOpt, check_trust, solve
from mechviz.files import replacing
from mechviz.outputs.images.browser import find_chromium
from mechviz.outputs.images.drawing import write_svg
from mechviz.outputs.images.pictures import VIEWS, Look, find_ffmpeg, moment
from mechviz.outputs.images.pictures import film as make
from mechviz.outputs.images.pictures import shot as take
from mechviz.outputs.page.pack import MOST_FRAMES
from mechviz.outputs.page.page import make_page
from mechviz.outputs.presentation import Presentation, presentation_in, presentation_of
from mechviz.outputs.rerun.reader import is_recording
from mechviz.progress import progress_bar
from mechviz.scene.units import QuantityError, Units

FramesOpt = Annotated[
    int | None, typer.Option("--frames", "-n", min=2, max=10_000_000, help="of a scene: frames over the whole run")
]
CyclesOpt = Annotated[int | None, typer.Option("--cycles", min=1, max=100_000, help="of a scene: cycles of the first drive")]
ViewOpt = Annotated[str, typer.Option("--view", help="3d, front, iso, top, left, right or back")]
SizeOpt = Annotated[str, typer.Option("--size", metavar="WxH", help="size of the picture in pixels")]
DarkOpt = Annotated[bool, typer.Option("--dark", help="on a dark ground")]
ShowOpt = Annotated[
    str | None,
    typer.Option("--show", metavar="NAME,NAME", help="only these arrows and lines, such as reaction,paths,names; none: nothing"),
]

SMALLEST, LARGEST = 64, 8192  # pixels of a picture's side


def share(
    source: SourceArg,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="page to write [default: <scene>.html here]")] = None,
    most: Annotated[
        int, typer.Option("--most", min=2, max=100_000, help="frames in the page at most; longer runs are thinned")
    ] = 1000,
    frames: FramesOpt = None,
    cycles: CyclesOpt = None,
    values: SetOpt = None,
    keep: KeepOpt = False,
) -> None:
    """Write one HTML file that plays a mechanism in any browser, with plots and events, without a server or a network."""
    with clear_errors(source):
        path = output or Path(f"{Path(source).stem}.html")
        check_targets(source, path)
        shown = _presentation(source, values, frames, cycles, keep, most)
        if shown.bands().refused:
            say(f"note: some curves have no tolerance band: {shown.bands().refused}")
        with interruptible("pyarrow"), progress_bar("sharing") as bar:
            text, chosen = make_page(shown, most=most, progress=bar)
            with replacing(path) as temporary:
                temporary.write_text(text, encoding="utf-8")
        held = (
            f"{len(chosen.chosen)} frames"
            if len(chosen.chosen) == chosen.total
            else f"{len(chosen.chosen)} of {chosen.total} frames"
        )
        say(f"{held}, {path.stat().st_size / 1e6:.2f} MB. Open it in any browser; it needs no network.")
        print(path)


def shot(
    source: SourceArg,
    output: Annotated[Path, typer.Option("--output", "-o", help="picture to write (.png, or .svg without Chromium)")],
    at: Annotated[str | None, typer.Option("--at", metavar="TIME", help='a time, such as 0.2 (seconds) or "20 ms"')] = None,
    frame: Annotated[int | None, typer.Option("--frame", metavar="K", help="a frame, from 0")] = None,
    angle: Annotated[str | None, typer.Option("--angle", help='of the drive, such as 90 (degrees) or "0.5 rad"')] = None,
    view: ViewOpt = "3d",
    size: SizeOpt = "1280x800",
    dark: DarkOpt = False,
    show: ShowOpt = None,
    frames: FramesOpt = None,
    cycles: CyclesOpt = None,
    values: SetOpt = None,
    keep: KeepOpt = False,
) -> None:
    """Write a picture of a mechanism at a time, frame or drive angle, without a display.

    A PNG is made by Chromium and looks like the shared page; an SVG needs no browser: a drawing seen from the front.
    """
    with clear_errors(source):
        _ending(output, (".png", ".svg"), "a picture")
        drawing = output.suffix.lower() == ".svg"
        if drawing and (view not in ("3d", "front") or show is not None):
            fail("--view and --show are for .png: an .svg is seen from the front, with what a page shows.")
        look = _look(view, size, dark, show)
        if sum(x is not None for x in (at, frame, angle)) > 1:
            fail("--at, --frame and --angle name the same thing. Give one of them.")
        when = {"at": _quantity(at, "at", "s", "time"), "angle": _quantity(angle, "angle", "deg", "angle")}
        if not drawing:
            find_chromium()
        check_targets(source, output)
        anywhere = at is None and frame is None and angle is None  # else the frames on both sides of it have to be there
        shown = _presentation(source, values, frames, cycles, keep, MOST_FRAMES if anywhere else None)
        place = moment(shown, frame=frame, **when)
        with interruptible("pyarrow"), progress_bar("drawing") as bar:
            if drawing:
                sides = {"width": look.width, "height": look.height}
                write_svg(shown, output, time=place.time, dark=dark, progress=bar, **sides)
            else:
                take(shown, output, look, place, progress=bar, begin=bar.stage)
        print(output)


def film(
    source: SourceArg,
    output: Annotated[Path, typer.Option("--output", "-o", help="film to write (.gif, or .mp4 where ffmpeg is installed)")],
    seconds: Annotated[
        float | None, typer.Option("--seconds", min=0.1, max=3600.0, help="length of the film [default: 5 s a cycle]")
    ] = None,
    rate: Annotated[int | None, typer.Option("--rate", min=1, max=100, help="pictures a second [default: 20 of a GIF, 30]")] = None,
    view: ViewOpt = "3d",
    size: SizeOpt = "800x600",
    dark: DarkOpt = False,
    show: ShowOpt = None,
    frames: FramesOpt = None,
    cycles: CyclesOpt = None,
    values: SetOpt = None,
    keep: KeepOpt = False,
) -> None:
    """Write a film of a mechanism over its run, GIF or MP4; needs Chromium, but no display."""
    with clear_errors(source):
        _ending(output, (".gif", ".mp4"), "a film")
        look = _look(view, size, dark, show)
        find_chromium()
        if output.suffix.lower() == ".mp4":
            find_ffmpeg()
        check_targets(source, output)
        shown = _presentation(source, values, frames, cycles, keep, MOST_FRAMES)
        with interruptible("pyarrow", "PIL.Image"), progress_bar("filming") as bar:
            make(shown, output, look, seconds=seconds, rate=rate, progress=bar, reading=bar, begin=bar.stage)
        print(output)


def _presentation(
    source: str, values: list[str] | None, frames: int | None, cycles: int | None, keep: bool, most: int | None = None
) -> Presentation:
    """Presentation of the recording that is meant, of a long one at ``most`` frames where a number is given, or of the scene."""
    if not is_recording(source):
        run = solve(load_scene(source, values), frames, cycles)
        check_trust(run, keep)
        with interruptible("mechviz.meshes"), progress_bar("building") as bar:
            return presentation_of(run, bar.stage)
    if frames is not None or cycles is not None or values:
        fail(f"{source} is a recording, whose frames, cycles and parameters are what they are. Give a scene for other ones.")
    with progress_bar(f"opening {Path(source).name}"):
        return presentation_in(open_recording(source, most=most))


def _ending(path: Path, endings: tuple[str, ...], what: str) -> None:
    if path.suffix.lower() not in endings:
        fail(f"--output {path}: {what} is written as {' or '.join(e[1:].upper() for e in endings)}. Give a name that ends in "
             f"{' or '.join(endings)}.")  # fmt: skip


def _look(view: str, size: str, dark: bool, show: str | None) -> Look:
    if view not in VIEWS:
        fail(f"--view {view}: there is no such view. There are: {', '.join(VIEWS)}.")
    match = re.fullmatch(r"(\d{1,5})\s*[xX×]\s*(\d{1,5})", size.strip())
    if not match or not all(SMALLEST <= int(n) <= LARGEST for n in match.groups()):
        fail(f"--size {size}: a size is written like 1280x800, each side from {SMALLEST} to {LARGEST} pixels.")
    shown = None if show is None else tuple(name.strip() for name in show.split(",") if name.strip() not in ("", "none"))
    return Look(int(match[1]), int(match[2]), view, dark, shown)


def _quantity(text: str | None, option: str, unit: str, kind: str) -> float | None:
    """A time [s] or an angle [rad] of an option; a bare number is in ``unit``."""
    if text is None:
        return None
    bare = re.fullmatch(r"\s*[+-]?[0-9.]+([eE][+-]?[0-9]+)?\s*", text)
    try:
        return Units().si(f"{text} {unit}" if bare else text, kind)
    except QuantityError as e:
        fail(f"--{option}: {e} {e.remedy}")
