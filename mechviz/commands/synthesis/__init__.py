"""``mechviz synthesise``: scenes from tasks. There is a command for each task, which prints its solutions and writes them as
scenes."""

import typer

from mechviz.commands.synthesis.four_bars import cognates, function, motion, path, slider
from mechviz.commands.synthesis.strokes import chains, dwell, lid, line, stroke, swing

NEGATIVE = {"ignore_unknown_options": True}  # so that -5,0 is read as a position

synthesise = typer.Typer(
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    no_args_is_help=True,
    help="Find mechanisms for a task: a function, positions of a body, a path, a stroke, a dwell; or list "
    "kinematic chains.\n\n"
    "Every solution is a line with its numbers and defects, and with -o FOLDER a scene: mechviz view FOLDER/motion-1.toml. "
    "Bare numbers are mm and degrees.",
)
for task in (function, slider, motion, path, cognates, stroke, swing, line, dwell, lid, chains):
    synthesise.command(context_settings=NEGATIVE if task in (motion, path) else None)(task)
