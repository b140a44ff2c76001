"""Studies that a scene can include beside motion and forces: graphical constructions, reductions, shaking, substitute masses.

The requested studies are part of the mechanism (`Studies`); `compute` evaluates these over a motion, and no others.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field, replace

import numpy as np

from mechcore.arrays import Real
from mechcore.constructions.centres import (
    InflectionCircle,
    InstantCentre,
    PathCurvature,
    Percussion,
    inflection_circle,
    kennedy,
    path_curvature,
    percussion,
)
from mechcore.constructions.equivalents import Equivalent, equivalent
from mechcore.constructions.force_polygons import Funicular, force_polygons, funicular
from mechcore.constructions.inversion import CamInversion, cam_inversions
from mechcore.constructions.polygons import Centrodes, Polygon, acceleration_polygon, centrodes, velocity_polygon
from mechcore.errors import Fault, MechanismError
from mechcore.forces.kinetostatics import Forces, loads_on
from mechcore.forces.section_forces import SectionForces, all_sections
from mechcore.motion.motion import Motion
from mechcore.records import dataclass
from mechcore.reduction.balancing import Counterweight, Shaking, counterweights, find_linkage, shaking, with_counterweights
from mechcore.reduction.bodies import acceleration_field
from mechcore.reduction.reduced import Reduced, Resultant, reduce_mechanism, reduce_to, resultant
from mechcore.reduction.substitute import PointMass, Substitution, static_replacement, substitute_masses
from mechcore.spec.studies import ShakingStudy, SubstituteStudy, SystemStudy


@dataclass(frozen=True, eq=False)
class SystemResult:
    """The loads on one link as a force system: reduced to a point ``about`` (F, 2), its resultant, and the drawing that constructs
    it."""

    names: tuple[str, ...]
    about: Real
    force: Real
    moment: Real
    resultant: Resultant
    drawing: Funicular


@dataclass(frozen=True, eq=False)
class SubstituteResult:
    """``masses`` (n,) [kg] at ``places`` (F, n, 2) [m] of the world with inertia forces ``forces`` (F, n, 2) [N]; their resultant
    ``force`` (F, 2) and ``moment`` (F,) about S; ``substitution`` holds all solutions, ``chosen`` is the number of the one shown.
    For a static replacement, ``correction`` (F,) [N m] is the couple that makes the inertia forces exact; the moment includes
    it."""

    substitution: Substitution
    chosen: int
    masses: Real
    places: Real
    forces: Real
    force: Real
    moment: Real
    correction: Real | None = None


@dataclass(frozen=True, eq=False)
class StudyResults:
    """Results of the requested studies; the others are empty."""

    polygons: Mapping[str, tuple[Polygon, ...]] = field(default_factory=dict)
    centrodes: Mapping[str, Centrodes] = field(default_factory=dict)
    equivalents: Mapping[str, Equivalent] = field(default_factory=dict)
    systems: Mapping[str, SystemResult] = field(default_factory=dict)
    reduced: Mapping[str, Reduced] = field(default_factory=dict)
    shaking: Shaking | None = None
    balanced: Shaking | None = None  # with the counterweights
    weights: tuple[Counterweight, ...] = ()
    substitutes: Mapping[str, SubstituteResult] = field(default_factory=dict)
    sections: Mapping[str, SectionForces] = field(default_factory=dict)
    instant_centres: Mapping[str, InstantCentre] = field(default_factory=dict)
    evolutes: Mapping[str, PathCurvature] = field(default_factory=dict)
    inflection: Mapping[str, InflectionCircle] = field(default_factory=dict)
    percussion: Mapping[str, Percussion] = field(default_factory=dict)
    inversion: Mapping[str, CamInversion] = field(default_factory=dict)


def compute(motion: Motion, forces: Forces | None) -> StudyResults:
    """The results of a mechanism's studies. Raises `MechanismError` where one of them has no solution."""
    asked = motion.mechanism.studies
    polygons: dict[str, tuple[Polygon, ...]] = {}
    if "velocity" in asked.polygons:
        polygons["velocity"] = (velocity_polygon(motion),)
    if "acceleration" in asked.polygons:
        polygons["acceleration"] = (acceleration_polygon(motion),)
    if "force" in asked.polygons and forces is not None:
        polygons["force"] = force_polygons(forces)
    loads = () if forces is None else forces.applied
    result = StudyResults(
        polygons=polygons,
        centrodes={name: centrodes(motion, name) for name in asked.centrodes},
        equivalents={name: equivalent(motion, name, forces) for name in asked.equivalent},
        systems={s.name: _system(s, forces) for s in asked.systems if forces is not None},
        reduced={_place(*at): reduce_mechanism(motion, *at, loads) for at in asked.reduced},
        substitutes={s.link: _substitute(s, motion) for s in asked.substitutes},
        sections={} if forces is None else dict(all_sections(forces)),
        instant_centres=kennedy(motion, asked.instant_centres) if asked.instant_centres else {},
        evolutes={_place(*at): path_curvature(motion, *at) for at in asked.evolutes},
        inflection={link: inflection_circle(motion, link) for link in asked.inflection},
        inversion={name: drawn for joint in asked.inversion for name, drawn in cam_inversions(motion, joint).items()},
        percussion={_place(*at): percussion(motion, *at) for at in asked.percussion},
    )
    return result if asked.shaking is None else _shaken(result, asked.shaking, motion)


