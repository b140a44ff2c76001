"""Results of a run's studies as tables and as text: force systems, reduction, shaking force, substitute masses, section forces,
closure errors of polygons."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

import numpy as np

from mechcore.arrays import Complex, Real
from mechcore.forces.section_forces import SectionForces
from mechviz.quantities.items import ColumnUnits, ItemTable

if TYPE_CHECKING:
    from mechviz.runs import Run


NEAR_POINT = 100.0
"""In sizes of the mechanism: intersections that are farther away are not checked, as the lines are nearly parallel."""
_FORCE: ColumnUnits = (("Fx", "N"), ("Fy", "N"), ("moment", "N m"))


def study_tables(run: Run) -> Iterator[ItemTable]:
    """The tables of all studies that the scene names."""
    studies = run.studies
    for name, polygons in studies.polygons.items():
        closing = np.max([polygon.closing for polygon in polygons], axis=0)
        yield ItemTable(("polygons", name, "closing"), f"{name} polygon", (("closing", "1"),), closing[:, None])
    for name, system in studies.systems.items():
        line = np.column_stack([system.force, system.moment, system.resultant.point])
        columns: ColumnUnits = (*_FORCE, ("line x", "m"), ("line y", "m"))
        yield ItemTable(("data", "systems", name, "resultant"), f"{name}.resultant", columns, line)
    if studies.systems:
        closing = np.max([s.drawing.closing for s in studies.systems.values()], axis=0)
        yield ItemTable(("polygons", "funicular", "closing"), "funicular polygon", (("closing", "1"),), closing[:, None])
    for name, centrode in studies.centrodes.items():
        for kind, places in (("fixed", centrode.fixed), ("moving", centrode.moving)):
            yield ItemTable(("data", "polodes", name, kind), f"{name}.{kind} centrode", (("x", "m"), ("y", "m")), places)
    for name, centre in studies.instant_centres.items():
        yield _places(("instant_centres", name), f"{name} of {' and '.join(centre.links)}", ("", centre.place))
    for name, drawn in studies.evolutes.items():
        yield _places(("evolutes", name), f"{name}.evolute", ("", drawn.centre))
        with np.errstate(divide="ignore"):
            radius = 1.0 / np.abs(drawn.curvature)
        yield ItemTable(("data", "evolutes", name, "radius"), f"{name}.evolute", (("radius", "m"),), radius[:, None])
    for name, circle in studies.inflection.items():
        yield _places(("inflection", name), f"{name}.inflection", ("pole", circle.pole), ("inflection pole", circle.end))
    for name, struck in studies.percussion.items():
        yield _places(("percussion", name), f"{name}.percussion", ("", struck.centre), ("line", struck.through))
        values = np.column_stack([struck.force.real, struck.force.imag, struck.moment])
        yield ItemTable(("data", "percussion", name, "inertia"), f"{name}.percussion", _FORCE, values)
    for name, masses in studies.equivalents.items():
        for pin, place in masses.pins.items():
            columns = (("x", "m"), ("y", "m"))
            values = np.column_stack([place.real, place.imag])
            yield ItemTable(("data", "equivalent", name, pin or "block"), f"{name}.{pin or 'block'}", columns, values)
    for name, r in studies.reduced.items():
        turning = r.point is None
        columns = (
            ("reduced inertia", "kg m^2") if turning else ("reduced mass", "kg"),
            ("slope", "kg m^2/rad") if turning else ("slope", "kg/m"),
            ("reduced moment", "N m") if turning else ("reduced force", "N"),
            ("kinetic energy", "J"),
        )
        values = np.column_stack([r.mass, r.slope, r.force, r.energy])
        yield ItemTable(("data", "reduced", name), f"{name}.reduced", columns, values)
    for name, s in (("", studies.shaking), ("balanced", studies.balanced)):
        if s is not None:
            path = ("data", "shaking", name) if name else ("data", "shaking")
            yield ItemTable(path, f"shaking {name}".strip(), _FORCE, np.column_stack([s.force, s.moment]))
    for name, body in studies.substitutes.items():
        path = ("data", "substitutes", name)
        yield ItemTable((*path, "inertia"), f"{name}.substitutes", _FORCE, np.column_stack([body.force, body.moment]))
        if body.correction is not None:
            columns = (("couple", "N m"),)
            yield ItemTable((*path, "correction"), f"{name}.correction", columns, body.correction[:, None])
        for k in range(len(body.masses)):
            columns = (("x", "m"), ("y", "m"), ("Fx", "N"), ("Fy", "N"), ("mass", "kg"))
            mass = np.full(len(body.places), body.masses[k])
            values = np.column_stack([body.places[:, k], body.forces[:, k], mass])
            yield ItemTable((*path, str(k + 1)), f"{name}.mass {k + 1}", columns, values)
    for name, along in studies.sections.items():
        columns = (("normal force", "N"), ("shear force", "N"), ("bending moment", "N m"), ("bending moment at", "m"))
        extremes = [along.extreme(along.normal).values, along.extreme(along.shear).values]
        extremes += [along.bending.values, along.bending.stations]
        for stress, word in ((along.bending_stress, "bending stress"), (along.stress, "normal stress")):
            if stress is not None:
                columns, extremes = (*columns, (word, "Pa")), [*extremes, stress]
        yield ItemTable(("data", "sections", name), name, columns, np.column_stack(extremes))


def _places(path: tuple[str, str], label: str, *places: tuple[str, Complex]) -> ItemTable:
    """A table of points (F,) in the plane, each with columns x and y that are named by its word."""
    columns = tuple((f"{word} {axis}".strip(), "m") for word, _ in places for axis in "xy")
    return ItemTable(("data", *path), label, columns, np.column_stack([part for _, z in places for part in (z.real, z.imag)]))


def study_lines(run: Run) -> list[str]:
    """The results of all studies that the scene names, as lines of text."""
    return list(_lines(run, run.scene.units.text))


ValueWords = Callable[[float, str], str]
"""Converts a value in an SI unit to text in the unit of the display."""


def _lines(run: Run, in_words: ValueWords) -> Iterator[str]:
    studies = run.studies
    for name, polygons in studies.polygons.items():
        worst = max(float(np.nanmax(polygon.closing, initial=0.0)) for polygon in polygons)
        if not any(polygon.edges for polygon in polygons):
            yield f"{name} polygon: empty, no pin and no traced point moves"
            continue
        yield f"{name} polygon: closes to {worst:.1e} of its longest side"
    for name, chain in studies.equivalents.items():
        bars = ", ".join("".join(ends) for ends in chain.bars) or "no bar"
        sliding = f" and {len(chain.blocks)} sliding block{'s' if len(chain.blocks) > 1 else ''}" if chain.blocks else ""
        yield f"equivalent linkage of {name}: {bars}{sliding}; it moves like the joint, up to accelerations"
    yield from _centre_lines(run, in_words)
    for name, system in studies.systems.items():
        kinds = sorted(set(map(str, system.drawing.kind)))
        worst = float(np.nanmax(system.drawing.closing, initial=0.0))
        yield f"force system {name}: {' or '.join(kinds)}; the drawing agrees with the algebra to {worst:.1e}"
    for name, r in studies.reduced.items():
        good = r.mass[np.isfinite(r.mass)]
        unit, factor = run.scene.units.display_unit("kg m^2" if r.point is None else "kg")
        if len(good):
            yield f"reduced to {name}: {factor * good.min():.5g} to {factor * good.max():.5g} {unit}"
    for what, s in (("shaking force", studies.shaking), ("with counterweights", studies.balanced)):
        if s is not None:
            forces = f"peak {in_words(s.peak, 'N')}, rms {in_words(s.rms, 'N')}"
            yield f"{what}: {forces}; moment peak {in_words(s.peak_moment, 'N m')}, rms {in_words(s.rms_moment, 'N m')}"
    for w in studies.weights:
        length, per = run.scene.units.display_unit("m", small=True)
        place = f"({per * w.at[0]:.5g}, {per * w.at[1]:.5g}) {length}"
        yield f"counterweight on {w.link}: {in_words(w.mass, 'kg')} at {place} of its frame"
    for name, body in studies.substitutes.items():
        masses = ", ".join(in_words(m, "kg") for m in body.masses)
        if body.correction is not None:
            most = float(np.abs(body.correction).max(initial=0.0))
            yield f"static replacement of {name}: {masses}, with a correction couple of up to {in_words(most, 'N m')}"
            continue
        yield f"substitute masses of {name}: {body.substitution.message}; shown is solution {body.chosen + 1}: {masses}"
    for name, section in studies.sections.items():
        yield f"section forces of {name}: {_section_words(section, run.motion.time, in_words)}"


def _centre_lines(run: Run, in_words: ValueWords) -> Iterator[str]:
    studies, size = run.studies, run.motion.model.length_scale
    centres = studies.instant_centres
    if centres:
        near = [
            c.closure_error[np.isfinite(c.closure_error) & (np.abs(c.place - c.place[0]) < NEAR_POINT * size)]
            for c in centres.values()
        ]
        yield "instant centres of " + ", ".join(f"{k} {link}" for k, link in enumerate(run.motion.model.links))
        texts = [f"{name} in {' and '.join(''.join(line.through) for line in c.lines)}" for name, c in centres.items() if c.lines]
        if texts:
            worst = float(np.max(np.concatenate(near), initial=0.0)) / size
            yield f"{', '.join(texts)}: as the velocities have them, to {worst:.1e} of the mechanism's size"
        alone = [name for name, c in centres.items() if c.determined_by == "velocities"]
        if alone:
            yield f"{', '.join(alone)}: by the velocities, as no two lines decide them"
    for name, path in studies.evolutes.items():
        bend = np.abs(path.curvature[np.isfinite(path.curvature)])
        if len(bend):
            most = 1.0 / bend.max() if bend.max() > 0.0 else np.inf
            yield f"path of {name}: smallest radius of curvature {in_words(most, 'm')}"
    for name, cam in studies.inversion.items():
        words = "the profile touches the follower in all"
        if undercut := int((cam.gap < -1e-6 * cam.base).sum()):
            words = f"undercut in {undercut}, by up to {run.scene.units.text(-cam.gap.min(), 'm', 4)}"
        sizes = f"base {'line' if cam.wedge else 'circle'} {in_words(cam.base, 'm')}, lift {in_words(cam.lifts.max(), 'm')}"
        yield f"cam {name} by inversion in {len(cam.angles)} steps: {sizes}; {words}"
    for name, circle in studies.inflection.items():
        across = np.abs(circle.end - circle.pole)
        if np.isfinite(across).any():
            unit, factor = run.scene.units.display_unit("m")
            low, high = factor * np.nanmin(across), factor * np.nanmax(across)
            yield f"inflection circle of {name}: diameter {low:.5g} to {high:.5g} {unit}"
    for name, struck in studies.percussion.items():
        arm, far = (in_words(float(np.abs(z - struck.pivot)[0]), "m") for z in (struck.mass_centre, struck.centre))
        force = float(np.nanmax(np.abs(struck.force), initial=0.0))
        words = f"{far} from it, centre of mass {arm}; inertia force up to {in_words(force, 'N')}"
        yield f"centre of percussion of {name}: {words}"


def _section_words(section: SectionForces, time: Real, in_words: ValueWords) -> str:
    """Ranges of the section forces, and the largest bending moment with its place and time, in words."""
    size = np.abs(section.bending.values)
    if not np.isfinite(size).any():
        return "not known, it jams over the whole run"
    k = int(np.nanargmax(size))
    low, high, most = (float(x) for x in (np.nanmin(section.normal), np.nanmax(section.normal), np.nanmax(np.abs(section.shear))))
    words = f"N {in_words(low, 'N').split()[0]} to {in_words(high, 'N')}, |V| up to {in_words(most, 'N')}, largest bending moment "
    place, length = in_words(section.bending.stations[k], "m"), in_words(section.axis.length, "m")
    words += f"{in_words(section.bending.values[k], 'N m')} at {place} of its {length}, {time[k]:.5g} s"
    if section.bending_stress is not None and section.stress is not None:
        bending, normal = (in_words(float(np.nanmax(s)), "Pa") for s in (section.bending_stress, section.stress))
        words += f"; bending stress up to {bending}, with the normal force {normal}"
    return words
