"""Makes charts and drawings of the guides that need no browser.

python docs/make_charts.py [--to FOLDER] [NAME ...]
"""

from __future__ import annotations

import argparse
import re
import tempfile
from cmath import rect
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
from typer.testing import CliRunner

import mechviz
from mechcore.cams import Follower, Requirement, Translating, best_offset, least_base
from mechcore.forces.cam_rating import placed_cams
from mechcore.laws.boundary_conditions import BoundaryCondition, measured_table
from mechcore.laws.catalogue import RISES, rise
from mechcore.laws.factors import peak
from mechcore.laws.program import Segment, program
from mechcore.laws.segment_laws import (
    BoundaryPolynomial,
    GivenAcceleration,
    GivenVelocity,
    LeastPeak,
    SegmentLaw,
    Spline,
    joined_table,
)
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion
from mechcore.reduction.bodies import single_resultant
from mechcore.reduction.inverse import inertia_from_two_swings, rates_from_accelerations
from mechviz.commands.main import app
from mechviz.figures import chart, save_chart
from mechviz.runs import run_scene
from mechviz.studies.equations import equilibrium_at

HERE = Path(__file__).parent / "images"
SIZED_FOR = 25  # [deg] pressure angle of a least offset
ACCELERATION_SCALE, FORCE_SCALE = 0.013, 0.0022  # [m] for 1 m/s² and 1 N in a drawing
STEEPEST = (20, 30, 40)  # [deg] pressure angles of least cams
SCENE, MOMENT = "kinetostatic-four-bar", "60 deg"
COUNT = 361  # places of a curve


def stem(path: Path) -> None:
    """The diagram of a follower's stem, where its moment is largest."""
    mechviz.run("cam-friction").shot(path, at=0.0708, size=(900, 560))


def guide_ends(path: Path) -> None:
    """The bearing forces at both ends of a guide."""
    ends = ("joint.S.bearing_force_behind", "joint.S.bearing_force_ahead")
    mechviz.run("cam-friction").plot(ends, "link.follower.bending_moment", path=path)


def least_cams(path: Path) -> None:
    """The least cams of one lift for several pressure angles."""
    with chart(6.2, 5.0) as figure:
        axes = figure.subplots()
        for steepest in STEEPEST:
            profile = {"base": "least", "pressure_limit": steepest}
            changes = {("joints", "K", "profile", key): value for key, value in profile.items()}
            mechanism = mechviz.load("cam-roller").changed(changes).mechanism
            (placed,) = placed_cams(solve_motion(compile_mechanism(mechanism), default_times(mechanism, 36, 1)))
            curve = 1e3 * placed.cam.at(np.linspace(0.0, 2.0 * np.pi, COUNT)).working
            axes.plot(curve.real, curve.imag, label=f"{steepest}°: base circle {1e3 * placed.base:.3g} mm")
        axes.plot(0.0, 0.0, "k+")
        axes.set(aspect="equal", xlabel="mm", title="Least cams by pressure angle")
        figure.legend(loc="outside lower center", ncols=len(STEEPEST))
        save_chart(figure, path)


def least_offset_and_roller(path: Path) -> None:
    """The least base circle over the offset of a follower, and the Hertz pressure over the radius of its roller."""
    scene = mechviz.load("cam-roller")
    (joint,) = (j for j in scene.mechanism.joints if j.name == "K")
    want = Requirement(pressure_rise=np.radians(SIZED_FOR), pressure_fall=np.radians(SIZED_FOR))
    offsets = 1e-3 * np.linspace(-12.0, 12.0, 97)
    bases = [least_base(joint.lift, Follower(Translating(offset=e), joint.face), want).base for e in offsets]
    best = best_offset(joint.lift, joint.face, want)
    radii = np.array([4.0, 4.5, 5.0, 6.0, 7.0, 8.0, 10.0, 12.0, 15.0, 20.0])
    roller = ("joints", "K", "follower", "roller")
    pressures = [mechviz.run(scene.changed({roller: r}))["cam.K.Hertz_pressure"].max() for r in radii]
    least = 1e3 * next(
        j.face.radius for j in mechviz.run(scene.changed({roller: "least"})).motion.mechanism.joints if j.name == "K"
    )
    limit = joint.rating.limit / 1e6
    with chart(8.2, 3.4) as figure:
        left, right = figure.subplots(1, 2)
        left.plot(1e3 * offsets, 1e3 * np.array(bases))
        left.plot(1e3 * best.offset, 1e3 * best.base, "o", label=f"best: {1e3 * best.offset:.3g} mm, base {1e3 * best.base:.3g} mm")
        left.set(xlabel="offset [mm]", ylabel="least base circle [mm]", title=f"Pressure angles up to {SIZED_FOR}°")
        right.plot(radii, pressures)
        right.axhline(limit, ls="--", color="0.5")
        right.plot(least, limit, "o", label=f"least roller for {limit:.0f} MPa: {least:.3g} mm")
        right.set(xlabel="roller [mm]", ylabel="largest Hertz pressure [MPa]", title="Roller on a base circle of 40 mm")
        for axes in (left, right):
            axes.legend(loc="upper center" if axes is left else "upper right")
        save_chart(figure, path)