def _place(link: str, point: str | None) -> str:
    return link if point is None else f"{link}.{point}"


def _system(study: SystemStudy, forces: Forces) -> SystemResult:
    motion = forces.motion
    k = motion.model.index[study.link]
    chosen = [load for load in loads_on(forces, k) if not study.loads or load.name in study.loads]
    if not chosen:
        why = f"no load acts on '{study.link}'."
        raise MechanismError(Fault(f"systems.{study.name}", why, "Add loads on it, or effects such as gravity."))
    points = np.stack([motion._rows(load.place) for load in chosen], axis=1)
    vectors = np.stack([motion._rows(load.force) for load in chosen], axis=1)
    couples = np.stack([np.broadcast_to(np.asarray(load.moment, float), (motion.frames,)) for load in chosen], axis=1)
    local = 0j if study.point is None else motion.model.points[k][study.point]
    about = motion._rows(motion.of_point(k, local))
    force, moment = reduce_to(points, vectors, couples, about=about)
    names = tuple(load.label for load in chosen)
    if study.pole is not None:
        _check_pole(study, vectors, motion)
    drawing = funicular(points, vectors, couples, pole=study.pole, names=names)
    return SystemResult(names, about, force, moment, resultant(points, vectors, couples), drawing)


def _check_pole(study: SystemStudy, vectors: Real, motion: Motion) -> None:
    """Refuse a pole on the line of a side of the force polygon: its strings are parallel to that force and do not meet its line."""
    f = vectors[..., 0] + 1j * vectors[..., 1]
    ray = np.cumsum(f, axis=1) - complex(*(study.pole or (0.0, 0.0)))
    with np.errstate(invalid="ignore"):
        size = np.abs(f).sum(axis=1)
        flat = (np.abs(np.imag(np.conj(ray) * f)) <= 1e-9 * np.abs(f) * size[:, None]) & (np.abs(f) > 1e-12 * size[:, None])
    if flat.any():
        frame = int(np.argmax(flat.any(axis=1)))
        why = f"the pole lies on the line of a force of its polygon at {motion.time[frame]:.4g} s: a string lies along that force."
        raise MechanismError(Fault(f"systems.{study.name}.pole", why, "Choose a pole beside the polygon, or leave it out."))


def _substitute(study: SubstituteStudy, motion: Motion) -> SubstituteResult:
    k = motion.model.index[study.link]
    mass, centre, inertia = motion.model.masses[k]
    points = [
        PointMass(m, None if x is None else x - centre.real, None if y is None else y - centre.imag) for m, x, y in study.points
    ]
    path = f"substitutes.{study.link}"
    try:
        excess = 0.0
        if study.static:
            solved, excess = _static(mass, inertia, points)
        else:
            solved = substitute_masses(mass, inertia, points)
    except MechanismError as error:
        raise MechanismError([replace(f, path=path) for f in error.faults]) from None
    if study.solution > len(solved.solutions):
        remedy = "Choose other places or masses." if not solved.solutions else f"Give solution = 1 to {len(solved.solutions)}."
        raise MechanismError(Fault(path, f"{solved.message}.", remedy))
    masses, places = solved.solutions[study.solution - 1]
    turned = (places @ np.array([1.0, 1.0j]))[None, :] * np.broadcast_to(motion.rotation(k), motion.frames)[:, None]
    arms = np.stack([turned.real, turned.imag], axis=-1)
    rotation_class = motion.model.angles.rotation_class[k]
    omega, alpha = (
        np.broadcast_to(v, motion.frames)
        for v in (motion.speeds.angular[rotation_class], motion.accelerations.angular[rotation_class])
    )
    correction = excess * np.array(alpha) if study.static else None
    single = -masses[:, None] * acceleration_field(arms, motion.centre_of_mass(study.link, 2), omega, alpha)
    return SubstituteResult(
        substitution=solved,
        chosen=study.solution - 1,
        masses=masses,
        places=motion.centre_of_mass(study.link)[:, None, :] + arms,
        forces=single,
        force=single.sum(axis=1),
        moment=(arms[..., 0] * single[..., 1] - arms[..., 1] * single[..., 0]).sum(axis=1) + excess * alpha,
        correction=correction,
    )


def _static(mass: float, inertia: float, points: list[PointMass]) -> tuple[Substitution, float]:
    """Two masses at given positions, and the excess of their moment of inertia over the body's."""
    if len(points) != 2 or any(p.mass is not None or p.x is None or p.y is None for p in points):
        raise MechanismError(Fault("", "a static replacement has two masses at given places.", "Give each its place, and no mass."))
    places = np.array([[p.x, p.y] for p in points], float)
    joint = static_replacement(mass, inertia, *places)
    return Substitution(((np.array(joint.masses), places),), "static replacement by two masses"), joint.excess


def _shaken(result: StudyResults, study: ShakingStudy, motion: Motion) -> StudyResults:
    own = shaking(motion, study.about)
    if study.radii is None:
        return replace(result, shaking=own)
    weights = counterweights(find_linkage(motion.mechanism), study.radii, fraction=study.fraction)
    better = {link.name: link for link in with_counterweights(motion.mechanism, weights).links}
    masses: list[tuple[float, complex, float]] = []
    for name, known in zip(motion.model.links, motion.model.masses, strict=True):
        link = better.get(name)
        masses.append(known if link is None else (link.mass, complex(*link.centre), link.inertia))
    return replace(result, shaking=own, balanced=shaking(motion, study.about, masses), weights=weights)
