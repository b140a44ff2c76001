"""What is in a recording, read back from the file: names, timelines, poses, physics, meshes."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import trimesh

from mechcore.effects.registry import effects_of
from mechcore.forces.cam_rating import placed_cams
from mechcore.laws.timed import Free
from mechcore.motion.events import find_events
from mechcore.spec.clearance import journals_of
from mechcore.spec.mechanism import CamJoint, Prismatic, Revolute
from mechcore.texts import Text
from mechviz.quantities.events import events_of
from mechviz.scene.document import UnitsDocument
from recordings import COVERING, NAMES, Made, made, motion_of, place, points_of, size_of

Check = Callable[[Made], None]
EVERYWHERE: list[Check] = []
LOADED: list[Check] = []


def everywhere(check: Check) -> Check:
    """Of the recording of every scene."""
    EVERYWHERE.append(check)
    return check


def loaded(check: Check) -> Check:
    """Of the recording of every scene that has forces."""
    LOADED.append(check)
    return check


@everywhere
def poses_are_what_the_core_computed_bit_for_bit(m: Made) -> None:
    again = motion_of(m.run.scene.name, m.run.motion.frames - 1)
    for link in m.recording.model["links"]:
        assert np.array_equal(m.data("links", link, "pose"), again.pose(link)), link
        assert np.array_equal(m.data("links", link, "velocity"), again.velocity(link)), link
        assert np.array_equal(m.data("links", link, "acceleration"), again.acceleration(link)), link


@everywhere
def loops_are_closed(m: Made) -> None:
    assert m.recording.scalars("health", "closure")[1].max() <= 1e-12 * size_of(m.run.motion.mechanism)


ODD = UnitsDocument(length="in", angle="turn", force="kgf")
FOREIGN = re.compile(r"(?<![\w'\"])-?[\d.]+(e[+-]?\d+)? ?(mm|cm|m|deg|rad|°)(?![\w²³/^])(?! \w*['\"])")
"""A number with a unit of length or angle other than those of `ODD`."""


@everywhere
def events_are_told_in_the_units_of_the_scene(m: Made) -> None:
    scene = replace(m.run.scene, document=m.run.scene.document.model_copy(update={"units": ODD}))
    assert not [e.text for e in events_of(replace(m.run, scene=scene)) if FOREIGN.search(e.text)]


@everywhere
def energies_close_and_happenings_of_motions_under_forces_are_there(m: Made) -> None:
    run, computed = m.run, m.recording
    if run.simulation is None:
        return
    kinetic, potential, work, dissipated = computed.scalars("data", "energy")[1].T
    balance = kinetic + potential - work + dissipated
    size = np.abs(computed.scalars("data", "energy")[1]).max()
    assert np.ptp(balance) <= 60.0 * run.simulation.tolerance * size
    assert np.all(np.diff(dissipated) >= -1e-9 * size)
    assert np.abs(computed.scalars("health", "energy_drift")[1]).max() < 30.0 * run.simulation.tolerance
    assert computed.model["drives"] == [d.joint for d in run.scene.mechanism.drives if not isinstance(d.law, Free)]
    texts = " ".join(e.text for e in computed.events)
    assert all(Text.of(h.text).in_units(run.scene.units) in texts for h in run.simulation.events)


@everywhere
def transforms_show_the_poses(m: Made) -> None:
    for link in m.recording.model["links"]:
        pose = m.data("links", link, "pose")
        where = m.recording.rows("mechanism", "links", link, component="Transform3D:translation")
        turn = m.recording.rows("mechanism", "links", link, component="Transform3D:quaternion")
        assert np.allclose(where.values[:, :2], pose[:, :2], rtol=0, atol=1e-6 * (1 + abs(pose[:, :2]).max()))
        assert not where.values[:, 2].any(), "layers are in the meshes"
        x, y, z, w = turn.values.T
        assert not x.any() and not y.any()
        # half angles grow with the turns, and float32 keeps seven digits of their sines
        assert np.allclose(np.exp(1j * pose[:, 2]), (w + 1j * z) ** 2, rtol=0, atol=1e-6)


@everywhere
def joints_coincide_on_both_links(m: Made) -> None:
    mechanism = m.mechanism
    points, near = points_of(mechanism), 1e-12 * size_of(mechanism)
    for joint in mechanism.joints:
        if not isinstance(joint, Revolute | Prismatic):
            continue
        poses = [m.data("links", link, "pose") for link in joint.links]
        at = [place(q, points[k][p]) for q, k, p in zip(poses, joint.links, joint.points, strict=True)]
        position = m.data("joints", joint.name, "position")
        dot = m.recording.rows("mechanism", "joints", joint.name, component="Points3D:positions")
        assert np.allclose(dot.values[:, :2], position, rtol=0, atol=1e-6 * (1 + abs(position).max()))
        if isinstance(joint, Revolute):
            loose = m.recording.model["joints"][joint.name]["type"] == "revolute with clearance"
            apart = (
                np.hypot(*m.data("joints", joint.name, "journal")[:, :2].T) if loose else 0.0
            )  # the journal is the second link's
            assert abs(np.hypot(*(at[0] - at[1]).T) - apart).max() < 4 * near, joint.name
            assert abs(at[1] - position).max() < 4 * near, joint.name
        elif isinstance(joint, Prismatic):
            along = np.array(joint.along) / np.hypot(*joint.along)
            axis = place(poses[joint.guide] * [0, 0, 1], tuple(along))
            apart = (at[1] - at[0]) * (1 if joint.guide == 0 else -1)
            assert abs(axis[:, 0] * apart[:, 1] - axis[:, 1] * apart[:, 0]).max() < 4 * near, f"{joint.name} leaves its guide"
            slide = m.data("joints", joint.name, "motion")[:, 0]
            assert np.allclose((axis * apart).sum(axis=1), slide, rtol=0, atol=4 * near)
            turned = poses[1][:, 2] - poses[0][:, 2] - joint.angle
            assert abs(np.exp(1j * turned) - 1).max() < 1e-12, f"{joint.name} turns"


def smooth(m: Made, motion: Any) -> np.ndarray:
    """Frames (F,) of a motion whose neighbours lie between the same two events of the drives: there derivatives exist."""
    t = motion.time
    ok = np.zeros(len(t), bool)
    ok[1:-1] = True
    if m.run.simulation is not None:
        breaks = [h.time for h in m.run.simulation.events if h.kind != "watch"]
        for rows, part in motion.parts:  # forces whose laws bend: accelerations bend with them
            effects = effects_of(part.mechanism)
            breaks += [b for e in effects for b in (*e.breaks, *(x for law in e.laws for x in law.breaks))]
            for effect in (e for e in effects if e.piecewise):
                bent = np.flatnonzero(np.diff(np.broadcast_to(effect.phase(part), len(rows))))
                breaks += [float(t[rows[k + j]]) for k in bent for j in (0, 1)]
    else:
        breaks = [e.time for e in find_events(motion) if e.text.startswith("drive") or "zone" in e.text]
    for joint in m.mechanism.joints:  # where pieces of a cam's law meet its jerk jumps
        if isinstance(joint, CamJoint):
            k = np.flatnonzero(np.diff(piece_of(m, motion, joint)))
            breaks += [float(x) for x in (*t[k], *t[k + 1])]
    near_singular = motion.condition > 20.0  # much happens there between two frames
    assert near_singular.mean() < 0.3
    breaks += list(t[near_singular])
    for b in breaks:
        ok &= ~((t > b - 1.5 * (t[1] - t[0])) & (t < b + 1.5 * (t[1] - t[0])))
    return ok


def bends(m: Made) -> bool:
    """Whether forces decide the motion and their laws bend, and accelerations with them: their differences are of lower order."""
    return m.run.simulation is not None and any(e.piecewise for e in effects_of(m.mechanism))


def piece_of(m: Made, motion: Any, joint: CamJoint) -> np.ndarray:
    """Which piece of a cam's law the follower is on at every frame (F,), counted on over the turns."""
    if joint.bed:
        argument = motion.coordinate(joint.bed)[:, 0]
    else:
        guide = next(p for p in m.mechanism.joints if p.name == joint.guide)
        carrier = next(k for k in guide.links if k != joint.links[1])
        argument = motion.pose(joint.links[0])[:, 2] - motion.pose(carrier)[:, 2]
    cam = next(c for c in placed_cams(m.run.motion) if c.name == joint.name)
    knots = cam.knots if joint.lift is None or cam.intended else joint.lift.knots
    way = cam.sense * argument + joint.phase - knots[0]
    turns, rest = np.divmod(way, knots[-1] - knots[0])
    return turns * len(knots) + np.searchsorted(knots - knots[0], rest, side="right")


