"""Equivalent linkages: the lower pairs that are drawn in place of a higher one move like it, up to accelerations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cam_mechanisms import oscillating, translating, wedge
from mechanisms import load, slider_crank
from rubbing_joints import GEAR, rack, shaper, wheels

import mechviz
from mechcore.cams.followers import Arc, Flat, Knife, Roller
from mechcore.constructions.equivalents import equivalent
from mechcore.errors import MechanismError
from mechcore.laws.timed import ConstantSpeed
from mechcore.motion.solve import compile_mechanism, solve_motion
from mechcore.spec.mechanism import Drive, Link, Mechanism, PinSlot, Prismatic, Revolute
from mechviz.outputs.rerun.reader import Recording
from mechviz.outputs.rerun.writer import write_recording
from mechviz.picture.overlays import chain_strips
from mechviz.quantities.study_tables import study_tables
from mechviz.runs import run_scene

THETA = np.array([0.4, 1.3, 1.9, 3.6, 4.4, 5.0])
SPEED, ACCELERATION = 3.0, 1.7


def xy(z: complex) -> tuple[float, float]:
    return float(z.real), float(z.imag)


def moved(links, joints, sketch, drive: str, start: float):
    """The rates at the start of a linkage that stands as drawn, driven with SPEED and ACCELERATION."""
    m = Mechanism(
        name="linkage",
        frame="frame",
        links=links,
        joints=joints,
        drives=(Drive(joint=drive, law=ConstantSpeed(start, 1.0, travel=1.0)),),
        sketch=sketch,
    )
    return load(m, [start], SPEED, ACCELERATION).motion


def bar(name: str, a: complex, b: complex) -> tuple[Link, tuple[float, float, float]]:
    """A link from a to b that lies along x of its own frame, and where it stands."""
    return Link(name=name, points={"a": (0.0, 0.0), "b": (abs(b - a), 0.0)}), (a.real, a.imag, float(np.angle(b - a)))


def joint(name: str, first: str, p: str, second: str, q: str) -> Revolute:
    return Revolute(name=name, links=(first, second), points=(p, q))


def guided(o: complex, k: complex, t: complex, foot: complex, up: complex, turn: float, *, face: complex | None = None):
    """Crank OK, rod KT, follower on its guide (or with a slot through K along its face): rates of the follower's displacement."""
    crank, place = bar("crank", o, k)
    frame = Link(name="frame", points={"O": xy(o), "G": xy(foot)})
    follower = Link(name="follower", points={"T": (0.0, 0.0), "S": (0.0, 0.0) if face is None else xy((k - t) / (up / 1j))})
    guide = Prismatic(name="S", links=("frame", "follower"), points=("G", "T"), along=xy(up), angle=float(np.angle(up / 1j)))
    drive = joint("O", "frame", "O", "crank", "a")
    poses = {"crank": place, "follower": (t.real, t.imag, float(np.angle(up / 1j)))}
    if face is None:
        rod, at = bar("rod", k, t)
        links, joints = (
            (frame, crank, rod, follower),
            (drive, joint("K", "crank", "b", "rod", "a"), joint("T", "rod", "b", "follower", "T"), guide),
        )
        poses["rod"] = at
    else:
        slot = PinSlot(name="K", links=("follower", "crank"), points=("S", "b"), along=xy(face / (up / 1j)))
        links, joints = (frame, crank, follower), (drive, slot, guide)
    return moved(links, joints, poses, "O", place[2]).coordinate("S")[0, 1:]


@pytest.mark.parametrize("slope", [90.0, 40.0])
@pytest.mark.parametrize("face", [Knife(), Roller(0.01), Arc(0.03, 1.0), Flat()])
def test_translating_followers(face, slope):
    motion = load(translating(face, offset=0.007, slope=slope), THETA, SPEED, ACCELERATION).motion
    equivalents = equivalent(motion, "K")
    up = np.exp(1j * np.radians(slope))
    for f in range(len(THETA)):
        o, k, t = (complex(equivalents.pins[name][f]) for name in "OKT")
        tip = complex(*motion.point("follower", "T")[f])
        face_way = complex(equivalents.blocks[0].along[f]) if equivalents.blocks else None
        rates = guided(o, k, tip if equivalents.blocks else t, tip, up, 1.0, face=face_way)
        np.testing.assert_allclose(rates, motion.coordinate("S")[f, 1:], rtol=1e-8, atol=1e-10)
    assert equivalents.bars[:2] == (("O", "K"), ("K", "T"))


