"""Scenes that ask for plans, force systems, reduction, shaking, substitute masses; masses from shapes; their recordings."""

from __future__ import annotations

import json
import tomllib

import numpy as np
import pytest
from sections import section
from typer.testing import CliRunner

import mechviz
from mechcore.constructions import studies as core_studies
from mechcore.errors import MechanismError
from mechcore.laws.indicator import Compressor
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion
from mechcore.reduction.bodies import SOLIDS
from mechviz.commands.main import app
from mechviz.meshes.solids import build_solids
from mechviz.outputs.rerun.plots import study_plots
from mechviz.outputs.rerun.reader import Recording
from mechviz.outputs.rerun.writer import write_recording
from mechviz.picture.constructions import drawings_of
from mechviz.runs import run_scene
from mechviz.scene.scene import json_schema
from mechviz.studies.balance import balance_scene

BASE = {
    "effects": ["inertia"],
    "links": {
        "frame": {"points": {"A": [0, 0], "E": [0.28, 0]}},
        "crank": {"points": {"A": [0, 0], "B": [0.1, 0]}, "mass": 0.8, "centre": [0.05, 0.01], "inertia": 0.001},
        "coupler": {"points": {"B": [0, 0], "D": [0.3, 0]}, "mass": 1.6, "centre": [0.14, 0.02], "inertia": 0.05},
        "rocker": {"points": {"E": [0, 0], "D": [0.25, 0]}, "mass": 1.2, "centre": [0.12, -0.01], "inertia": 0.007},
    },
    "joints": {
        "A": {"revolute": ["frame", "crank"], "drive": {"speed": 20}},
        "B": {"revolute": ["crank", "coupler"]},
        "D": {"revolute": ["coupler", "rocker"], "side": "left"},
        "E": {"revolute": ["frame", "rocker"]},
    },
    "loads": {"P": {"force": [-150, -60], "on": "rocker", "at": "D"}},
    "run": {"frames": 36},
}
ALL = {
    "polygons": ["velocity", "acceleration", "force"],
    "centrodes": ["coupler"],
    "instant_centres": ["frame", "coupler"],
    "evolutes": ["coupler.D"],
    "inflection": ["coupler"],
    "percussion": ["rocker.E"],
    "reduced": ["crank", "rocker.D"],
    "shaking": {"about": [0.1, 0], "counterweights": {"radius": "80 mm", "fraction": 1}},
    "systems": {"all": {"on": "rocker", "at": "D"}, "load": {"on": "rocker", "loads": ["P"], "pole": [30, 40]}},
    "substitutes": {"coupler": {"masses": [{"at": "B"}, {"at": "D"}, {"y": 0.12}]}},
}


def with_(**more):
    return mechviz.Scene.build(name="bar", **{**BASE, **more})


def link(name, **changes):
    links = {**BASE["links"], name: {**BASE["links"][name], **changes}}
    for key in [k for k, v in links[name].items() if v is None]:
        links[name] = {k: v for k, v in links[name].items() if k != key}
    return {"links": links}


def body(name, **changes):
    result = {k.name: k for k in with_(**link(name, **changes)).mechanism.links}[name]
    return result.mass, result.centre, result.inertia


def faults(**more):
    with pytest.raises(mechviz.SceneError) as error:
        with_(**more)
    return {f.path: f"{f.message} {f.remedy}" for f in error.value.faults}


# -- asking -------------------------------------------------------------------------------------------------------------
def test_read_write_read_gives_the_same():
    scene = with_(**ALL, **link("crank", point_masses=[{"mass": "0.3 kg", "at": [-0.05, 0]}, {"mass": 0.1, "at": "B"}]))
    again = mechviz.loads(scene.to_toml(), "bar")
    assert again == scene and again.mechanism == scene.mechanism
    assert tomllib.loads(again.to_toml()) == tomllib.loads(scene.to_toml())


