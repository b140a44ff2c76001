"""Makes charts and drawings of the guides that need no browser.

python docs/make_charts.py [--to FOLDER] [NAME ...]
"""

from __future__ import annotations

import argparse
import re
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
from typer.testing import CliRunner

import mechviz
from mechcore.forces.cam_rating import placed_cams
from mechcore.laws.boundary_conditions import Condition
from mechcore.laws.program import Segment, program
from mechcore.laws.segment_laws import GivenAcceleration, GivenVelocity, LeastPeak, Polynomial, SegmentLaw, Spline, joined_table
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion
from mechviz.commands.main import app
from mechviz.figures import chart, save_chart

HERE = Path(__file__).parent / "images"
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


def segment_laws(path: Path) -> None:
    """Laws of a segment that stand in a scene as a table: one rise from rest to rest."""
    places, gains = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0), (0.0, 1.0, 1.0, -1.0, -1.0, 0.0)
    through = (Condition(0.3, 0.35), Condition(0.7, 0.75))
    laws: Mapping[str, SegmentLaw] = {
        "polynomial through two points": Polynomial(through),
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
    "segment-laws.svg": segment_laws,
    "motor-program.svg": motor_program,
    "equations.png": equations,
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