def difference_errors(m: Made, motion: Any, ok: np.ndarray) -> dict[str, float]:
    """Root mean square, at frames ``ok`` (F,), of central differences minus derivatives, over the largest of the kind."""
    t = motion.time
    errors: dict[str, float] = {}
    for lower, upper in (("pose", "velocity"), ("velocity", "acceleration")):
        for columns, kind in ((slice(0, 2), "linear"), (slice(2, 3), "angular")):
            off, scale = [], 1e-300
            for link in m.recording.model["links"]:
                x, v = getattr(motion, lower)(link)[:, columns], getattr(motion, upper)(link)[:, columns]
                off.append(((x[2:] - x[:-2]) / (t[2:] - t[:-2])[:, None] - v[1:-1])[ok[1:-1]])
                scale = max(scale, abs(v).max(), 1e-6 * abs(x).max() / (t[1] - t[0]))  # a steady speed has no acceleration
            errors[f"{kind} {upper}"] = float(np.sqrt(np.mean(np.square(off)))) / scale
    return errors


@everywhere
def velocities_and_accelerations_are_derivatives_of_the_poses(m: Made) -> None:
    """Central differences are of second order: half the step, a quarter of the error. They are what is recorded, see above."""
    rows = max((len(j.lift.pieces) for j in m.mechanism.joints if isinstance(j, CamJoint) and j.lift is not None), default=0)
    # many swings or turns are not one cycle; of a fine table several frames lie between two rows
    frames = max(480 if m.run.simulation is None else 1440, 8 * rows if rows > 200 else 0)
    few, many = motion_of(m.run.scene.name, frames), motion_of(m.run.scene.name, 2 * frames)
    shared = np.zeros(len(many.time), bool)
    shared[::2] = smooth(m, few)  # the same moments: next to events differences leave out more of them when steps are long
    np.testing.assert_allclose(many.time[::2], few.time, rtol=0, atol=1e-9)
    fine_ones = smooth(m, many)
    every = difference_errors(m, many, fine_ones)
    coarse, fine = difference_errors(m, few, shared[::2]), difference_errors(m, many, shared & fine_ones)
    for kind, error in fine.items():
        assert every[kind] < 2e-3, kind
        if coarse[kind] > 1e-7 and not bends(m):  # below, the last digits of poses and times decide
            order = np.log2(coarse[kind] / error)
            assert order == pytest.approx(2.0, abs=0.2), f"{kind}: order {order:.2f}, errors {coarse[kind]:.1e}, {error:.1e}"


