"""What runs the steps of a scene's mechanism, numpy or a compiled program, and what that costs: for people."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mechcore.compiled.motion import PAYS, Executor, written
from mechcore.compiled.toolchain import cached, compiler, required_compiler
from mechcore.dynamics.equations.program import missing_in_c, written_source
from mechcore.dynamics.integration.windows import MANY
from mechcore.motion.compiled import Compiled
from mechcore.motion.solve import compile_mechanism
from mechviz.scene.faults import in_scene_words

if TYPE_CHECKING:
    from mechviz.scene.scene import Scene

START, EACH = 0.3, 5e-4  # [s] that compiling takes, and each line of it


@in_scene_words
def executor_lines(scene: Scene, executor: Executor) -> list[str]:
    """What runs each stage of a scene, in lines for the plan. Raises `MechanismError` where C is asked for without a compiler."""
    if executor == "numpy":
        return ["executor", "  numpy, as asked for"]
    if executor == "c":
        required_compiler()
    if compiler() is None:
        return ["executor", "  numpy: there is no C compiler (pip install 'mechviz[fast]' brings one)"]
    compiled = compile_mechanism(scene.mechanism)
    lines = ["executor", f"  {'positions and rates':<21}{_of_motion(compiled, executor, scene.frames + 1)}"]
    if scene.simulation is not None:
        lines.append(f"  {'motion under forces':<21}{_of_simulation(compiled, executor)}")
    return lines


@in_scene_words
def missing_lines(scene: Scene) -> list[str]:
    """What of a scene C does not have, so that numpy runs it."""
    compiled = compile_mechanism(scene.mechanism)
    found = {"positions and rates": _not_written(compiled)}
    if scene.simulation is not None:
        found["the motion under forces"] = missing_in_c(compiled)
    return [f"numpy runs {what}: {why}." for what, why in found.items() if why is not None]


def _not_written(compiled: Compiled) -> str | None:
    program = compiled.model.once(written)
    if isinstance(program, str):
        return program
    return (
        "frames near change points are interpolated"
        if compiled.singular_points is not None and compiled.singular_points.found
        else None
    )


def _of_motion(compiled: Compiled, executor: Executor, frames: int) -> str:
    missing, program = _not_written(compiled), compiled.model.once(written)
    if missing is not None or isinstance(program, str):
        return f"numpy: {missing}"
    if not program.lines:
        return "numpy: nothing is left to solve"
    if executor == "auto" and frames < PAYS:
        return f"numpy: {frames:,} frames; compiling {program.lines:,} lines of C pays from about {PAYS:,} on"
    return f"C, {_price(program.source, program.lines)}"


def _of_simulation(compiled: Compiled, executor: Executor) -> str:
    missing = missing_in_c(compiled)
    if missing is not None:
        return f"numpy: {missing}"
    price = _price(*written_source(compiled))
    return f"C, {price}" if executor == "c" else f"numpy; C where more than {MANY} windows are left to integrate, {price}"


def _price(source: str, lines: int) -> str:
    kept = "kept from before" if cached(source) else f"to be compiled once, in about {START + EACH * lines:.1f} s"
    return f"{lines:,} lines, {kept}"
