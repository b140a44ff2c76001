"""The suite of hard cases as tests, and the command that runs it."""

from __future__ import annotations

import json

import pytest
from typer.testing import CliRunner

import mechviz.hard_cases.input
from mechviz.commands.main import app
from mechviz.hard_cases import all_cases
from mechviz.hard_cases.case import CASE_FAMILIES, Case, Check, Outcome, check_that, compare

CASES = all_cases()


@pytest.mark.parametrize("case", CASES, ids=lambda c: f"{c.family}: {c.name}")
def test_hard_case(case: Case):
    outcome = case.run()
    missed = [f"{c.name}: {c.error:.3g} > {c.bound:.3g}" for c in outcome.checks if not c.passed]
    assert outcome.passed, f"{outcome.summary}; {missed}"


def test_the_suite_is_whole():
    """At least 40 cases from all five families, and the benchmarks at which peers fail among them."""
    assert len(CASES) >= 40 and {c.family for c in CASES} == set(CASE_FAMILIES)
    assert len({(c.family, c.name) for c in CASES}) == len(CASES)
    peers = [c.name for c in CASES if c.peers]
    for problem in ("P1", "P2", "P3", "P4", "P5"):
        assert any(name.startswith(problem) for name in peers), problem
    assert all(c.difficulty and c.expected for c in CASES)


def test_a_case_that_finds_something_else_fails():
    assert not compare("x", [1.0, 2.0], [1.0, 2.1], 1e-3).passed
    assert compare("x", [1.0, 2.0], [1.0, 2.001], 1e-3).passed
    assert not compare("x", [1.0, float("nan")], [1.0, 2.0], 1e9).passed
    assert not check_that("x", [True, False]).passed
    assert not Outcome("nothing was looked at", ()).passed


def _case(error: float) -> Case:
    return Case(
        "made", "input", "something", "nothing", lambda: Outcome("found", (Check("error", error, 1e-9),), 1e-16, 2.0, ("event",))
    )


def test_an_exception_is_a_failure_of_its_case_only():
    broken = Case("broken", "input", "it breaks", "nothing", lambda: 1 / 0)  # type: ignore[arg-type,return-value]  # on purpose
    outcome = broken.run()
    assert not outcome.passed and "division by zero" in outcome.summary


@pytest.mark.parametrize(("error", "code"), [(1e-12, 0), (1e-3, 1), (float("nan"), 1)])
def test_the_command_ends_with_one_where_a_case_fails(monkeypatch, error, code):
    monkeypatch.setattr(mechviz.hard_cases.input, "CASES", (_case(error),))
    result = CliRunner().invoke(app, ["hard", "--only", "input"])
    assert result.exit_code == code
    row = next(line for line in result.stdout.splitlines() if line.strip().startswith("made"))
    assert row.rstrip().endswith("FAIL" if code else "pass") and "event" in row and "1.0e-16" in row and "2.0e+00" in row
    assert f"{1 - code} of 1 hard cases pass" in result.stdout


def test_the_command_gives_json(monkeypatch):
    monkeypatch.setattr(mechviz.hard_cases.input, "CASES", (_case(float("inf")),))
    result = CliRunner().invoke(app, ["hard", "--only", "input", "--json"])
    assert result.exit_code == 1
    (data,) = json.loads(result.stdout)
    assert data["passed"] is False and data["checks"] == [{"name": "error", "error": "inf", "bound": 1e-9, "passed": False}]
    assert data["condition"] == 2.0 and data["events"] == ["event"]


def test_an_unknown_family_is_refused():
    result = CliRunner().invoke(app, ["hard", "--only", "lever"])
    assert result.exit_code == 2
    assert "'lever' is no family. Choose from linkages, cams" in result.stderr
