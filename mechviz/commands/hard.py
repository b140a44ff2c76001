"""``mechviz hard``: runs the suite of hard cases and prints what was found; exit code 1 where one fails."""

from __future__ import annotations

import json as json_text
import shutil
from typing import Annotated

import typer

from mechviz.commands.common import fail, progress_bar
from mechviz.commands.solving import clear_errors
from mechviz.hard_cases.case import FAMILIES, as_data, summary, table
from mechviz.hard_cases.suite import all_cases


def hard(
    only: Annotated[str | None, typer.Option("--only", metavar="FAMILY", help=f"one family: {', '.join(FAMILIES)}")] = None,
    json: Annotated[bool, typer.Option("--json", help="the outcomes as JSON, every check with its error and bound")] = False,
) -> None:
    """Run the suite of hard cases: what happens there, what is expected, what is found; exit code 1 where one fails.

    Singular positions, benchmarks at which other programs fail, undercut cams, jams, stick-slip, impacts, chaos, careless input.
    Each expectation is computed apart from the program: a closed form, a balance, another method.
    """
    if only is not None and only not in FAMILIES:
        fail(f"--only: '{only}' is no family. Choose from {', '.join(FAMILIES)}.")
    cases = all_cases(only)
    results = []
    with clear_errors("hard"):
        with progress_bar("hard cases") as bar:
            for k, case in enumerate(cases):
                bar(k, len(cases))
                results.append((case, case.run()))
        if json:
            print(json_text.dumps(as_data(results), indent=2, ensure_ascii=False))
        else:
            print(table(results, shutil.get_terminal_size((160, 40)).columns))
            print(summary(results))
    if not all(outcome.passed for _, outcome in results):
        raise typer.Exit(1)