@everywhere
def points_move_with_their_links(m: Made) -> None:
    mechanism = m.mechanism
    for link, point in mechanism.traced:
        position = m.data("points", f"{link}.{point}", "position")
        expected = place(m.data("links", link, "pose"), points_of(mechanism)[link][point])
        assert np.allclose(position, expected, rtol=0, atol=1e-12 * size_of(mechanism))
        path = m.recording.static("mechanism", "paths", f"{link}.{point}", component="LineStrips3D:strips")
        assert np.allclose(path[0][:, :2], position, rtol=0, atol=1e-6 * (1 + abs(position).max()))
        for family in ("velocity", "acceleration"):
            assert m.recording.has("vectors", family, f"{link}.{point}")


@loaded
def every_link_is_in_dynamic_balance(m: Made) -> None:
    """Reactions, drive wrenches, loads and inertia of every moving link sum to zero, in force and in moment."""
    model = m.recording.model
    sums = {link: np.zeros((len(m.time), 3)) for link in model["links"]}
    largest = {link: np.zeros(3) for link in model["links"]}

    def add(link: str, wrench: np.ndarray, at: np.ndarray, sign: float = 1.0) -> None:
        r = at - m.data("links", link, "pose")[:, :2]  # moments about the origin of the link's frame
        moment = wrench[:, 2] + r[:, 0] * wrench[:, 1] - r[:, 1] * wrench[:, 0]
        part = np.where(known(m)[:, None], sign * np.column_stack([wrench[:, :2], moment]), 0.0)
        sums[link] += part
        largest[link] = np.maximum(largest[link], abs(part).max(axis=0))

    for joint, about in model["joints"].items():
        first, second = about["links"]
        at = m.data("joints", joint, "position")
        wrenches = [m.data("joints", joint, "reaction")]
        if joint in model["drives"]:
            wrenches.append(m.data("drive", joint, "wrench"))
        for wrench in wrenches:
            add(second, wrench, at)
            add(first, wrench, at, -1.0)
    for load, about in model["loads"].items():
        parts = load.split("/") if about["kind"] == "gravity" else [load]
        values = m.data("loads", *parts)
        for link, sign in zip(about["links"], (1.0, -1.0), strict=False):
            add(link, values[:, :3], values[:, 3:], sign)
    for link in model["links"]:
        if m.recording.has("data", "links", link, "inertia"):
            mass, x, y, j = m.recording.static("data", "links", link, "properties")
            pose, v, a = (m.data("links", link, kind) for kind in ("pose", "velocity", "acceleration"))
            r = place(pose, (x, y)) - pose[:, :2]
            across = np.column_stack([-r[:, 1], r[:, 0]])
            at_centre = a[:, :2] + a[:, 2:] * across - v[:, 2:] ** 2 * r
            inertia = m.data("links", link, "inertia")
            expected = np.column_stack([-mass * at_centre, -j * a[:, 2]])
            assert np.allclose(inertia, expected, rtol=0, atol=1e-11 * abs(expected).max())
            add(link, inertia, pose[:, :2] + r)
    for link in model["links"]:
        if link != model["frame"]:
            force = largest[link][:2].max()
            moment = largest[link][2] + 1e-3 * force * size_of(m.mechanism)  # a slider has no moments but round-off
            assert abs(sums[link][:, :2]).max() <= 1e-10 * force, link
            assert abs(sums[link][:, 2]).max() <= 1e-10 * moment, link


