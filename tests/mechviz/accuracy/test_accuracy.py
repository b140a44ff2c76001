"""The settings of accuracy: each is used, a wanted error is reached, and what the program says of its errors is true."""

from __future__ import annotations

import dataclasses
import gc
import sys
import types
import weakref
from pathlib import Path

import numpy as np
import pytest
from true_errors import between_error, position_errors, reaction_error

from mechcore.accuracy import DEFAULT, SETTINGS, Accuracy, accuracy_for
from mechcore.dynamics.simulate import simulate
from mechcore.dynamics.simulation import Simulation
from mechcore.errors import MechanismError
from mechcore.forces.kinetostatics import solve_forces
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion
from mechcore.numerics.interpolation import between, differentiate
from mechviz.accuracy import fit as fit_module
from mechviz.accuracy.estimate import integration_error, interpolation_error
from mechviz.accuracy.fit import fit_frames, is_outlier, measure_fit, quantity_function, target_lines
from mechviz.accuracy.quantities import CheckedQuantity, Passage, passages_of, pole_size, quantities
from mechviz.hard_cases.dynamics import SQUEEZED
from mechviz.runs import run_scene
from mechviz.scene.faults import SceneError
from mechviz.scene.scene import Scene, load, loads

sys.path.insert(0, str(Path(__file__).resolve().parents[3] / "benchmarks"))
from error_estimates import compare


# -- the settings -----------------------------------------------------------------------------------------------------------------
def test_every_dial_has_a_default_and_is_checked():
    assert DEFAULT.changed == {}
    assert set(SETTINGS) == {f.name for f in dataclasses.fields(Accuracy)} - {"target"}
    for name, wrong in {
        "position": 1.0, "frames": 2, "interpolation": 2, "differentiation": "guess", "differences": 3, "resolution": -1.0,
        "method": "euler", "integrator": 1.0, "nodes": 1, "window": 0.0, "friction": 1.0, "event": 2.0, "chord": 0.0, "profile": 3,
        "numbers": "float16", "decimation": 0, "pictures": 0, "target": 1.0,
    }.items():  # fmt: skip
        with pytest.raises(MechanismError, match=f"accuracy.{name}"):
            Accuracy(**{name: wrong})
    with pytest.raises(MechanismError, match="is no accuracy"):
        accuracy_for(0.5)


def test_all_settings_follow_from_the_target():
    loose, tight = accuracy_for(1e-3), accuracy_for(1e-9)
    for name in ("position", "friction", "event", "integrator"):
        assert getattr(loose, name) > getattr(tight, name) > 0.0, name
        assert getattr(loose, name) <= 1e-2
    assert loose.interpolation < accuracy_for(1e-12).interpolation
    assert [accuracy_for(t).target for t in (0.1, 1e-13)] == [0.1, 1e-13], "the loosest and the tightest"
    assert accuracy_for(1e-6, chord=1e-4, interpolation=5).changed["chord"] == 1e-4


def test_newton_stops_earlier_with_a_larger_tolerance(monkeypatch):
    from mechcore.numerics import newton

    calls = []
    solve_many = newton.solve_many
    monkeypatch.setattr(newton, "solve_many", lambda *a: calls.append(1) or solve_many(*a))
    m = load("triad").mechanism
    counts, misses = [], []
    exact = solve_motion(compile_mechanism(m), default_times(m, 97)).pose("plate")
    for tolerance in (2e-15, 1e-4):
        compiled = compile_mechanism(m, Accuracy(position=tolerance))
        solve_motion(compiled, default_times(m, 60))  # walks along the curve
        calls.clear()
        motion = solve_motion(compiled, default_times(m, 97))  # from the walk's polynomials
        counts.append(len(calls))
        misses.append(np.abs(motion.pose("plate") - exact).max())
    assert counts[1] < counts[0] and misses[0] < 1e-13 < misses[1] < 1e-2