def triple_harmonics(path: Path) -> None:
    """The three laws that the literature calls triple harmonic: velocity, acceleration and jerk of one rise."""
    names = [name for name in RISES if name.startswith("triple-harmonic")]
    x = np.linspace(0.0, 1.0, COUNT)
    with chart(9.0, 3.4) as figure:
        panels = figure.subplots(1, 3)
        for name in names:
            law = rise(name)
            peaks = [abs(peak(law, order).value) for order in (1, 2, 3)]
            words = ", ".join(f"C{letter} {value:.4g}" for letter, value in zip("vaj", peaks, strict=True))
            for panel, values in zip(panels, law(x, 3, "left")[1:], strict=True):
                panel.plot(x, values, label=f"{name.removeprefix('triple-harmonic-').replace('-', ' ')}: {words}")
        for panel, title in zip(panels, ("Velocity", "Acceleration", "Jerk"), strict=True):
            panel.set(title=title, xlim=(0.0, 1.0), xlabel="part of the rise")
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=1)
        save_chart(figure, path)


def lift_table(path: Path) -> None:
    """A measured table of lift: through its rows, from rest to rest, and within a tolerance; lift, velocity and acceleration."""
    angles = np.arange(0.0, 121.0, 10.0)
    rows = [0.0, 0.06, 0.46, 1.44, 3.10, 5.51, 8.49, 11.82, 14.93, 17.44, 19.06, 19.83, 20.0]
    curves = {
        "through its rows": measured_table(angles, rows)[0],
        "rest = true": measured_table(angles, rows, rest=True)[0],
        'tolerance = "0.05 mm"': measured_table(angles, rows, 0.05)[0],
    }
    x = np.linspace(0.0, 120.0, COUNT)
    with chart(9.0, 3.4) as figure:
        panels = figure.subplots(1, 3)
        panels[0].plot(angles, rows, "k.", label="rows")
        for name, law in curves.items():
            for panel, values in zip(panels, law(x, 2, "left"), strict=True):
                panel.plot(x, values, label=name)
        for panel, title in zip(panels, ("Lift [mm]", "Velocity [mm/°]", "Acceleration [mm/°²]"), strict=True):
            panel.set(title=title, xlim=(0.0, 120.0), xlabel="angle of the cam [°]")
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
        save_chart(figure, path)


def segment_laws(path: Path) -> None:
    """Laws of a segment that stand in a scene as a table: one rise from rest to rest."""
    places, gains = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0), (0.0, 1.0, 1.0, -1.0, -1.0, 0.0)
    through = (BoundaryCondition(0.3, 0.35), BoundaryCondition(0.7, 0.75))
    laws: Mapping[str, SegmentLaw] = {
        "polynomial through two points": BoundaryPolynomial(through),
        "spline through the same": Spline(through),
        "given acceleration, scaled": GivenAcceleration(joined_table(places, gains), scaled=True),
        "given velocity": GivenVelocity(joined_table((0.0, 0.25, 0.75, 1.0), (0.0, 1.0, 1.0, 0.0))),
        "least acceleration": LeastPeak("acceleration"),
        "least jerk": LeastPeak("jerk"),
    }
    x = np.linspace(0.0, 1.0, COUNT)
    with chart(7.0, 6.0) as figure:
        panels = figure.subplots(3, sharex=True)
        for name, law in laws.items():
            curve = program([Segment(1.0, 1.0, law)], repeats=False)
            for panel, values in zip(panels, curve(x, 2, "left"), strict=True):
                panel.plot(x, values, label=name)
        for panel, title in zip(panels, ("Position", "Velocity", "Acceleration"), strict=True):
            panel.set(title=title, xlim=(0.0, 1.0))
        panels[-1].set(xlabel="part of the segment")
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
        save_chart(figure, path)