def test_the_builder_says_the_same():
    b = mechviz.SceneBuilder("bar")
    for name, entry in BASE["links"].items():
        b.link(name, entry["points"], **{k: v for k, v in entry.items() if k != "points"})
    b.revolute("A", "frame", "crank", drive={"speed": 20}).revolute("B", "crank", "coupler")
    b.revolute("D", "coupler", "rocker", side="left").revolute("E", "frame", "rocker")
    b.force("P", (-150, -60), on="rocker", at="D").effect("inertia").run(frames=36)
    b.polygon(*ALL["polygons"]).centrodes("coupler").reduce(*ALL["reduced"])
    b.instant_centres("frame", "coupler").evolutes("coupler.D").inflection("coupler").percussion("rocker.E")
    b.shaking(about=(0.1, 0), counterweights={"radius": "80 mm", "fraction": 1})
    b.system("all", on="rocker", at="D").system("load", on="rocker", loads=["P"], pole=(30, 40))
    b.substitute("coupler", {"at": "B"}, {"at": "D"}, {"y": 0.12})
    assert b.scene() == with_(**ALL)


def test_the_schema_knows_the_keywords():
    text = json.dumps(json_schema())
    for key in (
        "polygons",
        "centrodes",
        "systems",
        "reduced",
        "shaking",
        "counterweights",
        "substitutes",
        "point_masses",
        "density",
        "bulges",
    ):
        assert f'"{key}"' in text


@pytest.mark.parametrize(
    ("more", "path", "words"),
    [
        ({"polygons": ["velocities"]}, "polygons[0]", "Did you mean 'velocity'?"),
        ({"polygons": ["force", "force"]}, "polygons[1]", "twice"),
        ({"polygons": ["force"], "effects": [], "loads": {}}, "polygons[0]", "without any force"),
        ({"centrodes": ["copler"]}, "centrodes[0]", "Did you mean 'coupler'?"),
        ({"centrodes": ["frame"]}, "centrodes[0]", "fixed link"),
        ({"instant_centres": ["coupler"]}, "instant_centres", "two links or more"),
        ({"instant_centres": ["frame", "copler"]}, "instant_centres[1]", "Did you mean 'coupler'?"),
        ({"inflection": ["frame"]}, "inflection[0]", "fixed link"),
        ({"evolutes": ["coupler"]}, "evolutes[0]", "names no point"),
        ({"evolutes": ["coupler.X"]}, "evolutes[0]", "no point 'X'"),
        ({"inversion": ["A"]}, "inversion[0]", "'A' is no cam"),
        ({"percussion": ["rod.B"]}, "percussion[0]", "no link 'rod'"),
        ({"reduced": ["rocker.X"]}, "reduced[0]", "no point 'X'"),
        ({"reduced": ["rock.D"]}, "reduced[0]", "Did you mean 'rocker'?"),
        ({"shaking": {"counterweights": {"radius": 0}}}, "shaking.counterweights.radius", "zero"),
        ({"shaking": {"counterweights": {"radius": "3 kg"}}}, "shaking.counterweights.radius", "length"),
        ({"shaking": {"counterweights": {"radius": 1, "fraction": 2}}}, "shaking.counterweights.fraction", "between 0 and 1"),
        ({"shaking": {"counterweight": {"radius": 1}}}, "shaking", "Did you mean 'counterweights'?"),
        ({"systems": {"s": {"on": "rocker", "loads": ["Q"]}}}, "systems.s.loads[0]", "no load 'Q'"),
        ({"systems": {"s": {"on": "rocker", "at": "Q"}}}, "systems.s.at", "no point 'Q'"),
        ({"systems": {"s": {"link": "rocker"}}}, "systems.s", "Did you mean 'on'?"),
        ({"substitutes": {"coupler": {"masses": [{"at": "X"}]}}}, "substitutes.coupler.masses[0].at", "no point 'X'"),
        ({"substitutes": {"coupler": {"masses": [{"at": "B", "x": 1}]}}}, "substitutes.coupler.masses[0].x", "at"),
        ({"substitutes": {"rod": {"masses": [{"at": "B"}]}}}, "substitutes.rod", "no link 'rod'"),
        (link("crank", mass={"solid": "discus", "mass": 1}), "links.crank.mass.solid", "Did you mean 'disc'?"),
        (link("crank", mass={"solid": "disc", "mass": 1}), "links.crank.inertia", "decides the inertia"),
        (link("crank", mass={"solid": "disc", "radius": 1}, inertia=None), "links.crank.mass", "density or a mass"),
        (link("crank", mass={"solid": "disc", "density": 1, "a": 2}, inertia=None), "links.crank.mass.a", "no a"),
        (link("crank", mass={"solid": "rod", "density": "5 kg"}, inertia=None), "links.crank.mass.density", "density"),
        (link("crank", mass={"plate": ["A", "B"], "mass": 1}, inertia=None, centre=None), "links.crank.mass", "width"),
        (link("crank", mass={"plate": ["A", "Q"], "width": 1, "mass": 1}, inertia=None, centre=None),
         "links.crank.mass.plate[1]", "no point 'Q'"),
        (link("crank", mass={"mesh": "no.stl", "mass": 1}, inertia=None, centre=None), "links.crank.mass.mesh", "there is no file"),
        (link("crank", mass={"polygon": [[0, 0], [1, 0], [2, 0]], "mass": 1}, inertia=None, centre=None),
         "links.crank.mass.polygon", "no area"),
        (link("crank", mass={"polygon": [[0, 0], [1, 1], [1, 0], [0, 1]], "mass": 1}, inertia=None, centre=None),
         "links.crank.mass.polygon", "crosses itself"),
        (link("crank", mass={"plate": [], "width": 1, "mass": 1}, inertia=None, centre=None), "links.crank.mass.plate", "is empty"),
        (link("crank", mass={}, inertia=None, centre=None), "links.crank.mass", "Give exactly one"),
        (link("crank", inertia=None, centre=None, mass={"plate": ["A"], "width": 1, "thickness": 1, "density": 5,
              "holes": [{"at": "A", "radius": 3}]}), "links.crank.mass.holes[0]", "reaches out of the plate"),
        (link("crank", point_masses=[{"mass": -1, "at": "A"}]), "links.crank.point_masses[0].mass", "negative"),
        (link("crank", point_masses=[{"mass": 1, "at": "Q"}]), "links.crank.point_masses[0].at", "no point 'Q'"),
    ],
)  # fmt: skip
def test_faults_name_the_item_and_the_remedy(more, path, words):
    result = faults(**more)
    assert path in result, result
    assert words in result[path]


