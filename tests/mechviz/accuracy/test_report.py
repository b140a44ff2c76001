"""The report of the benchmarks and the generated pages: tables are read and drawn, failures are told, pages and suite agree."""

from __future__ import annotations

import argparse
import re
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest

from mechviz.hard_cases import all_cases
from mechviz.hard_cases.case import CASE_FAMILIES

sys.path.insert(0, str(Path(__file__).resolve().parents[3] / "benchmarks"))
sys.path.append(str(Path(__file__).resolve().parents[3] / "benchmarks" / "peers"))
import curves
import quote
import report
import spread

ROOT = Path(__file__).resolve().parents[3]

DYNAMICS = """machine; least of 3 turns

### Squeezer

| who | setting | time [ms] | error [rad] | faster by |
|---|---|---|---|---|
| mechviz | 1e-6 | 3.00 | 1.0e-07 |  |
| mechviz | 1e-9 | 5.00 | 1.0e-10 |  |
| peer | rtol 1e-6 | 12.00 | 5.0e-07 | 4.0 |
| broken | x | - | - | |
"""
GROWTH = "| loops | compile, ms | motion, ms |\n|---|---|---|\n| 10 | 2.0 | 1.0 |\n| 100 | 20.0 | 11.0 |\n"


def test_tables_are_found_with_their_headings():
    ((heading, table),) = report.tables(DYNAMICS)
    assert heading == "Squeezer" and table[0][:2] == ["who", "setting"] and len(table) == 5
    assert report.number("1,234 ms") == 1234.0 and report.number("") != report.number("")


def test_tables_are_drawn(tmp_path):
    (precision,) = report.draw_precision(DYNAMICS, tmp_path)
    said = [t.text for t in ET.fromstring(precision.read_text(encoding="utf-8")).findall(".//{*}g/{*}title")]
    ours = {"mechviz, 1e-6: 1.0e-07 in 3 ms", "mechviz, 1e-9: 1.0e-10 in 5 ms"}
    assert {*said} == {*ours, "peer, rtol 1e-6: 5.0e-07 in 12 ms"}, "what has no number is left out"
    (growth,) = report.draw_growth(GROWTH, tmp_path)
    words = {t.text for t in ET.fromstring(growth.read_text(encoding="utf-8")).iter("{http://www.w3.org/2000/svg}text")}
    assert {"loops", "compile, ms", "motion, ms", "10", "100"} <= words
    assert report.draw_precision("nothing", tmp_path) == [] == report.draw_growth("nothing", tmp_path)


def test_methods_of_ours_are_curves_of_their_own_and_others_have_the_colour_of_their_package():
    rows = [
        ["mechviz", "energy 1e-04", "2.0", "1e-12", ""],
        ["mechviz", "gauss 1e-04", "9.0", "1e-6", ""],
        ["mechviz", "energy 1e-06", "1,000.0", "0.0", ""],
        ["exudyn gen.-alpha", "10 steps", "5.0", "1e300", ""],
        ["exudyn gen.-alpha", "20 steps", "7.0", "1e-3", ""],
        ["by hand + DOP853", "rtol 1", "3.0", "1e-3", ""],
        ["peer", "could not be run", "", "", ""],
    ]
    result = {c.who: c for c in curves.precision_curves(rows)}
    assert set(result) == {"mechviz, energy", "mechviz, gauss", "exudyn gen.-alpha", "by hand + DOP853"}
    assert result["mechviz, energy"].seconds == (2e-3, 1.0) and result["mechviz, energy"].errors == (1e-12, curves.LEAST)
    assert result["exudyn gen.-alpha"].settings == ("20 steps",), "what went astray is no result"
    colored = {c.who: color for c, color in curves._coloured([*result.values()])}
    assert colored["exudyn gen.-alpha"] == curves.PACKAGES["exudyn"] and colored["by hand + DOP853"] in curves.BY_HAND
    assert curves._front([*result.values()]) == [(2e-3, 1e-12), (1.0, curves.LEAST)]


@pytest.mark.parametrize("order", [2, 4, 6])
def test_what_peers_do_with_few_positions_is_as_exact_as_its_order(order):
    """A point of two circles: differences converge by their order, splines of degree 5 by six orders, their derivatives by less."""

    def turn(n):
        return np.arange(n) * (2.0 * np.pi / n)

    def motion(t, d):
        return np.stack([(1j * k) ** d * np.exp(1j * k * t) / k for k in (1, 3)], -1).view(float)[:, :4]

    def error(n):
        computed = spread.with_rates(lambda t: {("P", 0): motion(t, 0)}, order, 2.0, turn(n))
        return np.array([np.abs(computed["P", d] - 2.0**d * motion(turn(n), d)).max() for d in (1, 2)])

    assert np.log2(error(64) / error(128)) == pytest.approx([order, order], abs=0.15)
    wanted = np.linspace(0.1, 6.0, 77)

    def splines(n):
        computed = spread.at_any_angle(lambda t: {("P", 0): motion(t, 0)}, turn(n), 2.0, wanted)
        return np.array([np.abs(computed["P", d] - 2.0**d * motion(wanted, d)).max() for d in range(3)])

    assert (np.log2(splines(64) / splines(128)) > [5.5, 4.5, 3.5]).all()