def test_friction_stops_earlier_with_a_larger_tolerance():
    m = load("slider-crank-friction").mechanism
    computed = [solve_forces(solve_motion(compile_mechanism(m, Accuracy(friction=t)), default_times(m, 90))) for t in (1e-13, 1e-3)]
    tight, loose = (f.friction for f in computed)
    assert loose.iterations < tight.iterations
    assert tight.residual.max() < 1e-13 < loose.residual.max() < 1e-3
    peak = np.abs(computed[0].effort("O")).max()
    assert 0.0 < np.abs(computed[1].effort("O") - computed[0].effort("O")).max() < 1e-2 * peak


@pytest.mark.parametrize("order", [2, 4, 6])
def test_differences_have_their_order(order):
    errors = []
    for n in (40, 80):
        t = np.linspace(0.0, 2.0, n + 1)
        errors.append(
            [
                np.abs(differentiate(t, np.sin(3 * t), order, d) - w).max()
                for d, w in ((1, 3 * np.cos(3 * t)), (2, -9 * np.sin(3 * t)))
            ]
        )
    first, second = np.log2(np.array(errors[0]) / errors[1])
    assert first == pytest.approx(order, abs=0.4)
    assert second == pytest.approx(order - 1, abs=0.6)  # at the ends the polynomial loses one order more
    uneven = np.sort(np.concatenate([np.linspace(0.0, 1.0, 30), np.linspace(1.01, 2.0, 21)]))
    assert np.abs(differentiate(uneven, uneven**2, order) - 2 * uneven).max() < 1e-10


def test_rates_by_differences_and_by_the_drawn_method():
    scene = load("crank-rocker")
    exact = run_scene(scene).motion
    peak = np.abs(exact.acceleration("rocker")[:, 2]).max()
    errors = {}
    for name, settings in {
        "2": Accuracy(differentiation="differences", differences=2),
        "4": Accuracy(differentiation="differences", differences=4),
        "drawn": Accuracy(differentiation="graphical", resolution=5e-4),
    }.items():
        motion = run_scene(scene, frames=360 if name != "drawn" else 24, accuracy=settings).motion
        other = exact if name != "drawn" else run_scene(scene, frames=24).motion
        errors[name] = np.abs(motion.acceleration("rocker")[:, 2] - other.acceleration("rocker")[:, 2]).max() / peak
        assert np.abs(motion.pose("rocker") - other.pose("rocker")).max() < 1e-14, "positions are the same"
        assert np.abs(motion.point("coupler", "E", 1)).max() > 0.1
    assert 0.0 < errors["4"] < errors["2"] < 5e-2 < errors["drawn"] < 1.0
    with pytest.raises(MechanismError, match="forces decide the motion"):
        run_scene(load("andrews-squeezer"), accuracy=Accuracy(differentiation="differences"))


def test_nodes_and_windows_of_the_integrator():
    scene = load("andrews-squeezer")
    plain = run_scene(scene, accuracy=Accuracy(method="gauss", integrator=1e-6)).simulation
    few = run_scene(scene, accuracy=Accuracy(method="gauss", integrator=1e-6, nodes=4)).simulation
    short = run_scene(scene, accuracy=Accuracy(method="gauss", integrator=1e-6, window=2e-4)).simulation
    windows = [[w for p in s.segments for w in p.solution.windows] for s in (plain, few, short)]
    assert {len(w.a) for w in windows[1]} == {4} and len(windows[1]) > len(windows[0])
    assert max(w.length for w in windows[2]) <= 2e-4 < max(w.length for w in windows[0])
    assert plain.method == "gauss" and plain.tolerance == 1e-6


