"""Shared by the synthesis commands: options, arguments with quantities and rows of points, output of solutions."""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer

from mechcore.arrays import Real
from mechviz.commands.shared.messages import fail, interruptible, say
from mechviz.figures import check_ending, save_chart
from mechviz.files import check_target, read_regular
from mechviz.scene.expressions import Amount, parse_expression
from mechviz.scene.units import QuantityError, Units
from mechviz.studies.synthesis.linkages import LinkageSolution, check_folder, solution_table, write

if TYPE_CHECKING:
    from matplotlib.figure import Figure

UNITS = Units(length="mm", angle="deg")
LEAST_LENGTH, LARGEST_LENGTH = 1e-9, 1e6  # [m]
LARGEST_FILE = 1 << 20  # largest size of a file of points [bytes]

OutputOpt = Annotated[
    Path | None,
    typer.Option("--output", "-o", metavar="FOLDER|FILE.toml", help="write all solutions as scenes, or the first"),
]
PlotOpt = Annotated[Path | None, typer.Option("--plot", help="write a chart (.svg, .png or .pdf)")]
MostOpt = Annotated[int, typer.Option("--most", min=1, max=1000, help="solutions that are shown")]


def output_solutions(
    solutions: Sequence[LinkageSolution], output: Path | None, plot: Path | None, figure: Callable[[], Figure] | None
) -> None:
    """Print solutions, and write their scenes and their chart."""
    if not solutions:
        fail("No linkage does that. Ask for something else.")
    print("\n".join(solution_table(solutions)))
    with interruptible(*(() if plot is None else ("matplotlib.figure",))):
        if output is not None:
            report_written(write(solutions, output))
        if plot is not None and figure is not None:
            save_chart(figure(), plot)
            say(f"{plot} written.")


def report_written(paths: list[Path]) -> None:
    """Report the scenes that were written."""
    say(f"{paths[0]} written." if len(paths) == 1 else f"{len(paths)} scenes written to {paths[0].parent}.")


def check_scene_targets(output: Path | None, plot: Path | None) -> None:
    """Raise `OutputError` where outputs cannot be written; called before anything is computed."""
    if output is not None:
        check_folder(output)
    if plot is not None:
        check_ending(plot)
        check_target(plot)


def angle_option(text: str, option: str) -> float:
    """An angle [rad] from an option."""
    return quantity_in(text, option, "angle")


def length_of(text: str, option: str) -> float:
    """A length [m] from an option; ends the command where it is not between `LEAST_LENGTH` and `LARGEST_LENGTH`."""
    value = quantity_in(text, option, "length")
    if not LEAST_LENGTH <= value <= LARGEST_LENGTH:
        fail(f"{_named(option)}: {text} is no length of a mechanism. Give one between 1e-6 mm and 1e6 m.")
    return value


def quantity_in(text: str, option: str, kind: str) -> float:
    """A quantity of a kind, in SI units, from an option: a text with a unit, or a number in mm or degrees."""
    try:
        value: float | str = float(text)
    except ValueError:
        value = text
    try:
        if isinstance(value, float) and not np.isfinite(value):
            raise QuantityError(f"{text} is not a finite number.", "Give a finite one.")
        return UNITS.si(value, kind)
    except QuantityError as e:
        fail(f"{_named(option)}: {e} {e.remedy}")


def _named(option: str) -> str:
    """An option as the user writes it; names of arguments, in capitals or of several words, stay as they are."""
    return option if option.isupper() or " " in option else f"--{option}"


def pairs_of(given: Sequence[str] | None) -> list[complex]:
    """Positions [m] from an option that can be repeated."""
    return [complex(x, y) for x, y in option_rows(list(given), 2, "pivot", least=1)] if given else []


def option_rows(words: list[str], columns: int, what: str, least: int = 2) -> Real:
    """Rows (n, columns) of two lengths and, with three columns, an angle, in SI units, from texts with commas or from a CSV
    file."""
    if len(words) == 1 and "," not in words[0]:
        text = read_regular(words[0], LARGEST_FILE).decode("utf-8", "replace")
        rows = [row for row in csv.reader(text.splitlines()) if row and not row[0].lstrip().startswith("#")]
        rows = rows[1:] if rows and not _is_number(rows[0][0]) else rows  # without the line of headings
    else:
        rows = [word.split(",") for word in words]
    kinds = ("length", "length", "angle")[:columns]
    out = []
    for k, row in enumerate(rows, 1):
        if len(row) != columns:
            wanted = ("30,10", "30,10,25")[columns - 2]
            fail(f"{what} {k}: '{','.join(row)}' has {len(row)} parts, and {columns} are wanted, such as {wanted}.")
        out.append([quantity_in(cell.strip(), f"{what} {k}", kind) for cell, kind in zip(row, kinds, strict=True)])
    if len(out) < least:
        fail(f"{len(out)} {what}s. Give {least} or more.")
    return np.array(out)


def _is_number(text: str) -> bool:
    return text.strip()[:1] in tuple("+-.0123456789")


def function_of(text: str, start: str, end: str) -> tuple[Callable[[Real], Real], float, float]:
    """A function of x, and the start and end of its range, from expressions with units. Ends the command where they are invalid."""
    try:
        ends = [parse_expression(word).value({}) for word in (start, end)]
        powers = next((one.powers for one in ends if one.number != 0.0), ends[0].powers)
        if any(one.powers != powers and one.number != 0.0 for one in ends):
            fail("--from, --to: they measure different things. Give both the same unit.")
        expression = parse_expression(text)
        expression.value({"x": Amount(float(ends[1].number), powers)})
    except QuantityError as e:
        fail(f"{e} {e.remedy}")

    def y(x: Real) -> Real:
        values = np.broadcast_to(np.asarray(expression.value({"x": Amount(x, powers)}).number, float), np.shape(x))
        return np.array(values)

    if float(ends[0].number) == float(ends[1].number):
        fail("--from, --to: the range of x is empty.")
    return y, float(ends[0].number), float(ends[1].number)
