"""The command line. Data goes to stdout, talk to stderr; bad input exits with 2; heavy libraries load only where they are used."""

from __future__ import annotations

import io
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mechviz.commands.accuracy import accuracy as accuracy_command
from mechviz.commands.accuracy import effects as effects_command
from mechviz.commands.cams import cams
from mechviz.commands.common import (
    check_targets,
    clear_errors,
    fail,
    interruptible,
    load_scene,
    no_output,
    progress_bar,
    quantity_of,
    say,
    solve,
    warn_of_accuracy,
)
from mechviz.commands.hard import hard
from mechviz.commands.laws import laws
from mechviz.commands.share import film, share, shot

if TYPE_CHECKING:
    from mechviz.runs import Run
    from mechviz.scene.scene import Scene


app = typer.Typer(
    name="mechviz",
    help="Inspect and record mechanisms: kinematics, forces, solids, rerun recordings, a browser viewer.\n\n"
    "SCENE is the name of a gallery scene (see: mechviz scenes) or the path of a scene file.\n\n"
    "Start with: mechviz record crank-rocker, then mechviz inspect recordings/crank-rocker.rrd, or mechviz view crank-rocker.\n\n"
    "Exit codes: 0 done; 2 it cannot be done as it is asked for (options, scene, recording, a file that cannot be written there); "
    "1 something is in the way (a full disk, a port in use, no Chromium), or a hard case fails; 130 and 143 interrupted.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)

SceneArg = Annotated[str, typer.Argument(metavar="SCENE", help="gallery name or path of a scene file (.toml)")]
FramesOpt = Annotated[
    int | None, typer.Option("--frames", "-n", min=2, max=10_000_000, help="frames over the whole run [default: the scene's]")
]
CyclesOpt = Annotated[
    int | None, typer.Option("--cycles", min=1, max=100_000, help="cycles of the first drive [default: the scene's]")
]
ReachableOpt = Annotated[bool, typer.Option("--reachable", help="run the drive as far as it can go and back, not a full turn")]
AccuracyOpt = Annotated[
    float | None,
    typer.Option(
        "--accuracy", "-a", metavar="ERROR", help="wanted relative error, such as 1e-6: all dials follow [default: the scene's]"
    ),
]


@app.command()
def scenes(names: Annotated[bool, typer.Option("--names", help="bare names only, one a line, for scripts")] = False) -> None:
    """List the gallery: one line a scene with what it teaches."""
    from mechviz.scene.folder import gallery

    entries = gallery()
    width = max(len(e.name) for e in entries)
    with clear_errors("scenes"):
        for e in entries:
            print(e.name if names else f"{e.name:<{width}}  {e.teaches}")


@app.command()
def show(scene: SceneArg) -> None:
    """Print a scene's TOML text: a starting point for your own."""
    with clear_errors(scene):
        loaded = load_scene(scene)
        print(loaded.to_toml(), end="")
        if loaded.files:
            say(f"note: it reads {', '.join(loaded.files)} from its folder, '{loaded.folder.path}': copy that along with the text.")


@app.command()
def schema() -> None:
    """Print the JSON Schema of scene files, for editors."""
    from mechviz.scene.scene import json_schema

    with clear_errors("schema"):
        print(json.dumps(json_schema(), indent=2, ensure_ascii=False))


@app.command()
def check(
    scene: SceneArg,
    equations: Annotated[
        bool, typer.Option("--equations", help="also the contour equations, velocities and accelerations")
    ] = False,
    modes: Annotated[bool, typer.Option("--modes", help="also all assembly modes of every group at the start")] = False,
    reachable: ReachableOpt = False,
) -> None:
    """Validate a scene and print its mobility, groups, contours, assembly modes and reachable range."""
    from mechviz.studies.report import check_lines

    with clear_errors(scene):
        print("\n".join(check_lines(load_scene(scene, reachable=reachable), equations=equations, modes=modes)))


@app.command()
def plan(
    scene: SceneArg,
    cost: Annotated[bool, typer.Option("--cost", help="also measure what each stage and effect costs")] = False,
) -> None:
    """Print what will be computed for a scene, what not, and why; with --cost what each stage and effect costs."""
    from mechcore.effects.plan import make_plan
    from mechviz.studies.report import plan_lines

    with clear_errors(scene):
        loaded = load_scene(scene)
        print(loaded.title)
        print("\n".join(plan_lines(make_plan(loaded.mechanism))))
        if cost:
            from mechviz.studies.cost import cost_lines, measure

            print("\n".join(cost_lines(measure(loaded), loaded.frames + 1)))


@app.command()
def forces(
    scene: SceneArg,
    csv: Annotated[Path | None, typer.Option("--csv", help="also write the table (CSV)")] = None,
    fluctuation: Annotated[
        float | None,
        typer.Option("--flywheel", metavar="DELTA", help="flywheel for a coefficient of fluctuation such as 0.02"),
    ] = None,
    plot: Annotated[Path | None, typer.Option("--plot", help="write polar plots of shaking force and moment (.svg)")] = None,
    steady: Annotated[
        int | None,
        typer.Option(
            "--steady", metavar="TURNS", min=1, help="free crank: steady run whose cycle is this many turns; sizes its flywheel"
        ),
    ] = None,
    frames: FramesOpt = None,
    cycles: CyclesOpt = None,
    accuracy: AccuracyOpt = None,
    reachable: ReachableOpt = False,
) -> None:
    """Print who supplies power and who absorbs it: every force with its classes and its work over the run. Where nothing moves:
    the reactions.

    Place: external forces come from outside, internal ones act between two links. Power: driving forces supply at every instant,
    resisting ones absorb, alternating ones do both. Use: useful resistance is what the machine is there for, harmful is loss.
    Supplied and absorbed works are equal: inertia and gravity only lend energy over a cycle.
    """
    from mechcore.forces.flywheel import flywheel
    from mechviz.quantities.power_table import flywheel_lines, force_lines, power_csv
    from mechviz.studies.statics import statics_lines

    if steady is not None:
        _print_steady(scene, steady, fluctuation)
        return
    with clear_errors(scene):
        check_targets(scene, csv, plot)
        run = solve(load_scene(scene, reachable=reachable), frames, cycles, accuracy)
        warn_of_accuracy(run)
        if run.forces is None:
            fail(f'{run.scene.name}: the scene names no effects and no loads, so there are no forces. Add effects = ["inertia"].')
        print(run.scene.title)
        print("\n".join(force_lines(run.forces) if run.motion.mechanism.led else statics_lines(run.forces, run.scene.units)))
        if fluctuation is not None:
            print("\n".join(flywheel_lines(flywheel(run.forces, fluctuation))))
        with interruptible():
            if csv is not None:
                print(power_csv(run.forces, csv))
            if plot is not None:
                from mechviz.studies.polar import shaken, write_polar

                write_polar(plot, run.scene.title, run.motion, {"shaking force": shaken(run)})
                print(plot)


def _print_steady(source: str, turns: int, fluctuation: float | None) -> None:
    """The steady run of a scene's machine, and its flywheel where a coefficient of fluctuation is wanted."""
    from mechcore.dynamics.rest.steady import size_flywheel, steady_run
    from mechviz.quantities.power_table import sized_lines, steady_lines

    with clear_errors(source):
        loaded = load_scene(source)
        print(loaded.title)
        print("\n".join(steady_lines(steady_run(loaded.mechanism, turns=turns))))
        if fluctuation is not None:
            print("\n".join(sized_lines(size_flywheel(loaded.mechanism, fluctuation, turns=turns))))


@app.command()
def record(
    scene: SceneArg,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="recording to write [default: recordings/<scene>.rrd]")
    ] = None,
    frames: FramesOpt = None,
    cycles: CyclesOpt = None,
    accuracy: AccuracyOpt = None,
    reachable: ReachableOpt = False,
    live: Annotated[
        int | None,
        typer.Option(
            "--live",
            metavar="PORT",
            min=0,
            max=65535,
            help="motion under forces: watch it on this port while it runs; 0: a free one",
        ),
    ] = None,
) -> None:
    """Solve a scene and write a rerun recording (.rrd). Open it with: rerun FILE."""
    from mechviz.outputs.rerun.writer import write_recording

    with clear_errors(scene):
        loaded = load_scene(scene, reachable=reachable)
        path = output
        if path is None:
            Path("recordings").mkdir(exist_ok=True)
            path = Path("recordings") / f"{loaded.name}.rrd"
        check_targets(scene, path)
        if live is not None and loaded.simulation is None:
            fail(f"{loaded.name}: nothing is free, so that the whole motion is there at once. Leave out --live.")
        run = None if live is not None else solve(loaded, frames, cycles, accuracy)
        with interruptible("rerun", "mechviz.picture.meshes"):
            if run is None:
                run = _solve_live(loaded, frames, cycles, accuracy, path, live or 0)
            with progress_bar("recording") as bar:
                summary = write_recording(run, path, progress=bar, begin=bar.stage)
        say(str(summary))
        print(path)