def known(m: Made) -> np.ndarray:
    """Frames at which there are forces (F,): where friction jams a mechanism there are none."""
    jammed = m.run.forces.friction.jammed if m.run.forces.friction is not None else np.zeros(len(m.time), bool)
    assert not jammed.all()
    return ~jammed


@loaded
def power_is_balanced(m: Made) -> None:
    """Where friction jams a mechanism there are no numbers."""
    balance = m.recording.scalars("health", "power_balance")[1]
    assert abs(balance[known(m)]).max() < 1e-9 and np.isnan(balance[~known(m)]).all()


@loaded
def inertia_arrows_lie_on_their_lines_of_action(m: Made) -> None:
    scale = m.recording.properties["newtons_per_metre"]
    for link in m.recording.model["links"]:
        if not m.recording.has("vectors", "inertia", link):
            continue
        origins = m.recording.rows("vectors", "inertia", link, component="Arrows3D:origins")
        vectors = m.recording.rows("vectors", "inertia", link, component="Arrows3D:vectors")
        shown = vectors.lengths.astype(bool)
        if not shown.any():
            continue
        _, x, y, _ = m.recording.static("data", "links", link, "properties")
        inertia = m.data("links", link, "inertia")[shown]
        force = scale * vectors.values[:, :2]
        arm = origins.values[:, :2] - place(m.data("links", link, "pose")[shown], (x, y))
        moment = arm[:, 0] * force[:, 1] - arm[:, 1] * force[:, 0]
        assert np.allclose(force, inertia[:, :2], rtol=0, atol=1e-5 * abs(inertia[:, :2]).max())
        # float32 coordinates: seven digits of the place, times the force
        room = 1e-5 * abs(force).max() * (1 + abs(origins.values).max())
        assert np.allclose(moment, inertia[:, 2], rtol=1e-5, atol=room)