@pytest.mark.parametrize("scene", ["gear-train", "crank-rocker"])
def test_chords_are_as_near_to_circles_as_is_asked(scene, monkeypatch):
    """The middles of the sides of the largest circle lie at most the chord's distance inside it; no more sides than that needs."""
    from mechviz.meshes import solids as made
    from mechviz.meshes.model import largest_circle
    from mechviz.picture.build import solids_of

    models = []
    draft = made.draft_pieces
    monkeypatch.setattr(made, "draft_pieces", lambda model: models.append(model) or draft(model))
    run = run_scene(load(scene), frames=36)
    counts = []
    for chord in (1e-4, 1e-5):
        solids = solids_of(dataclasses.replace(run, accuracy=Accuracy(chord=chord)))
        radius = solids.size * largest_circle(models[-1])
        sides = models[-1].segments
        assert radius * (1.0 - np.cos(np.pi / sides)) <= chord * (1 + 1e-9)
        assert radius * (1.0 - np.cos(np.pi / (sides - 5))) > chord or sides == 24, "circles have sides in steps of four"
        counts.append(sum(len(s.faces) for s in solids.links.values()))
    assert counts[0] < counts[1]


def test_profile_points_of_a_cam():
    from mechviz.picture.build import solids_of

    run = run_scene(load("cam-roller"), frames=36)
    few, many = (solids_of(dataclasses.replace(run, accuracy=Accuracy(profile=n))).links["cam"].faces for n in (180, 2160))
    assert len(few) < 0.3 * len(many)


def test_what_is_recorded_has_the_digits_and_frames_that_are_asked(tmp_path):
    from mechviz.outputs.inspection import inspect
    from mechviz.outputs.rerun.reader import Recording
    from mechviz.outputs.rerun.writer import write_recording

    scene = load("crank-rocker")
    full, thin = (
        run_scene(scene, frames=361, accuracy=a) for a in (DEFAULT, Accuracy(numbers="float32", decimation=4))
    )  # fmt: skip
    sizes = []
    for run, name in ((full, "full.rrd"), (thin, "thin.rrd")):
        summary = write_recording(run, tmp_path / name)
        rows = Recording(tmp_path / name).rows("data", "links", "rocker", "pose", component="Scalars:scalars")
        values = rows.values.reshape(len(rows.time), 3)
        sizes.append(summary.bytes)
        if run is thin:
            assert len(values) == summary.frames == 91
            assert np.array_equal(values, run.motion.pose("rocker")[::4].astype(np.float32).astype(float))
        else:
            assert np.array_equal(values, run.motion.pose("rocker"))
    assert sizes[1] < 0.7 * sizes[0]
    computed = {p.item: p.value for p in inspect(tmp_path / "full.rrd").health}
    assert computed["estimated error: between frames"] == pytest.approx(np.nanmax(full.errors.interpolation))
    assert 0.0 < computed["estimated error: position"] < 1e-13


def test_what_nobody_asks_for_costs_nothing(monkeypatch):
    """Neither frames are fitted nor errors estimated, and rates are not taken by differences."""
    from mechcore.motion import motion
    from mechviz.accuracy import estimate, fit

    for module, name in ((fit, "fit_frames"), (estimate, "estimate_errors"), (motion, "_numerical_rates")):
        monkeypatch.setattr(module, name, None)
    run = run_scene(load("slider-crank-engine"), frames=36)
    assert run.accuracy is DEFAULT and run.fit is None


# -- the scene's keyword ---------------------------------------------------------------------------------------------------------
def _with(accuracy: object, **run: object) -> dict:
    document = load("crank-rocker").document.model_dump(exclude_defaults=True)
    return {**document, "accuracy": accuracy, **({"run": run} if run else {})}


def test_a_scene_states_its_accuracy_and_is_written_back():
    scene = Scene.build(**_with(1e-5))
    assert scene.accuracy == accuracy_for(1e-5) and loads(scene.to_toml()) == scene and "accuracy = 1e-05" in scene.to_toml()
    table = Scene.build(**_with({"target": 1e-5, "chord": "0.2 mm", "interpolation": "quintic"}))
    assert table.accuracy == accuracy_for(1e-5, chord=2e-4, interpolation=5) and loads(table.to_toml()) == table
    stated = run_scene(Scene.build(**_with(1e-5, frames=77)))
    assert stated.motion.frames == 78 and stated.fit is None, "frames that the scene states stay"
    fitted = run_scene(Scene.build(**_with(1e-5)))
    assert fitted.fit is not None and fitted.motion.frames == fitted.fit.frames + 1 == fitted.scene.frames + 1