def _solve_live(scene: Scene, frames: int | None, cycles: int | None, accuracy: float | None, path: Path, port: int) -> Run:
    """Solve a motion under forces; what is known of it is in the unfinished recording, and can be watched."""
    from mechviz.outputs.rerun.live import live
    from mechviz.runs import run_scene, with_run

    scene = with_run(scene, frames, cycles)
    with live(scene, path, port) as (observer, address), progress_bar("simulating") as bar:
        say(f"watch it with: rerun {address}")
        return run_scene(scene, accuracy=accuracy, advance=lambda t, end: bar(round(1e3 * t / end), 1000), observe=observer)


@app.command()
def inspect(recording: Annotated[Path, typer.Argument(metavar="FILE.rrd", help="a mechviz recording")]) -> None:
    """Print what a recording holds, without a viewer: links, joints, peaks of forces and torque, health, events."""
    from mechviz.outputs.rerun.inspection import format_inspection
    from mechviz.outputs.rerun.inspection import inspect as inspect_recording

    with clear_errors(str(recording)):
        print(format_inspection(inspect_recording(recording)))


@app.command()
def balance(
    scene: SceneArg,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="write the scene with its counterweights to this file")
    ] = None,
    radius: Annotated[str | None, typer.Option(help='distance of the counterweights from their pivots, such as "60 mm"')] = None,
    rocker_radius: Annotated[str | None, typer.Option(help="distance of the rocker's own from its pivot")] = None,
    fraction: Annotated[
        float | None, typer.Option(help="how much is balanced, 0 to 1 (slider-crank: of what goes to and fro)")
    ] = None,
    plot: Annotated[Path | None, typer.Option("--plot", help="write polar plots, before and after (.svg)")] = None,
) -> None:
    """Balance the shaking force of a four-bar or slider-crank by counterweights; show it before and after."""
    from mechviz.studies.balance import balance_scene
    from mechviz.studies.polar import write_polar

    with clear_errors(scene):
        check_targets("", output, plot)  # the scene itself may be given its counterweights
        loaded = load_scene(scene)
        stated = ((radius, "radius"), (rocker_radius, "rocker-radius"))
        first, second = (quantity_of(loaded, text, name, "length") for text, name in stated)
        found = balance_scene(loaded, radius=first, rocker_radius=second, fraction=fraction)
        print("\n".join(found.lines()))
        with interruptible():
            if output is not None:
                _dump(found.scene, output)
            if plot is not None:
                write_polar(plot, loaded.title, found.motion, {"before": found.before, "with counterweights": found.after})
                print(plot)