def test_studies_need_masses_and_moments_of_inertia():
    bare = link("coupler", inertia=None)
    assert "no moment of inertia" in faults(effects=[], loads={}, shaking={}, **bare)["links.coupler"]
    assert (
        "no mass to be replaced"
        in faults(substitutes={"coupler": ALL["substitutes"]["coupler"]}, **link("coupler", mass=None))["substitutes.coupler"]
    )


def test_a_choice_without_solution_is_an_error_in_words():
    scene = with_(substitutes={"coupler": {"masses": [{"at": "B"}, {"at": "D"}, {"y": 5}]}})
    with pytest.raises(MechanismError, match=r"substitutes.coupler: no real solution"):
        run_scene(scene)
    scene = with_(substitutes={"coupler": {"masses": [{"at": "B"}, {}], "solution": 2}})
    with pytest.raises(MechanismError, match="solution = 1 to 1"):
        run_scene(scene)


# -- only what is named -------------------------------------------------------------------------------------------------
def test_what_is_not_named_is_not_computed(monkeypatch):
    calls: dict[str, int] = {}
    names = (
        "velocity_polygon",
        "acceleration_polygon",
        "force_polygons",
        "funicular",
        "centrodes",
        "kennedy",
        "path_curvature",
        "inflection_circle",
        "percussion",
        "reduce_mechanism",
        "shaking",
        "substitute_masses",
    )

    def counted(name):
        real = getattr(core_studies, name)

        def call(*args, **kwargs):
            calls[name] = calls.get(name, 0) + 1
            return real(*args, **kwargs)

        return call

    for name in names:
        monkeypatch.setattr(core_studies, name, counted(name))
    run = run_scene(with_())
    assert calls == {} and not any(s.name == "studies" for s in run.stages)
    run_scene(with_(plans=["velocity"]))
    assert calls == {"velocity_polygon": 1}
    calls.clear()
    run = run_scene(with_(**ALL))
    assert calls == {
        "velocity_polygon": 1, "acceleration_polygon": 1, "force_polygons": 1, "funicular": 2, "centrodes": 1,
        "kennedy": 1, "path_curvature": 1, "inflection_circle": 1, "percussion": 1,
        "reduce_mechanism": 2, "shaking": 2, "substitute_masses": 1,
    }  # fmt: skip
    named = {s.name for s in run.plan.computed}
    assert {"velocity polygon", "force polygon", "centrodes of coupler", "system load", "reduced to rocker.D", "shaking"} <= named