def motor_program(path: Path) -> None:
    """The program of three axes that writes a word."""
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "axes.toml"
        _output("draw", "--text", "Ada", "--program", str(target))
        axes = tuple(f"joint.{axis}.displacement" for axis in "XYZ")
        speeds = tuple(f"joint.{axis}.velocity" for axis in "XY")
        mechviz.run(mechviz.load(str(target)), frames=900).plot(axes, speeds, path=path, against="time")


def equations(path: Path) -> None:
    """The LaTeX of the equations of a scene's groups, set."""
    text = _output("forces", SCENE, "--equations", "--latex", "--at", MOMENT)
    rows = [row for row in (line.strip() for line in text.splitlines()) if row and not row.startswith(("%", r"\begin", r"\end"))]
    with chart(4.6, 0.29 * len(rows)) as figure:
        for k, row in enumerate(rows):
            head = re.fullmatch(r"\\paragraph\{(.*)\}", row)
            left = 0.02 if head else 0.06
            shown = head[1] if head else f"${_plain(row)}$"
            figure.text(left, 1.0 - (k + 0.7) / len(rows), shown, fontsize=10, weight="bold" if head else "normal")
        save_chart(figure, path)


def all_at_once(path: Path) -> None:
    """All equilibrium equations of a mechanism as one linear system: its cells, the known loads, and what it gives."""
    run = run_scene(mechviz.load(SCENE))
    (drive,) = run.motion.mechanism.drives
    equilibrium, frame = equilibrium_at(run, np.radians(float(MOMENT.split()[0])) / drive.law.speed)
    matrix, loads, values = equilibrium.matrix[frame], equilibrium.loads[frame], equilibrium.at_once()[frame]
    links = list(run.motion.model.links)[1:]
    rows = [f"{link}: {what}" for link in links for what in ("$F_x$", "$F_y$", "$M_O$")]
    names = [re.sub(r"_(\w+)", r"$_{\1}$", u.name) for u in equilibrium.unknowns]
    with chart(8.6, 3.6) as figure:
        axes = figure.subplots()
        axes.axis("off")
        cells = [
            [f"{v:.3g}" if abs(v) > 1e-12 else "" for v in row] + [f"{0.0 - load:.4g}"]
            for row, load in zip(matrix, loads, strict=True)
        ]
        cells.append([*(f"{v:.4g}" for v in values), ""])
        table = axes.table(cells, rowLabels=[*rows, "gives"], colLabels=[*names, "= − loads"], loc="center", cellLoc="center")
        table.auto_set_font_size(False)
        table.set_fontsize(8)
        for (row, _), cell in table.get_celld().items():
            cell.set_linewidth(0.3)
            if row == 0 or row > len(rows):
                cell.set_facecolor("0.93")
        save_chart(figure, path)


def force_task(path: Path) -> None:
    """The worked task of the lecture: a link by the accelerations of two of its points, its inertia force and where that acts."""
    a, b = -0.5 + 0j, 0.366 - 0.5j
    of_a, of_b = (rect(size, np.radians(angle)) for size, angle in ((20.0, 50.0), (30.0, 140.0)))
    rates, mass, inertia = rates_from_accelerations(a, b, of_a, of_b), 10.0, 2.0
    force, moment = -mass * rates.at(0j), -inertia * rates.alpha
    at, _ = single_resultant((force.real, force.imag), moment)
    foot = complex(*at)
    with chart(6.0, 4.6) as figure:
        axes = figure.subplots()
        axes.plot([a.real, b.real], [a.imag, b.imag], color="0.75", lw=9, solid_capstyle="round", zorder=0)
        axes.plot([a.real, 0.0, b.real], [a.imag, 0.0, b.imag], color="0.85", lw=6, zorder=0)
        along = force / abs(force)
        ends = [foot - 0.75 * along, foot + 0.75 * along]
        axes.plot([z.real for z in ends], [z.imag for z in ends], "k-.", lw=0.8)
        for place, vector, scale, colour, words, beside in (
            (a, of_a, ACCELERATION_SCALE, "C0", "$a_A$ = 20 m/s²", (6, -2)),
            (b, of_b, ACCELERATION_SCALE, "C0", "$a_B$ = 30 m/s²", (6, 0)),
            (0j, rates.at(0j), ACCELERATION_SCALE, "C1", f"$a_S$ = {abs(rates.at(0j)):.4g} m/s²", (8, -6)),
            (foot, force, FORCE_SCALE, "C3", f"$F_i$ = {abs(force):.4g} N", (-78, -4)),
        ):
            tip = place + scale * vector
            arrow = {"arrowstyle": "-|>", "color": colour, "lw": 1.8}
            axes.annotate("", (tip.real, tip.imag), (place.real, place.imag), arrowprops=arrow)
            axes.annotate(words, (tip.real, tip.imag), beside, textcoords="offset points", color=colour)
        for name, z, up in (("A", a, 5), ("B", b, -11), ("S", 0j, -11), ("Q", rates.pole, 5)):
            axes.plot(z.real, z.imag, "ko", ms=4)
            axes.annotate(name, (z.real, z.imag), (-13, up), textcoords="offset points")
        axes.set(
            aspect="equal",
            xlabel="m",
            title=f"ω² = {rates.omega_squared:.4f} rad²/s², α = {rates.alpha:.4f} rad/s², $M_i$ = {moment:.4g} N m",
        )
        axes.margins(0.12)
        save_chart(figure, path)