@pytest.mark.parametrize("face", [Roller(0.012), Knife()])
def test_oscillating_followers(face):
    motion = load(oscillating(face), THETA, SPEED, ACCELERATION).motion
    equivalents = equivalent(motion, "K")
    for f in range(len(THETA)):
        o, k, t, p = (complex(equivalents.pins[name][f]) for name in "OKTP")
        rates = four_bar(o, k, t, p)
        np.testing.assert_allclose(rates[0], motion.velocity("follower")[f, 2], rtol=1e-8, atol=1e-10)
        np.testing.assert_allclose(rates[1], motion.acceleration("follower")[f, 2], rtol=1e-8, atol=1e-9)


def four_bar(o: complex, k: complex, t: complex, p: complex) -> tuple[float, float]:
    """Crank OK, coupler KT, rocker PT: the rocker's angular velocity and acceleration."""
    links, sketch = [Link(name="frame", points={"O": xy(o), "P": xy(p)})], {}
    for name, a, b in (("crank", o, k), ("coupler", k, t), ("rocker", p, t)):
        made, sketch[name] = bar(name, a, b)
        links.append(made)
    joints = (
        joint("O", "frame", "O", "crank", "a"),
        joint("K", "crank", "b", "coupler", "a"),
        joint("T", "coupler", "b", "rocker", "b"),
        joint("P", "rocker", "a", "frame", "P"),
    )
    motion = moved(tuple(links), joints, sketch, "O", sketch["crank"][2])
    return float(motion.velocity("rocker")[0, 2]), float(motion.acceleration("rocker")[0, 2])


@pytest.mark.parametrize(("sizes", "internal"), [((20, 30), False), ((20, 60), True)])
def test_gears_turn_like_a_four_bar_between_their_base_circles(sizes, internal):
    gear = replace(GEAR, sizes=sizes, internal=internal)
    for moment in (-3.0, 3.0):
        m = wheels(gear)
        forces = load(replace(m, loads=(replace(m.loads[0], moment=moment),), effects=()), [0.3], SPEED, ACCELERATION)
        equivalents = equivalent(forces.motion, "K", forces)
        o1, n1, n2, o2 = (complex(equivalents.pins[name][0]) for name in ("O1", "N1", "N2", "O2"))
        assert (abs(o1), abs(o2 - complex(0.5, 0.2))) < (1e-15, 1e-15)
        rates = four_bar(o1, n1, n2, o2)
        np.testing.assert_allclose(rates, (forces.motion.velocity("b")[0, 2], forces.motion.acceleration("b")[0, 2]), rtol=1e-9)
        along = forces.reaction("K")[0, :2] @ np.array([1.0, 1.0j])
        assert abs(np.imag(np.conj(along) * (n2 - n1))) < 1e-12 * abs(along)  # the rod carries the tooth's force


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_rack_is_pushed_by_a_rod_that_slides_on_its_flank(side):
    m = rack()
    g = (0.0, -0.04) if side == "left" else (0.0, 0.04)
    frame = replace(m.links[0], points={**m.links[0].points, "G": g})
    m = replace(m, links=(frame, *m.links[1:]), joints=(*m.joints[:2], replace(m.joints[2], side=side)))
    motion = load(m, [0.3], SPEED, ACCELERATION).motion
    equivalents = equivalent(motion, "K")
    o, n, c = (complex(equivalents.pins[name][0]) for name in ("O1", "N1", "C"))
    assert abs(o) < 1e-15 and abs(c - complex(*g)) < 1e-15
    crank, place = bar("crank", o, n)
    links = (
        Link(name="frame", points={"O": xy(o), "G": xy(c)}),
        crank,
        Link(name="rack", points={"C": (0.0, 0.0), "N": xy(n - c)}),
    )
    joints = (
        joint("O", "frame", "O", "crank", "a"),
        PinSlot(name="N", links=("rack", "crank"), points=("N", "b"), along=xy(complex(equivalents.blocks[0].along[0]))),
        Prismatic(name="S", links=("frame", "rack"), points=("G", "C")),
    )
    rates = moved(links, joints, {"crank": place, "rack": (*xy(c), 0.0)}, "O", place[2]).coordinate("S")[0, 1:]
    np.testing.assert_allclose(rates, motion.coordinate("S")[0, 1:], rtol=1e-9)