# -- results ------------------------------------------------------------------------------------------------------------
def test_results_of_a_run():
    run = run_scene(with_(**ALL))
    s = run.studies
    assert s.balanced is not None and s.shaking is not None
    assert s.balanced.peak <= 1e-12 * s.shaking.peak
    own = run.forces.inertia("coupler")
    sub = s.substitutes["coupler"]
    assert np.abs(sub.force - own[:, :2]).max() <= 1e-9 * np.abs(own[:, :2]).max()
    assert np.abs(sub.moment - own[:, 2]).max() <= 1e-9 * np.abs(own[:, 2]).max()
    system = s.systems["all"]
    inertia = run.forces.inertia("rocker")
    assert system.force == pytest.approx(inertia[:, :2] + [-150, -60], rel=1e-12)
    assert s.systems["load"].force == pytest.approx(np.tile([-150.0, -60.0], (37, 1)))
    arm = run.motion.point("rocker", "D") - run.motion.point("rocker", "E")  # reduced to the link's origin
    assert s.systems["load"].moment == pytest.approx(arm[:, 0] * -60 - arm[:, 1] * -150, rel=1e-12)
    # about D: the load has no moment there, the inertia resultant has
    r = run.motion.centre_of_mass("rocker") - run.motion.point("rocker", "D")
    turning = r[:, 0] * inertia[:, 1] - r[:, 1] * inertia[:, 0] + inertia[:, 2]
    system_at_d = run_scene(with_(systems={"all": {"on": "rocker", "at": "D"}})).studies.systems["all"]
    assert system_at_d.moment == pytest.approx(turning, abs=1e-9)


def test_a_static_replacement_with_its_correction_couple_is_the_link():
    own = link("coupler", centre=[0.14, 0])
    run = run_scene(with_(substitutes={"coupler": {"masses": [{"at": "B"}, {"at": "D"}], "static": True}}, **own))
    inertia, computed = run.forces.inertia("coupler"), run.studies.substitutes["coupler"]
    assert computed.masses == pytest.approx([1.6 * 0.16 / 0.3, 1.6 * 0.14 / 0.3])
    assert computed.force == pytest.approx(inertia[:, :2], abs=1e-9)
    assert computed.moment == pytest.approx(inertia[:, 2], abs=1e-9)
    assert np.abs(computed.correction).max() > 1.0  # J = 0.05 is not m a b = 0.036
    with pytest.raises(MechanismError, match=r"substitutes.coupler: a static replacement has two masses"):
        run_scene(with_(substitutes={"coupler": {"masses": [{"at": "B"}, {}], "static": True}}, **own))
    with pytest.raises(MechanismError, match="does not lie on the line"):
        run_scene(with_(substitutes={"coupler": {"masses": [{"at": "B"}, {"at": "D"}], "static": True}}))


def test_counterweights_are_drawn_on_their_links(tmp_path):
    path = tmp_path / "lumps.rrd"
    write_recording(run_scene(mechviz.load("counterweighted-four-bar"), frames=6), path)
    recording = Recording(path)
    at = recording.static("mechanism", "links", "crank", "lumps", component="Points3D:positions")
    assert np.ravel(at)[:2] == pytest.approx([-0.05, 0.0])
    assert recording.static("mechanism", "links", "coupler", "lumps", component="Points3D:positions") is None


def test_a_plan_without_a_moving_point_is_empty_and_says_so(tmp_path):
    data = mechviz.load("gear-train").document.model_dump(exclude_defaults=True)
    run = run_scene(mechviz.Scene.build(name="gears", **{**data, "polygons": ["velocity"]}), frames=6)
    path = tmp_path / "empty.rrd"
    write_recording(run, path)
    assert "velocity polygon: empty" in Recording(path).notes


@pytest.mark.parametrize("pole", [[0, -5], [0, -10], [0, 30]])
def test_a_pole_on_the_line_of_a_force_is_refused(pole):
    loads = {"P": {"force": [0, -10], "on": "rocker", "at": "E"}, "Q": {"force": [0, -10], "on": "rocker", "at": "D"}}
    with pytest.raises(MechanismError, match=r"systems\.s\.pole: the pole lies on the line of a force"):
        run_scene(with_(effects=[], loads=loads, systems={"s": {"on": "rocker", "pole": pole}}))
    run_scene(with_(effects=[], loads=loads, systems={"s": {"on": "rocker", "pole": [3, -5]}}))