def _dump(scene: Scene, path: Path) -> None:
    """Write a scene and say so, and which files went with it."""
    from mechviz.scene.scene import dump

    copies = dump(scene, path)
    say(f"{path} written." + (f" Copied beside it: {', '.join(copy.name for copy in copies)}." if copies else ""))


@app.command()
def vibrations(
    scene: SceneArg,
    nearest: Annotated[
        bool, typer.Option("--nearest", help="the nearest equilibrium, also an unstable one, instead of going downhill")
    ] = False,
    csv: Annotated[Path | None, typer.Option("--csv", help="also write the modes as a table (CSV)")] = None,
    mode: Annotated[int | None, typer.Option("--mode", metavar="K", help="the mode to show: 1 is the slowest")] = None,
    amplitude: Annotated[
        float, typer.Option(metavar="PART", help="largest displacement in it, as a part of the mechanism's size")
    ] = 0.08,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="write the mode as a recording (.rrd) or as a scene (.toml)")
    ] = None,
) -> None:
    """Find the equilibrium of a scene with free pairs, and its natural frequencies, damping ratios and modes.

    The mechanism is let down from the start of its free pairs to where it stays at rest; about that place its equations of motion
    are linearised. In a mode all parts move in step at one frequency; every small free motion is a sum of modes. Shapes are
    printed with their largest part one, and are mass-normalised in the table.

    Try: mechviz vibrations swinging-double-pendulum, then add --mode 2 -o mode2.rrd and open that with rerun.
    """
    from mechviz.outputs.rerun.writer import write_recording
    from mechviz.studies.vibrations import mode_scene, vibration_lines, vibrations_csv, vibrations_of

    if (mode is None) != (output is None):
        fail("a mode to show needs both: --mode K and -o FILE.rrd (or FILE.toml).")
    if output is not None and output.suffix not in (".rrd", ".toml"):
        fail(f"--output: '{output}' ends neither in .rrd (a recording) nor in .toml (a scene).")
    with clear_errors(scene):
        check_targets(scene, csv, output)
        loaded = load_scene(scene)
        found = vibrations_of(loaded, seek="nearest" if nearest else "stable")
        print("\n".join(vibration_lines(loaded, found)))
        with interruptible(*(() if output is None else ("rerun", "mechviz.picture.meshes"))):
            if csv is not None:
                say(f"{vibrations_csv(found, csv)} written.")
            if mode is not None and output is not None:
                shown = mode_scene(loaded, found, mode, amplitude=amplitude)
                if output.suffix == ".toml":
                    _dump(shown, output)
                else:
                    write_recording(solve(shown, None, None), output)
                    say(f"{output} written.")