def test_a_wedge_carries_its_centre_of_curvature_on_its_bed():
    motion = load(wedge(Roller(0.01)), [0.02, 0.05], 0.3, 0.1).motion
    equivalents = equivalent(motion, "K")
    assert "O" not in equivalents.pins and len(equivalents.blocks) >= 1
    inner = np.isfinite(equivalents.pins["K"])
    rod = equivalents.pins["T"] - equivalents.pins["K"]
    for f in np.flatnonzero(inner):
        bed, up = complex(equivalents.blocks[-1].along[f]), 1j * complex(equivalents.blocks[-1].along[f])
        k, t = complex(equivalents.pins["K"][f]), complex(equivalents.pins["T"][f])
        made, at = bar("rod", k, t)
        links = (
            Link(name="frame", points={"K": xy(k), "T": xy(t)}),
            Link(name="cam", points={"K": (0.0, 0.0)}),
            made,
            Link(name="follower", points={"T": (0.0, 0.0)}),
        )
        joints = (
            Prismatic(name="B", links=("frame", "cam"), points=("K", "K"), along=xy(bed)),
            joint("K", "cam", "K", "rod", "a"),
            joint("T", "rod", "b", "follower", "T"),
            Prismatic(name="S", links=("frame", "follower"), points=("T", "T"), along=xy(up)),
        )
        poses = {"cam": (*xy(k), 0.0), "rod": at, "follower": (*xy(t), 0.0)}
        m = Mechanism(
            name="w",
            frame="frame",
            links=links,
            joints=joints,
            drives=(Drive(joint="B", law=ConstantSpeed(0.0, 1.0, travel=1.0)),),
            sketch=poses,
        )
        own = motion.point("cam", next(iter(motion.mechanism.links[1].points)), 1)[f] @ np.array([1.0, 1j])
        second = motion.point("cam", next(iter(motion.mechanism.links[1].points)), 2)[f] @ np.array([1.0, 1j])
        got = load(m, [0.0], float(np.real(np.conj(bed) * own)), float(np.real(np.conj(bed) * second))).motion
        for d in (1, 2):
            wanted = motion.point("follower", "T", d)[f]
            np.testing.assert_allclose(got.point("follower", "T", d)[0], wanted, rtol=1e-8, atol=1e-10)
    assert inner.any() and np.isfinite(rod[inner]).all()


def test_a_pin_in_a_slot_is_a_block():
    motion = load(shaper(), THETA, SPEED).motion
    equivalents = equivalent(motion, "K")
    np.testing.assert_allclose(equivalents.blocks[0].place, motion.point("crank", "A") @ [1.0, 1j], atol=1e-15)
    np.testing.assert_allclose(
        np.angle(equivalents.blocks[0].along), np.angle(motion.rotation(motion.model.index["lever"])), atol=1e-14
    )


def test_lower_joints_have_none():
    motion = solve_motion(compile_mechanism(slider_crank(r=1.0, l=3.0)), np.zeros(1))
    for name, words in (("S", "lower pair"), ("X", "there is no joint")):
        with pytest.raises(MechanismError, match=words):
            equivalent(motion, name)


def test_scenes_ask_for_them_and_recordings_hold_them(tmp_path):
    scene = mechviz.load("cam-equivalent")
    assert scene.mechanism.studies.equivalent == ("C",) and mechviz.loads(scene.to_toml()) == scene
    run = run_scene(scene, frames=60)
    chain = run.studies.equivalents["C"]
    computed = {table.path: table.values for table in study_tables(run)}
    for pin in "OKTP":
        np.testing.assert_array_equal(computed["data", "equivalent", "C", pin] @ [1.0, 1j], chain.pins[pin])
    strips = dict(chain_strips(run, 0.1))["C"]
    np.testing.assert_array_equal(strips[1], np.stack([chain.pins["K"], chain.pins["T"]], axis=1))
    path = tmp_path / "x.rrd"
    write_recording(run, path)
    recording = Recording(path)
    assert {"/polygons/equivalent/C", "/polygons/equivalent/C/pins", "/data/equivalent/C/K"} <= set(recording.entities)


