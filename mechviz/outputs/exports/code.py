"""A mechanism as a self-contained C program: poses of its links with their derivatives, efforts of its drives."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Sequence
from pathlib import Path
from shlex import quote
from typing import Any

import numpy as np

from mechcore.branches.unwrapped import GivenLinkAngles
from mechcore.compiled.steps import check_forces_traceable, check_traceable, placed_state
from mechcore.compiled.symbols import HELPERS, Code, Symbol, Untraceable, rotation
from mechcore.effects.registry import effects_of
from mechcore.errors import Fault, MechanismError
from mechcore.forces.kinetostatics import solve_forces
from mechcore.motion.compiled import Compiled
from mechcore.motion.motion import Motion
from mechcore.motion.solve import compile_mechanism
from mechcore.spec.mechanism import joints_with_friction
from mechviz.files import replacing
from mechviz.quantities.items import joint_unit
from mechviz.quantities.vectors import point_name
from mechviz.runs import package_version
from mechviz.scene.scene import Scene

PROGRAM_TEXT = """\
/* {title}
   Written by mechviz {version}; a C99 compiler makes a program of it: cc -O2 {file} -o {program} -lm

   mechanism(q, v, a, out): out of positions q [rad or m], speeds v and accelerations a of the drives ({drives}).
   All is in m, rad, s, N and N m; the columns of `out` are named below. NaN: it cannot be put together there.
   Assembly modes are those of the scene.

   The program goes over the first drive, the others resting where they start: {program} [FROM TO COUNT [SPEED]] */

#include <stdio.h>
#include <stdlib.h>
{helpers}
#define DRIVES {count}
#define COLUMNS {columns}

const char *const names[COLUMNS] = {{
    {names},
}};
static const double p[] = {{{parameters}}};
static const double start[DRIVES + 1] = {{{start}}};

void mechanism(const double *q, const double *v, const double *a, double *out) {{
    (void)q, (void)v, (void)a, (void)p;
    {lines}
}}