@app.command()
def view(
    scene: Annotated[
        str, typer.Argument(metavar="SCENE|RECORDING.rrd", help="gallery name, path of a scene file (.toml), or a recording (.rrd)")
    ],
    port: Annotated[int, typer.Option("--port", "-p", min=0, max=65535, help="port on 127.0.0.1; 0 takes a free one")] = 8080,
    frames: FramesOpt = None,
    cycles: CyclesOpt = None,
    accuracy: AccuracyOpt = None,
    reachable: ReachableOpt = False,
    live: Annotated[bool, typer.Option("--live", help="motion under forces: show it while it is found")] = False,
) -> None:
    """Show a scene in the browser at http://127.0.0.1:PORT until Ctrl-C, to look at and to edit; or play a recording."""
    from mechviz.outputs.viewer.app import serve, serve_while
    from mechviz.outputs.viewer.server import ViewerError

    with clear_errors(scene):
        if scene.endswith(".rrd"):
            from mechviz.outputs.rerun.reader import Recording

            if (frames, cycles, accuracy) != (None, None, None):
                fail("--frames, --cycles and --accuracy are for scenes: a recording is played as it is.")
            if live:
                fail("--live is for scenes: a recording is there at once.")
            try:
                serve(Recording(scene), port=port)
            except ViewerError as e:
                fail(str(e), 1)
            return
        loaded, folder = load_scene(scene, reachable=reachable), Path(scene).parent.resolve() if Path(scene).is_file() else None
        try:
            if live:
                if loaded.simulation is None:
                    fail(f"{loaded.name}: nothing is free, so that the whole motion is there at once. Leave out --live.")
                from mechviz.runs import run_scene, with_run

                grown = with_run(loaded, frames, cycles)
                serve_while(lambda observe: run_scene(grown, accuracy=accuracy, observe=observe), grown, port, folder)
            else:
                run = solve(loaded, frames, cycles, accuracy)
                warn_of_accuracy(run)
                serve(run, port=port, folder=folder)
        except ViewerError as e:
            fail(str(e), 1)


