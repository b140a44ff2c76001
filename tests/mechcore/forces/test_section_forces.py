"""Section forces along links against closed forms, equilibrium of every cut, and invariance."""

import cmath
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from support.mechanisms import four_bar, pin, slider_crank

from mechcore.errors import MechanismError
from mechcore.forces.kinetostatics import Forces, solve_forces
from mechcore.forces.section_forces import SectionForces, guide_load, section_forces
from mechcore.forces.section_lines import Cuts, MassPart, SectionAxis, axis_of, mass_line
from mechcore.laws.timed import ConstantSpeed, Law, Oscillation
from mechcore.motion.solve import compile_mechanism, solve_motion
from mechcore.spec.loads import Actuator, Force, GasSpring, Load, Spring, Torque, TorsionDamper, TorsionSpring
from mechcore.spec.mechanism import Drive, Friction, Link, Mechanism, Prismatic, Weld
from mechcore.spec.studies import CrossSection, SectionStudy

LENGTH, MASS, SPEED = 0.8, 2.4, 11.0
BAR = (MASS, (LENGTH / 2, 0.0), MASS * LENGTH**2 / 12)


def solved(mechanism: Mechanism, times: Sequence[float]) -> Forces:
    return solve_forces(solve_motion(compile_mechanism(mechanism), np.asarray(times, float)))


def sections(mechanism: Mechanism, link: str, times: Sequence[float] = (0.0,), **more: object) -> SectionForces:
    return section_forces(solved(mechanism, times), SectionStudy(link=link, **more))  # type: ignore[arg-type]


def bar(law: Law, *, effects: tuple[str, ...] = ("inertia",), **more: object) -> Mechanism:
    """A uniform bar from the pin A on the frame to its free end B."""
    mass, centre, inertia = BAR
    link = Link(name="bar", points={"A": (0.0, 0.0), "B": (LENGTH, 0.0)}, mass=mass, centre=centre, inertia=inertia)
    frame = Link(name="frame", points={"A": (0.0, 0.0)})
    drives = (Drive(joint="A", law=law),)
    return Mechanism(
        name="bar", frame="frame", links=(frame, link), joints=(pin("A", "frame", "bar"),), drives=drives, effects=effects, **more
    )  # type: ignore[arg-type]


def inside(diagrams: SectionForces) -> np.ndarray:
    """The stations of the first frame that lie between the ends."""
    return (diagrams.stations[0] > 0.0) & (diagrams.stations[0] < diagrams.axis.length)


def test_a_beam_in_uniform_rotation_is_pulled_by_the_masses_farther_out() -> None:
    diagrams = sections(bar(ConstantSpeed(0.3, SPEED)), "bar", [0.0, 0.1])
    k, s = inside(diagrams), diagrams.stations
    pull = MASS / LENGTH * SPEED**2 * (LENGTH**2 - s**2) / 2.0
    assert np.allclose(diagrams.normal[:, k], pull[:, k], rtol=1e-12)
    scale = pull.max()
    assert np.abs(diagrams.shear).max() < 1e-12 * scale
    assert np.abs(diagrams.moment).max() < 1e-12 * scale * LENGTH


@pytest.mark.parametrize(
    "load",
    [
        TorsionSpring(name="couple", links=("bar", "frame"), stiffness=2.0),
        TorsionDamper(name="couple", links=("frame", "bar"), coefficient=0.3),
        Torque(name="couple", link="bar", moment=4.0, against="frame"),
    ],
)
def test_a_couple_between_two_links_acts_where_they_are_pinned(load: Load) -> None:
    """The drive in the same pin holds it: nothing is left inside the bar, whose frame has its origin at the other end."""
    held = bar(ConstantSpeed(0.3, SPEED), effects=(), loads=(load,))
    frame = Link(name="frame", points={"B": (0.2, 0.1)})
    held = replace(
        held, links=(frame, held.links[1]), joints=(pin("B", "frame", "bar"),), drives=(Drive(joint="B", law=held.drives[0].law),)
    )
    forces = solved(held, [0.0, 0.1])
    assert np.abs(forces.effort("B")).min() > 0.5
    np.testing.assert_allclose(forces.loads["couple"].values[:, 3:], [[0.2, 0.1]] * 2)
    diagrams = section_forces(forces, SectionStudy(link="bar"))
    assert np.abs(diagrams.moment[:, inside(diagrams)]).max() < 1e-12


