"""The command line. Data goes to stdout, messages to stderr; invalid input gives exit code 2. The module of a command is imported
when the command is called.

``mechviz scenes`` is in this module, so that it lists the gallery without importing numpy and the modules that read scenes.
"""

from __future__ import annotations

import gc
import io
import math
import os
import sys
from collections.abc import Callable
from functools import wraps
from textwrap import fill, shorten
from typing import Annotated, Any, get_args, get_type_hints

import typer
from typer.core import TyperGroup
from typer.main import get_command

from mechviz.commands.shared.messages import Stdout, errors_as_messages, fail, load_module, report_stdout_failure, report_unforeseen
from mechviz.files import LARGE_VARIABLE
from mechviz.scene.folder import TOPICS, gallery

COMMANDS = {
    "main": {
        "scenes": "List the gallery by topic, or the scenes in which words stand: one line a scene.",
    },
    "scene": {
        "show": "Print a scene's TOML text: a starting point for your own.",
        "schema": "Print the JSON Schema of scene files, for editors.",
        "check": "Validate a scene and print its mobility, groups, loops, assembly modes and reachable range.",
    },
    "forces": {
        "plan": "Print what will be computed for a scene, what not, and why; with --cost what each stage and effect costs.",
        "forces": "Print who supplies power and who absorbs it: every force with its classes and its work over the run.",
        "cams": "Print the limits, contact forces and stresses of a scene's cams, and the least springs that keep contact.",
    },
    "recording": {
        "record": "Solve a scene and write a rerun recording (.rrd).",
        "inspect": "Print what a recording holds, without a viewer: links, joints, peaks of forces and torque, health, events.",
    },
    "studies": {
        "balance": "Balance the shaking force of a four-bar or slider-crank by counterweights; show it before and after.",
        "graph": "Print the contour graph of a scene, links as vertices, joints as edges, with its independent loops; -o draws it.",
        "vibrations": "Find the equilibrium of a scene with free joints, and its natural frequencies, damping ratios and modes.",
    },
    "automata": {
        "draw": "Turn an SVG drawing, or words, into a machine that draws it: three cams, levers, rods or slides, and a pen.",
        "walk": "Let a mechanism walk: its fixed link becomes the body, and the foot that is lowest stands still on the ground.",
    },
    "designs": {
        "sweep": "Compute quantities of many designs: a grid, lists or samples of a scene's parameters, one row for each design.",
        "study": "Draw a study: the response to a parameter, contours, parallel coordinates or a scatter matrix.",
        "sensitivity": "Print how quantities depend on parameters, ranked by what one percent of each does: exact derivatives, no "
        "trial runs.",
        "tolerance": "Print what tolerances do to quantities: worst case, root sum of squares and samples, and what each tolerance "
        "contributes.",
        "optimise": "Find the design that a scene's goal asks for, and write it as a scene.",
    },
    "synthesis": {
        "synthesise": "Find mechanisms for a task: a function, positions of a body, a path, a stroke, a dwell; or list "
        "kinematic chains.",
    },
    "view": {
        "view": "Show a scene in the browser at http://127.0.0.1:PORT until Ctrl-C, to look at and to edit; or play a recording.",
    },
    "export": {
        "export": "Write results as tables, the links as solids, the profiles of cams as drawings.",
        "share": "Write one HTML file that plays a mechanism in any browser, with plots and events, without a server or a network.",
        "shot": "Write a picture of a mechanism at a time, frame or drive angle, without a display.",
        "film": "Write a film of a mechanism over its run, GIF or MP4; needs Chromium, but no display.",
    },
    "lectures": {
        "laws": "Print motion laws with their peak factors Cv, Ca, Cj and the steps of their derivatives; "
        "plot them over each other.",
        "solve": "Solve an inverse task of a lecture, without a scene.",
    },
    "accuracy": {
        "hard": "Run the suite of hard cases: what happens there, what is expected, what is found; exit code 1 where one fails.",
        "accuracy": "Measure what accuracy costs: error against time for a series of values of each setting.",
        "effects": "Measure what each effect and load does to the answer, beside its price in time; suggest those worth having.",
    },
}
"""By module: its commands in the order of the help, each with the first sentence of its help. A command is the function of that
name."""
LINE = 100  # characters
TRACEBACK = "--traceback"
"""Option, anywhere on the command line: shows the traceback of a fault of the program."""
ANY_SIZE = "--large"
"""Option, anywhere on the command line: lifts the limits of `mechviz.scene.limits`."""
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Environment variables for the number of threads of numpy's matrix products, which numpy reads when it is imported. They are set
to one: starting threads takes as long as importing numpy, the matrices of mechanisms are too small to benefit, and times are
measured on one thread. If the user sets one of them, none is changed."""


class Commands(TyperGroup):
    """A group of commands whose modules are loaded when a command is called."""

    def resolve_command(self, ctx: Any, args: list[str]) -> tuple[str | None, Any, list[str]]:
        """Name, command and remaining arguments of a command line; loads the command."""
        name, listed, rest = super().resolve_command(ctx, args)
        return name, listed and load_command(str(name)), rest


def load_command(name: str) -> Any:
    """The command with a name, loaded from its module."""
    if not any(variable in os.environ for variable in THREADS):
        os.environ.update(dict.fromkeys(THREADS, "1"))
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")  # the search for plugins takes longer than reading a scene
    module = next(module for module, commands in COMMANDS.items() if name in commands)
    function = getattr(load_module(f"mechviz.commands.{module}"), name)
    if isinstance(function, typer.Typer):  # a group of commands
        for own in function.registered_commands:
            own.callback = _with_finite_numbers(own.callback) if own.callback else None
        return get_command(function)
    single = typer.Typer(add_completion=False, rich_markup_mode=None, pretty_exceptions_enable=False)
    single.command(name)(_with_finite_numbers(function))
    return get_command(single)


def scenes(
    words: Annotated[list[str] | None, typer.Argument(metavar="[WORD]...", help="only scenes about all of these")] = None,
    lessons: Annotated[bool, typer.Option("--lessons", help="what each scene teaches, in full")] = False,
    names: Annotated[bool, typer.Option("--names", help="bare names only, one a line, for scripts")] = False,
) -> None:
    """List the gallery by topic, or the scenes in which words stand: one line a scene.

    Words are looked for in names, titles, topics and lessons: mechviz scenes cam spring
    """
    entries = [entry for entry in gallery() if entry.about(words or ())]
    if not entries:
        fail(f"no scene of the gallery is about {' and '.join(words or ())}. Use fewer or other words, or none for all.")
    with errors_as_messages():
        if names:
            print("\n".join(entry.name for entry in entries))
            return
        width = max(len(entry.name) for entry in entries)
        for topic in TOPICS:
            own = [entry for entry in entries if entry.topic == topic]
            if own:
                print(topic)
            for entry in own:
                if lessons:
                    print(f"  {entry.name}")
                    print(fill(entry.learning_goal, LINE, initial_indent="      ", subsequent_indent="      "))
                else:
                    print(f"  {entry.name:<{width}}  {shorten(entry.title, LINE - width - 4, placeholder=' …')}")


def _with_finite_numbers(function: Callable[..., None]) -> Callable[..., None]:
    """A command that rejects options with infinite or NaN values, by name."""

    @wraps(function)
    def checked(**given: object) -> None:
        for name, value in given.items():
            if isinstance(value, float) and not math.isfinite(value):
                stated = get_args(get_type_hints(function, include_extras=True)[name])[1:]
                words = [word for option in stated for word in (option.default, *option.param_decls) if str(word).startswith("--")]
                fail(f"{[*words, f'--{name}'][0]}: {value} is not a finite number. Give a finite one.")
        function(**given)

    return checked


def _listed() -> None:
    """Placeholder in the list of commands for a command that is not loaded yet."""


app = typer.Typer(
    name="mechviz",
    cls=Commands,
    help="Inspect and record mechanisms: kinematics, forces, solids, rerun recordings, a browser viewer.\n\n"
    "SCENE is the name of a gallery scene (see: mechviz scenes) or the path of a scene file.\n\n"
    "Start with: mechviz record crank-rocker, then mechviz inspect recordings/crank-rocker.rrd, or mechviz view crank-rocker.\n\n"
    "Exit codes: 0 done; 2 it cannot be done as it is asked for (options, scene, recording, a file that cannot be written there); "
    "1 something is in the way (a full disk, a port in use, no Chromium), or a hard case fails; "
    "3 the results cannot be trusted: they do not balance or close; "
    "70 a fault of mechviz: --traceback, anywhere, shows where; 130 and 143 interrupted.\n\n"
    "--large, anywhere, takes scenes and runs that are refused as too large, whatever time and memory they need.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)
for listed in COMMANDS.values():
    for command, line in listed.items():
        app.command(command, help=line)(_listed)


def main() -> None:
    """Run the `mechviz` command; called when the signal handlers are installed."""
    if isinstance(sys.stdout, io.TextIOWrapper) and not isinstance(sys.stdout.buffer, io.BytesIO):  # only where there is a file
        at_once = sys.stdout.line_buffering or sys.stdout.write_through
        raw = Stdout(sys.stdout.fileno(), "w", closefd=False)
        sys.stdout = io.TextIOWrapper(io.BufferedWriter(raw), sys.stdout.encoding, line_buffering=at_once)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # characters that the terminal's encoding lacks must not stop a command
    shown = TRACEBACK in sys.argv
    if ANY_SIZE in sys.argv:
        os.environ[LARGE_VARIABLE] = "1"
    sys.argv[1:] = [word for word in sys.argv[1:] if word not in (TRACEBACK, ANY_SIZE)]
    code: str | int | None = 0
    try:
        try:
            app()
        except SystemExit as end:
            code = end.code
        except (KeyboardInterrupt, OSError):
            raise
        except BaseException as error:  # includes errors that are no Exception, such as a panic of rerun
            code = report_unforeseen(error, shown=shown)
        sys.stdout.flush()
    except OSError as error:  # even the help may be written to a full disk
        code = report_stdout_failure(error)
    gc.freeze()  # saves a garbage collection over all modules at exit
    sys.exit(code)


if __name__ == "__main__":
    main()