def test_a_compressor_without_clearance_is_full_of_nothing_at_top_dead_centre():
    cycle = Compressor(stroke=0.08, suction=1e5, delivery=7e5, clearance=0.0)
    out = np.array([False, True])
    with np.errstate(all="raise"):
        assert np.array_equal(cycle.pressure(np.zeros(2), out, out), [7e5, 1e5])


def test_the_polar_plot_has_room_for_the_whole_curve():
    run = run_scene(mechviz.load("shaking-four-bar"))
    drawing = drawings_of(run, 0.5)["shaking"]
    low, high = drawing.bounds
    tips = drawing.arrows[0].vector
    assert (low <= [tips.real.min(), tips.imag.min()]).all() and (high >= [tips.real.max(), tips.imag.max()]).all()


def test_shaking_moments_share_a_plot_with_names_of_their_own():
    run = run_scene(mechviz.load("shaking-four-bar"), frames=12)
    (output,) = [o for o in study_plots(run) if o.name.startswith("Shaking")]
    assert output.entities == (("/plots/shaking\\ moment", ()),)
    assert np.array_equal(output.values, np.column_stack([run.studies.shaking.moment, run.studies.balanced.moment]))


def test_drawings_are_to_scale():
    run = run_scene(with_(**ALL))
    drawings = drawings_of(run, 0.3)
    assert set(drawings) == {"velocity", "acceleration", "force", "funicular/forces", "shaking"}
    velocity = drawings["velocity"]
    v = next(i for i in velocity.arrows if i.label == "v_B")
    assert np.abs(v.vector) * velocity.per_metre == pytest.approx(np.full(37, 2.0))
    assert f"{velocity.per_metre:.4g}" in velocity.title
    for d in drawings.values():
        low, high = d.bounds
        assert 0 < (high - low).max() < 2 * 0.3


def test_centre_of_percussion_of_the_gallery_lies_on_the_inertia_resultant():
    run = run_scene(mechviz.load("percussion-centre"))
    force = run.forces.inertia("rod")
    w = run.motion.point("rod", "W") - run.motion.centre_of_mass("rod")
    about_w = force[:, 2] - (w[:, 0] * force[:, 1] - w[:, 1] * force[:, 0])
    assert np.abs(about_w).max() <= 1e-12 * np.abs(force[:, 2]).max()


@pytest.mark.parametrize(
    ("name", "force", "moment"),
    [
        ("inertia-uniform-translation", False, False),
        ("inertia-translation", True, False),
        ("inertia-uniform-rotation-about-centre", False, False),
        ("inertia-rotation-about-centre", False, True),
        ("inertia-uniform-rotation", True, False),
        ("percussion-centre", True, True),
    ],
)
def test_the_special_motions_have_the_inertia_of_the_table(name, force, moment):
    run = run_scene(mechviz.load(name))
    moving = next(k for k in run.motion.mechanism.links if k.name != run.motion.mechanism.frame)
    values = run.forces.inertia(moving.name)
    assert (np.abs(values[:, :2]).max() > 1e-6) == force
    assert (np.abs(values[:, 2]).max() > 1e-6) == moment
    if not force:
        assert np.abs(values[:, :2]).max() <= 1e-12


def test_counterweights_of_the_gallery_scene_balance_it():
    run = run_scene(mechviz.load("counterweighted-four-bar"))
    single = np.abs(run.forces.inertia("rocker")[:, :2]).max()
    assert run.studies.shaking.peak <= 1e-12 * single
    assert np.abs(run.forces.reaction("A")[:, :2]).max() > 0.1 * single


# -- balancing a scene --------------------------------------------------------------------------------------------------
def test_a_balanced_scene_says_what_it_was_given(tmp_path):
    balanced = balance_scene(with_(**ALL))
    assert balanced.after.peak <= 1e-12 * balanced.before.peak
    again = mechviz.loads(balanced.scene.to_toml(), "bar")
    assert again.document.links["crank"].point_masses and again.document.shaking.counterweights is None
    run = run_scene(again)
    assert run.studies.shaking.peak <= 1e-12 * balanced.before.peak
    out = tmp_path / "balanced.toml"
    result = CliRunner().invoke(app, ["balance", "shaking-engine", "-o", str(out), "--fraction", "0.4"])
    assert result.exit_code == 0, result.output
    assert "peak force" in result.output
    half = mechviz.load(out)
    assert [lump.mass for lump in half.document.links["crank"].point_masses]
    assert CliRunner().invoke(app, ["balance", "crank-rocker"]).exit_code == 2  # no radius
    assert CliRunner().invoke(app, ["balance", "ten-link", "--radius", "50 mm"]).exit_code == 2  # no four-bar
    assert CliRunner().invoke(app, ["balance", "shaking-engine", "--radius", "50 kg"]).exit_code == 2