def test_a_rod_that_falls_about_its_end_bends_most_at_a_third_of_its_length() -> None:
    """M(s) = m g s (1 - s/L)^2 / 4, largest m g L / 27 at L/3: why falling chimneys break. The law starts with 3 g / (2 L)."""
    w = 3.0
    amplitude = 1.5 * 9.81 / (LENGTH * w * w)
    law = Oscillation(-amplitude, amplitude, w / (2.0 * math.pi), 0.5 * math.pi)
    mechanism = bar(law, effects=("inertia", "gravity"))
    forces = solved(mechanism, [0.0])
    assert abs(forces.effort("A")[0]) < 1e-9 * MASS * 9.81 * LENGTH  # it falls freely
    diagrams = section_forces(forces, SectionStudy(link="bar", section=CrossSection(area=4e-4, modulus=2e-6)))
    s = diagrams.stations[0]
    assert np.allclose(np.abs(diagrams.moment[0]), MASS * 9.81 * s * (1.0 - s / LENGTH) ** 2 / 4.0, atol=1e-11)
    assert abs(diagrams.bending.values[0]) == pytest.approx(MASS * 9.81 * LENGTH / 27.0, rel=1e-8)
    assert diagrams.bending.stations[0] == pytest.approx(LENGTH / 3.0, rel=1e-3)
    assert diagrams.bending_stress is not None
    assert diagrams.bending_stress[0] == pytest.approx(MASS * 9.81 * LENGTH / 27.0 / 2e-6, rel=1e-8)
    # and so is the whole stress, which is looked for between stations, too: with N = m g (L - s)^2 cos / (2 L^2) of a bar aslant
    q = np.linspace(0.0, LENGTH, 2_000_001)
    sizes = [np.interp(q, s, np.abs(diagrams.normal[0])) / 4e-4, MASS * 9.81 * q * (1.0 - q / LENGTH) ** 2 / 4.0 / 2e-6]
    assert diagrams.stress is not None
    assert diagrams.stress[0] == pytest.approx(np.max(sum(sizes)), rel=1e-8)
    assert diagrams.stress[0] >= diagrams.bending_stress[0]


def test_a_connecting_rod_at_speed_bends_most_near_its_length_over_the_root_of_three() -> None:
    """Between pins, under an inertia load that is linear along the rod: -q0 s (L-s)(2L-s)/(6L) - q1 s (L-s)(L+s)/(6L)."""
    bodies = {"rod": (MASS, (0.4, 0.0), MASS * 0.8**2 / 12)}
    mechanism = slider_crank(r=0.1, l=0.8, speed=50.0, bodies=bodies, effects=("inertia",))
    times = np.linspace(0.0, 2.0 * math.pi / 50.0, 97)
    forces = solved(mechanism, times)
    diagrams = section_forces(forces, SectionStudy(link="rod"))
    motion = forces.motion
    across = 1j * np.exp(1j * motion.pose("rod")[:, 2])
    q0, q1 = (-MASS / 0.8 * np.real(np.conj(across) * (motion.point("rod", p, 2) @ [1.0, 1.0j])) for p in ("B", "C"))
    s, length = diagrams.stations, 0.8
    moment = -(q0[:, None] * (2 * length - s) + q1[:, None] * (length + s)) * s * (length - s) / (6.0 * length)
    assert np.allclose(diagrams.moment, moment, atol=1e-11 * np.abs(moment).max())
    # where the slider is not accelerated the load is a triangle: largest at L / sqrt 3 from the slider
    slider = motion.acceleration("piston")[:, 0]
    k = int(np.flatnonzero(np.diff(np.sign(slider)))[0])
    still = times[k] - slider[k] * (times[k + 1] - times[k]) / (slider[k + 1] - slider[k])
    triangle = sections(mechanism, "rod", [still])
    q = np.interp(still, times, q0)
    assert triangle.bending.stations[0] == pytest.approx(length * (1.0 - 1.0 / math.sqrt(3.0)), rel=2e-3)
    assert abs(triangle.bending.values[0]) == pytest.approx(abs(q) * length**2 / (9.0 * math.sqrt(3.0)), rel=2e-3)


