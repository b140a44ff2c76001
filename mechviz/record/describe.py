"""What a recording says about itself: properties, connectivity, notes."""

from __future__ import annotations

import json
from base64 import b64encode
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING, Any

from mechcore.powers import power_labels, power_table

from ..power_report import power_markdown
from ..quantities import Catalogue
from ..study_words import study_lines
from ..vectors import Scales
from .nodes import listed
from .paths import entity
from .simulations import simulation_notes

if TYPE_CHECKING:
    from ..meshes import Solids
    from ..picture import Picture
    from ..run import Run, Stage

__all__ = ["SCHEMA", "accuracy_words", "model_json", "notes", "package_version", "properties", "recorded_frames", "scene_text"]

SCHEMA = 2
"""Version of the recording contract; a change of meaning raises it."""


@cache
def package_version() -> str:
    """The version of mechviz."""
    try:
        return version("mechviz")
    except PackageNotFoundError:  # run from a source folder that was never installed
        return "unknown"


def scene_text(run: Run) -> str:
    """The scene as TOML: the file's own text where there is one."""
    return getattr(run.scene, "text", "") or run.scene.to_toml()


def scene_files(run: Run) -> dict[str, str]:
    """The files that the scene names, by these names, in base64: with them a recording can be run again anywhere."""
    return {name: b64encode(data).decode("ascii") for name, data in run.scene.files.items()}


def model_json(run: Run) -> str:
    """The connectivity that a reader needs to check the physics, as JSON."""
    n = run.numbers
    model = {
        "frame": n.frame,
        "links": n.links,
        "joints": {j.name: {"type": j.kind, "links": list(j.links)} for j in n.joints.values()},
        "drives": n.drives,
        "loads": {name: {"kind": load.kind, "links": list(load.links)} for name, load in n.loads.items()},
        "traced": n.traced,
    }
    return json.dumps(model, ensure_ascii=False)


def properties(run: Run, picture: Picture, wall_seconds: float, *, complete: bool) -> dict[str, Any]:
    """The recording's properties; lists of strings as arrow arrays, so that an empty one keeps its type."""
    import pyarrow as pa

    scales = picture.scales
    return {
        "schema": SCHEMA,
        "version": package_version(),
        "scene": run.scene.name,
        "title": run.scene.title or run.scene.name,
        "frames": recorded_frames(run),
        "tolerance": run.numbers.tolerance,
        "length_scale": run.numbers.length_scale,
        "cycle": run.numbers.cycle,
        "size": picture.size,
        "bounds": json.dumps(picture.bounds.tolist()),
        "top": picture.top,
        "picture": listed(picture),
        "quantities": listed_quantities(run.catalogue),
        "model": model_json(run),
        "effects": pa.array(list(run.plan.effects), pa.string()),
        "skipped": pa.array([s.name for s in run.plan.skipped], pa.string()),
        "newtons_per_metre": scales.newtons_per_metre,
        "newton_metres_per_metre": scales.newton_metres_per_metre,
        "mps_per_metre": scales.mps_per_metre,
        "mps2_per_metre": scales.mps2_per_metre,
        "wall_seconds": wall_seconds,
        **_simulated(run),
        "accuracy": json.dumps(_stated(run)),
        "interpolation": run.accuracy.interpolation,
        "files": json.dumps(scene_files(run)),
        "power_items": pa.array([] if run.forces is None else power_labels(run.forces), pa.string()),
        "complete": complete,
    }


def listed_quantities(catalogue: Catalogue) -> str:
    """The catalogue as JSON: of every quantity its key, label, unit and curves, and the entity that holds it."""
    found = [
        {"key": q.key, "label": q.label, "unit": q.unit, "curves": list(q.curves), "entity": entity(*q.path)}
        for q in catalogue.quantities
    ]
    return json.dumps(found, ensure_ascii=False)


def _stated(run: Run) -> dict[str, Any]:
    """The dials that are not at their defaults, with those that followed from a target."""
    if run.accuracy.target is None:
        return run.accuracy.changed
    return {**run.kept.changed, "frames": run.motion.frames - 1}


def recorded_frames(run: Run) -> int:
    """Frames that a recording holds."""
    return (run.motion.frames - 1) // run.accuracy.decimation + 1


def accuracy_words(run: Run) -> tuple[str, ...]:
    """What the run says of its own errors, in lines."""
    worst = run.errors.worst()
    words = ", ".join(f"{name.replace('_', ' ')} {value:.1e}" for name, value in worst.items())
    lines = [f"estimated errors, relative: {words}"]
    if run.accuracy.target is not None:
        from ..accuracy.words import target_words

        lines += target_words(run)
    return tuple(lines)


def _simulated(run: Run) -> dict[str, Any]:
    """How the motion was found, where forces decide it."""
    s = run.simulation
    return {} if s is None else {"duration": s.duration, "method": s.method, "motion_tolerance": s.tolerance}


def notes(run: Run, solids: Solids, scales: Scales, stages: list[Stage], every: int, *, complete: bool) -> str:
    """Markdown: what was computed, what was left out and why, what each stage cost, what an arrow's length means."""
    scene, plan = run.scene, run.plan
    lines = [f"# {scene.title or scene.name}", "", scene.teaches, ""]
    if not complete:
        lines += ["**Unfinished**: writing was interrupted; the frames up to then are here.", ""]
    lines += ["## Computed", "", *(f"- **{s.name}**: {s.why}" for s in plan.computed), ""]
    lines += ["## Left out", "", *(f"- **{s.name}**: {s.why}" for s in plan.skipped), ""]
    found = study_lines(run)
    if found:
        lines += ["## Studies", "", *(f"- {line}" for line in found), ""]
    lines += ["## Cost", "", "| stage | time [ms] |", "|---|---|"]
    lines += [f"| {s.name} | {1e3 * s.seconds:.1f} |" for s in stages]
    shown = [
        (scales.newtons_per_metre, "N of force per metre of an arrow"),
        (scales.newton_metres_per_metre, "N m of moment per metre of an arc's length"),
        (scales.mps_per_metre, "m/s of velocity per metre of an arrow"),
        (scales.mps2_per_metre, "m/s² of acceleration per metre of an arrow"),
    ]
    if run.forces is not None:
        lines += ["", *power_markdown(power_table(run.forces))]
    lines += simulation_notes(run)
    lines += ["", "## Accuracy", "", *(f"- {line}" for line in accuracy_words(run))]
    lines += ["", "## Scales", "", *(f"- {value:.6g} {what}" for value, what in shown)]
    lines += ["- arrows shorter than 1.5 % of the mechanism's size are not drawn"]
    if every > 1:
        lines += [f"- arrows are drawn at every {every}th frame; all numbers under /data are there at every frame"]
    for a, b in solids.clashes:
        lines += ["", f"The solids of {a} and {b} pass through each other: no order of layers avoids it."]
    return "\n".join(lines) + "\n"