# -- masses from shapes -------------------------------------------------------------------------------------------------
def test_every_row_of_the_table_of_solids_is_a_line_of_a_scene():
    """J about the named axis, against the formulas of the lecture written out."""
    m = 2.0
    rows = {
        "point": ({"radius": 0.3}, m * 0.09),
        "rod": ({"length": 0.4}, m * 0.16 / 12),
        "cylinder": ({"radius": 0.2}, m * 0.04 / 2),
        "cylinder across": ({"radius": 0.2, "length": 0.6}, m * (0.36 + 3 * 0.04) / 12),
        "hollow cylinder": ({"radius": 0.2, "bore": 0.1}, m * 0.05 / 2),
        "ring": ({"radius": 0.2}, m * 0.04),
        "disc": ({"radius": 0.2}, m * 0.04 / 2),
        "sphere": ({"radius": 0.2}, 0.4 * m * 0.04),
        "shell": ({"radius": 0.2}, 2 / 3 * m * 0.04),
        "ellipsoid": ({"b": 0.2, "c": 0.3}, m * 0.13 / 5),
        "cone": ({"radius": 0.2}, 0.3 * m * 0.04),
        "box": ({"a": 0.2, "b": 0.3}, m * 0.13 / 12),
        "cube": ({"a": 0.2}, m * 0.04 / 6),
        "torus": ({"radius": 0.2, "section": 0.05}, m * (0.04 + 0.75 * 0.0025)),
    }
    for name, (sizes, wanted) in rows.items():
        got = body("crank", mass={"solid": name, "mass": m, **sizes}, inertia=None)
        assert got[2] == pytest.approx(wanted, rel=1e-14), name
    ends = {"rod end": ({"length": 0.4}, 0.2), "rod inclined": ({"length": 0.4, "angle": "30 deg"}, 0.1)}
    for name, (sizes, half) in ends.items():
        mass, centre, inertia = body("crank", mass={"solid": name, "mass": m, **sizes}, inertia=None, centre=None)
        assert centre == pytest.approx((half, 0.0)), name  # seen along the axis
        assert inertia + mass * half**2 == pytest.approx(m * (2 * half) ** 2 / 3), name  # about the end
    assert {*rows, *ends} == set(SOLIDS)


def test_a_drawn_mass_is_that_of_the_outline_in_the_picture():
    drawn = {"drawn": True, "thickness": "8 mm", "density": 7850}
    links = {name: {"points": {**entry["points"]}} for name, entry in BASE["links"].items()}
    links["crank"]["mass"] = links["rocker"]["mass"] = drawn
    links["rocker"]["points"]["Q"] = [0.1, 0.08]  # a wide plate, with a mark
    scene = with_(links=links)
    motion = solve_motion(compile_mechanism(scene.mechanism), default_times(scene.mechanism, scene.frames))
    solids = build_solids(scene.mechanism, {k.name: motion.pose(k.name) for k in scene.mechanism.links}, tolerance=1e-4)
    for name in ("crank", "rocker"):
        link = next(k for k in scene.mechanism.links if k.name == name)
        (part,) = [p for p, kind in zip(solids.links[name].parts, solids.links[name].kinds, strict=True) if kind == "plate"]
        z = part.vertices[:, 2]
        outline = section(part, 0.5 * (z.min() + z.max()))
        assert link.mass == pytest.approx(outline.area * 0.008 * 7850, rel=1e-3), name
        assert link.centre == pytest.approx(outline.centroid.coords[0], abs=1e-4), name
    again = mechviz.loads(scene.to_toml(), "bar")
    assert again == scene and again.mechanism == scene.mechanism