def plunger(bearing: str, *, load: tuple[float, float] = (30.0, -200.0), coefficient: float = 0.0) -> Mechanism:
    """A stem that slides along y in a guide 0.1 long, loaded at its foot 0.2 below the point that slides."""
    points = {"foot": (0.0, -0.2), "G": (0.0, 0.0), "top": (0.0, 0.3)}
    frame, stem = Link(name="frame", points={"G": (0.0, 0.0)}), Link(name="stem", points=points)
    friction = Friction(coefficient=coefficient, length=0.1, offset=0.02, bearing=bearing)  # type: ignore[arg-type]
    guide = Prismatic(name="S", links=("frame", "stem"), points=("G", "G"), along=(0.0, 1.0), friction=friction)
    drives = (Drive(joint="S", law=Oscillation(0.0, 0.04, 1.0)),)
    loads = (Force(name="F", link="stem", point="foot", vector=load),)
    effects = ("friction",) if coefficient else ()
    return Mechanism(
        name="plunger", frame="frame", links=(frame, stem), joints=(guide,), drives=drives, loads=loads, effects=effects
    )


@pytest.mark.parametrize("bearing", ["guide", "slider"])
def test_the_pressure_of_a_guide_is_linear_along_it(bearing: str) -> None:
    times = np.linspace(0.0, 1.0, 9)
    mechanism = plunger(bearing)
    forces = solved(mechanism, times)
    diagrams = section_forces(forces, SectionStudy(link="stem", points=("foot", "top")))
    lift = forces.motion.coordinate("S")[:, 0]
    middle = 0.22 - lift if bearing == "guide" else np.full(len(times), 0.22)  # from the foot
    load = guide_load(forces, mechanism.joints[0])  # type: ignore[arg-type]
    # two unknown forces at the ends of the bearing hold the side force of the foot
    ahead = 30.0 * (middle - 0.05) / 0.1  # moments about the other end
    assert np.allclose(np.abs(load.ends[:, 0]), 30.0 + ahead)
    assert np.allclose(np.abs(load.ends[:, 1]), ahead)
    assert np.allclose(np.abs(load.ends.sum(axis=1)), 30.0)
    # below the bearing a cantilever, above it nothing; at the lower edge the pressure begins
    for k in range(len(times)):
        s = diagrams.stations[k]
        below = (s > 0.0) & (s < middle[k] - 0.05)
        assert np.allclose(np.abs(diagrams.moment[k, below]), 30.0 * s[below])
        above = s > middle[k] + 0.05
        assert np.abs(diagrams.moment[k, above]).max() < 1e-12
        x = s - middle[k]
        within = np.abs(x) < 0.05 - 1e-9
        turn = 30.0 * middle[k]
        y = x[within]
        wanted = 30.0 * s[within] - 30.0 * (y + 0.05) ** 2 / 0.2 - 12.0 * turn / 0.1**3 * (y + 0.05) ** 2 * (0.1 - y) / 6.0
        assert np.allclose(np.abs(diagrams.moment[k, within]), np.abs(wanted), atol=1e-10)
    assert diagrams.unbalanced.max() < 1e-10


def test_friction_of_a_guide_acts_along_its_bearing() -> None:
    forces = solved(plunger("guide", coefficient=0.2), np.linspace(0.01, 0.2, 5))
    diagrams = section_forces(forces, SectionStudy(link="stem", points=("foot", "top")))
    assert diagrams.unbalanced.max() < 1e-10
    assert forces.friction is not None
    rubs = forces.friction.wrench("S")[:, 1]
    assert (np.abs(rubs) > 20.0).all()
    lift = forces.motion.coordinate("S")[:, 0]
    for k in range(5):  # the foot's load below the bearing and where the drive acts, nothing above
        below, above = (np.argmin(np.abs(diagrams.stations[k] - (0.22 - lift[k] + x))) for x in (-0.07, 0.07))
        assert diagrams.normal[k, below] == pytest.approx(200.0)
        assert abs(diagrams.normal[k, above]) < 1e-9
        # friction pulls evenly along the bearing, the drive's force is one jump
        assert np.ptp(diagrams.normal[k]) == pytest.approx(200.0 + abs(rubs[k]))