@pytest.mark.parametrize(
    ("value", "path", "words"),
    [
        (3, "accuracy", "3 is no accuracy"),
        ("high", "accuracy", "'high' is no accuracy"),
        ({"targt": 1e-3}, "accuracy", "unknown key 'targt'"),
        ({"chord": "-3 mm"}, "accuracy.chord", "is negative"),
        ({"chord": "3 kg"}, "accuracy.chord", "is a mass"),
        ({"chord": "3 km"}, "accuracy.chord", "is out of range"),
        ({"interpolation": "cubik"}, "accuracy.interpolation", "'cubik'"),
        ({"nodes": 5}, "accuracy.nodes", "nothing is free"),
        ({"decimation": 0}, "accuracy.decimation", "too small"),
        ({"friction": 0.5}, "accuracy.friction", "out of range"),
    ],
)
def test_faults_of_the_keyword(value, path, words):
    with pytest.raises(SceneError) as e:
        Scene.build(**_with(value))
    (fault,) = e.value.faults
    assert fault.path == path and words in fault.message and fault.remedy


# -- between frames ---------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(("order", "rates"), [(0, False), (1, False), (3, True), (3, False), (5, True), (5, False)])
def test_interpolation_has_its_order(order, rates):
    def miss(n: int) -> float:
        t = np.linspace(0.0, 2.0, n + 1)
        fine = np.linspace(0.2, 1.8, 999)
        more = (2 * np.cos(2 * t)[:, None], -4 * np.sin(2 * t)[:, None]) if rates else (None, None)
        return float(np.abs(between(t, np.sin(2 * t)[:, None], fine, order, *more)[:, 0] - np.sin(2 * fine)).max())

    assert np.log2(miss(16) / miss(32)) == pytest.approx(order + 1, abs=0.35)


def test_intervals_with_a_jump_stand_out():
    errors = 1e-6 * (1.5 + np.sin(np.linspace(0.0, 6.0, 200)))
    assert not is_outlier(errors).any()
    errors[80] = 0.3
    assert list(np.flatnonzero(is_outlier(errors))) == [80]


@pytest.mark.sample(6)
@pytest.mark.parametrize("name", ["crank-rocker", "triad", "ten-link-forces", "shaper-quick-return", "slider-crank-compressor"])
@pytest.mark.parametrize("target", [1e-3, 1e-5, 1e-8])
def test_the_wanted_error_is_reached_and_not_far_undercut(name, target):
    """Measured at random times, where the fit did not look. A few frames have to be there, however little is wanted."""
    run = run_scene(load(name), accuracy=target)
    error = between_error(run, each=3, seed=int(1 / target) % 97)
    assert error <= target
    assert error >= 0.05 * target or run.motion.frames <= 20
    assert run.fit.error <= target


def test_a_jump_is_counted_and_named():
    run = run_scene(load("cam-roller"), accuracy=1e-4)
    assert run.fit.error <= 1e-4 and run.fit.jumps > 0
    assert np.nanmax(run.errors.interpolation) > 1e-3, "the estimate does not leave it out"
    assert run.fit.jump_error > 1e-3 and f"up to {run.fit.jump_error:.1e} of the peak is left there" in target_lines(run)[0]