@pytest.mark.parametrize(
    ("mass", "path", "words"),
    [
        ({"drawn": True, "density": 1}, "", "needs the thickness"),
        ({"drawn": True, "plate": ["A"], "width": 1, "mass": 1}, "", "plate and drawn at once"),
        ({"drawn": False, "mass": 1}, "", "none of solid"),
        ({"plate": ["A", "B"], "width": 0.02, "mass": 1, "holes": [{"at": "A", "radius": 0.02}]}, "holes[0]", "out of the plate"),
        (
            {"plate": ["A"], "width": 0.1, "mass": 1, "holes": [{"at": "A", "radius": 0.01}, {"at": [0.01, 0], "radius": 0.01}]},
            "holes[1]",
            "overlaps hole 1",
        ),
        (
            {"polygon": [[0, -1], [0, 1]], "bulges": [1, 1], "mass": 1, "holes": [{"at": [0.8, 0.8], "radius": 0.1}]},
            "holes[0]",
            "out of the plate",
        ),
        ({"polygon": [[0, -1], [0, 1], [3.5, 0]], "bulges": [3, 0, 0], "mass": 1}, "polygon", "crosses itself"),
        ({"solid": "rod inclined", "mass": 1, "length": 1}, "", "angle"),
    ],
)
def test_faults_of_drawn_and_cut_masses(mass, path, words):
    with pytest.raises(mechviz.SceneError) as caught:
        body("crank", mass=mass, centre=None, inertia=None)
    (fault,) = caught.value.faults
    assert fault.path == "links.crank.mass" + (f".{path}" if path else "")
    assert words in f"{fault.message} {fault.remedy}"


def test_masses_from_shapes():
    rod = body("crank", mass={"solid": "rod", "mass": 2}, centre=None, inertia=None)
    mass, centre, inertia = rod
    assert (mass, *centre, inertia) == pytest.approx((2, 0.05, 0, 2 * 0.01 / 12))
    mass, centre, inertia = body(
        "crank", mass={"solid": "disc", "radius": "20 mm", "thickness": 0.01, "density": 1000}, inertia=None
    )
    assert centre == (0.05, 0.01)
    assert mass == pytest.approx(np.pi * 0.02**2 * 0.01 * 1000) and inertia == pytest.approx(mass * 0.0002)
    plate = {"plate": ["A", "B"], "width": 0.04, "thickness": 0.01, "density": 1000}
    mass, centre, inertia = body("crank", mass=plate, centre=None, inertia=None)
    assert mass == pytest.approx((0.1 * 0.04 + np.pi * 0.02**2) * 10)
    assert centre == pytest.approx((0.05, 0))
    outline = {
        "polygon": [[0, 0.02], [0, -0.02], [0.1, -0.02], [0.1, 0.02]],
        "bulges": [1, 0, 1, 0],
        "thickness": 0.01,
        "density": 1000,
    }
    assert body("crank", mass=outline, centre=None, inertia=None)[2] == pytest.approx(inertia, rel=1e-12)
    holed = {**plate, "holes": [{"at": "A", "radius": 0.01}], "bosses": [{"at": [0.1, 0], "radius": 0.015, "height": 0.02}]}
    got = body("crank", mass=holed, centre=None, inertia=None)
    assert got[0] == pytest.approx(mass - np.pi * 1e-4 * 10 + np.pi * 0.015**2 * 20)
    assert got[1][0] == pytest.approx((mass * 0.05 + np.pi * 0.015**2 * 20 * 0.1) / got[0])
    total = body("crank", mass={"plate": ["A", "B"], "width": 0.04, "mass": "3 kg"}, centre=None, inertia=None)
    assert total[0] == pytest.approx(3) and total[2] / 3 == pytest.approx(inertia / mass)


def test_point_masses_are_added_and_make_lumped_models():
    mass, centre, _ = body("crank", point_masses=[{"mass": 0.2, "at": "B"}])
    assert mass == pytest.approx(1.0) and centre[0] == pytest.approx(0.8 * 0.05 + 0.2 * 0.1)
    only = body("crank", mass=None, centre=None, inertia=None, point_masses=[{"mass": 1, "at": "A"}, {"mass": 3, "at": "B"}])
    assert only[0] == 4 and only[1] == pytest.approx((0.075, 0)) and only[2] == pytest.approx(0.75 * 0.01)


