"""Shared by the commands of synthesis: their options, quantities and rows of points as arguments, solutions as output."""

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
LARGEST_FILE = 1 << 20  # bytes of a file of points

OutputOpt = Annotated[
    Path | None,
    typer.Option("--output", "-o", metavar="FOLDER|FILE.toml", help="write all solutions as scenes, or the first"),
]
PlotOpt = Annotated[Path | None, typer.Option("--plot", help="write a chart (.svg, .png or .pdf)")]
MostOpt = Annotated[int, typer.Option("--most", min=1, max=1000, help="solutions that are shown")]


def give(solutions: Sequence[LinkageSolution], output: Path | None, plot: Path | None, figure: Callable[[], Figure] | None) -> None:
    """Prints solutions, and writes their scenes and their chart."""
    if not solutions:
        fail("No linkage does that. Ask for something else.")
    print("\n".join(solution_table(solutions)))
    with interruptible(*(() if plot is None else ("matplotlib.figure",))):
        if output is not None:
            tell_written(write(solutions, output))
        if plot is not None and figure is not None:
            save_chart(figure(), plot)
            say(f"{plot} written.")


def tell_written(paths: list[Path]) -> None:
    """Say which scenes were written."""
    say(f"{paths[0]} written." if len(paths) == 1 else f"{len(paths)} scenes written to {paths[0].parent}.")


def check_scene_targets(output: Path | None, plot: Path | None) -> None:
    """Refuse targets that cannot be written before anything is computed. Raises `OutputError`."""
    if output is not None:
        check_folder(output)
    if plot is not None:
        check_ending(plot)
        check_target(plot)


def angle_option(text: str, option: str) -> float:
    """An angle [rad] of an option."""
    return quantity_in(text, option, "angle")


def length_of(text: str, option: str) -> float:
    """A length [m] of an option, above zero."""
    value = quantity_in(text, option, "length")
    if not LEAST_LENGTH <= value <= LARGEST_LENGTH:
        fail(f"{_named(option)}: {text} is no length of a mechanism. Give one between 1e-6 mm and 1e6 m.")
    return value


def quantity_in(text: str, option: str, kind: str) -> float:
    """A quantity in SI units, from a text with a unit or a number in mm or degrees."""
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
    """An option as it is written; arguments have names in capitals, or of several words."""
    return option if option.isupper() or " " in option else f"--{option}"


def pairs_of(given: Sequence[str] | None) -> list[complex]:
    """Places [m] of an option that is given again and again."""
    return [complex(x, y) for x, y in option_rows(list(given), 2, "pivot", least=1)] if given else []


def option_rows(words: list[str], columns: int, what: str, least: int = 2) -> Real:
    """Rows of two lengths, and perhaps an angle, in SI units: texts with commas, or the rows of a CSV file."""
    if len(words) == 1 and "," not in words[0]:
        text = read_regular(words[0], LARGEST_FILE).decode("utf-8", "replace")
        rows = [row for row in csv.reader(text.splitlines()) if row and not row[0].lstrip().startswith("#")]
        rows = rows[1:] if rows and not _is_number(rows[0][0]) else rows  # a line of titles
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
    """A function of x and its range, from expressions with units."""
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