def test_what_is_printed_becomes_markdown():
    text = report.as_markdown("words\n| a | b |\n|---|---|\n| 1 | 2 |\nmore words")
    assert text.splitlines()[:3] == ["```text", "words", "```"] and text.endswith("more words\n```")


def test_a_part_that_fails_says_so(tmp_path):
    part = report.Part("broken", "Broken", "It breaks.", lambda _: [sys.executable, "-c", "raise SystemExit('no luck')"])
    text, seconds, fault = report.run(part, argparse.Namespace(short=True))
    assert "exit code 1" in fault and "no luck" in fault and seconds > 0.0
    assert any("failed" in line for line in report.chapter(part, text, fault, tmp_path))
    assert {p.name for p in report.PARTS} >= {"peers", "dynamics", "cams", "scaling", "recording", "effects", "accuracy"}


@pytest.mark.parametrize("page", ["accuracy.md", "hard-cases.md"])
def test_generated_pages_are_filled_and_their_pictures_are_there(page):
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    blocks = re.findall(r"<!-- block: (\w+) -->\n(.*?)<!-- end -->", text, flags=re.DOTALL)
    assert blocks and all(len(body.strip()) > 100 for _, body in blocks)
    for picture in re.findall(r"\]\((images/[^)]+)\)", text):
        ET.parse(ROOT / "docs" / picture)


def test_the_page_of_hard_cases_lists_the_suite():
    text = (ROOT / "docs" / "hard-cases.md").read_text(encoding="utf-8")
    for family in CASE_FAMILIES:
        body = re.search(rf"<!-- block: {family} -->\n(.*?)<!-- end -->", text, flags=re.DOTALL)[1]
        named = [line.split(" | ")[0].removeprefix("| ") for line in body.splitlines() if line.startswith("| ")][1:]
        assert named == [c.name for c in all_cases(family)], family


PEERS = """2026-11-21, short mode. A processor; versions

### P1 Four-bar over a turn: all

| who | 360 positions | ratio | 3,600 positions | ratio | set-up, once | error |
|---|---|---|---|---|---|---|
| mechviz | 0.1 ms | 1.00 | 0.3 ms | 1.00 | 0.8 s | position 4e-16, velocity 6e-16 |
| pylinkage with numba | 0.2 ms | 1.98 | 2.0 ms | 6.47 | 0.9 s | position 3e-13, velocity 5e-13 |
| slow one | 6.0 ms | 48.8 | 53.6 ms | 1,672 | 0.2 s | position 4e-11, velocity not given |
| by hand: x | 0.1 ms | 1.1 | 0.3 ms | 1.1 | 0.2 s | position 4e-16 |
"""


def test_peers_are_drawn_with_their_largest_errors(tmp_path):
    drawn = report.draw_peers(PEERS, tmp_path)
    assert [p.name for p in drawn] == [
        "peers-p1-four-bar-over-a-turn-360-positions.svg",
        "peers-p1-four-bar-over-a-turn-3-600-positions.svg",
    ]
    root = ET.fromstring(drawn[0].read_text(encoding="utf-8"))
    marks = [root.find(f".//{{*}}g[@id='who-{k}']//{{*}}use") for k in range(1, 5)]
    dots = [(float(m.get("x")), float(m.get("y"))) for m in marks]
    assert dots[0][0] < dots[1][0] < dots[2][0], "slower is further right"
    assert dots[0][1] > dots[1][1] > dots[2][1], "more wrong is higher"
    assert "2  pylinkage with numba" in {t.text for t in root.findall(".//{*}text")}


def test_the_page_on_performance_quotes_ratios_that_are_in_the_report(capsys):
    text = quote.block(PEERS)
    assert "| 6.4 times / at least 1600 times faster |" in text and "| 1.9 times / at least 48 times faster |" in text
    assert "| 1.1 times faster / 1.1 times faster |" in text, "by hand"
    assert text.count("| `benchmarks/") == 3 and "left out: slider-crank forces" in capsys.readouterr().err
    assert [quote.times(x) for x in (1.99, 9.97, 48.8, 136.1, 9344.0)] == ["1.9", "9.9", "48", "130", "9300"]
    assert (ROOT / "docs" / "performance.md").read_text(encoding="utf-8").count("<!-- block: performance -->") == 1


PENDULUM = """### Double pendulum, 5 s

| who | setting | time [ms] | error [rad] | mechviz at this error or less is faster by |
|---|---|---|---|---|
| mechviz | gauss 1e-07 | 30.0 | 1e-9 |  |
| mechviz | gauss 1e-09 | 80.0 | 1e-11 |  |
| mechviz, C | c 1e-09 | 2.0 | 1e-11 |  |
| Pinocchio + DOP853 | rtol 1e-09 | 9.0 | 1e-10 | 0.11 |
"""


def test_the_page_on_performance_says_where_mechviz_is_slower():
    """80 ms against 9: our row with the larger error does not count, and 8.88 is rounded against us."""
    said = quote.beside("Double pendulum", "Pinocchio + DOP853", "rtol 1e-09")(report.tables(PENDULUM), "")
    assert said == "by numpy 8.9 times slower, by a compiled program 4.5 times faster"


def test_what_a_script_prints_becomes_markdown():
    text = report.as_markdown("# Title\nplain\n\n| a | b |\n|---|---|\n| 1 | 2 |\n\nmore")
    assert text.count("```") % 2 == 0 and text.startswith("### Title")
    assert "```text\nplain\n```\n\n| a | b |" in text
