"""``mechviz draw`` and ``walk``: machines that draw a picture or write a text, and walking mechanisms."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from mechviz.automata.pen_linkages import CrossSlides, Rods
from mechviz.automata.pen_motion import plotter_scene
from mechviz.automata.strokes import fit_to_sheet, joined_strokes, ordered_strokes, svg_strokes, text_strokes
from mechviz.automata.walking import walk_of, walking_scene
from mechviz.automata.writer import design_drawing_machine
from mechviz.commands.shared.loading import SceneArg, SetOpt, clear_errors, load_scene, quantity, quantity_option
from mechviz.commands.shared.messages import check_suffix, check_targets, fail, interruptible, say
from mechviz.files import check_target, replacing
from mechviz.progress import progress_bar
from mechviz.scene.faults import did_you_mean
from mechviz.scene.scene import Scene, dump
from mechviz.scene.units import Units

_UNITS = Units(length="mm", angle="deg")


def draw(
    picture: Annotated[Path | None, typer.Argument(metavar="[PICTURE.svg]", help="its paths and shapes are drawn")] = None,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="scene of the machine to write (.toml)")] = None,
    text: Annotated[str | None, typer.Option("--text", metavar="WORDS", help="write this instead of drawing a picture")] = None,
    font: Annotated[
        str, typer.Option("--font", help="of --text and of texts in a picture: scripts, cursive, rowmans, futural ...")
    ] = "scripts",
    size: Annotated[str, typer.Option("--size", help="larger side of the drawing")] = "100 mm",
    error: Annotated[str, typer.Option("--error", help="how far the drawn line may be off its strokes")] = "0.1 mm",
    speed: Annotated[str, typer.Option("--speed", help="of the shaft: the drawing takes one turn")] = "1 rpm",
    pressure_angle: Annotated[str, typer.Option("--pressure-angle", help="largest one of the cams")] = "40 deg",
    slides: Annotated[bool, typer.Option("--slides", help="two crossed slides lead the pen, instead of two rods")] = False,
    program: Annotated[
        Path | None, typer.Option("--program", metavar="FILE.toml", help="also, or only: a program of three axes for motors")
    ] = None,
) -> None:
    """Turn an SVG drawing, or words, into a machine that draws it: three cams, levers, rods or slides, and a pen.

    Two cams lead the pen, a third one lifts it between strokes. The pen goes at an even speed, slower at corners, with a bounded
    jerk. The cams are as small as the pressure angle and undercut allow. The machine is run, and the distance of its line from the
    strokes stated. Beside the scene lie the tables of its cams; export their profiles with: mechviz export FILE.toml --dxf FILE.

    Try: mechviz draw --text Ada -o ada.toml, then mechviz view ada.toml
    """
    if (picture is None) == (text is None):
        fail("Give a picture, or --text WORDS.")
    if output is None and program is None:
        fail("Where to? Give -o FILE.toml for the machine, or --program FILE.toml.")
    if slides and output is None:
        fail("--slides is a choice of the machine: give -o FILE.toml, too.")
    for path in (output, program):
        if path is not None and path.suffix != ".toml":
            fail(f"'{path}' does not end in .toml, as scenes do.")
    width, off = quantity(_UNITS, size, "size", "length"), quantity(_UNITS, error, "error", "length")
    rate, limit = quantity(_UNITS, speed, "speed", "angular speed"), quantity(_UNITS, pressure_angle, "pressure-angle", "angle")
    for value, option, words in ((width, "size", size), (off, "error", error), (rate, "speed", speed)):
        if not value > 0.0:
            fail(f"--{option}: {words} is not above zero.")
    if not 0.0 < limit < math.radians(80.0):
        fail(f"--pressure-angle: {pressure_angle} is not between 0 and 80 deg.")
    name = text if text is not None else picture.stem if picture is not None else ""
    with clear_errors(str(picture or "")):
        check_targets(str(picture or ""), output, program)
        with interruptible("matplotlib.path"), progress_bar("drawing") as bar:
            bar.stage("reading strokes")
            if text is not None:
                strokes = joined_strokes(fit_to_sheet(text_strokes(text, font), width), 0.5 * off)
            else:
                strokes = ordered_strokes(fit_to_sheet(svg_strokes(str(picture), font), width), 0.5 * off)
            stem = (output or program or Path("writer")).stem
            title = f"A machine that writes “{name}”" if text is not None else f"A machine that draws “{name}”"
            machine = design_drawing_machine(
                strokes, off, title=title, name=stem, speed=rate, pressure_limit=limit,
                linkage=CrossSlides if slides else Rods, levers=output is not None, progress=bar.stage,
            )  # fmt: skip
        motion = machine.motion
        points, ink = sum(map(len, strokes)), sum(float(np.abs(np.diff(s)).sum()) for s in strokes)
        print(f"{len(strokes)} strokes, {points} points, {_mm(ink)} of line on {_mm(width)}")
        print(f"drawn within {_mm(machine.error)} of its strokes; {100.0 * motion.even:.0f} % of the line at an even speed")
        print(f"jerk at most {1e3 * motion.jerk * rate**3:.3g} mm/s^3 at {speed}")
        for key, pressure, radius, sharp in zip("XYZ", machine.pressure_angles, machine.radii, machine.least_radii, strict=False):
            words = f"radius {_mm(radius)}, pressure angle up to {math.degrees(pressure):.3g} deg, least convex radius"
            print(f"cam {key}: {words} {_mm(sharp)}")
        if machine.ratio > 1.0:
            print(
                f"levers {machine.ratio:g} to 1: a cam that is off by 0.01 mm moves the pen by about {0.01 * machine.ratio:.2g} mm"
            )
        if output is not None and machine.scene is not None:
            _write(machine.scene, output)
        if program is not None:
            _write(plotter_scene(motion, 2.0 * math.pi / rate, title=f"Axes that draw “{name}”", name=program.stem), program)


def _mm(length: float) -> str:
    return f"{1e3 * length:.3g} mm"


def _write(scene: Scene, path: Path) -> None:
    """Write a scene and its tables; existing files are replaced."""
    for name, data in scene.files.items():
        place = path.parent / name
        check_target(place)
        with replacing(place) as temporary:
            temporary.write_bytes(data)
    dump(scene, path, keep=True)
    say(f"{path} written, with {' and '.join(scene.files)}.")


def walk(
    scene: SceneArg,
    foot: Annotated[list[str], typer.Option("--foot", metavar="LINK.POINT", help="a point that steps on the ground; again")],
    output: Annotated[Path | None, typer.Option("--output", "-o", help="scene of the walk to write (.toml)")] = None,
    touch: Annotated[str, typer.Option("--touch", help="a foot that is not higher than this touches the ground")] = "1 mm",
    values: SetOpt = None,
) -> None:
    """Let a mechanism walk: its fixed link becomes the body, and the foot that is lowest stands still on the ground.

    It prints how far the body advances in a cycle, how far it moves up and down, how long each foot stands, and how far feet slip
    that touch the ground while another one stands. The body keeps its attitude; whether it would tip over is not computed. In the
    scene that is written two slides guide the body along the ground.

    Try: mechviz walk walking-toy --foot foot.H --foot "foot 2.H" -o walk.toml, then mechviz view walk.toml
    """
    with clear_errors(scene):
        check_suffix(output, ".toml")
        if output is not None:
            check_targets(scene, output)
        loaded = load_scene(scene, values, targets=(output,))
        feet = [_foot(loaded, text) for text in foot]
        gait = walk_of(loaded, feet, quantity_option(loaded, touch, "touch", "length") or 0.0)
        duration = float(gait.time[-1] - gait.time[0])
        text = loaded.units.text
        print(f"a cycle of {duration:.4g} s leads {text(gait.advance, 'm', 4)}: {text(gait.advance / duration, 'm/s', 4)}")
        print(f"the body goes up and down by {text(gait.bounce, 'm', 3)}")
        for name, share, slip in zip(gait.feet, gait.shares, gait.slips, strict=True):
            print(f"{name} stands for {100.0 * share:.3g} % of the cycle, slips {text(slip, 'm', 3)} in it")
        if output is not None:
            dump(walking_scene(loaded, gait, output.stem), output)
            say(f"{output} written.")


def _foot(scene: Scene, text: str) -> tuple[str, str]:
    known = {f"{link.name}.{point}": (link.name, point) for link in scene.mechanism.links for point in link.points}
    if text not in known:
        fail(f"--foot: there is no point '{text}'. {did_you_mean(text, known, what='Points')}")
    return known[text]
