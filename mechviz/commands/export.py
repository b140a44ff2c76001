"""Files for other programs and people. ``mechviz export``: tables, solids, profiles of cams, and the moving mechanism of a
recording; ``share``: a page that plays a mechanism in any browser; ``shot`` and ``film``: pictures and films."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from mechviz.commands.recording import open_recording
from mechviz.commands.shared.loading import ReachableOpt, SetOpt, SourceArg, clear_errors, load_scene, quantity, quantity_option
from mechviz.commands.shared.messages import check_suffix, check_targets, fail, interruptible, say
from mechviz.commands.shared.solving import (
    AccuracyOpt,
    CyclesOpt,
    ExecutorOpt,
    FramesOpt,
    KeepOpt,
    check_trust,
    solve,
    warn_of_accuracy,
)
from mechviz.files import replacing
from mechviz.outputs.exports.cam_profiles import export_profiles
from mechviz.outputs.exports.code import export_code
from mechviz.outputs.exports.gltf import export_glb
from mechviz.outputs.exports.gltf_marks import ARROW_FAMILIES
from mechviz.outputs.exports.solids import export_3mf, export_kit, export_stl
from mechviz.outputs.exports.tables import even_times, export_csv, export_parquet
from mechviz.outputs.images.browser import find_chromium
from mechviz.outputs.images.drawing import write_svg
from mechviz.outputs.images.pictures import VIEW_NAMES, Look, film_rate, find_ffmpeg, picture_time
from mechviz.outputs.images.pictures import film as make
from mechviz.outputs.images.pictures import shot as take
from mechviz.outputs.page.pack import MOST_FRAMES
from mechviz.outputs.page.page import make_page
from mechviz.outputs.presentation import Presentation, presentation_in, presentation_of
from mechviz.outputs.rerun.reader import is_recording
from mechviz.progress import progress_bar
from mechviz.quantities.vectors import VECTOR_FAMILIES
from mechviz.scene.units import QuantityError, Units

KIT_SIZES = ("3 mm", "0.2 mm", "1 mm")  # thickness, clearance, washer


def export(
    source: SourceArg,
    values: SetOpt = None,
    csv: Annotated[Path | None, typer.Option("--csv", help="write all results as one table (CSV)")] = None,
    parquet: Annotated[Path | None, typer.Option("--parquet", help="write all results as one table (Parquet)")] = None,
    stl: Annotated[Path | None, typer.Option("--stl", help="write one STL a link into this folder (millimetres)")] = None,
    glb: Annotated[
        Path | None, typer.Option("--glb", help="write the moving mechanism for viewers of glTF; also of a recording")
    ] = None,
    arrows: Annotated[
        str | None, typer.Option("--arrows", metavar="NAME,NAME", help="in the GLB, such as reaction,drive; none: nothing")
    ] = None,
    threemf: Annotated[Path | None, typer.Option("--3mf", help="write all solids into one file to print (3MF)")] = None,
    dxf: Annotated[Path | None, typer.Option("--dxf", help="write the profiles of cams as arcs (DXF, millimetres)")] = None,
    svg: Annotated[Path | None, typer.Option("--svg", help="write the profiles of cams true to scale (SVG)")] = None,
    profile: Annotated[Path | None, typer.Option("--profile", help="write cams' points, normals, curvature (CSV)")] = None,
    kit: Annotated[
        Path | None,
        typer.Option("--kit", metavar="FOLDER", help="write plates, pins and spacers to print or cut (3MF, DXF, SVG)"),
    ] = None,
    thickness: Annotated[str, typer.Option("--thickness", help="kit: of its plates")] = KIT_SIZES[0],
    clearance: Annotated[
        str, typer.Option("--clearance", help="kit: by how much holes are wider than the pins that turn in them")
    ] = KIT_SIZES[1],
    washer: Annotated[str, typer.Option("--washer", help="kit: distance of plates that lie on each other")] = KIT_SIZES[2],
    code: Annotated[
        Path | None, typer.Option("--c", help="write poses, rates and drive efforts as a program in C that needs nothing else")
    ] = None,
    every: Annotated[
        str | None, typer.Option("--every", metavar="TIME", help='tables: a row each such time, as "1 ms", also between frames')
    ] = None,
    frames: FramesOpt = None,
    cycles: CyclesOpt = None,
    accuracy: AccuracyOpt = None,
    executor: ExecutorOpt = "auto",
    reachable: ReachableOpt = False,
    keep: KeepOpt = False,
) -> None:
    """Write results as tables, the links as solids, the profiles of cams as drawings.

    --kit writes flat parts from which the mechanism is built: the holes in which a pin turns are wider by --clearance.
    Of a recording (.rrd) the moving mechanism is written, with --glb.
    """
    profiles = {kind: path for kind, path in (("dxf", dxf), ("svg", svg), ("csv", profile)) if path is not None}
    if not profiles and all(target is None for target in (csv, parquet, stl, glb, threemf, kit, code)):
        fail(
            "nothing to export: add --csv, --parquet, --glb, --3mf, --c FILE, --stl, --kit FOLDER, of cams --dxf, --svg, --profile."
        )
    families = _families(arrows)
    if glb is None and arrows is not None:
        fail("--arrows is for --glb FILE: name that too.")
    if kit is None and (thickness, clearance, washer) != KIT_SIZES:
        fail("--thickness, --clearance and --washer are for --kit FOLDER: name that too.")
    if every is not None and csv is None and parquet is None:
        fail("--every is for tables: name --csv or --parquet FILE, too.")
    for path, suffix in ((glb, ".glb"), (threemf, ".3mf"), (parquet, ".parquet"), (code, ".c")):
        check_suffix(path, suffix, f"--{suffix[1:]}")
    with clear_errors(source):
        targets = (csv, parquet, glb, threemf, code, *profiles.values())
        check_targets(source, *targets)
        if is_recording(source):
            others = (csv, parquet, stl, threemf, kit, code, every, frames, cycles, accuracy)
            if glb is None or profiles or values or reachable or any(option is not None for option in others):
                fail(f"{source} is a recording: of it --glb FILE is exported, with --arrows. Give its scene for all else.")
            with interruptible("pyarrow"), progress_bar(f"exporting {glb.name}"):
                print(export_glb(presentation_in(open_recording(source)), glb, arrows=families))
            return
        loaded = load_scene(source, values, reachable=reachable, targets=targets)
        if code is not None:
            written, missing = export_code(loaded, code)
            print(written)
            if missing is not None:
                say(f"note: efforts of drives are not in {written}: {missing}.")
            if not profiles and all(target is None for target in (csv, parquet, stl, glb, threemf, kit)):
                return
        step = quantity_option(loaded, every, "every", "time")
        sizes = [_size(text, option) for text, option in ((thickness, "thickness"), (clearance, "clearance"), (washer, "washer"))]
        run = solve(loaded, frames, cycles, accuracy, executor)
        check_trust(run, keep)
        warn_of_accuracy(run)
        times = None if step is None else even_times(run, step)

        def export_to(target: Path, write: Callable[..., Any], *more: object, **options: object) -> Any:
            with progress_bar(f"exporting {target.name}"):
                return write(run, target, *more, **options)

        solid = any(path is not None for path in (stl, glb, threemf, kit))
        libraries = ["mechviz.meshes", "trimesh"] if solid else []
        libraries += ["pyarrow.parquet"] if parquet is not None else []
        with interruptible(*libraries):
            if csv is not None:
                print(export_to(csv, export_csv, times))
            if parquet is not None:
                print(export_to(parquet, export_parquet, times))
            if stl is not None:
                for path in export_to(stl, export_stl):
                    print(path)
            if kit is not None:
                for path in export_to(kit, export_kit, *sizes):
                    print(path)
            if glb is not None:
                with progress_bar(f"exporting {glb.name}"):
                    print(export_glb(presentation_of(run), glb, arrows=families))
            if threemf is not None:
                print(export_to(threemf, export_3mf))
            for kind, path in profiles.items():
                print(export_to(path, export_profiles, kind, lambda line: print(line, file=sys.stderr)))


def _size(text: str, option: str) -> float:
    """A length [mm] from an option for kits; ends the command where it is not above zero."""
    value = 1e3 * quantity(Units(length="mm"), text, option, "length")
    if not value > 0.0:
        fail(f"--{option}: {text} is not above zero.")
    return value


def _families(text: str | None) -> tuple[str, ...]:
    """The families of arrows that an option names; without the option the default ones."""
    if text is None:
        return ARROW_FAMILIES
    names = tuple(name.strip() for name in text.split(",") if name.strip() not in ("", "none"))
    unknown = [name for name in names if name not in VECTOR_FAMILIES]
    if unknown:
        fail(f"--arrows {unknown[0]}: there are no such arrows. There are: {', '.join(VECTOR_FAMILIES)}.")
    return names


ViewOpt = Annotated[str, typer.Option("--view", help="3d, front, iso, top, left, right or back")]
SizeOpt = Annotated[str, typer.Option("--size", metavar="WxH", help="size of the picture in pixels")]
DarkOpt = Annotated[bool, typer.Option("--dark", help="on a dark ground")]
ShowOpt = Annotated[
    str | None,
    typer.Option("--show", metavar="NAME,NAME", help="only these arrows and lines, such as reaction,paths,names; none: nothing"),
]

SMALLEST, LARGEST = 64, 8192  # side of a picture in pixels


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
    check_suffix(output, ".html")
    with clear_errors(source):
        path = output or Path(f"{Path(source).stem}.html")
        check_targets(source, path)
        shown = _presentation(source, path, values, frames, cycles, keep, most)
        if shown.bands().missing_reason:
            say(f"note: some curves have no tolerance band: {shown.bands().missing_reason}")
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
        anywhere = at is None and frame is None and angle is None  # otherwise the frames on both sides of the moment are needed
        shown = _presentation(source, output, values, frames, cycles, keep, MOST_FRAMES if anywhere else None)
        place = picture_time(shown, frame=frame, **when)
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
        rate = film_rate(output, rate)
        find_chromium()
        if output.suffix.lower() == ".mp4":
            find_ffmpeg()
        check_targets(source, output)
        shown = _presentation(source, output, values, frames, cycles, keep, MOST_FRAMES)
        with interruptible("pyarrow", "PIL.Image"), progress_bar("filming") as bar:
            make(shown, output, look, seconds=seconds, rate=rate, progress=bar, reading=bar, begin=bar.stage)
        print(output)


def _presentation(
    source: str,
    target: Path,
    values: list[str] | None,
    frames: int | None,
    cycles: int | None,
    keep: bool,
    most: int | None = None,
) -> Presentation:
    """Presentation of the recording or scene at ``source``, of which ``target`` will be made; ``most``: largest number of frames
    that are read from a recording."""
    if not is_recording(source):
        run = solve(load_scene(source, values, targets=(target,)), frames, cycles)
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
    if view not in VIEW_NAMES:
        fail(f"--view {view}: there is no such view. There are: {', '.join(VIEW_NAMES)}.")
    match = re.fullmatch(r"(\d{1,5})\s*[xX×]\s*(\d{1,5})", size.strip())
    if not match or not all(SMALLEST <= int(n) <= LARGEST for n in match.groups()):
        fail(f"--size {size}: a size is written like 1280x800, each side from {SMALLEST} to {LARGEST} pixels.")
    shown = None if show is None else tuple(name.strip() for name in show.split(",") if name.strip() not in ("", "none"))
    return Look(int(match[1]), int(match[2]), view, dark, shown)


def _quantity(text: str | None, option: str, unit: str, kind: str) -> float | None:
    """A time [s] or an angle [rad] from an option, None without it; a number without a unit is in ``unit``."""
    if text is None:
        return None
    bare = re.fullmatch(r"\s*[+-]?[0-9.]+([eE][+-]?[0-9]+)?\s*", text)
    try:
        return Units().si(f"{text} {unit}" if bare else text, kind)
    except QuantityError as e:
        fail(f"--{option}: {e} {e.remedy}")