@pytest.mark.parametrize(
    ("extra", "reached", "jumps"),
    [
        (lambda t: 8.0 * np.abs(t - 0.3712) * (t - 0.3712), True, 1),
        (lambda t: np.where(t > 0.3712, 0.3, 0.0), False, 1),
        (lambda t: np.where((20.0 * t) % 1.0 > 0.37, 0.3, 0.0), False, 40),
    ],
    ids=["bend", "jump", "many jumps"],
)
def test_more_frames_resolve_a_bend_and_not_a_jump(extra, reached, jumps, monkeypatch):
    """Cubics over a sine with something in it: the error where it bends falls with the frames, that of a jump stays."""

    def at(t):
        return [CheckedQuantity("x", "position", (np.sin(6.0 * t) + extra(t))[:, None], 1.0)]

    monkeypatch.setattr(fit_module, "quantity_function", lambda *_: at)
    monkeypatch.setattr(fit_module, "duration", lambda *_: 1.0)
    fit = fit_frames(types.SimpleNamespace(cycles=1, mechanism=load("crank-rocker").mechanism), accuracy_for(1e-5, interpolation=3))
    assert fit.error <= 1e-5 and (fit.jump_error <= 1e-5) == reached and fit.left_out <= 0.1
    assert fit.jumps == jumps and fit.frames < 3000
    if not reached:
        assert fit.jump_error == pytest.approx(0.15, rel=0.1)


def test_a_motion_whose_rounding_grows_beyond_the_wanted_error_says_so(monkeypatch):
    run = run_scene(load("andrews-squeezer"), frames=100, accuracy=1e-6)
    assert target_lines(run)[1].startswith("motion under forces: within")
    monkeypatch.setattr(fit_module, "integration_error", lambda *_: np.array([3e-5]))
    assert target_lines(run)[1].startswith("warning: motion under forces: about 3.0e-05 is left")
    assert target_lines(dataclasses.replace(run, resimulate=None))[1].startswith("warning: motion under forces: no second run")


def test_what_a_motion_is_compared_with_is_made_once_and_goes_with_its_run():
    """Both were kept for four runs more, which were hundreds of megabytes of long motions."""
    run, made = run_scene(load("swinging-double-pendulum"), frames=8), []
    simulate, judged = run.resimulate, weakref.ref(run.simulation)

    def again(*args: object) -> Simulation:
        made.append(weakref.ref(companion := simulate(*args)))
        return companion

    for _ in range(2):
        integration_error(run.simulation, run.motion.time, again)
    (companion,) = made
    assert companion() is not None
    del run, again
    gc.collect()
    assert companion() is None and judged() is None


@pytest.mark.parametrize("target", [1e-3, 1e-5, 1e-8])
def test_motion_under_forces_within_the_wanted_error(target):
    """The squeezer stepped in time, against its reference; the estimate is within ten of the truth."""
    run = run_scene(load("andrews-squeezer"), frames=100, accuracy=accuracy_for(target, method="gauss"))
    assert run.simulation.method == "gauss"
    assert abs(run.simulation([0.03])[0][0, 0] - SQUEEZED[0]) <= target
    t = np.linspace(0.0, 0.03, 65)
    truth = np.abs(run.simulation(t)[0] - simulate(run.compiled, 0.03, method="energy")(t)[0]).max()
    said = integration_error(run.simulation, t, run.resimulate).max()
    assert truth <= target and 0.1 < max(said, 1e-12) / max(truth, 1e-12) < 10.0


# -- what the program says of its errors -----------------------------------------------------------------------------------------
@pytest.mark.parametrize("name", ["crank-rocker", "slider-crank-compressor", "near-flat-four-bar", "ten-link-forces"])
def test_estimates_are_within_ten_of_the_truth(name):
    """Those of the benchmark over the gallery, on a sample; rates next to singular positions are only bounded."""
    compared = list(compare(name))
    assert len(compared) >= 4
    assert all(c.bounded for c in compared), [c for c in compared if not c.bounded]
    assert all(c.within for c in compared if c.what not in ("velocity", "acceleration"))


@pytest.mark.parametrize("name", ["scissor-lift", "valve-train", "lamp-arm"])
def test_small_reactions_have_the_rounding_of_the_largest_force(name):
    """Joints that carry next to nothing beside the largest force, as one system of equations finds them: relative to themselves."""
    run = run_scene(load(name))
    truth = float(np.nanmax(reaction_error(run.scene, run.scene.frames)))
    said = float(np.nanmax(run.errors.reaction))
    assert truth > 1e-12 and 0.1 <= said / truth <= 10.0