def test_the_slope_of_the_moment_is_the_shear_force_between_loads() -> None:
    """The equilibrium of every short piece, of a coupler with a mass beside its axis, weight, inertia and a load."""
    bodies = {"coupler": (1.7, (0.11, 0.0), 0.019), "rocker": (0.8, (0.1, 0.0), 0.004)}
    load = Force(name="F", link="coupler", point="Q", vector=(20.0, -70.0))
    mechanism = four_bar(
        E=(0.5, 0.0), AB=0.15, BD=0.4, DE=0.3, speed=9.0, bodies=bodies, loads=(load,), effects=("inertia", "gravity"),
        extra={"coupler": {"Q": (0.25, 0.0)}},
    )  # fmt: skip
    for link in ("crank", "coupler", "rocker"):
        diagrams = sections(mechanism, link, np.linspace(0.0, 0.6, 7))
        steps = np.diff(diagrams.stations, axis=1)
        regular = steps > 1e-3 * diagrams.axis.length
        mean = 0.5 * (diagrams.shear[:, 1:] + diagrams.shear[:, :-1])
        slope = np.diff(diagrams.moment, axis=1)[regular] / steps[regular]
        scale = np.abs(diagrams.shear).max() + 1e-12
        assert np.abs(slope - mean[regular]).max() < 2e-3 * scale  # trapezoids, of curves of the third degree
        assert diagrams.unbalanced.max() < 1e-11 * np.abs(diagrams.normal).max()
        assert np.abs(diagrams.moment[:, [0, -1]]).max() < 1e-11 * (1.0 + np.abs(diagrams.moment).max())


def test_an_axis_with_corners_and_a_load_beside_it() -> None:
    """A bent bracket welded to the frame, loaded at its tip: forces turn at the corner, the moment does not jump."""
    points = {"O": (0.0, 0.0), "K": (0.0, 0.3), "T": (0.4, 0.3)}
    frame, arm = (
        Link(name="frame", points={"O": (0.0, 0.0)}),
        Link(name="arm", points=points, mass=3.0, centre=(0.1, 0.2), inertia=0.02),
    )
    weld = Weld(name="W", links=("frame", "arm"), points=("O", "O"))
    loads = (Force(name="F", link="arm", point="T", vector=(0.0, -50.0)),)
    mechanism = Mechanism(
        name="bracket", frame="frame", links=(frame, arm), joints=(weld,), loads=loads, effects=("gravity",), standstill=0.0
    )
    diagrams = sections(mechanism, "arm", points=("O", "K", "T"))
    assert diagrams.unbalanced[0] < 1e-11
    s = diagrams.stations[0]
    corner = np.flatnonzero(np.abs(s - 0.3) < 1e-12)
    assert diagrams.moment[0, corner[0]] == pytest.approx(diagrams.moment[0, corner[-1]], rel=1e-6)
    assert diagrams.normal[0, corner[0]] == pytest.approx(-abs(diagrams.shear[0, corner[-1]]), rel=1e-6)
    foot = np.flatnonzero(s == 0.0)[-1]
    assert diagrams.moment[0, foot] == pytest.approx(-(50.0 * 0.4 + 3.0 * 9.81 * 0.1), rel=1e-6)
    straight = sections(mechanism, "arm", points=("O", "K"))  # the load at T is passed on by a rigid arm
    assert straight.unbalanced[0] < 1e-11
    assert straight.moment[0, np.flatnonzero(straight.stations[0] == 0.0)[-1]] == pytest.approx(diagrams.moment[0, foot], rel=1e-6)


