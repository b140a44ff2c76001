"""The numbers of a run's studies as tables: force systems, reduction, shaking, substitute masses, section forces,
closing errors of polygons."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from mechcore.arrays import Complex, Real
from mechcore.forces.section_forces import SectionForces
from mechviz.quantities.items import Columns, Table

if TYPE_CHECKING:
    from mechviz.runs import Run


NEAR = 100.0
"""Sizes of the mechanism: lines that meet farther off are not judged, as they are nearly parallel."""
_FORCE: Columns = (("Fx", "N"), ("Fy", "N"), ("moment", "N m"))


def study_tables(run: Run) -> Iterator[Table]:
    """All tables of what the scene asks for; nothing where it asks for nothing."""
    studies = run.studies
    for name, polygons in studies.polygons.items():
        closing = np.max([polygon.closing for polygon in polygons], axis=0)
        yield Table(("polygons", name, "closing"), f"{name} plan", (("closing", "1"),), closing[:, None])
    for name, system in studies.systems.items():
        line = np.column_stack([system.force, system.moment, system.resultant.point])
        columns: Columns = (*_FORCE, ("line x", "m"), ("line y", "m"))
        yield Table(("data", "systems", name, "resultant"), f"{name}.resultant", columns, line)
    if studies.systems:
        closing = np.max([s.drawing.closing for s in studies.systems.values()], axis=0)
        yield Table(("polygons", "funicular", "closing"), "funicular polygon", (("closing", "1"),), closing[:, None])
    for name, centrode in studies.centrodes.items():
        for kind, places in (("fixed", centrode.fixed), ("moving", centrode.moving)):
            yield Table(("data", "polodes", name, kind), f"{name}.{kind} polode", (("x", "m"), ("y", "m")), places)
    for name, centre in studies.instant_centres.items():
        yield _places(("instant_centres", name), f"{name} of {' and '.join(centre.links)}", ("", centre.place))
    for name, drawn in studies.evolutes.items():
        yield _places(("evolutes", name), f"{name}.evolute", ("", drawn.centre))
        with np.errstate(divide="ignore"):
            radius = 1.0 / np.abs(drawn.curvature)
        yield Table(("data", "evolutes", name, "radius"), f"{name}.evolute", (("radius", "m"),), radius[:, None])
    for name, circle in studies.inflection.items():
        yield _places(("inflection", name), f"{name}.inflection", ("pole", circle.pole), ("inflection pole", circle.end))
    for name, struck in studies.percussion.items():
        yield _places(("percussion", name), f"{name}.percussion", ("", struck.centre), ("line", struck.through))
        values = np.column_stack([struck.force.real, struck.force.imag, struck.moment])
        yield Table(("data", "percussion", name, "inertia"), f"{name}.percussion", _FORCE, values)
    for name, masses in studies.equivalents.items():
        for pin, place in masses.pins.items():
            columns = (("x", "m"), ("y", "m"))
            values = np.column_stack([place.real, place.imag])
            yield Table(("data", "equivalent", name, pin or "block"), f"{name}.{pin or 'block'}", columns, values)
    for name, r in studies.reduced.items():
        turning = r.point is None
        columns = (
            ("reduced inertia", "kg m^2") if turning else ("reduced mass", "kg"),
            ("slope", "kg m^2/rad") if turning else ("slope", "kg/m"),
            ("reduced moment", "N m") if turning else ("reduced force", "N"),
            ("kinetic energy", "J"),
        )
        values = np.column_stack([r.mass, r.slope, r.force, r.energy])
        yield Table(("data", "reduced", name), f"{name}.reduced", columns, values)
    for name, s in (("", studies.shaking), ("balanced", studies.balanced)):
        if s is not None:
            path = ("data", "shaking", name) if name else ("data", "shaking")
            yield Table(path, f"shaking {name}".strip(), _FORCE, np.column_stack([s.force, s.moment]))
    for name, body in studies.substitutes.items():
        path = ("data", "substitutes", name)
        yield Table((*path, "inertia"), f"{name}.substitutes", _FORCE, np.column_stack([body.force, body.moment]))
        if body.correction is not None:
            columns = (("couple", "N m"),)
            yield Table((*path, "correction"), f"{name}.correction", columns, body.correction[:, None])
        for k in range(len(body.masses)):
            columns = (("x", "m"), ("y", "m"), ("Fx", "N"), ("Fy", "N"), ("mass", "kg"))
            mass = np.full(len(body.places), body.masses[k])
            values = np.column_stack([body.places[:, k], body.forces[:, k], mass])
            yield Table((*path, str(k + 1)), f"{name}.mass {k + 1}", columns, values)
    for name, along in studies.sections.items():
        columns = (("normal force", "N"), ("shear force", "N"), ("bending moment", "N m"), ("bending moment at", "m"))
        extremes = [along.extreme(along.normal).values, along.extreme(along.shear).values]
        extremes += [along.bending.values, along.bending.stations]
        for stress, word in ((along.bending_stress, "bending stress"), (along.stress, "normal stress")):
            if stress is not None:
                columns, extremes = (*columns, (word, "Pa")), [*extremes, stress]
        yield Table(("data", "sections", name), name, columns, np.column_stack(extremes))


def _places(path: tuple[str, str], label: str, *places: tuple[str, Complex]) -> Table:
    """Places (F,) of the plane, each called by a word, as columns x and y."""
    columns = tuple((f"{word} {axis}".strip(), "m") for word, _ in places for axis in "xy")
    return Table(("data", *path), label, columns, np.column_stack([part for _, z in places for part in (z.real, z.imag)]))


def study_lines(run: Run) -> list[str]:
    """One line for each result; none where nothing was asked for."""
    return list(_lines(run))


def _lines(run: Run) -> Iterator[str]:
    studies = run.studies
    for name, polygons in studies.polygons.items():
        worst = max(float(np.nanmax(polygon.closing, initial=0.0)) for polygon in polygons)
        if not any(polygon.edges for polygon in polygons):
            yield f"{name} plan: empty, no pin and no traced point moves"
            continue
        yield f"{name} plan: closes to {worst:.1e} of its longest side"
    for name, chain in studies.equivalents.items():
        bars = ", ".join("".join(ends) for ends in chain.bars) or "no bar"
        sliding = f" and {len(chain.blocks)} sliding block{'s' if len(chain.blocks) > 1 else ''}" if chain.blocks else ""
        yield f"equivalent linkage of {name}: {bars}{sliding}; it moves like the joint, up to accelerations"
    yield from _centre_lines(run)
    for name, system in studies.systems.items():
        kinds = sorted(set(map(str, system.drawing.kind)))
        worst = float(np.nanmax(system.drawing.closing, initial=0.0))
        yield f"force system {name}: {' or '.join(kinds)}; the drawing agrees with the algebra to {worst:.1e}"
    for name, r in studies.reduced.items():
        good = r.mass[np.isfinite(r.mass)]
        unit = "kg m²" if r.point is None else "kg"
        if len(good):
            yield f"reduced to {name}: {good.min():.5g} to {good.max():.5g} {unit}"
    for what, s in (("shaking force", studies.shaking), ("with counterweights", studies.balanced)):
        if s is not None:
            yield f"{what}: peak {s.peak:.5g} N, rms {s.rms:.5g} N; moment peak {s.peak_moment:.5g} N m, rms {s.rms_moment:.5g} N m"
    for w in studies.weights:
        yield f"counterweight on {w.link}: {w.mass:.5g} kg at ({w.at[0]:.5g}, {w.at[1]:.5g}) m of its frame"
    for name, body in studies.substitutes.items():
        masses = ", ".join(f"{m:.5g} kg" for m in body.masses)
        if body.correction is not None:
            most = float(np.abs(body.correction).max(initial=0.0))
            yield f"static replacement of {name}: {masses}, with a correction couple of up to {most:.5g} N m"
            continue
        yield f"substitute masses of {name}: {body.substitution.message}; shown is solution {body.chosen + 1}: {masses}"
    for name, forces in studies.sections.items():
        yield f"section forces of {name}: {_section_words(forces, run.motion.time)}"


def _centre_lines(run: Run) -> Iterator[str]:
    studies, size = run.studies, run.motion.model.length_scale
    centres = studies.instant_centres
    if centres:
        near = [c.gap[np.isfinite(c.gap) & (np.abs(c.place - c.place[0]) < NEAR * size)] for c in centres.values()]
        yield "instant centres of " + ", ".join(f"{k} {link}" for k, link in enumerate(run.motion.model.links))
        texts = [f"{name} in {' and '.join(''.join(line.through) for line in c.lines)}" for name, c in centres.items() if c.lines]
        if texts:
            worst = float(np.max(np.concatenate(near), initial=0.0)) / size
            yield f"{', '.join(texts)}: as the velocities have them, to {worst:.1e} of the mechanism's size"
        alone = [name for name, c in centres.items() if c.found_by == "velocities"]
        if alone:
            yield f"{', '.join(alone)}: by the velocities, as no two lines decide them"
    for name, path in studies.evolutes.items():
        bend = np.abs(path.curvature[np.isfinite(path.curvature)])
        if len(bend):
            most = 1e3 / bend.max() if bend.max() > 0.0 else np.inf
            yield f"path of {name}: smallest radius of curvature {most:.5g} mm"
    for name, cam in studies.inversion.items():
        words = "the profile touches the follower in all"
        if undercut := int((cam.gap < -1e-6 * cam.base).sum()):
            words = f"undercut in {undercut}, by up to {-1e3 * cam.gap.min():.4g} mm"
        sizes = f"base {'line' if cam.wedge else 'circle'} {1e3 * cam.base:.5g} mm, lift {1e3 * cam.lifts.max():.5g} mm"
        yield f"cam {name} by inversion in {len(cam.angles)} steps: {sizes}; {words}"
    for name, circle in studies.inflection.items():
        across = np.abs(circle.end - circle.pole)
        if np.isfinite(across).any():
            low, high = 1e3 * np.nanmin(across), 1e3 * np.nanmax(across)
            yield f"inflection circle of {name}: diameter {low:.5g} to {high:.5g} mm"
    for name, struck in studies.percussion.items():
        arm, far = (1e3 * float(np.abs(z - struck.pivot)[0]) for z in (struck.mass_centre, struck.centre))
        force = float(np.nanmax(np.abs(struck.force), initial=0.0))
        words = f"{far:.5g} mm from it, centre of mass {arm:.5g} mm; inertia force up to {force:.5g} N"
        yield f"centre of percussion of {name}: {words}"


def _section_words(section: SectionForces, time: Real) -> str:
    """Ranges and the largest bending moment, with its place and time."""
    size = np.abs(section.bending.values)
    if not np.isfinite(size).any():
        return "not known, it jams over the whole run"
    k = int(np.nanargmax(size))
    low, high = float(np.nanmin(section.normal)), float(np.nanmax(section.normal))
    words = f"N {low:.5g} to {high:.5g} N, |V| up to {float(np.nanmax(np.abs(section.shear))):.5g} N, largest bending moment "
    place, length = 1e3 * section.bending.stations[k], 1e3 * section.axis.length
    words += f"{section.bending.values[k]:.5g} N m at {place:.5g} mm of its {length:.5g} mm, {time[k]:.5g} s"
    if section.bending_stress is not None and section.stress is not None:
        bending, normal = (1e-6 * float(np.nanmax(s)) for s in (section.bending_stress, section.stress))
        words += f"; bending stress up to {bending:.5g} MPa, with the normal force {normal:.5g} MPa"
    return words