def evolute(path: Path) -> None:
    """The evolute of an ellipse that a rod between two guides draws, with a circle of curvature."""
    changes = {("centrodes",): [], ("trace",): ["rod.P"], ("evolutes",): ["rod.P"], ("links", "rod", "points", "P"): [22, 0]}
    mechviz.run(mechviz.load("cardan-circles").changed(changes)).shot(path, angle=138.0, size=(900, 620))


def cam_by_inversion(path: Path) -> None:
    """The synthesis of a disc cam by inversion, without forces."""
    scene = mechviz.load("cam-by-inversion").changed({("effects",): [], ("loads",): {}})
    mechviz.run(scene).shot(path, angle=36.0, size=(900, 620))


def swing(path: Path) -> None:
    """Two periods of a rod about two axes, and its period about every other one: the two decide its inertia and its centre."""
    mass, apart, periods, gravity = 1.5, 0.55, (1.3415, 1.2113), 9.81
    first, inertia = inertia_from_two_swings(mass, apart, periods)
    distance = np.linspace(0.06, 0.5, COUNT)
    with chart(5.6, 3.6) as figure:
        axes = figure.subplots()
        period = 2.0 * np.pi * np.sqrt((inertia + mass * distance**2) / (mass * gravity * distance))
        axes.plot(1e3 * distance, period, label=f"J = {inertia:.4g} kg m² about S, m = {mass} kg")
        for name, at, measured in zip("AB", (first, apart - first), periods, strict=True):
            axes.plot(1e3 * at, measured, "o", label=f"axis {name}: {measured} s, {1e3 * at:.4g} mm from S")
        axes.set(xlabel="distance of the axis from S [mm]", ylabel="period [s]", title="Inertia from the times of two swings")
        figure.legend(loc="outside lower center", ncols=1)
        save_chart(figure, path)


def _plain(row: str) -> str:
    """A row of an aligned formula without what matplotlib does not set."""
    return re.sub(r"\\text\{(\w+)\}", r"\\mathrm{\1}", row.removesuffix(r"\\").replace(r"\textstyle", "").replace("&", ""))


def _output(*arguments: str) -> str:
    done = CliRunner().invoke(app, arguments)
    if done.exit_code:
        raise SystemExit(done.output)
    return done.stdout


CHARTS: Mapping[str, Callable[[Path], None]] = {
    "stem.svg": stem,
    "guide-ends.svg": guide_ends,
    "least-cams.svg": least_cams,
    "least-offset-roller.svg": least_offset_and_roller,
    "segment-laws.svg": segment_laws,
    "triple-harmonics.svg": triple_harmonics,
    "lift-table.svg": lift_table,
    "motor-program.svg": motor_program,
    "equations.png": equations,
    "all-at-once.svg": all_at_once,
    "force-task.svg": force_task,
    "evolute.svg": evolute,
    "cam-by-inversion.svg": cam_by_inversion,
    "swing.svg": swing,
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(CHARTS)} [default: all]")
    parser.add_argument("--to", type=Path, default=HERE, metavar="FOLDER")
    chosen = parser.parse_args()
    chosen.to.mkdir(parents=True, exist_ok=True)
    for name in chosen.names or CHARTS:
        CHARTS[name](chosen.to / name)
        print(chosen.to / name, flush=True)


if __name__ == "__main__":
    main()