@app.command()
def export(
    scene: SceneArg,
    csv: Annotated[Path | None, typer.Option("--csv", help="write all results as one table (CSV)")] = None,
    parquet: Annotated[Path | None, typer.Option("--parquet", help="write all results as one table (Parquet)")] = None,
    stl: Annotated[Path | None, typer.Option("--stl", help="write one STL a link into this folder (millimetres)")] = None,
    glb: Annotated[Path | None, typer.Option("--glb", help="write the moving mechanism for viewers of glTF")] = None,
    arrows: Annotated[
        str | None, typer.Option("--arrows", metavar="NAME,NAME", help="in the GLB, such as reaction,drive; none: nothing")
    ] = None,
    threemf: Annotated[Path | None, typer.Option("--3mf", help="write all solids into one file to print (3MF)")] = None,
    dxf: Annotated[Path | None, typer.Option("--dxf", help="write the profiles of cams as arcs (DXF, millimetres)")] = None,
    svg: Annotated[Path | None, typer.Option("--svg", help="write the profiles of cams true to scale (SVG)")] = None,
    profile: Annotated[Path | None, typer.Option("--profile", help="write cams' points, normals, curvature (CSV)")] = None,
    every: Annotated[
        str | None, typer.Option("--every", metavar="TIME", help='tables: a row each such time, as "1 ms", read between frames')
    ] = None,
    frames: FramesOpt = None,
    cycles: CyclesOpt = None,
    accuracy: AccuracyOpt = None,
    reachable: ReachableOpt = False,
) -> None:
    """Write results as tables, the links as solids, the profiles of cams as drawings."""
    from mechviz.outputs.exports import tables as ex

    profiles = {kind: path for kind, path in (("dxf", dxf), ("svg", svg), ("csv", profile)) if path is not None}
    if csv is None and parquet is None and stl is None and glb is None and threemf is None and not profiles:
        fail("nothing to export: add --csv, --parquet, --glb, --3mf FILE or --stl FOLDER, of cams --dxf, --svg or --profile FILE.")
    families = _families(arrows) if glb is not None else None
    if glb is None and arrows is not None:
        fail("--arrows is for --glb FILE: name that too.")
    with clear_errors(scene):
        check_targets(scene, csv, parquet, glb, threemf, *profiles.values())
        loaded = load_scene(scene, reachable=reachable)
        step = quantity_of(loaded, every, "every", "time")
        run = solve(loaded, frames, cycles, accuracy)
        warn_of_accuracy(run)
        times = None if step is None else ex.even_times(run, step)

        def export_to(target: Path, write: Callable[..., Any], *more: Any, **options: Any) -> Any:
            with progress_bar(f"exporting {target.name}"):
                return write(run, target, *more, **options)

        solid = any(path is not None for path in (stl, glb, threemf))
        libraries = ["mechviz.picture.meshes", "trimesh"] if solid else []
        libraries += ["pyarrow.parquet"] if parquet is not None else []
        with interruptible(*libraries):
            if csv is not None:
                print(export_to(csv, ex.export_csv, times))
            if parquet is not None:
                print(export_to(parquet, ex.export_parquet, times))
            if stl is not None:
                for path in export_to(stl, ex.export_stl):
                    print(path)
            if glb is not None:
                from mechviz.outputs.exports.gltf import export_glb
                from mechviz.outputs.exports.gltf_marks import ARROWS

                print(export_to(glb, export_glb, arrows=ARROWS if families is None else families))
            if threemf is not None:
                from mechviz.outputs.exports.threemf import export_3mf

                print(export_to(threemf, export_3mf))
            for kind, path in profiles.items():
                from mechviz.outputs.exports.cam_profiles import export_profiles

                print(export_to(path, export_profiles, kind, lambda line: print(line, file=sys.stderr)))


def _families(text: str | None) -> tuple[str, ...] | None:
    """The families of arrows that an option names; None where nothing is said."""
    from mechviz.quantities.vectors import FAMILIES

    if text is None:
        return None
    names = tuple(name.strip() for name in text.split(",") if name.strip() not in ("", "none"))
    unknown = [name for name in names if name not in FAMILIES]
    if unknown:
        fail(f"--arrows {unknown[0]}: there are no such arrows. There are: {', '.join(FAMILIES)}.")
    return names


for command in (share, shot, film, laws, cams, hard):
    app.command()(command)
app.command("accuracy")(accuracy_command)
app.command("effects")(effects_command)


def main() -> None:
    """The `mechviz` command, once the signals are looked after."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # terminals of few letters: a name in them is no reason to stop
    code: str | int | None = 0
    try:
        try:
            app()
        except SystemExit as end:
            code = end.code
        sys.stdout.flush()
    except OSError as error:  # help, too, may go to a full disk
        code = no_output(error)
    sys.exit(code)


if __name__ == "__main__":
    main()