def test_positions_in_extended_precision_are_better():
    """A wrong digit in a position shows in its true error, and no other way."""
    motion = run_scene(load("crank-rocker")).motion
    assert 0.0 < position_errors(motion)["position"].max() < 1e-14
    motion.state.rot = [r * np.exp(1e-9j) if k == 2 else r for k, r in enumerate(motion.state.rot)]
    motion._origins.clear()
    motion._origins.update({(0, 0): 0j, (0, 1): 0j, (0, 2): 0j})
    assert position_errors(motion)["position"].max() > 1e-10


def test_the_estimate_between_frames_falls_with_the_frames():
    scene, at = load("crank-rocker"), quantity_function(load("crank-rocker"), DEFAULT)
    for order in (0, 1, 3, 5):
        said = []
        for frames in (90, 180):
            run = run_scene(scene, frames=frames)
            said.append(np.nanmax(interpolation_error(quantities(run.motion, None), run.motion.time, order)))
            true = measure_fit(at, 1.0, frames, order).error
            assert 0.3 < said[-1] / true < 4.0
        assert np.log2(said[0] / said[1]) > order + 0.4


def test_fit_is_the_least_number_of_frames():
    scene, settings = load("crank-rocker"), accuracy_for(1e-5)
    fit = fit_frames(scene, settings)
    at = quantity_function(scene, settings)
    assert measure_fit(at, 1.0, fit.frames, 3).error <= 1e-5 < measure_fit(at, 1.0, int(0.6 * fit.frames), 3).error


def test_a_number_of_a_few_is_told_with_those_that_are_known():
    text = load("cam-roller").text.replace("[links]", "[accuracy]\ndifferences = 3\n\n[links]", 1)
    with pytest.raises(MechanismError) as refused:
        loads(text)
    assert [str(f) for f in refused.value.faults] == ["accuracy.differences: 3 is not one of 2, 4, 6. Write one of these."]


@pytest.mark.parametrize("share", [0.2, 0.5, 0.77])
def test_a_pole_between_frames_is_told_as_large_as_it_is_beside_it(share):
    """A / x + b + c x at frames: what is said is A over a hundredth of the distance; without the pole, or small, nothing is."""
    x = np.arange(12.0) - 5.0 - share
    passage = Passage(5, share)
    for strength in (1.0, -3.0):
        values = (strength / x + 0.7 + 0.2 * x)[:, None]
        said = pole_size(passage, CheckedQuantity("reaction A", "reaction", values, 2.0))
        assert said == pytest.approx(abs(strength) / 0.01 / 2.0, rel=0.1)
    for values in (0.7 + 0.2 * x, np.sin(x), x**3, 1e-5 / x + 1.0):
        assert pole_size(passage, CheckedQuantity("reaction A", "reaction", values[:, None], 1.0)) == 0.0


def test_poles_are_where_bars_come_into_line():
    """Uprights that fall through the line of the ground: the reactions of the bars go as one over the angle to it (statics)."""
    run = run_scene(load("falling-four-bars"))
    passages = passages_of(run.motion)
    angle = run.motion.pose("upright0")[:, 2]
    turns = np.flatnonzero(np.diff(np.floor(angle / np.pi)) != 0)
    assert len(turns) == 8 and sorted({p.frame for p in passages}) == list(turns)
    k = int(turns[0])
    share = next(p.fraction for p in passages if p.frame == k)
    there = run.motion.time[k] + share * (run.motion.time[k + 1] - run.motion.time[k])
    assert abs(np.sin(run.simulation([there])[0][0, 0])) < 1e-3
    assert run.errors.interpolation[k] > 10.0 > 100.0 * np.median(run.errors.interpolation)


def test_rounding_next_to_a_change_point_does_not_fall_with_the_number_of_frames():
    """A kite that folds flat: there digits are lost, and the estimate leaves them as they are."""
    result = [c for c in compare("kite") if c.what == "between frames, order 5"]
    assert result[0].within and result[0].truth > 1e-12
