"""The order of solution in words: the steps of a mechanism's programs, forwards to its motion and back to its forces."""

from __future__ import annotations

from mechcore.forces.balance import Balance, balance_program
from mechcore.kinematics.model import Model
from mechcore.kinematics.program import Block, Unknown
from mechcore.topology.graph import FRAME

FORMS = {
    "theta_theta": "a e1 + b e2 = c",
    "theta_slide": "a e + s d = c",
    "arm_slide": "(a + s d) e = c",
    "slide_slide": "s1 d1 + s2 d2 = c",
    "angle": "a e = c",
    "slide": "s d = c",
    "check": "nothing is left to solve: it only has to close",
    "relation": "sum of coordinates",
    "general": "Newton's method",
}
"""How each kind of `Block` is solved, e = exp(i angle)."""


def solution_order(model: Model) -> list[str]:
    """Lines of text: what the drives decide, what every block solves and how, what balances there on the way back to the drives.

    Loops have the numbers that they have among the loop equations.
    """
    program, back = model.program, model.once(balance_program)
    steps = [f"{_drives(model, turned.drives)} turn{'s' * (len(turned.drives) == 1)} {_turned(model, turned.rotation_class)}"
             for turned in program.driven_rotations]  # fmt: skip
    steps += [f"drive {model.joints[j].name} moves along its guide" for j, _ in program.driven_slides]
    steps += [_solved(model, block) for block in program.blocks]
    lines = ["order of solution, e = exp(i angle): forwards to positions, velocities and accelerations"]
    lines += [f"  {n}. {words}" for n, words in enumerate(steps, 1)]
    if model.needs_global_solve:
        return [*lines, "joint forces: of all joints together"]
    lines.append("back to joint forces, from the loads and inertia forces on the links")
    steps = [_balanced(model, block, balances) for _, block, balances in back.blocks if block.kind != "check"]
    steps.append("link by link towards the frame: equilibrium gives the forces in all other joints, couples and drives")
    return lines + [f"  {n}. {words}" for n, words in enumerate(steps, 1)]


def _drives(model: Model, drives: tuple[tuple[int, int], ...]) -> str:
    names = [model.mechanism.drives[d].joint for d, _ in drives]
    return f"drive{'s' * (len(names) > 1)} {' and '.join(names)}"


def _turned(model: Model, rotation_class: int) -> str:
    """The links of a rotation class, with what they turn against where that is not the frame."""
    links = ", ".join(model.links[k] for k, s in enumerate(model.angles.rotation_class) if s == rotation_class)
    group = model.angles.class_group[rotation_class]
    others = [model.links[k] for k in model.angles.links_of[group] if model.angles.rotation_class[k] != rotation_class]
    return links if group == model.angles.class_group[FRAME] else f"{links} against {', '.join(others)}"


def _solved(model: Model, block: Block) -> str:
    unknowns = ", ".join(_unknown(model, u) for u in block.unknowns)
    return f"{block.name}: {FORMS[block.kind]}, {_equations(model, block)}{': ' * bool(unknowns)}{unknowns}"


def _equations(model: Model, block: Block) -> str:
    loops = [f"loop{'s' * (len(block.loops) > 1)} {', '.join(str(c + 1) for c in block.loops)}"] if block.loops else []
    return " and ".join(loops + [f"{model.relations[r].kind} {model.relations[r].name}" for r in block.relations])


def _unknown(model: Model, unknown: Unknown) -> str:
    what, i = unknown
    if what == "slide":
        return f"displacement {model.joints[i].name}"
    return f"angle of {', '.join(model.links[k] for k in model.angles.links_of[i])}"


def _balanced(model: Model, block: Block, balances: tuple[Balance, ...]) -> str:
    cuts = [model.joints[model.loops[c].closing].name for c in block.loops] + [model.relations[r].name for r in block.relations]
    works = ", ".join(_work(model, b) for b in balances)
    return f"{block.name}: {works}: force{'s' * (len(cuts) > 1)} in {', '.join(cuts)}"


def _work(model: Model, balance: Balance) -> str:
    what, i = balance.unknown
    if what == "angle":
        return f"moments on {', '.join(model.links[k] for k in balance.links)}"
    return f"forces along {model.joints[i].name}"
