"""``mechviz export``: tables, solids and profiles of cams as files; of a recording the moving mechanism."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from mechviz.commands.common import check_targets, fail, interruptible, say
from mechviz.commands.loading import ReachableOpt, SetOpt, SourceArg, clear_errors, load_scene, quantity, quantity_of
from mechviz.commands.recording import open_recording
from mechviz.commands.solving import AccuracyOpt, CyclesOpt, ExecutorOpt, FramesOpt, KeepOpt, check_trust, solve, warn_of_accuracy
from mechviz.outputs.exports.cam_profiles import export_profiles
from mechviz.outputs.exports.code import export_code
from mechviz.outputs.exports.gltf import export_glb
from mechviz.outputs.exports.gltf_marks import ARROWS
from mechviz.outputs.exports.solids import export_3mf, export_kit, export_stl
from mechviz.outputs.exports.tables import even_times, export_csv, export_parquet
from mechviz.outputs.presentation import presentation_in, presentation_of
from mechviz.outputs.rerun.reader import is_recording
from mechviz.progress import progress_bar
from mechviz.quantities.vectors import FAMILIES
from mechviz.scene.units import Units


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
    thickness: Annotated[str, typer.Option("--thickness", help="kit: of its plates")] = "3 mm",
    clearance: Annotated[
        str, typer.Option("--clearance", help="kit: by how much holes are wider than the pins that turn in them")
    ] = "0.2 mm",
    washer: Annotated[str, typer.Option("--washer", help="kit: distance of plates that lie on each other")] = "1 mm",
    code: Annotated[
        Path | None, typer.Option("--c", help="write poses, rates and drive efforts as a program in C that needs nothing else")
    ] = None,
    every: Annotated[
        str | None, typer.Option("--every", metavar="TIME", help='tables: a row each such time, as "1 ms", read between frames')
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
    with clear_errors(source):
        check_targets(source, csv, parquet, glb, threemf, code, *profiles.values())
        if is_recording(source):
            others = (csv, parquet, stl, threemf, kit, code, every, frames, cycles, accuracy)
            if glb is None or profiles or values or reachable or any(option is not None for option in others):
                fail(f"{source} is a recording: of it --glb FILE is exported, with --arrows. Give its scene for all else.")
            with interruptible("pyarrow"), progress_bar(f"exporting {glb.name}"):
                print(export_glb(presentation_in(open_recording(source)), glb, arrows=families))
            return
        loaded = load_scene(source, values, reachable=reachable)
        if code is not None:
            written, missing = export_code(loaded, code)
            print(written)
            if missing is not None:
                say(f"note: efforts of drives are not in {written}: {missing}.")
            if not profiles and all(target is None for target in (csv, parquet, stl, glb, threemf, kit)):
                return
        step = quantity_of(loaded, every, "every", "time")
        sizes = [_size(text, option) for text, option in ((thickness, "thickness"), (clearance, "clearance"), (washer, "washer"))]
        run = solve(loaded, frames, cycles, accuracy, executor)
        check_trust(run, keep)
        warn_of_accuracy(run)
        times = None if step is None else even_times(run, step)

        def export_to(target: Path, write: Callable[..., Any], *more: Any, **options: Any) -> Any:
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
    """A length of a kit [mm]."""
    value = 1e3 * quantity(Units(length="mm"), text, option, "length")
    if not value > 0.0:
        fail(f"--{option}: {text} is not above zero.")
    return value


def _families(text: str | None) -> tuple[str, ...]:
    """The families of arrows that an option names; the usual ones where nothing is said."""
    if text is None:
        return ARROWS
    names = tuple(name.strip() for name in text.split(",") if name.strip() not in ("", "none"))
    unknown = [name for name in names if name not in FAMILIES]
    if unknown:
        fail(f"--arrows {unknown[0]}: there are no such arrows. There are: {', '.join(FAMILIES)}.")
    return names