@loaded
def the_largest_force_is_a_third_of_the_mechanism_and_small_ones_are_left_out(m: Made) -> None:
    vectors = [
        m.recording.rows(e, component="Arrows3D:vectors").values
        for e in m.recording.entities
        if e.startswith("/vectors/") and e.split("/")[2] not in ("velocity", "acceleration") and "Arrows3D:vectors" in names(m, e)
    ]
    forces = [m.data("joints", joint, "reaction")[:, :2] for joint in m.recording.model["joints"]]
    inertia = [e for e in m.recording.entities if e.startswith("/data/links/") and e.endswith("/inertia")]
    forces += [m.data(*e.removeprefix("/data/").split("/"))[:, :2] for e in inertia]
    lengths = np.concatenate([np.empty(0), *(np.linalg.norm(v, axis=1) for v in vectors)])
    if not len(lengths):  # nothing acts but couples, or nothing at all: a balanced rotor, say
        assert all(np.abs(f).max() < 1e-9 for f in forces)
        return
    assert lengths.min() > 0.01 * lengths.max()
    assert lengths.max() == pytest.approx(max(np.linalg.norm(v, axis=1).max() for v in vectors if len(v)))


def names(m: Made, path: str) -> set[str]:
    """Components of an entity that change over time."""
    return {n for batch in m.recording._moving.get(path, ()) for n in batch.schema.names}


@everywhere
def meshes_are_closed_and_lit(m: Made) -> None:
    for link in m.recording.model["links"]:
        path = ("mechanism", "links", link, "mesh")
        vertices, faces, normals, colors = (
            m.recording.static(*path, component=f"Mesh3D:{c}")
            for c in ("vertex_positions", "triangle_indices", "vertex_normals", "vertex_colors")
        )
        assert len(vertices) == len(normals) == len(colors)
        assert np.allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-5)
        mesh = trimesh.Trimesh(*merged(vertices, faces), process=False)
        assert mesh.is_watertight and mesh.is_winding_consistent and mesh.volume > 0, link


