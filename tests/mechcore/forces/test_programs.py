"""Programs of steps: plain data that another executor can run, and the order of solution in words."""

import cmath
from dataclasses import fields, is_dataclass

import numpy as np
import pytest

import mechviz
from mechcore.forces.equilibrium import balance_program, solution_order
from mechcore.kinematics.program import NonlinearTerm
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion

SCENES = ("contour-lever", "slider-crank-compressor", "ten-link-forces", "triad", "two-guides", "scotch-yoke", "planetary-gear")


def leaves(value):
    """The numbers and texts that nested tuples and dataclasses are made of."""
    if isinstance(value, tuple):
        for item in value:
            yield from leaves(item)
    elif is_dataclass(value):
        for field in fields(value):
            if not (isinstance(value, NonlinearTerm) and field.name == "function"):
                yield from leaves(getattr(value, field.name))
    else:
        yield value


@pytest.mark.parametrize("name", [*SCENES, "cam-roller"])
def test_programs_are_indices_numbers_and_words(name):
    model = compile_mechanism(mechviz.load(name).mechanism).model
    for program in (model.program, balance_program(model)):
        assert {type(leaf) for leaf in leaves(program)} <= {int, float, complex, str, bool, type(None)}


def one_frame(program, constants, drives, near):
    """Rotations and displacements at one frame: every block by Newton's method, from ``near`` (rotations, displacements)."""
    angle: dict[int, float] = {}
    delta, slide = [1.0] * len(near[0]), {j: drives[d] for j, d in program.driven_slides}
    for rotation_class, terms in program.driven_rotations:
        delta[rotation_class] = cmath.exp(1j * sum(sign * drives[d] for d, sign in terms))
    rot = [delta[s] if s in program.classes_of[0] else None for s in range(len(delta))]

    def total(vectors, turned):
        arms = sum(a * turned[s] for s, a in vectors.arms)
        return vectors.constant + arms + sum(d * turned[s] * slide[j] for j, s, d in vectors.slides)

    for block in program.blocks:
        loops = [program.loop_equations[c] for c in block.loops]
        targets = [total(loop.target, rot) for loop in loops]
        arms = [[total(arm, delta) for arm in loop.arms] for loop in loops]

        def residual(x, block=block, loops=loops, targets=targets, arms=arms, angle=angle, slide=slide):
            e = np.exp(1j * x)
            rows = []
            for loop, target, own in zip(loops, targets, arms, strict=True):
                left = sum(a * e[k] for k, a in enumerate(own)) - target
                for j, carrier, s, d in loop.slides:
                    left += x[len(block.angles) + block.slides.index(j)] * d * (rot[s] if carrier < 0 else delta[s] * e[carrier])
                rows += [left.real, left.imag]
            for r in block.relations:
                t, known = program.constraints[r], dict(zip(block.unknowns, x, strict=True))
                assert t.curve is None
                left = sum(c * drives[d] for d, c in t.drives) - constants[r]
                left += sum(c * known.get(("angle", g), angle.get(g)) for g, c in t.groups)
                rows.append(left + sum(c * known.get(("slide", j), slide.get(j)) for j, c in t.slides))
            return np.array(rows)

        at_start = [
            near[2].get(g, cmath.phase(near[0][program.classes_of[g][0]] / delta[program.classes_of[g][0]])) for g in block.angles
        ]
        x = np.array([*at_start, *(near[1][j] for j in block.slides)])
        x = x + 1e-3
        for _ in range(8 if len(x) else 0):
            columns = np.array([(residual(x + h) - residual(x - h)) / 2e-6 for h in 1e-6 * np.eye(len(x))]).T
            x = x - np.linalg.lstsq(columns, residual(x), rcond=1e-9)[0]
        for g, q in zip(block.angles, x, strict=False):
            angle[g] = q
            for s in program.classes_of[g]:
                rot[s] = cmath.exp(1j * q) * delta[s]
        slide |= dict(zip(block.slides, x[len(block.angles) :], strict=True))
    return rot, slide


@pytest.mark.parametrize("name", SCENES)
def test_another_executor_needs_nothing_but_the_program(name):
    mechanism = mechviz.load(name).mechanism
    compiled = compile_mechanism(mechanism)
    motion = solve_motion(compiled, default_times(mechanism, 12))
    state = motion.state
    for frame in (1, 5, 8):
        at = lambda x, frame=frame: complex(np.broadcast_to(x, motion.frames)[frame])  # noqa: E731
        drives = [float(d[0][frame]) for d in motion.drives]
        near = (
            [at(r) for r in state.rot],
            {j: at(s).real for j, s in state.slide.items()},
            {g: at(a).real for g, a in state.angle.items()},
        )
        rot, slide = one_frame(compiled.model.program, compiled.assembly.constants, drives, near)
        assert np.allclose(rot, near[0], rtol=0.0, atol=1e-9)
        assert all(abs(slide[j] - s) < 1e-9 * compiled.model.length_scale for j, s in near[1].items())


def test_order_of_solution_reads_like_a_textbook():
    words = solution_order(compile_mechanism(mechviz.load("contour-lever").mechanism).model)
    assert [line.strip() for line in words[1:4]] == [
        "1. drive O turns crank",
        "2. S: (a + s d) e = c, loop 1: angle of block, lever, displacement S",
        "3. T: a e + s d = c, loop 2: angle of coupler, displacement T",
    ]
    assert [line.strip() for line in words[5:7]] == [
        "1. T: moments on coupler, forces along T: force in D",
        "2. S: moments on block, lever, forces along S: force in S",
    ]
