"""Derivatives by parameters: closed forms of the four-bar, differences of eighth order on every kind of mechanism, the way back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mechanisms import case, four_bar, slider_crank
from random_mechanisms import KINDS, draw

from mechcore.derivatives.exact import Derivatives
from mechcore.derivatives.model_numbers import Parameter
from mechcore.errors import MechanismError
from mechcore.forces.kinetostatics import solve_forces
from mechcore.laws.timed import ConstantSpeed, Free
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion
from mechcore.numerics.tape_functions import new_tape
from mechcore.spec.loads import Spring, Torque

LENGTHS = case("design", "sensitivities-four-bar")
FEW = 12  # frames


def solved(mechanism, time):
    motion = solve_motion(compile_mechanism(mechanism), time)
    return motion, solve_forces(motion)


def reference_four_bar(lengths, start):
    given = LENGTHS["inputs"]
    return four_bar(
        E=(lengths["d"], 0.0), AB=lengths["a"], BD=lengths["b"], DE=lengths["c"], start=start, speed=given["omega2"],
        loads=(Torque(name="M", link="rocker", moment=given["M4"]),),
    )  # fmt: skip


@pytest.mark.parametrize("row", LENGTHS["expected"]["rows"], ids=lambda row: f"{row['theta_deg']}")
def test_a_four_bar_agrees_with_its_closed_forms(row):
    nominal = {k: LENGTHS["inputs"][k] for k in "abcd"}
    start = np.radians(row["theta_deg"])
    motion, _ = solved(reference_four_bar(nominal, start), [0.0])
    parameters = [Parameter(k, x, 0.1, lambda y, k=k: reference_four_bar(nominal | {k: y}, start)) for k, x in nominal.items()]
    derivatives = Derivatives(motion, parameters)
    pull = derivatives.forces.reaction("D")
    along = np.exp(1j * row["theta3"])
    tension = pull[:, 0] * along.real + pull[:, 1] * along.imag  # at a nominal direction: its turning counts apart
    d_angle, d_rate, d_tension = derivatives.of(
        derivatives.motion.pose("rocker")[:, 2], derivatives.motion.velocity("rocker")[:, 2], tension
    )
    for k, name in enumerate(nominal):
        assert d_angle[k, 0] == pytest.approx(row["dpsi"][name], rel=1e-10)
        assert d_rate[k, 0] == pytest.approx(row["domega4"][name], rel=1e-10)
        assert abs(d_tension[k, 0]) == pytest.approx(abs(row["dcoupler_force"][name]), rel=1e-10)


def moved_together(m, rng):
    """A mechanism as a function of one number that moves all points, masses and friction in some direction, those that lie at
    one place, as axes of wheels do, together."""
    drift = {(link.name, xy): rng.uniform(-1.0, 1.0, 2) for link in m.links for xy in link.points.values()}
    growth = {link.name: rng.uniform(0.5, 1.0) for link in m.links}

    def at(x):
        links = []
        for link in m.links:
            points = {p: tuple(np.asarray(xy) + x * drift[link.name, xy]) for p, xy in link.points.items()}
            links.append(replace(link, points={p: (float(a), float(b)) for p, (a, b) in points.items()},
                                 mass=link.mass * (1.0 + x * growth[link.name])))  # fmt: skip
        return replace(m, links=tuple(links), joints=tuple(rougher(joint, x) for joint in m.joints))

    return at


def rougher(joint, x):
    """A joint with more friction."""
    own = getattr(joint, "friction", None)
    return joint if own is None else replace(joint, friction=replace(own, coefficient=own.coefficient * (1.0 + x)))


def asked(motion, forces):
    result = [forces.reaction(c.name) for c in motion.model.connections]
    result += [forces.effort(d.joint) for d in motion.mechanism.drives]
    result += [motion.acceleration(link) for link in motion.model.links[1:]]
    return result + [motion.coordinate(c.name) for c in motion.model.connections if c.kind != "weld"]


def difference(values, h):
    """Derivative at 0 by differences of eighth order with steps h."""
    weights = ((1, 4 / 5), (2, -1 / 5), (3, 4 / 105), (4, -1 / 280))
    sides = [(w, values(k * h), values(-k * h)) for k, w in weights]
    return [sum(w * (a - b) / h for (w, _, _), a, b in zip(sides, *pairs, strict=True)) for pairs in by_result(sides)]


def by_result(sides):
    for k in range(len(sides[0][1])):
        yield [above[k] for _, above, _ in sides], [below[k] for _, _, below in sides]


def drawn(kind, rubs):
    """The first mechanism of a kind that can be led through its run, all frames far from dead points and jams."""
    for seed in range(30):
        drawing = draw(kind, seed, forces=False, friction=rubs)
        if drawing.free or rubs is not ("friction" in drawing.mechanism.effects):
            continue
        time = drawing.time[:: max(len(drawing.time) // FEW, 1)]
        try:
            motion, forces = solved(drawing.mechanism, time)
        except MechanismError:
            continue
        jams = forces.friction is not None and forces.friction.jammed.any()
        if not motion.singular_points and np.max(motion.condition) < 30.0 and drawing.mechanism.effects and not jams:
            return drawing.mechanism, motion, forces
    raise LookupError(kind)


RUBBING = ("slider-crank", "pin in slot", "rack", "cam", "rolling", "several drives")


@pytest.mark.sample(6)
@pytest.mark.parametrize(("kind", "rubs"), [*((k, False) for k in KINDS), *((k, True) for k in RUBBING)])
def test_every_kind_of_mechanism_agrees_with_differences(kind, rubs):
    compare(*drawn(kind, rubs))


@pytest.mark.parametrize(("kind", "seed"), [("belt", 17), ("gear", 19), ("cylinder", 9)])
def test_friction_that_changes_which_side_carries_is_followed(kind, seed):
    """Of a belt the tight span, of gears the flank; the cylinder has a joint in which nothing but rounding acts."""
    drawing = draw(kind, seed, forces=False, friction=True)
    compare(drawing.mechanism, *solved(drawing.mechanism, drawing.time[:: len(drawing.time) // FEW]))


def compare(m, motion, forces):
    at = moved_together(m, np.random.default_rng(5))
    derivatives = Derivatives(motion, [Parameter("x", 0.0, 0.01, at)])
    traced = asked(derivatives.motion, derivatives.forces)
    exact = derivatives.of(*traced)
    close = [difference(lambda x: asked(*solved(at(x), motion.time)), h) for h in (2e-3, 3e-4)]
    plain = asked(motion, forces)
    largest = max(np.max(np.abs(value)) for value in plain)
    for value, ours, *theirs in zip(plain, exact, *close, strict=True):
        size = max(np.max(np.abs(theirs[0])), 1e-3 * np.max(np.abs(value)), 1e-4 * largest)
        assert min(np.max(np.abs(ours[0] - other)) for other in theirs) <= 1e-9 * size
    result = traced[-2]
    weights = np.random.default_rng(1).normal(size=(2, *result.shape))
    forward = (weights * exact[-2]).reshape(2, -1).sum(axis=1)
    np.testing.assert_allclose(
        derivatives.adjoint(result, weights)[:, 0], forward, rtol=1e-11, atol=1e-11 * np.abs(exact[-2]).max()
    )


def test_frames_keep_their_place_in_the_cycle_where_its_time_varies():
    def at(speed):
        return slider_crank(r=0.1, l=0.35, speed=speed, effects=("inertia",),
                            bodies={"rod": (2.0, (0.1, 0.0), 0.01), "piston": (1.5, (0.0, 0.0), 0.0)})  # fmt: skip

    def times(m):
        return default_times(m, FEW)

    motion, forces = solved(at(30.0), times(at(30.0)))
    derivatives = Derivatives(motion, [Parameter("speed", 30.0, 1.0, at)], times)
    d_torque, d_place = derivatives.of(derivatives.forces.effort("O"), derivatives.motion.pose("piston"))
    np.testing.assert_allclose(d_torque[0], 2.0 * forces.effort("O") / 30.0, rtol=1e-12, atol=1e-12)  # inertia goes with its square
    np.testing.assert_allclose(d_place[0], 0.0, atol=1e-15)


def test_numbers_of_loads_and_points_that_are_zero_vary_too():
    def at(stiffness=400.0, offset=0.0):
        spring = Spring(name="k", links=("frame", "piston"), points=("O", "C"), stiffness=stiffness, free_length=0.2)
        return slider_crank(r=0.1, l=0.35, e=offset, loads=(spring,))

    time = np.linspace(0.1, 3.0, FEW)
    motion, _ = solved(at(), time)
    derivatives = Derivatives(
        motion, [Parameter("k", 400.0, 40.0, lambda k: at(k)), Parameter("e", 0.0, 0.01, lambda e: at(offset=e))]
    )
    torque, place = derivatives.forces.effort("O"), derivatives.motion.pose("piston")[:, 0]
    d_torque, d_place = derivatives.of(torque, place)
    np.testing.assert_allclose(d_torque[0], torque.value / 400.0, rtol=1e-12)
    # x = r cos q + sqrt(l^2 - (r sin q - e)^2)
    drop = 0.1 * np.sin(time)
    np.testing.assert_allclose(d_place[1], drop / np.sqrt(0.35**2 - drop**2), rtol=1e-11, atol=1e-13)


def test_what_has_no_derivatives_is_refused_with_its_reason():
    m = slider_crank(r=0.1, l=0.35)
    free = replace(m, drives=(replace(m.drives[0], law=Free(0.0, 1.0)),))
    motion, _ = solved(free, [0.0, 0.1])
    with pytest.raises(MechanismError, match="forces decide the motion"):
        Derivatives(motion, [])
    motion, _ = solved(m, [0.0, 0.1])
    with pytest.raises(MechanismError, match="not change smoothly with r"):
        Derivatives(motion, [Parameter("r", 0.1, 0.01, lambda r: slider_crank(r=0.1 + abs(r - 0.1), l=0.35))])
    with pytest.raises(MechanismError, match="another one"):
        Derivatives(motion, [Parameter("law", 1.0, 0.1, lambda w: four_bar(E=(4.0, 0.0), AB=1.0, BD=3.5, DE=3.0, speed=w))])
    assert isinstance(m.drives[0].law, ConstantSpeed)


def test_lengths_that_vanish_have_their_one_sided_slopes():
    """How fast they grow with the parameter: beside the tip of a cone they are no straight lines. Backwards there is none."""
    tape = new_tape()
    p = tape.variable(np.array([0.0, 3.0]))
    given = {p.number: np.ones((1, 2))}
    lengths = [np.hypot(3.0 * p, -4.0 * p), np.abs((3.0 - 4.0j) * p), np.abs(-5.0 * p), np.hypot(0.0 * p, 0.0)]
    slopes = [d[0] for d in tape.forward(given, lengths)]
    np.testing.assert_allclose(slopes, [[5.0, 5.0]] * 3 + [[0.0, 0.0]], rtol=1e-15)
    back = tape.adjoint(lengths[0], np.array([[1.0, 1.0], [0.0, 1.0]]))[p.number]
    np.testing.assert_allclose(back, [[np.nan, 5.0], [0.0, 5.0]], rtol=1e-15)
