"""Texts of the panels, as HTML. Every text from a scene is escaped: otherwise a browser would run scripts contained in it."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable
from html import escape
from typing import TYPE_CHECKING

import numpy as np

from mechviz.outputs.viewer.world.camera import grid_cell
from mechviz.outputs.viewer.world.marks import PATH_COLORS
from mechviz.quantities.catalogue import time_decimals
from mechviz.quantities.vectors import FORCE_FAMILIES, VECTOR_FAMILIES, Scales, round_value

if TYPE_CHECKING:
    from mechviz.editor.parameters import Parameter
    from mechviz.outputs.viewer.session import Contribution
    from mechviz.outputs.viewer.view_model import DriveCoordinate, ViewModel
    from mechviz.runs import Run
    from mechviz.scene.units import Units


def _rgb(color: tuple[int, int, int]) -> str:
    return "rgb({},{},{})".format(*color)


def _colors_by_theme(light: tuple[int, int, int], dark: tuple[int, int, int]) -> str:
    """A colour on a light page, another one on a dark page."""
    return f"light-dark({_rgb(light)},{_rgb(dark)})"


COLOR_OF_PATHS = _colors_by_theme(PATH_COLORS[False], PATH_COLORS[True])
FAMILY_COLORS = {name: _colors_by_theme(family.color, family.on_dark) for name, family in VECTOR_FAMILIES.items()}
LEGEND_ARROW = 0.2  # of the mechanism's size: approximate length of the arrow whose value the legend states


def format_number(value: float) -> str:
    """A value for reading: five significant digits, a true minus."""
    if not np.isfinite(value):
        return "not finite"
    return f"{value:.5g}".replace("-", "−", 1) if value < 0 else f"{value:.5g}"


def unit_suffix(unit: str) -> str:
    """A unit as written after a value: empty for the unit 1, degrees without a space, other units after a space."""
    return {"1": "", "°": "°"}.get(unit, f" {unit}")


def heading(title: str, learning_goal: str) -> str:
    """Title and learning goal."""
    return _block(
        '<div class="mechviz-heading" style="font-size:1.12em;font-weight:650;line-height:1.25;padding-bottom:0.3em">'
        f"{escape(title)}</div>"
        f'<div style="font-size:0.85em;line-height:1.4;opacity:0.85">{escape(learning_goal)}</div>'
    )


def legend(
    families: Iterable[str],
    paths: Iterable[str],
    scales: Scales,
    factor: float | Callable[[str], float],
    size: float,
    units: Units,
) -> str:
    """Legend: the meaning of each colour, the scales of the arrows and the grid. ``factor``: the user's enlargement of all arrows,
    or a function of the family."""
    enlarged = factor if callable(factor) else lambda _: factor
    families, paths = list(families), list(paths)
    rows = [_swatch(FAMILY_COLORS[f], 0.42, f"<b>{VECTOR_FAMILIES[f].label}</b>: {VECTOR_FAMILIES[f].meaning}") for f in families]
    if paths:
        rows.append(_swatch(COLOR_OF_PATHS, 0.16, f"<b>Path</b> of {escape(', '.join(paths))}"))
    shown = set(families)
    for si, some, per_metre in (
        ("N", shown & set(FORCE_FAMILIES), scales.newtons_per_metre),
        ("m/s", shown & {"velocity"}, scales.mps_per_metre),
        ("m/s²", shown & {"acceleration"}, scales.mps2_per_metre),
    ):
        if some and per_metre != 1.0:
            for times in sorted({enlarged(family) for family in some}):
                whose = "" if len({enlarged(f) for f in some}) == 1 else _names(f for f in families if enlarged(f) == times)
                rows.append(f"<div>{scale_line(units, si, per_metre / times, size)}{whose}</div>")
    rows.append(f'<div style="opacity:0.75">Grid: {units.text(grid_cell(size, units), "m")}</div>')
    return _block("".join(rows), "font-size:0.78em;line-height:1.35")


def legend_line(
    families: Iterable[str], paths: Iterable[str], scales: Scales, factor: Callable[[str], float], size: float, units: Units
) -> str:
    """The legend in one line: colours with their names, and the scale of forces."""
    families, paths = list(families), list(paths)
    entries = [(FAMILY_COLORS[f], VECTOR_FAMILIES[f].label, VECTOR_FAMILIES[f].meaning) for f in families]
    entries += [(COLOR_OF_PATHS, f"Path of {', '.join(paths)}", "")] if paths else []
    parts = [
        f'<span title="{escape(meaning)}" style="white-space:nowrap"><span style="display:inline-block;width:1.1em;height:0.36em;'
        f'border-radius:0.2em;margin-right:0.4em;vertical-align:middle;background:{color}"></span>{escape(label)}</span>'
        for color, label, meaning in entries
    ]
    forces = [f for f in families if f in FORCE_FAMILIES]
    if forces and scales.newtons_per_metre != 1.0:
        text = scale_line(units, "N", scales.newtons_per_metre / factor(forces[0]), size)
        parts.append(f'<span style="opacity:0.7;white-space:nowrap">{text}</span>')
    return _block("".join(parts), "display:flex;flex-wrap:wrap;gap:0.1em 1.1em;font-size:0.78em;line-height:1.4")


def warnings_html(sentences: Iterable[str]) -> str:
    """Why the run cannot be trusted; empty if there is no warning."""
    rows = "".join(f"<div>Not to be trusted: {escape(text)}</div>" for text in sentences if text)
    return f'<div role="alert" style="color:#c22f2f;font-size:0.8em;line-height:1.35">{rows}</div>' if rows else ""


def plan_list(run: Run) -> str:
    """Stages that were computed, stages that were left out with the reason, and the total time."""
    done = "".join(f"<li>{escape(step.name)}</li>" for step in run.plan.computed)
    left = "".join(
        f'<li>{escape(step.name)} <span style="opacity:0.65">({escape(step.why)})</span></li>' for step in run.plan.skipped
    )
    seconds = sum(stage.seconds for stage in run.stages)
    style = 'style="margin:0.15em 0 0.5em;padding-left:1.2em"'
    return _block(
        f"<b>Computed</b> for {run.motion.frames} frames in {format_number(round(seconds * 1e3, 1))} ms<ul {style}>{done}</ul>"
        f"<b>Left out</b><ul {style}>{left or '<li>nothing</li>'}</ul>",
        "font-size:0.78em;line-height:1.35",
    )


def edit_status(seconds: float, can_undo: bool, can_redo: bool, oscillating_drives: Iterable[str] = ()) -> str:
    """Status when the scene could be built: a hint before the first edit, the time of the last solution, and the drives that
    oscillate over their reachable range (``oscillating_drives``)."""
    text = "Drag a slider, or type a value: everything is computed anew while you drag." if not can_undo and not can_redo else ""
    if seconds > 0.0:
        text = f'<span style="color:#0f8a5f">✓</span> solved in {format_number(round(seconds * 1e3))} ms{text and ". " + text}'
    for joint in oscillating_drives:
        text += f"<div>Drive {escape(joint)} runs as far as it can go and back: <code>range = &quot;reachable&quot;</code></div>"
    return _block(f'<div role="status">{text or "As opened."}</div>', "font-size:0.8em;line-height:1.35;opacity:0.85")


def refusal_words(text: str, parameter: Parameter | None, value: float, reach: tuple[float, float] | None) -> str:
    """Why a value is refused, and the range ``reach`` in which it is possible, if known."""
    rows = [f"<div>{escape(text[:1].upper() + text[1:])}</div>"] if text else []
    if parameter is not None:
        if reach is not None:
            low, high = (escape(parameter.text(float(f"{v:.4g}"))) for v in reach)
            rows.insert(0, f"<div>Reachable: <b>{low} to {high}</b>. The last good mechanism is shown.</div>")
        rows.insert(0, f"<b>{escape(parameter.label)} = {escape(parameter.text(value))} is not possible.</b>")
    return _block(
        f'<div role="alert" style="border-left:4px solid #d03030;padding:0.35em 0.7em;background:rgba(208,48,48,0.09)">'
        f"{''.join(rows)}</div>",
        "font-size:0.8em;line-height:1.35",
    )


def contribution_table(items: Iterable[Contribution], effort: str, units: Units) -> str:
    """A table: by how much each effect changes the peak of the ``effort`` (a drive torque, a drive force or a reaction), and its
    computing time; below it, why a contribution is not known."""
    items = list(items)
    unit, factor = units.display_unit("N m" if effort.endswith("torque") else "N")
    rows = []
    for item in items:
        known = np.isfinite([item.peak_with, item.peak_without]).all()
        peak = "—"
        if known:
            change = factor * (item.peak_with - item.peak_without)
            sign = "+" if change > 0.0 else "−" if change < 0.0 else "±"
            peak = f"{sign}{format_number(abs(float(f'{change:.3g}')))} {unit}"
        cost = f"{format_number(float(f'{item.seconds * 1e3:.2g}'))} ms" if np.isfinite(item.seconds) else "—"
        style = "" if item.on else ' style="opacity:0.55"'
        now = "on" if item.on else "off"
        cells = f'<td>{escape(item.name)}</td><td>{now}</td><td>{peak}</td><td style="white-space:nowrap">{cost}</td>'
        rows.append(f"<tr{style}>{cells}</tr>")
    head = f"<tr><th>effect</th><th>now</th><th>peak {effort} changes by</th><th>costs</th></tr>"
    table = f'<table style="width:100%;border-collapse:collapse;text-align:left" cellpadding="3">{head}{"".join(rows)}</table>'
    notes = [f"{item.name}: {item.why}" for item in items if item.why]
    if items and not notes and all(np.isnan(item.seconds) for item in items):
        notes = ["One run takes too long for this to be found unasked: press the button."]
    below = "".join(f'<div style="opacity:0.7;padding-top:0.3em">{escape(note)}</div>' for note in notes)
    return _block(f"{table}{below}", "font-size:0.78em;line-height:1.3;font-variant-numeric:tabular-nums")


def html_table(title: str, lines: Iterable[Iterable[str]]) -> str:
    """A small table of texts below a title."""
    body = "".join(f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in line)}</tr>" for line in lines)
    return _block(
        f'<div>{escape(title)}</div><table style="width:100%" cellpadding="2">{body}</table>', "font-size:0.78em;line-height:1.3"
    )


def html_rows(lines: Iterable[str]) -> str:
    """Lines of HTML, one below the other."""
    return _block("".join(f"<div>{line}</div>" for line in lines), "font-size:0.8em;line-height:1.35")


def notes_html(content: str) -> str:
    """The notes of a recording, given as HTML, in the style of a panel."""
    return f'<div style="padding:0.2em 0.9em 0.6em;font-size:0.85em;line-height:1.4;overflow-wrap:anywhere">{content}</div>'


def hint(text: str) -> str:
    """A sentence of help in faint letters."""
    return _block(escape(text), "font-size:0.78em;line-height:1.35;opacity:0.7")


def value_table(item: str, rows: Iterable[tuple[str, Iterable[str], Iterable[float], str]]) -> str:
    """A table of the values of an item. Each row: what it is, the names of its components, their values, the unit."""
    lines = []
    count = itertools.count()
    for what, curves, numbers, unit in rows:
        names = list(curves)
        parts = [
            '<span style="white-space:nowrap">'
            + (f'<span style="opacity:0.65">{escape(name)}</span> ' if len(names) > 1 else "")  # a single component needs no name
            + f'<span data-mv="closer:{next(count)}">{format_number(value)}</span></span>'
            for name, value in zip(names, numbers, strict=True)
        ]
        lines.append(
            f'<tr><td style="opacity:0.75">{escape(what)}</td>'
            f'<td><div style="display:flex;gap:0.9em;flex-wrap:wrap">{"".join(parts)}'
            f"<span>{escape(unit_suffix(unit))}</span></div></td></tr>"
        )
    return _block(
        f'<b>{escape(item)}</b><table style="width:100%;border-collapse:collapse" cellpadding="2">{"".join(lines)}</table>',
        "font-size:0.8em;line-height:1.3;font-variant-numeric:tabular-nums",
    )


def place_in_run(view_model: ViewModel, frame: int) -> str:
    """Drive positions, time and frame number."""
    parts = [f'{escape(d.name)} <b data-mv="drive:{k}">{_position(d, frame)}</b>' for k, d in enumerate(view_model.drives)]
    parts.append(f'time <b data-mv="time">{view_model.time[frame]:.{time_decimals(view_model.time)}f} s</b>')
    parts.append(f'<span style="opacity:0.7">frame <span data-mv="frame">{frame}</span> of {view_model.frames - 1}</span>')
    ends = float(view_model.time[0]), float(view_model.time[-1])
    part_of_run = (float(view_model.time[frame]) - ends[0]) / max(ends[1] - ends[0], 1e-300)  # for the cursor of the health strip
    spans = "".join(f"<span>{part}</span>" for part in parts)
    return _block(
        f'<div data-mv-part="{part_of_run:.5f}" style="display:flex;flex-wrap:wrap;gap:0 1.3em;'
        f'font-variant-numeric:tabular-nums">{spans}</div>'
    )


def _position(drive: DriveCoordinate, frame: int) -> str:
    return f"{drive.position[frame]:.{drive.decimals}f}{unit_suffix(drive.unit)}".replace("-", "−", 1)


def scale_line(units: Units, si: str, per_metre: float, size: float) -> str:
    """The scale of a drawing, as a round value and its drawn length, "Scale: 500 N = 41 mm"; ``per_metre`` [``si`` per m]."""
    unit, factor = units.display_unit(si)
    value = round_value(LEGEND_ARROW * size * per_metre * factor)
    long, metre = units.display_unit("m")
    length = f"{format_number(float(f'{value / factor / per_metre * metre:.3g}'))} {long}"
    for big, small in (("kN", "N"), ("km/s²", "m/s²")):
        if unit == small and value >= 1000.0:
            return f"Scale: {format_number(value / 1000.0)} {big} = {length}"
    return f"Scale: {format_number(value)}{unit_suffix(unit)} = {length}"


def _swatch(color: str, thickness: float, words: str) -> str:
    return (
        '<div style="display:flex;gap:0.55em;align-items:baseline;padding-bottom:0.25em">'
        f'<span style="flex:none;width:1.3em;height:{thickness}em;border-radius:0.2em;background:{color};'
        'transform:translateY(-0.2em)"></span>'
        f"<span>{words}</span></div>"
    )


def _names(families: Iterable[str]) -> str:
    return f" ({', '.join(VECTOR_FAMILIES[f].label for f in families)})"


def _block(content: str, style: str = "") -> str:
    return f'<div style="padding:0.1em 0.85em 0.5em;{style}">{content}</div>'