PULLS = (
    Spring(name="F", links=("frame", "bar"), points=("H", "B"), stiffness=100.0, free_length=0.1),
    GasSpring(name="F", links=("frame", "bar"), points=("H", "B"), force=-50.0, extended=0.6, gas_length=5.0),
    Actuator(name="F", links=("frame", "bar"), points=("H", "B"), force=-50.0),
)


@pytest.mark.parametrize("pull", PULLS, ids=lambda pull: type(pull).__name__)
@pytest.mark.parametrize("bar_first", [False, True])
def test_a_pull_between_two_points_bends_each_link_from_its_own_point_on(pull: Spring, bar_first: bool) -> None:
    """A clamped bar whose tip is pulled slantwise towards a point above its middle: whichever link the load names first, the
    moment grows evenly from the tip on."""
    base = bar(ConstantSpeed(start=0.0, speed=0.0), effects=())
    frame, beam = base.links
    height, back = 0.3, LENGTH / 2
    frame = replace(frame, points={**frame.points, "H": (LENGTH - back, height)})
    if bar_first:
        pull = replace(pull, links=pull.links[::-1], points=pull.points[::-1])
    mechanism = replace(
        base, links=(frame, beam), joints=(Weld(name="A", links=("frame", "bar"), points=("A", "A")),), drives=(), loads=(pull,)
    )
    diagrams = sections(mechanism, "bar")
    load = solved(mechanism, (0.0,)).loads["F"].values[0]
    along, across = np.array([-back, height]) / math.hypot(back, height) * np.hypot(*load[:2])
    s = diagrams.stations[0]
    within = (s > 0.0) & (s < LENGTH)
    assert np.hypot(*load[:2]) > 30.0
    np.testing.assert_allclose(diagrams.normal[0, within], along, rtol=1e-12)
    np.testing.assert_allclose(diagrams.shear[0, within], -across, rtol=1e-12)
    np.testing.assert_allclose(diagrams.moment[0, within], across * (LENGTH - s[within]), rtol=1e-10)


def test_turned_scaled_and_reversed_links_carry_the_same() -> None:
    bodies = {"rod": (1.3, (0.2, 0.03), 0.02), "crank": (0.5, (0.05, 0.0), 0.001)}
    mechanism = slider_crank(r=0.1, l=0.5, speed=20.0, bodies=bodies, effects=("inertia", "gravity"))
    times = np.linspace(0.0, 0.3, 5)
    diagrams = sections(mechanism, "rod", times)
    back = sections(mechanism, "rod", times, points=("C", "B"))
    scale = np.abs(diagrams.normal).max()
    assert np.allclose(back.normal[:, ::-1], diagrams.normal, atol=1e-7 * scale)
    assert np.allclose(back.shear[:, ::-1], diagrams.shear, atol=1e-7 * scale)
    assert np.allclose(back.moment[:, ::-1], -diagrams.moment, atol=1e-7 * scale)
    turn = cmath.exp(0.7j)

    def turned(xy: tuple[float, float]) -> tuple[float, float]:
        z = complex(*xy) * turn
        return z.real, z.imag

    rod = next(k for k in mechanism.links if k.name == "rod")
    other = replace(rod, points={k: turned(xy) for k, xy in rod.points.items()}, centre=turned(rod.centre))
    again = sections(replace(mechanism, links=tuple(other if k is rod else k for k in mechanism.links)), "rod", times)
    assert np.allclose(again.moment, diagrams.moment, atol=1e-9 * scale)
    large = [
        replace(
            k, points={n: (3.0 * x, 3.0 * y) for n, (x, y) in k.points.items()},
            centre=(3.0 * k.centre[0], 3.0 * k.centre[1]), inertia=9.0 * k.inertia,
        )
        for k in mechanism.links
    ]  # fmt: skip
    thrice = sections(replace(mechanism, links=tuple(large), gravity=(0.0, -29.43)), "rod", times)
    assert np.allclose(thrice.normal, 3.0 * diagrams.normal, atol=1e-9 * scale)
    assert np.allclose(thrice.moment, 9.0 * diagrams.moment, atol=1e-9 * scale)


