"""Goal of a scene: its variables and measures, and a check that reports all faults at once; with a run it checks quantities too."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mechcore.errors import Fault, MechanismError
from mechviz.quantities.catalogue import Catalogue
from mechviz.scene.faults import in_file_order
from mechviz.scene.kinds.settings import GoalDocument
from mechviz.scene.scene import Scene
from mechviz.studies.designs.measures import parse_measure, quantity_of
from mechviz.studies.designs.variables import Variable, parameters_of


def goal_of(scene: Scene) -> GoalDocument:
    """The goal of a scene. Raises `MechanismError` where it has none."""
    if scene.document.goal is None:
        remedy = 'Say what to look for: [goal] minimise = "drive.A.torque:peak".'
        raise MechanismError(Fault("goal", "the scene has no goal.", remedy))
    return scene.document.goal


def path_measures(point: str) -> tuple[str, str]:
    """The measures (x and y) of the path of a traced point."""
    return f"point.{point}.position[x]", f"point.{point}.position[y]"


def goal_variables(scene: Scene, goal: GoalDocument) -> tuple[Variable, ...]:
    """The variables of a goal that has no faults: those that it names, or else all parameters with a range."""
    own = {v.name: v for v in parameters_of(scene)}
    return tuple(own[name] for name in goal.vary) or tuple(v for v in own.values() if _varies(v))


def check_goal(scene: Scene, catalogue: Catalogue | None = None) -> None:
    """Raise `MechanismError` with all faults of a scene's goal; a scene without a goal has none. With the catalogue of a run,
    measures of quantities that the catalogue does not have are faults too."""
    goal = scene.document.goal
    if goal is None:
        return
    faults = list(_faults_of_variables(scene, goal))
    for text, path, is_number in _asked(goal):
        try:
            measure = parse_measure(scene, text)
            if is_number and not measure.reducer:
                remedy = f"Say what of it counts: {text}:peak, :max, :min or :rms."
                faults.append(Fault(path, f"'{text}' is a curve.", remedy))
            if measure.reducer and not is_number:
                faults.append(Fault(path, f"'{text}' is a number.", "Leave out what is behind the colon."))
            if catalogue is not None:
                measure.column(quantity_of(measure, catalogue))
        except MechanismError as error:
            faults += [Fault(path, fault.message, fault.remedy) for fault in error.faults]
    if faults:
        raise MechanismError(in_file_order(faults, scene.document.to_data()))


def _varies(variable: Variable) -> bool:
    return bool(np.isfinite(variable.low) and np.isfinite(variable.high))


def _faults_of_variables(scene: Scene, goal: GoalDocument) -> Iterator[Fault]:
    own = {v.name: v for v in parameters_of(scene)}
    for name in goal.vary:
        if name not in own or not _varies(own[name]):
            why = "has no range" if name in own else "follows from others" if name in scene.parameters else "is no parameter"
            remedy = "Name a parameter that stands for itself, with a range: r = { value = '30 mm', range = ['20 mm', '50 mm'] }."
            yield Fault("goal.vary", f"'{name}' {why}.", remedy)
    if not goal.vary and not any(map(_varies, own.values())):
        yield Fault("goal", "no parameter has a range in which it may vary.", "Give parameters a range.")


def _asked(goal: GoalDocument) -> Iterator[tuple[str, str, bool]]:
    """The measures of a goal as text, each with its key in the scene, and whether it has to be a number."""
    yield from ((text, "goal.minimise", True) for text in goal.minimise)
    yield from ((text, "goal.maximise", True) for text in goal.maximise)
    yield from ((text, f"goal.limits.{text}", True) for text in goal.limits)
    if goal.follow is not None:
        yield goal.follow.quantity, "goal.follow.quantity", False
    if goal.path is not None:
        yield path_measures(goal.path.point)[0], "goal.path.point", False