def test_masses_from_a_mesh_file(tmp_path):
    import trimesh

    box = trimesh.creation.box((100, 40, 10))
    box.apply_translation((50, 0, 0))
    box.export(tmp_path / "part.stl")
    bar = with_(**link("crank", mass=0.123, centre=None, inertia=None, shape="bar")).to_toml()
    text = bar.replace('mass = 0.123, shape = "bar"', 'mass = { mesh = "part.stl", density = "7850 kg/m^3" }')
    assert "part.stl" in text
    (tmp_path / "scene.toml").write_text(text)
    crank = next(k for k in mechviz.load(tmp_path / "scene.toml").mechanism.links if k.name == "crank")
    mass = 0.1 * 0.04 * 0.01 * 7850
    assert crank.mass == pytest.approx(mass, rel=1e-6)
    assert crank.centre == pytest.approx((0.05, 0), abs=1e-9)
    assert crank.inertia == pytest.approx(mass * (0.1**2 + 0.04**2) / 12, rel=1e-6)
    (tmp_path / "part.stl").write_text("no mesh at all")
    with pytest.raises(mechviz.SceneError, match=r"cannot be read|not closed"):
        mechviz.load(tmp_path / "scene.toml")
    box.faces = box.faces[1:]
    box.export(tmp_path / "part.stl")
    with pytest.raises(mechviz.SceneError, match="not closed"):
        mechviz.load(tmp_path / "scene.toml")


def test_a_mesh_whose_faces_do_not_all_look_outwards_is_refused(tmp_path):
    """Two turned triangles moved the centre of a box, whose volume was right, and a second body inside out was taken away."""
    import trimesh

    def read(*bodies):
        trimesh.util.concatenate(bodies).export(tmp_path / "part.stl")
        return next(k for k in mechviz.load(tmp_path / "scene.toml").mechanism.links if k.name == "crank")

    text = with_(**link("crank", mass=0.123, centre=None, inertia=None, shape="bar")).to_toml()
    text = text.replace('mass = 0.123, shape = "bar"', 'mass = { mesh = "part.stl", density = 7850 }')
    (tmp_path / "scene.toml").write_text(text)
    box, hollow, beside = (trimesh.creation.box(sides) for sides in ((100, 40, 10), (60, 20, 6), (60, 20, 6)))
    hollow.invert()
    assert read(box, hollow).mass == pytest.approx((100 * 40 * 10 - 60 * 20 * 6) * 7850e-9, rel=1e-6)
    beside.apply_translation((0, 100, 0))
    assert read(box, beside).mass == pytest.approx((100 * 40 * 10 + 60 * 20 * 6) * 7850e-9, rel=1e-6)
    beside.invert()
    with pytest.raises(mechviz.SceneError, match="look inwards"):
        read(box, beside)
    faces = box.faces.copy()
    faces[[3, 7]] = faces[[3, 7], ::-1]
    with pytest.raises(mechviz.SceneError, match="look inwards"):
        read(trimesh.Trimesh(box.vertices, faces, process=False))


# -- recording ----------------------------------------------------------------------------------------------------------
def test_a_recording_has_the_polygons_and_their_closing_errors(tmp_path):
    path = tmp_path / "all.rrd"
    write_recording(run_scene(with_(**ALL)), path)
    recording = Recording(path)
    for name in ("velocity", "acceleration", "force", "funicular"):
        _, closing = recording.scalars("polygons", name, "closing")
        assert closing.shape == (37, 1) and np.abs(closing).max() < 1e-9
        assert recording.has("polygons", name)
    for moving in ("polygons/funicular/forces", "polygons/shaking", "polygons/substitutes/coupler"):
        assert recording.has(*moving.split("/")), moving
    for still in ("polygons/shaking/polar", "polygons/polodes/coupler", "mechanism/links/coupler/polode"):
        assert recording.static(*still.split("/"), component="LineStrips3D:strips") is not None, still
    _, shaking = recording.scalars("data", "shaking")
    _, balanced = recording.scalars("data", "shaking", "balanced")
    assert shaking.shape == (37, 3)
    assert np.abs(balanced[:, :2]).max() <= 1e-11 * np.abs(shaking[:, :2]).max()
    assert recording.scalars("data", "reduced", "crank")[1].shape == (37, 4)
    assert "counterweight on crank" in recording.notes and "two real solutions" in recording.notes
    bare = tmp_path / "bare.rrd"
    write_recording(run_scene(with_()), bare)
    assert not [e for e in Recording(bare).entities if e.startswith(("/polygons", "/data/shaking", "/data/reduced"))]


def test_power_balance_of_forces_without_power_is_no_rounding_blown_up():
    for name in ("inertia-uniform-rotation", "inertia-uniform-translation", "inertia-uniform-rotation-about-centre"):
        assert np.abs(run_scene(mechviz.load(name)).forces.power_balance).max() <= 1e-9