def test_the_distribution_of_mass_meets_mass_centre_and_inertia() -> None:
    random = np.random.default_rng(3)
    straight, bent = SectionAxis(np.array([0.1 + 0.2j, 0.7 + 0.5j])), SectionAxis(np.array([0j, 0.3 + 0j, 0.3 + 0.4j]))
    for axis in (straight, bent):
        for _ in range(60):
            centre = complex(*random.uniform(-0.3, 0.9, 2))
            whole = MassPart(float(random.uniform(0.1, 5.0)), centre, float(10.0 ** random.uniform(-5.0, 0.5)))
            known = [MassPart(0.05, complex(*random.uniform(0.0, 0.5, 2)), 1e-6)] if random.random() < 0.3 else []
            rest = whole.inertia - 0.05 * sum(
                abs(k.centre - centre) ** 2 * (1.0 + 0.05 / (whole.mass - 0.05)) + 2e-5 for k in known
            )
            if rest < 0.0:
                continue
            line = mass_line(axis, whole, known)
            mass, first, inertia = line.beyond(Cuts(np.zeros(1), np.array([-1.0])))
            assert mass[0] == pytest.approx(whole.mass)
            assert abs(first[0]) < 1e-12
            assert inertia[0] == pytest.approx(whole.inertia, rel=1e-9)
            cuts = np.linspace(0.0, axis.length, 200)
            assert (np.diff(line.beyond(Cuts(cuts, np.ones(200)))[0]) <= 1e-12).all()  # no mass is negative


def test_a_tapered_rod_has_a_linear_density() -> None:
    """Density (1 + s/L): mass 3/2, centre 5/9 L, moment of inertia 13/162 of mass times length squared."""
    line = mass_line(SectionAxis(np.array([0j, 1.0 + 0j])), MassPart(1.5, 5.0 / 9.0 + 0j, 1.5 * 13.0 / 162.0))
    (spread,) = line.distributed
    assert not line.points
    assert line.extra < 1e-15
    assert np.allclose(spread.density, [1.0, 1.0, 0.0], atol=1e-12)


def test_known_masses_stay_where_they_are() -> None:
    ball = MassPart(0.5, 1.0 + 0j, 0.0)  # a uniform rod of 2 kg with a ball at its end
    centre = (2.0 * 0.5 + 0.5 * 1.0) / 2.5
    inertia = 2.0 / 12.0 + 2.0 * (0.5 - centre) ** 2 + 0.5 * (1.0 - centre) ** 2
    line = mass_line(SectionAxis(np.array([0j, 1.0 + 0j])), MassPart(2.5, centre + 0j, inertia), [ball])
    assert np.allclose(line.distributed[0].density, [2.0, 0.0, 0.0], atol=1e-12)
    assert np.allclose(line.beyond(Cuts(np.array([0.0, 0.25, 0.999999]), np.ones(3)))[0], [2.5, 2.0, 0.500002])


def test_the_axis_of_a_link_runs_through_what_acts_on_it() -> None:
    mechanism = four_bar(E=(0.5, 0.0), AB=0.15, BD=0.4, DE=0.3, extra={"coupler": {"Q": (0.5, 0.0), "P": (0.2, 0.1)}})
    assert axis_of(mechanism, "coupler").length == pytest.approx(0.4)
    loaded = replace(mechanism, loads=(Force(name="F", link="coupler", point="Q", vector=(1.0, 0.0)),))
    assert axis_of(loaded, "coupler").length == pytest.approx(0.5)
    aside = replace(mechanism, loads=(Force(name="F", link="coupler", point="P", vector=(1.0, 0.0)),))
    assert axis_of(aside, "coupler").length == pytest.approx(0.4)
    ternary = replace(mechanism, joints=(*mechanism.joints, pin("P", "coupler", "rocker")))
    with pytest.raises(MechanismError, match="do not lie on one line"):
        axis_of(ternary, "coupler")
    with pytest.raises(MechanismError, match="at one place"):
        axis_of(mechanism, "coupler", ("B", "B", "D"))