def test_where_a_profile_is_straight_nothing_runs_away():
    """The dwells of a flat-faced follower are circles, the flanks of a cam with a straight line have their centre far away."""
    text = mechviz.load("cam-wedge").to_toml()
    name = next(p.name for p in mechviz.loads(text).mechanism.joints if type(p).__name__ == "CamJoint")
    run = run_scene(mechviz.loads(f'equivalent = ["{name}"]\n' + text), frames=80)
    chain = run.studies.equivalents[name]
    assert not np.isfinite(chain.pins["K"]).all() or np.abs(chain.pins["K"]).max() > 1.0
    for _, strips in chain_strips(run, 0.2):
        for strip in strips:
            assert np.isfinite(strip).all() and (np.abs(strip - strip[:, :1]).max(axis=1) <= 4.0 * 0.2 + 1e-12).all()


@pytest.mark.parametrize(
    ("scene", "joint", "words"),
    [
        ("cam-equivalent", "O", "'O' is no cam, gear, rack or pin in a slot"),
        ("cam-equivalent", "c", "there is no joint 'c'"),
        ("crank-rocker", "A", "the scene has no such joint"),
    ],
)
def test_faults(scene, joint, words):
    text = mechviz.load(scene).to_toml()
    head = [line for line in text.splitlines() if not line.startswith("equivalent")]
    with pytest.raises(mechviz.SceneError) as error:
        mechviz.loads(f'equivalent = ["{joint}"]\n' + "\n".join(head))
    assert words in str(error.value)


@pytest.mark.parametrize(("name", "driver", "bars"), [
    ("cam-inverse", "crank", (("O", "T"), ("T", "K"), ("K", "P"))),
    ("cam-inverse-slide", "slide", (("T", "K"), ("K", "P"))),
])  # fmt: skip
def test_the_slot_of_an_inverse_cam_acts_like_a_rod_from_its_roller(name: str, driver: str, bars: tuple[tuple[str, str], ...]):
    """T of the driving link and K of the driven one keep their distance up to accelerations."""
    scene = mechviz.load(name).changed({("equivalent",): ["K"]})
    run = run_scene(scene, frames=60)
    found, motion = run.studies.equivalents["K"], run.motion
    assert found.bars == bars
    t, k = found.pins["T"], found.pins["K"]
    curved = np.isfinite(k)
    assert curved.sum() > 20

    def rates(link: str, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        pose, v, a = motion.pose(link), motion.velocity(link), motion.acceleration(link)
        arm, plane = place - pose[:, :2] @ [1.0, 1.0j], np.array([1.0, 1.0j])
        return v[:, :2] @ plane + 1j * v[:, 2] * arm, a[:, :2] @ plane + (1j * a[:, 2] - v[:, 2] ** 2) * arm

    (v1, a1), (v2, a2) = rates(driver, t), rates("lever", k)
    rod = k - t
    first = np.real(np.conj(rod) * (v2 - v1))
    second = np.real(np.conj(rod) * (a2 - a1)) + np.abs(v2 - v1) ** 2
    scale = np.abs(rod) * (np.abs(a1) + np.abs(a2)) + np.abs(v1) ** 2 + np.abs(v2) ** 2
    assert np.abs(first[curved]).max() < 1e-12 * np.sqrt((np.abs(rod) ** 2 * scale)[curved].max())
    assert np.abs(second / scale)[curved].max() < 1e-11
    straight = [block.place for block in found.blocks]
    assert all(np.array_equal(place, t) for place in straight)


def test_a_cam_about_a_shaft_in_the_plane_has_no_equivalent():
    with pytest.raises(MechanismError, match="no linkage of the plane is its equivalent"):
        compile_mechanism(mechviz.load("cam-barrel").changed({("equivalent",): ["K"]}).mechanism)