def merged(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Corners that were repeated for their normals, made one again: they are equal bit for bit."""
    unique, inverse = np.unique(vertices, axis=0, return_inverse=True)
    return unique.astype(float), inverse[faces]


@everywhere
def properties_and_documents_say_what_was_done(m: Made) -> None:
    p = m.recording.properties
    plan = m.run.plan
    assert p["schema"] == 2 and p["scene"] == m.run.scene.name and p["frames"] == m.run.motion.frames and p["complete"] is True
    assert p["effects"] == list(plan.effects) and p["skipped"] == [s.name for s in plan.skipped]
    assert p["version"] and p["tolerance"] > 0 and p["wall_seconds"] > 0
    for scale in ("newtons_per_metre", "newton_metres_per_metre", "mps_per_metre", "mps2_per_metre"):
        assert p[scale] > 0
    model = json.loads(p["model"])
    mechanism = m.mechanism
    assert set(model["links"]) >= {link.name for link in mechanism.links} and model["frame"] == mechanism.frame
    assert set(model["joints"]) >= {q.name for q in mechanism.joints}
    for q in mechanism.joints:
        if isinstance(q, Revolute | Prismatic):
            loose = " with clearance" if q.name in journals_of(m.run.scene.mechanism) else ""
            assert model["joints"][q.name] == {"type": type(q).__name__.lower() + loose, "links": list(q.links)}
    assert model["drives"] == [d.joint for d in mechanism.drives if not isinstance(d.law, Free)]
    assert m.recording.scene_text == m.run.scene.text
    for step in plan.computed + plan.skipped:
        assert f"**{step.name}**: {step.why}" in m.recording.notes


@everywhere
def all_rows_are_on_all_timelines_at_the_frames(m: Made) -> None:
    motion = m.run.motion
    ns = np.round(motion.time * 1e9).astype(np.int64)
    rotary = [d.joint for d in motion.mechanism.drives if isinstance(joint_of(m, d.joint), Revolute)]
    for path in m.recording.entities:
        if not path.startswith(("/data", "/health", "/mechanism", "/vectors")):
            continue
        for component in names(m, path):
            if ":" not in component:
                continue
            rows = m.recording.rows(path, component=component)
            assert np.array_equal(rows.time, ns), f"{path} {component}"
            if rotary:
                degrees = np.degrees(motion.coordinate(rotary[0])[:, 0])
                assert np.array_equal(rows.drives["drive_mdeg"], np.round(1e3 * degrees).astype(np.int64))


def joint_of(m: Made, name: str):
    return next(p for p in m.run.motion.mechanism.joints if p.name == name)


def pure_kinematics_records_nothing_else(m: Made) -> None:
    for path in m.recording.entities:
        assert not path.endswith(("/reaction", "/inertia", "/properties", "/wrench", "/energy", "/power_balance")), path
        assert not path.startswith(
            (
                "/data/loads",
                "/plots/reactions",
                "/plots/torque",
                "/plots/force",
                "/vectors/reaction",
                "/vectors/gravity",
                "/vectors/inertia",
            )
        ), path
    for drive in m.recording.model["drives"]:
        values = m.data("drive", drive)
        assert values.shape[1] == 5 and np.isfinite(values[:, :3]).all() and np.isnan(values[:, 3:]).all()


@loaded
def efforts_and_power_of_the_drives(m: Made) -> None:
    for drive in m.recording.model["drives"]:
        _, speed, _, effort, power = m.data("drive", drive).T
        assert np.allclose(power, effort * speed, rtol=1e-12, atol=0, equal_nan=True) and np.isfinite(power[known(m)]).all()
        if m.recording.model["joints"][drive]["type"] == "revolute":
            assert np.array_equal(m.data("drive", drive, "wrench")[:, 2], effort)


@everywhere
def the_default_blueprint_is_embedded(m: Made) -> None:
    from rerun.chunk import RrdReader

    reader = RrdReader(m.path)
    assert [e.application_id for e in reader.recordings()] == ["mechviz"]
    blueprints = reader.blueprints()
    assert [e.application_id for e in blueprints] == ["mechviz"]
    views = [str(c.entity_path) for c in reader.stream(store=blueprints[0]) if str(c.entity_path).startswith("/view/")]
    assert len(views) >= 5


@pytest.mark.sample(12)
@pytest.mark.parametrize("name", COVERING)
def test_what_is_recorded(name: str) -> None:
    """All of the above, of one recording."""
    m = made(name)
    for check in (*EVERYWHERE, *([pure_kinematics_records_nothing_else] if m.run.forces is None else LOADED)):
        check(m)


def test_no_wall_clock_timeline():
    assert not any("log_time" in names(made(NAMES[0]), e) for e in made(NAMES[0]).recording.entities)


def test_a_coarse_picture_of_a_dense_run():
    """With many frames a cycle the arrows come at some of them, and the numbers at all."""
    m = made("crank-rocker", 4000)
    arrows = m.recording.rows("vectors", "velocity", "coupler.E", component="Arrows3D:vectors")
    assert 720 <= len(arrows.time) <= 1440
    assert len(m.recording.scalars("data", "points", "coupler.E", "velocity")[0]) == 4001
    assert "every 5th frame" in m.recording.notes


@pytest.mark.parametrize(("scene", "most"), [("ten-link", 3000), ("ten-link-forces", 5400)])
def test_bytes_per_frame(scene, most):
    """Ten links and thirteen joints, without what is there once: kinematics takes less than 3 kB a frame. With inertia and gravity
    the contract asks for some 140 rows a frame, of 20 bytes each before any value is in them."""
    sizes = [made(scene, frames).summary.bytes for frames in (1000, 4000)]
    assert sizes[1] - sizes[0] < most * 3000


@pytest.mark.parametrize(("scene", "factor"), [("micro-gripper", 1000.0), ("crank-rocker", None)])
def test_tiny_mechanisms_are_enlarged_for_the_viewer_only(scene, factor):
    """The native viewer draws nothing close to its eye; poses and numbers stay in metres."""
    m = made(scene)
    if factor is None:
        assert not any(e in ("/mechanism", "/vectors") and "Transform3D:scale" in names(m, e) for e in m.recording.entities)
        return
    for root in ("mechanism", "vectors"):
        assert np.ravel(m.recording.static(root, component="Transform3D:scale"))[0] == factor
    size = np.ptp(m.recording.scalars("data", "points", "jaw.T", "position")[1], axis=0).max()
    assert size < 1e-3