int main(int argc, char **argv) {{
    const double from = argc > 2 ? atof(argv[1]) : {first!r}, to = argc > 2 ? atof(argv[2]) : {last!r};
    const long count = argc > 3 ? atol(argv[3]) : 37;
    double q[DRIVES + 1], v[DRIVES + 1] = {{0.0}}, a[DRIVES + 1] = {{0.0}}, out[COLUMNS];
    for (long d = 0; d <= DRIVES; d++) q[d] = start[d];
    v[0] = argc > 4 ? atof(argv[4]) : {speed!r};
    fputs({titles}, stdout);
    for (long i = 0; i < count; i++) {{
        q[0] = count > 1 ? from + (to - from) * (double)i / (double)(count - 1) : from;
        mechanism(q, v, a, out);
        printf("%.17g", q[0]);
        for (long k = 0; k < COLUMNS; k++) printf(",%.17g", out[k]);
        printf("\\n");
    }}
    return 0;
}}
"""


def export_code(scene: Scene, path: Path | str) -> tuple[Path, str | None]:
    """Write the program of a scene's mechanism; return its path, and why it does not contain the efforts of the drives, None if it
    contains them.

    Raises `MechanismError` if the mechanism cannot be written in C.
    """
    path = Path(path)
    text, missing = code_of(scene, path.stem)
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return path, missing


def code_of(scene: Scene, name: str) -> tuple[str, str | None]:
    """The C program that `export_code` writes, and why efforts are missing."""
    compiled = compile_mechanism(scene.mechanism, scene.accuracy)
    drives = compiled.mechanism.drives
    try:
        if scene.simulation is not None:
            raise Untraceable("forces decide its motion, which is no function of the drives")
        if not drives:
            raise Untraceable("no drive moves it")
        if compiled.singular_points is not None and compiled.singular_points.points:
            raise Untraceable("its assembly modes meet at change points, between which a program would have to choose")
        written = _SymbolicResults(compiled)
    except Untraceable as reason:
        why = f"C does not have this mechanism: {reason}."
        raise MechanismError(Fault("--c", why, "Export a table of its motion: --csv.")) from None
    law, low = drives[0].law, float(compiled.start[0])
    own = law(np.array([0.0, law.duration]))
    parameters: list[float] = []
    lines = written.lines(parameters)
    text = PROGRAM_TEXT.format(
        title=_comment(scene.title),
        version=package_version(),
        file=_comment(quote(f"{name}.c")),
        program=_comment(quote(f"./{name}")),
        drives=", ".join(d.joint for d in drives),
        helpers=HELPERS,
        count=len(drives),
        columns=len(written.columns),
        names=",\n    ".join(map(_literal, written.columns)),
        parameters=", ".join(_number(x) for x in parameters or [0.0]),
        start=", ".join(map(repr, [*map(float, compiled.start), 0.0])),
        lines="\n    ".join(lines),
        first=low,
        last=float(own[0][1]) if own[0][1] != own[0][0] else low,
        speed=float(own[1][0]),
        titles=_literal(_row([f"{drives[0].joint} [{written.unit}]", *written.columns])),
    )
    return text, written.missing


def _row(cells: Sequence[str]) -> str:
    """A line of a table (CSV)."""
    line = io.StringIO()
    csv.writer(line, lineterminator="\n").writerow(cells)
    return line.getvalue()


def _comment(text: str) -> str:
    """A text for a comment in C: on one line, because a backslash at the end of a line joins the next one."""
    return " ".join(text.split()).replace("*/", "* /").replace("/*", "/ *")


def _literal(text: str) -> str:
    """A text as a string in C, in which two question marks may begin a trigraph."""
    return json.dumps(text, ensure_ascii=False).replace("??", "?\\?")


def _number(x: float) -> str:
    """A number in C notation."""
    return repr(x) if math.isfinite(x) else "NAN" if math.isnan(x) else "INFINITY" if x > 0.0 else "-INFINITY"


class _SymbolicResults:
    """The mechanism evaluated with symbols: its ``columns`` by name with unit, why efforts are ``missing``, and the ``unit`` of the
    first drive's coordinate."""

    def __init__(self, compiled: Compiled):
        check_traceable(compiled.model)
        if compiled.model.multi_turn:
            raise Untraceable("wheels count the turns of a link, which a function of the drives does not know")
        self.compiled, self.code = compiled, Code()
        self.columns: dict[str, Any] = {}
        motion = self._motion()
        self.unit = joint_unit(motion, compiled.mechanism.drives[0].joint)
        model = compiled.model
        for k, link in enumerate(model.links[1:], 1):
            rotated: Any = motion.rotation(k)
            s = model.angles.rotation_class[k]
            self._put(link, (motion.origin(k), np.angle(rotated)), ("x [m]", "y [m]", "angle [rad]"))
            first = motion.origin(k, 1), motion.speeds.angular[s]
            self._put(link, first, ("x_velocity [m/s]", "y_velocity [m/s]", "angular_velocity [rad/s]"))
            second = motion.origin(k, 2), motion.accelerations.angular[s]
            self._put(link, second, ("x_acceleration [m/s^2]", "y_acceleration [m/s^2]", "angular_acceleration [rad/s^2]"))
        for link, point in compiled.mechanism.traced:
            k = model.index[link]
            self._put(point_name(link, point), (motion.of_point(k, model.points[k][point]),), ("x [m]", "y [m]"))
        self.missing = self._efforts(motion)

    def _efforts(self, motion: Motion) -> str | None:
        mechanism = self.compiled.mechanism
        if not (mechanism.effects or mechanism.loads):
            return None
        if "friction" in mechanism.effects and joints_with_friction(mechanism.joints):
            return "dry friction depends on the reactions"
        timed = [effect.name for effect in effects_of(mechanism) if "time" in effect.needs]
        if timed:
            return f"the program has no time, on which loads depend: {', '.join(timed)}"
        limited = [effect.name for effect in effects_of(mechanism) if effect.limited]
        if limited:
            return f"the range that {', '.join(limited)} must not leave is checked over a whole run"
        try:
            check_forces_traceable(motion.model)
            forces = solve_forces(motion)
            efforts = {"rad": "effort [N m]", "m": "effort [N]"}
            self.columns |= {f"{d.joint} {efforts[joint_unit(motion, d.joint)]}": forces.effort(d.joint) for d in mechanism.drives}
        except (TypeError, AttributeError, ValueError, IndexError, KeyError) as reason:  # `Untraceable` is a TypeError
            return str(reason)
        return None

    def _put(self, item: str, values: tuple[Any, ...], names: tuple[str, ...]) -> None:
        parts = [values[0].real, values[0].imag, *values[1:]]
        self.columns |= {f"{item} {name}": value for name, value in zip(names, parts, strict=True)}

    def _motion(self) -> Motion:
        model, code = self.compiled.model, self.code
        count = len(model.mechanism.drives)
        drives: Any = [tuple(code.input(f"{x}[{d}]") for x in "qva") for d in range(count)]
        delta: list[Any] = []
        for terms in model.angles.class_drives:
            turn: Any = 1 + 0j
            for d, sign in terms:
                turn = turn * rotation(sign * drives[d][0])
            delta.append(turn)
        modes: list[Any] = [Symbol(code, float(mode), 0.0) for mode in self.compiled.assembly.modes]
        state = placed_state(model, drives, delta, constants=self.compiled.assembly.constants, modes=modes)
        none: Any = None
        motion = Motion(model, none, drives, state, _NoAngles(self.compiled))
        vars(motion).update(drives=drives, shape=())
        return motion

    def lines(self, parameters: list[float]) -> list[str]:
        """Lines of the program that compute its results; their constants are appended to ``parameters``."""
        targets = [(f"out[{k}]", x) for k, x in enumerate(self.columns.values())]
        return self.code.written([(target, x.re if isinstance(x, Symbol) else float(x)) for target, x in targets], parameters)


class _NoAngles(GivenLinkAngles):
    """Link angles counted over turns, which a function of the drives cannot give: `link` raises `Untraceable`."""

    def __init__(self, compiled: Compiled):
        super().__init__(compiled.model, compiled.angles.start, compiled.angles.exact)

    def link(self, k: int) -> Any:
        raise Untraceable(f"a load asks how far {self.model.links[k]} has turned")
