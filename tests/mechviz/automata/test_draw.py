"""`mechviz draw`: strokes of drawings and words, the motion of the pen, the machine that draws them, and its ink."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
import shapely
from design_cases import design_case

import mechviz
from mechcore.errors import MechanismError
from mechcore.forces.cam_rating import placed_cams
from mechviz.automata.pen_linkages import CrossSlides
from mechviz.automata.pen_motion import plan_motion, plotter_scene
from mechviz.automata.strokes import fit_to_sheet, joined_strokes, ordered_strokes, svg_strokes, text_strokes
from mechviz.automata.writer import design_drawing_machine
from mechviz.files import OutputError
from mechviz.meshes.solids import build_solids
from mechviz.outputs.exports.cam_profiles import _chain, cam_outlines
from mechviz.picture.build import solids_of
from mechviz.picture.surface_marks import drawn_strokes, growing, stroke_nodes
from mechviz.runs import run_scene

ERROR = 2e-4
RISE = np.radians(4.0)
HOOK = np.array([-40.0, -40.0 + 25.0j, -5.0 + 25.0j]) * 1e-3  # one right angle
RING = 20e-3 + 12e-3 * np.exp(1j * np.linspace(0.0, 2.0 * np.pi, 181))


def distances(points, line):
    """Distances of points (n,) from a polyline, each from all of its sides."""
    a, way = line[:-1, None], np.diff(line)[:, None]
    u = np.clip(np.real((points - a) * np.conj(way)) / np.abs(way) ** 2, 0.0, 1.0)
    return np.abs(points - a - u * way).min(axis=0)


@pytest.fixture(scope="module")
def motion():
    return plan_motion([HOOK, RING], ERROR, RISE)


@pytest.fixture(scope="module")
def writer():
    return design_drawing_machine([HOOK, RING], ERROR, title="Hook and ring")


@pytest.fixture(scope="module")
def slides():
    return design_drawing_machine([HOOK, RING], ERROR, title="Hook and ring", linkage=CrossSlides)


def fine(motion, count=8000):
    """Angles, places, and the derivatives of the pen's motion by the angle: its places are samples of what has no higher waves."""
    spectrum = np.fft.fft(motion.places)
    n = len(spectrum)
    order = np.fft.fftfreq(n, 1.0 / n)
    angles = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    waves = np.exp(1j * np.outer(angles[:: count // 4000], order)) / n
    return angles[:: count // 4000], [waves @ (spectrum * (1j * order) ** k) for k in range(4)]


def test_the_pen_stays_within_the_error_of_its_strokes(motion):
    angles, (places, *_) = fine(motion, 4000)
    for stroke, (begin, end) in zip((HOOK, RING), motion.strokes, strict=True):
        line = places[(angles >= begin) & (angles <= end)]
        assert distances(line, stroke).max() < 1.02 * motion.error
        dense = np.concatenate([a + (b - a) * np.linspace(0.0, 1.0, 7) for a, b in pairwise(stroke)])
        assert distances(dense, line).max() < 1.05 * motion.error
    assert 0.3 * ERROR < motion.error <= ERROR


def test_its_jerk_is_the_stated_one_and_it_rests_where_it_is_lifted(motion):
    angles, rates = fine(motion)
    for order, stated in ((1, motion.speed), (2, motion.acceleration), (3, motion.jerk)):
        assert np.abs(rates[order]).max() == pytest.approx(stated, rel=0.02)
    for (begin, end), (up, _, _, down) in zip(motion.strokes, motion.pen_up, strict=True):
        assert up == pytest.approx(end)
        for at in (begin, end, down):
            k = np.argmin(np.abs(angles - at % (2.0 * np.pi)))
            assert abs(rates[1][k]) < 2e-3 * motion.speed
    assert motion.pen_up[0][1] - motion.pen_up[0][0] == pytest.approx(RISE)


def test_a_corner_is_cut_as_the_spline_says():
    """At a corner of turn d that is passed at the speed v a cubic B-spline over h cuts off (7/15) v h sin(d/2), goes on at
    v cos(d/2), and has the acceleration (4/3) v sin(d/2) / h: their ratio knows neither v nor h."""
    _, (places, rate, second, _) = fine(plan_motion([HOOK], ERROR, RISE))
    near = np.abs(places - HOOK[1])
    k = int(np.argmin(near))
    assert near[k] * np.abs(second[k]) / np.abs(rate[k]) ** 2 == pytest.approx(28.0 / 45.0, rel=0.06)


def test_a_smaller_error_takes_a_slower_corner_and_a_larger_acceleration(monkeypatch):
    loose, tight = (plan_motion([HOOK, RING], e, RISE) for e in (5e-4, 5e-5))
    assert tight.error <= 5e-5 < loose.error <= 5e-4
    assert tight.acceleration > loose.acceleration
    assert 0.3 < tight.even < 1.0
    with pytest.raises(MechanismError, match="without any error"):
        plan_motion([HOOK], 0.0, RISE)
    monkeypatch.setattr("mechviz.automata.pen_motion._planned", lambda *_: None)  # what is too fine takes long to find out
    with pytest.raises(MechanismError, match=r"an error of 0\.0001 mm on a drawing of 35 mm cannot be reached"):
        plan_motion([HOOK], 0.9e-7, RISE, stated=1e-7)


@pytest.mark.parametrize(("made", "link"), [("writer", "left rod"), ("slides", "pen slide")])
def test_the_machine_draws_them_within_the_stated_error(made, link, request):
    writer = request.getfixturevalue(made)
    frames = 2711  # no multiple of what it was made with
    run = run_scene(writer.scene.changed({("run", "frames"): frames}))
    pen = run.motion.point(link, "P") @ np.array([1.0, 1.0j])
    down = run.motion.coordinate("C")[:, 0] <= run.motion.mechanism.studies.pens[0].level
    strokes = [s for s in drawn_strokes(down) if s[0] < 0.9 * frames]  # at the end the pen is down for the next turn
    middle = np.mean(np.concatenate([HOOK, RING]).imag)
    shift = pen[strokes[0][0]] - HOOK[0]
    assert abs(shift.real) < ERROR  # the sheet lies straight above the shaft
    assert len(strokes) == 2 and middle < shift.imag
    for stroke, frames_of in zip((HOOK, RING), strokes, strict=True):
        line = pen[frames_of] - 1j * shift.imag
        assert distances(line, stroke).max() < 1.1 * ERROR
        assert distances(stroke, line).max() < 1.1 * ERROR
    assert writer.error <= ERROR


def test_each_lever_leads_one_of_two_crossed_slides(slides):
    """The pin of a lever of length l at the angle q is l sin q above its pivot, l cos q beside it: the slide goes so far."""
    motion = run_scene(slides.scene, frames=90).motion
    pen, links = motion.point("pen slide", "P"), {link.name: link.points for link in motion.mechanism.links}
    for column, lever, pin, joint, led in ((1, "left lever", "D", "A", np.sin), (0, "right lever", "E", "B", np.cos)):
        assert np.ptp(pen[:, column] - links[lever][pin][0] * led(motion.coordinate(joint)[:, 0])) < 1e-12
        assert np.ptp(pen[:, column]) > 0.03


def test_no_two_solids_of_the_slides_meet_in_a_turn(slides):
    motion = run_scene(slides.scene, frames=60).motion
    poses = {link: motion.pose(link) for link in motion.model.links}
    assert build_solids(motion.mechanism, poses, profile=180).clashes == ()


def test_its_cams_keep_to_the_pressure_angle_and_are_not_undercut(writer):
    run = run_scene(writer.scene)
    cams = placed_cams(run.motion)
    assert [cam.name for cam in cams] == ["X", "Y", "Z"]
    for cam, stated, sharp in zip(cams, writer.pressure_angles, writer.least_radii, strict=True):
        cam_at = cam.cam.at(np.linspace(0.0, 2.0 * np.pi, 7001))
        largest = np.degrees(np.abs(cam_at.pressure_angle).max())
        assert largest == pytest.approx(np.degrees(stated), abs=0.1) and largest < 40.1
        convex = cam_at.radius[cam_at.radius > 0.0]
        assert convex.min() == pytest.approx(sharp, rel=0.05) and sharp > 0.15 * cam.cam.follower.radius


def test_the_rollers_of_the_machine_touch_its_cams_as_they_are_cut(writer):
    """At every angle of the shaft each roller lies on its profile as drawings hold it: on arcs a bulge b turns by 4 atan(b)."""
    run = run_scene(writer.scene.changed({("run", "frames"): 24}))
    pose, joints = run.motion.pose("cams"), {joint.name: joint for joint in run.motion.mechanism.joints}
    for outline in cam_outlines(run):
        z, bulges = _chain(outline)
        turn, part = 4.0 * np.arctan(bulges)[:, None], np.linspace(0.0, 1.0, 6, endpoint=False)
        along = np.where(abs(turn) > 1e-9, (np.exp(1j * turn * part) - 1.0) / (np.exp(1j * turn) - 1.0 + (turn == 0.0)), part)
        profile = (z[:, None] + (np.roll(z, -1) - z)[:, None] * along).ravel()
        lever = joints[outline.cam].links[1]
        centre = (run.motion.point(lever, "R") - pose[:, :2]) @ np.array([1.0, 1.0j]) * np.exp(-1j * pose[:, 2])
        ring = shapely.LinearRing(np.column_stack([profile.real, profile.imag]))
        gaps = shapely.distance(ring, shapely.points(1e3 * np.column_stack([centre.real, centre.imag])))
        np.testing.assert_allclose(gaps, 1e3 * joints[outline.cam].face.radius, atol=2e-3)  # mm


def test_the_program_for_motors_goes_the_same_way(motion):
    scene = plotter_scene(motion, 30.0, title="axes", name="axes")
    run = run_scene(scene)
    assert run.motion.time[-1] == pytest.approx(30.0)
    pen = run.motion.point("pen", "P") @ np.array([1.0, 1.0j])
    assert np.abs(pen[:-1:2] - motion.places).max() < 1e-9
    down = run.motion.coordinate("Z")[:, 0] <= run.motion.mechanism.studies.pens[0].level
    assert len([s for s in drawn_strokes(down) if s[0] < 0.9 * len(pen)]) == 2


def test_ink_grows_and_ends_as_what_was_drawn():
    turn = np.linspace(0.0, 2.0 * np.pi, 400)
    places = np.column_stack([np.cos(turn), np.sin(turn)])
    down = (turn < 2.0) | (turn > 3.0)
    strokes = drawn_strokes(down)
    first, second = growing(places, strokes, 1e-3)
    assert first.shape[1] < 40 and np.array_equal(first[-1, -1], places[strokes[0][-1]])
    assert np.all(first[0] == places[0])  # nothing yet
    k = strokes[0][len(strokes[0]) // 2]
    assert np.array_equal(first[k, -1], places[k])  # the rest lies at the pen
    assert np.all(second[k] == places[k]) and np.all(second[strokes[1][0] - 1] == places[strokes[0][-1]])
    radii = np.hypot(*np.moveaxis(0.5 * (second[-1, 1:] + second[-1, :-1]), -1, 0))
    assert 1.0 - radii.min() < 1e-3  # chords stay within what was asked for


def test_strokes_of_an_svg(tmp_path):
    path = tmp_path / "a.svg"
    path.write_text(
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 100 100"><g transform="translate(10 0) scale(2)">'
        '<circle cx="20" cy="20" r="10"/><path d="M0 0 L 10 0 M 5 5 h 10 v 10"/></g></svg>'
    )
    ring, line, hook = svg_strokes(path)
    assert np.abs(np.diff(ring)).sum() == pytest.approx(2.0 * np.pi * 20.0, rel=1e-3)
    assert np.abs(ring - (50.0 - 40.0j)).max() == pytest.approx(20.0) and np.allclose(line, [10.0, 30.0])
    assert np.allclose(hook, [20.0 - 10.0j, 40.0 - 10.0j, 40.0 - 30.0j])  # y upwards
    sheet = fit_to_sheet([ring, line, hook], 0.1)
    every = np.concatenate(sheet)
    assert np.ptp(every.imag) == pytest.approx(0.1) or np.ptp(every.real) == pytest.approx(0.1)


@pytest.mark.parametrize("corner", range(3))
def test_a_rounded_corner_of_an_svg_is_the_reference_s(tmp_path, corner):
    """A corner that an arc rounds: how far the arc passes it, how long it is, and the acceleration at the reference's speed."""
    inputs, expected = design_case("stroke-time-parametrisation")
    given, wanted = inputs["corners"][corner], expected["corners"][corner]
    turn, radius, leg = np.radians(given["turn_deg"]), 1e3 * wanted["radius"], 1e3 * wanted["tangent_length"]
    end = leg * np.exp(1j * turn)
    path = f"M {-leg:.12f} 0 A {radius:.12f} {radius:.12f} 0 0 0 {end.real:.12f} {-end.imag:.12f}"
    (tmp_path / "corner.svg").write_text(f'<svg xmlns="http://www.w3.org/2000/svg"><path d="{path}"/></svg>')
    (arc,) = svg_strokes(tmp_path / "corner.svg")
    sides = np.abs(np.diff(arc))
    assert sides.sum() == pytest.approx(1e3 * wanted["arc_length"], rel=1e-4)
    assert np.abs(arc).min() == pytest.approx(1e3 * given["eps"], rel=1e-3)
    turning = np.abs(np.angle(np.diff(arc)[1:] / np.diff(arc)[:-1])) / sides[1:]  # per mm
    wished = min(given["v"], np.sqrt(given["a"] / (1e3 * turning.mean())))
    assert wished == pytest.approx(wanted["speed"], rel=1e-3)


def test_strokes_are_put_in_a_short_order_and_joined():
    rng = np.random.default_rng(5)
    ends = rng.uniform(-1.0, 1.0, (30, 2)) @ np.array([1.0, 1.0j])
    strokes = [np.array([z, z + 0.1]) for z in ends]
    ordered = ordered_strokes(strokes, 0.0)
    before, after = (sum(abs(b[0] - a[-1]) for a, b in pairwise([*some, some[0]])) for some in (strokes, ordered))
    assert len(ordered) == 30 and after < 0.5 * before
    chain = [np.array([k + 0.0j, k + 1.0]) for k in (2, 0, 1)]
    (joined,) = ordered_strokes(chain, 1e-9)
    assert np.allclose(joined, [0, 1, 2, 3])


def test_letters_that_a_font_lacks_are_told():
    with pytest.raises(OutputError, match="has no Ż, ó, ł"):
        text_strokes("Żółw", "scripts")


def test_words_are_written_from_letter_to_letter():
    """As one writes; the shortest way between strokes would begin with the last letters and go backwards through some."""
    strokes = text_strokes("Ada", "scripts")
    written, shortest = joined_strokes(strokes, 1e-9), ordered_strokes(strokes, 1e-9)
    assert np.all(np.diff([stroke[0].real for stroke in written]) > 0.0)
    assert not np.all(np.diff([stroke[0].real for stroke in shortest]) > 0.0)
    halves = [np.array([0.0, 1.0]), np.array([1.0, 2.0j]), np.array([3.0, 4.0])]
    assert [len(stroke) for stroke in joined_strokes(halves, 1e-9)] == [3, 2]


def test_the_sheet_of_paper_lies_just_behind_all_ink():
    run = run_scene(crank_rocker_with_a_pen(), frames=36)
    ink, edge, paper = stroke_nodes(run, solids_of(run))
    places = np.concatenate([strip[-1] for strip in ink.strips])
    low, high = paper.mesh.vertices.min(axis=0), paper.mesh.vertices.max(axis=0)
    assert np.all(places[:, :2] > low[:2]) and np.all(places[:, :2] < high[:2])
    gap = places[:, 2] - high[2]
    assert np.ptp(gap) == 0.0 and ink.radii[0] <= gap[0] < 2.0 * ink.radii[0]
    assert edge.strips[0][0, :, :2].max(axis=0) == pytest.approx(high[:2])
    assert paper.group == edge.group and paper.poses is None


def crank_rocker_with_a_pen():
    text = mechviz.load("crank-rocker").to_toml()
    return mechviz.loads(text + '\n[pens.E]\npoint = "coupler.E"\n', "pen")


def test_words_keep_corners_and_round_the_rest():
    square = text_strokes("[", "rowmans")
    assert all(len(stroke) == 2 for stroke in square)
    low, high = (np.concatenate(text_strokes(letter, "rowmans")).imag for letter in "gh")
    assert low.min() < high.min() < low.max() < high.max()  # g hangs down, h stands up
    bow = text_strokes("o", "scripts")[0]
    turns = np.abs(np.angle(np.diff(bow)[1:] / np.diff(bow)[:-1]))
    assert np.median(turns) < 0.15


def test_texts_of_an_svg_are_written_where_they_stand(tmp_path):
    """Their capitals are 0.7 of the font's size high and stand on the line of the text, about its middle if anchored so."""
    path = tmp_path / "text.svg"
    words = '<text x="50" y="30" font-size="20" text-anchor="middle" transform="translate(7 5)">HH</text>'
    path.write_text(f'<svg xmlns="http://www.w3.org/2000/svg">{words}<path d="M0 0 L 9 9"/></svg>')
    for font in ("futural", "scripts"):
        letters = [stroke for stroke in svg_strokes(path, font) if abs(stroke[0]) > 1.0]
        spots = np.concatenate(letters)
        assert spots.imag.min() == pytest.approx(-35.0, abs=0.01) and spots.imag.max() == pytest.approx(-21.0, abs=0.01)
        assert 0.5 * (spots.real.min() + spots.real.max()) == pytest.approx(57.0, abs=0.01)
        assert len(letters) >= 4
