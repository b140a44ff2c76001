"""Given profiles in mechanisms: lift, leaps and corners, files, and what the cutter leaves of an undercut profile."""

from __future__ import annotations

import io
from itertools import product

import ezdxf
import numpy as np
import pytest
from cam_scenes import changed, refused, solved, text_of
from cases import side_by_side
from ezdxf.math import ConstructionEllipse, rational_bspline_from_ellipse

import mechviz
from mechcore.cams.analysis import analyse
from mechcore.cams.contour import bulged, cam_contour, circle, moved_contour, polygon, self_crossing, spline_contour
from mechcore.cams.followers import Arc, Flat, Follower, Knife, Oscillating, Roller, Translating
from mechcore.cams.real_profiles import lift_of
from mechcore.cams.synthesis import cam_on_base
from mechcore.errors import MechanismError
from mechcore.forces.cam_events import cam_events, lost_ranges
from mechcore.forces.cam_rating import placed_cams
from mechcore.laws.program import Segment, program
from mechcore.motion.solve import compile_mechanism
from mechviz.outputs.exports.cam_profiles import cam_outlines, export_profiles
from mechviz.runs import run_scene
from mechviz.scene.faults import SceneError
from mechviz.scene.folder import GALLERY_FOLDER
from mechviz.scene.kinds.cam_files import read_dxf, read_points

FOLLOWERS = {
    "knife": Follower(Translating(0.004), Knife()),
    "roller": Follower(Translating(0.003), Roller(0.01)),
    "flat": Follower(Translating(), Flat(tilt=0.1)),
    "arm": Follower(Oscillating(0.07 + 0.02j, 0.065), Roller(0.01)),
    "lever": Follower(Oscillating(-0.07 + 0.02j, 0.065), Flat(tilt=0.1)),
    "mushroom": Follower(Translating(), Arc(0.05)),
}


def tangent_cam():
    a = np.arccos((0.020 - 0.008) / 0.030)
    n = np.exp(1j * a)
    return bulged([0.020 / n, 0.030 + 0.008 / n, 0.030 + 0.008 * n, 0.020 * n], [0, np.tan(a / 2), 0, np.tan((np.pi - a) / 2)])


def lobes():
    t = 2.0 * np.pi * np.arange(40) / 40
    return spline_contour((0.03 + 0.004 * np.cos(2 * t) + 0.002 * np.sin(3 * t)) * np.exp(1j * t))[0]


PROFILES = {"arcs": tangent_cam, "spline": lobes, "square": lambda: polygon([0.03, 0.03j, -0.03, -0.03j])}


@pytest.mark.sample(9)
@pytest.mark.parametrize(("fitting", "turn"), side_by_side([*product(FOLLOWERS, PROFILES)], [1, -1]))
def test_the_law_of_a_profile_is_what_the_search_finds(fitting, turn):
    """Between its knots as at them: value, velocity and acceleration against the global search at angles that are none."""
    f, contour = FOLLOWERS[fitting[0]], PROFILES[fitting[1]]()
    given = lift_of(contour, f, turn)
    x = np.random.default_rng(5).uniform(0.0, 2.0 * np.pi, 20)
    wanted = analyse(contour, f, x, turn, bridges=False).motion
    sizes = np.abs(wanted).max(axis=1)
    for order, bound in enumerate((1e-13, 1e-12, 1e-11)):
        np.testing.assert_allclose(given.law(x, order)[order], wanted[order], atol=bound * sizes[order])


def test_the_whole_profile_is_searched_once(monkeypatch):
    """The lift is fitted at angles between those of the first search, where only the samples about its contacts are compared."""
    from mechcore.cams import analysis as search

    compared, plain = [], search.Task.height
    monkeypatch.setattr(search.Task, "height", lambda task, z: compared.append(z.size) or plain(task, z))
    contour = lobes()
    lift_of(contour, FOLLOWERS["lever"])
    whole = 1441 * contour.samples(1024 // contour.count)[0].size
    assert whole < sum(compared) < 1.25 * whole


def test_an_eccentric_disc_is_a_scotch_yoke_and_a_slider_crank():
    """The theory's fixed replacements of an eccentric circular cam."""
    e, r, x = 0.012, 0.038, np.linspace(0.1, 6.0, 50)
    flat = lift_of(circle(r, e), Follower(Translating(), Flat())).law
    np.testing.assert_allclose(flat(x, 2), [r + e * np.sin(x), e * np.cos(x), -e * np.sin(x)], atol=3e-16)
    rod = r + 0.010
    roller = lift_of(circle(r, e), Follower(Translating(), Roller(0.010))).law
    np.testing.assert_allclose(roller(x, 0)[0], e * np.sin(x) + np.sqrt(rod**2 - (e * np.cos(x)) ** 2), atol=3e-16)


def test_the_lift_of_a_given_profile_is_that_above_its_lowest_place():
    """A flat face on a disc of 38 mm, 12 mm off its axis in any direction, is lowest at 26 mm."""
    for angle in (0.001, 0.7013, 2.9):
        centre = [f"{12.0 * x} mm" for x in (np.cos(angle), np.sin(angle))]
        scene = mechviz.load("cam-eccentric").changed({("joints", "K", "profile", "eccentric", "centre"): centre})
        (cam,) = (r.geometry for r in run_scene(scene, frames=4).motion.model.relations)
        assert cam.zero == pytest.approx(0.026, rel=1e-12)


def test_accelerations_of_a_given_profile_in_a_scene():
    """A flat follower on an eccentric disc: the yoke's acceleration, to twelve digits of the largest, between the frames too."""
    motion, _ = solved(text_of("cam-eccentric"))
    turn, speed, _ = motion.coordinate("O").T
    wanted = -0.012 * speed**2 * np.sin(turn)
    np.testing.assert_allclose(motion.coordinate("S")[:, 2], wanted, atol=1e-12 * np.abs(wanted).max())


@pytest.mark.parametrize("follower", ["roller", "flat", "arm"])
def test_the_profile_of_a_law_gives_the_law_back(follower):
    lift = program([Segment(2.0, 0.01 if follower != "arm" else 0.15, "cycloidal"), Segment(0.8), Segment(2.2, 0.0, "3-4-5"),
                    Segment(2.0 * np.pi - 5.0)])  # fmt: skip
    cam = cam_on_base(lift, FOLLOWERS[follower], 0.035, turn=-1)
    x = np.linspace(0.0, 6.2, 80)
    got = lift_of(cam_contour(cam), cam.follower, -1).law(x, 0)[0]
    np.testing.assert_allclose(got, cam.law(x, 0)[0], atol=1e-11)


def test_a_moved_contour_is_the_same_shape():
    c, turn = tangent_cam(), np.exp(0.7j)
    other, t = moved_contour(c, 0.01 + 0.002j, turn), np.linspace(0.0, 3.9, 9)
    np.testing.assert_allclose(other(t, 2)[0], 0.01 + 0.002j + turn * c(t, 2)[0])
    np.testing.assert_allclose(other.curvature(t), c.curvature(t), rtol=1e-12, atol=1e-9)


def test_a_roller_that_is_too_large_for_a_hollow_is_knocked():
    motion, forces = solved(text_of("cam-drawing"))
    leaps = [e for e in cam_events(motion, forces) if "leaps" in e.text]
    assert [e.level for e in leaps] == ["WARN", "WARN"] and all("a knock" in e.text for e in leaps)
    again = motion.at_times
    for e in leaps:  # the slider's velocity really steps there, by what the event says
        v = again(np.array([e.time - 1e-8, e.time + 1e-8])).coordinate("S")[:, 1]
        speed = motion.coordinate("O")[0, 1]
        assert v[1] - v[0] == pytest.approx(e.value * speed, rel=1e-4) and e.value > 0.0
    small, _ = solved(text_of("cam-drawing").replace("roller = 45", "roller = 20"))
    assert not [e for e in cam_events(small, None) if "leaps" in e.text]


def test_a_knife_passes_corners():
    text = text_of("cam-eccentric").replace(
        "eccentric = { radius = 38, centre = [12, 0] }", "outline = [[40, 0], [0, 40], [-40, 0], [0, -40]]"
    )
    motion, _ = solved(text.replace("flat = true", "knife = true"))
    corners = [e for e in cam_events(motion, None) if "passes a corner" in e.text]
    at = np.interp([e.time for e in corners], motion.time, np.degrees(motion.coordinate("O")[:, 0]))
    np.testing.assert_allclose((at + 45.0) % 90.0, 45.0, atol=1e-9)
    assert len(corners) >= 3
    np.testing.assert_allclose(motion.coordinate("S")[45, 0] + 0.095, 0.02 * np.sqrt(2.0), atol=1e-12)


def test_what_the_cutter_leaves(tmp_path):
    """The follower misses the law where the event says, nowhere else, and rests on the profile that is exported."""
    text = text_of("cam-undercut")
    with pytest.raises(MechanismError) as refused:
        compile_mechanism(mechviz.loads(text.replace('undercut = "cut"\n', "")).mechanism)
    assert "undercut" in str(refused.value) and "Give a base circle of at least" in str(refused.value)
    scene = mechviz.loads(text)
    run = run_scene(scene)
    (cam,) = placed_cams(run.motion)
    events = [e for e in cam_events(run.motion, run.forces) if e.text.startswith("undercut")]
    assert len(events) == len(cam.lost_ranges) == 2
    x = np.linspace(0.0, 2.0 * np.pi, 721)
    miss = cam.cam.law(x, 0)[0] - cam.intended.law(x, 0)[0]
    inside = np.zeros(x.size, bool)
    for first, last in cam.lost_ranges:
        inside |= (x > first - 1e-6) & (x < last + 1e-6)
    assert np.abs(miss[~inside]).max() < 1e-11
    assert np.abs(miss).max() == pytest.approx(max(abs(e.value) for e in events), rel=1e-3)
    assert miss.max() < 1e-11, "a cutter takes away: the follower stands lower"
    (outline,) = cam_outlines(run)
    z = outline.points
    heights = np.array([np.max(np.imag(z * np.exp(1j * t))) for t in x])
    np.testing.assert_allclose(1e-3 * heights, cam.cam.law(x, 0)[0], atol=3e-6)  # a flat face rests on the highest point
    told: list[str] = []
    export_profiles(run, tmp_path / "left.dxf", "dxf", told.append)
    assert len(told) == 2 and all("0.6398 mm" in line and "what the cutter leaves" in line for line in told)
    unspoilt: list[str] = []
    export_profiles(run_scene(mechviz.load("cam-flat")), tmp_path / "flat.dxf", "dxf", unspoilt.append)
    assert unspoilt == []


def test_a_face_that_is_too_short_changes_no_motion_and_is_told():
    """The eccentric disc under its face is a Scotch yoke: s = r + e sin(theta), and the contact goes e to either side."""
    text = changed(text_of("cam-eccentric"), "flat = true", "flat = true, face = [5, 5]")
    motion, forces = solved(text)
    (cam,) = placed_cams(motion)
    rows, theta, omega = cam.rows(motion), motion.pose("cam")[:, 2], 180.0 * np.pi / 30.0
    s, v, a = motion.coordinate("S").T
    np.testing.assert_allclose(s, 1e-3 * (38.0 + 12.0 * np.sin(theta) - 95.0), atol=1e-13)
    np.testing.assert_allclose(v, 1e-3 * 12.0 * omega * np.cos(theta), atol=1e-12)
    np.testing.assert_allclose(a, -1e-3 * 12.0 * omega**2 * np.sin(theta), atol=1e-10)
    np.testing.assert_allclose(rows.place, 1e-3 * (12.0 * np.exp(1j * theta) + 38.0j), atol=1e-13)
    np.testing.assert_allclose(rows.radius, 0.038, rtol=1e-10)
    told = [e for e in cam_events(motion, forces) if "leaves the face" in e.text]
    assert [abs(e.value) for e in told] == pytest.approx(3 * [0.012]) and "those of a longer face" in told[0].text
    exact, forces = solved(text.replace("[5, 5]", "[12, 12]"))
    assert not [e for e in cam_events(exact, forces) if "leaves the face" in e.text], "it reaches just to the ends"


def test_a_short_face_follows_what_the_cutter_leaves():
    """The face rests on the highest point of the profile; the velocity is the derivative of the displacement."""
    motion, _ = solved(changed(text_of("cam-undercut"), "flat = true", "flat = true, face = [5, 5]"), 720)
    (cam,) = placed_cams(motion)
    theta = cam.argument(motion)
    z = cam.contour(np.linspace(0.0, cam.contour.count, 40001))[0]
    heights = np.array([(z * np.exp(1j * x)).imag.max() for x in theta[::15]])
    np.testing.assert_allclose(cam.rows(motion).coordinate[::15], heights, atol=1e-7)
    s, v, _ = motion.coordinate("S").T
    near = (s[2:] - s[:-2]) / (motion.time[2:] - motion.time[:-2])
    assert np.abs(near - v[1:-1]).max() < 0.005 * np.abs(v).max()
    assert max(abs(d) for *_, d in lost_ranges(cam)) == pytest.approx(0.6398e-3, rel=1e-4)


def test_a_drawing_that_was_exported_gives_the_lift_back(tmp_path):
    run = run_scene(mechviz.load("cam-roller"))
    export_profiles(run, tmp_path / "cam.dxf", "dxf")
    export_profiles(run, tmp_path / "cam.csv", "csv")
    head, _, tail = text_of("cam-roller").partition("[joints.K.profile]\n")
    loads = tail[tail.index("[loads]") :]
    for name, bound in (("cam.dxf", 3e-7), ("cam.csv", 3e-6)):
        (tmp_path / "again.toml").write_text(f'{head}[joints.K.profile]\nfile = "{name}"\n\n{loads}')
        again = run_scene(mechviz.load(tmp_path / "again.toml")).motion
        np.testing.assert_allclose(again.coordinate("S")[:, 0], run.motion.coordinate("S")[:, 0], atol=bound)


def dxf(*entities: str, unit: int | None = 4) -> str:
    header = "" if unit is None else f"0\nSECTION\n2\nHEADER\n9\n$INSUNITS\n70\n{unit}\n0\nENDSEC\n"
    return f"{header}0\nSECTION\n2\nENTITIES\n" + "".join(entities) + "0\nENDSEC\n0\nEOF\n"


def line(a: complex, b: complex) -> str:
    return f"0\nLINE\n8\n0\n10\n{a.real}\n20\n{a.imag}\n11\n{b.real}\n21\n{b.imag}\n"


def test_drawings_of_lines_and_arcs(tmp_path):
    path = tmp_path / "d.dxf"
    half = "0\nARC\n8\n0\n10\n0\n20\n0\n40\n20\n50\n90\n51\n270\n"
    path.write_text(dxf(line(-20j, 30 - 20j), half, line(20j, 30 + 20j), line(30 + 20j, 30 - 20j)))
    z, bulges, unit = read_dxf(path.read_bytes())
    assert unit == 1e-3
    c = bulged(z, bulges)
    assert c.area == pytest.approx(1200.0 + 200.0 * np.pi, rel=1e-3)
    path.write_text(dxf("0\nCIRCLE\n10\n5\n20\n0\n40\n30\n", unit=None))
    z, bulges, unit = read_dxf(path.read_bytes())
    assert unit is None and bulged(z, bulges).area == pytest.approx(900.0 * np.pi, rel=1e-3)
    for text, word in (
        (dxf(line(0j, 1 + 0j)), "no closed outline"),
        (dxf("0\nLWPOLYLINE\n90\n2\n70\n1\n10\n0\n20\n0\n10\n1\n20\n0\n"), "AcDbPolyline"),
        ("hello\nthere\n", "no DXF"),
    ):
        path.write_text(text)
        with pytest.raises(MechanismError, match=word):
            read_dxf(path.read_bytes())


@pytest.mark.parametrize("kind", ["ellipse", "spline", "half ellipse", "block", "mirrored"])
def test_drawings_of_curves(kind):
    """An ellipse of 40 x 20 mm, written in several ways, and a half disc drawn from behind have their areas and places."""
    drawing = ezdxf.new(units=4)
    sheet = drawing.modelspace()
    if kind == "block":
        sheet, outer = drawing.blocks.new("CAM"), sheet
        outer.add_blockref("CAM", (7, 3), dxfattribs={"rotation": 30})
    if kind == "spline":
        sheet.add_spline().apply_construction_tool(rational_bspline_from_ellipse(ConstructionEllipse((0, 0), (20, 0), ratio=0.5)))
    elif kind == "mirrored":
        sheet.add_lwpolyline([(-20, -10, -1), (-20, 10, 0)], "xyb", dxfattribs={"extrusion": (0, 0, -1)})
        sheet.add_line((20, -10), (20, 10))
    else:
        sheet.add_ellipse((0, 0), (20, 0), 0.5, 0.0, np.pi if kind == "half ellipse" else 2.0 * np.pi)
        if kind == "half ellipse":
            sheet.add_line((-20, 0), (20, 0))
    text = io.StringIO()
    drawing.write(text)
    z, bulges, unit = read_dxf(text.getvalue().encode())
    contour = bulged(z, bulges)
    area = {"half ellipse": 100.0, "mirrored": 50.0}.get(kind, 200.0) * np.pi
    assert unit == 1e-3 and contour.area == pytest.approx(area, rel=2e-4 if kind == "mirrored" else 1e-6)
    assert kind != "mirrored" or np.allclose(z.real, 20.0)


def test_tables_of_points(tmp_path):
    path = tmp_path / "p.csv"
    path.write_text("name;x [cm];y [cm]\n" + "".join(f"a;{np.cos(t)};{np.sin(t)}\n" for t in np.arange(8.0)))
    z, unit = read_points(path.read_bytes())
    assert unit == 1e-2 and len(z) == 8 and z[1] == pytest.approx(np.exp(1j))
    path.write_text("1,2\n3,4\n5,x\n" * 3)
    with pytest.raises(MechanismError, match="row 3"):
        read_points(path.read_bytes())


CIRCLE = np.exp(1j * np.arange(8.0))


def test_a_table_of_points_has_a_unit_for_each_column():
    rows = "".join(f"{z.real},{z.imag}\n" for z in CIRCLE)
    for header, want, y in (
        ("x [cm],y [in]", 1e-2, 2.54),
        ("x,y [in]", 0.0254, 1.0),
        ("x [mm],y", 1e-3, 1.0),
        ("x [?],y [mm]", None, 1.0),
    ):
        z, unit = read_points(f"{header}\n{rows}".encode())
        assert unit == want
        np.testing.assert_allclose(z, CIRCLE.real + 1j * y * CIRCLE.imag, rtol=1e-14)


@pytest.mark.parametrize("header", ["r [mm],phi [deg]", "Angle [deg],Radius [mm]"])
def test_a_table_of_polar_coordinates_is_refused_as_such(header):
    with pytest.raises(MechanismError, match=r"its columns are .* and .*Give columns x and y"):
        read_points((header + "\n" + "30,1\n31,2\n" * 8).encode())


def test_a_table_of_two_curves_is_refused_as_such():
    rows = "".join(f"{name},{z.real},{z.imag}\n" for name in ("K", "K outer flank") for z in CIRCLE)
    with pytest.raises(MechanismError, match=r"it has 2 curves: 'K', 'K outer flank'.*Leave the profile of the cam alone"):
        read_points(f"curve,x [mm],y [mm]\n{rows}".encode())


DISC = "eccentric = { radius = 38, centre = [12, 0] }"


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (DISC, "", ["has none of lift, eccentric, outline, points, file or radius"]),
        (DISC, f"phase = 10\n{DISC}", ["phase does not go with eccentric"]),
        (DISC, 'file = "nowhere.dxf"', ["joints.K.profile.file", "no file 'nowhere.dxf'"]),
        (DISC, "outline = [[1, 0], [0, 1]]\nbulges = [1]", ["1 bulges for 2 corners"]),
        (DISC, 'base = 30\nradius = [{ over = 360, to = 31 }]', ["joints.K.profile.radius", "does not end where it starts"]),
        ("radius = 38", "radius = -38", ["joints.K.profile.eccentric.radius", "negative"]),
        ("flat = true", "roller = 8", ["joints.K", "does not reach the profile"]),
        ('cam = ["cam", "follower"]', 'cam = ["cam", "follower"]\nclosur = "form"', ["Did you mean 'closure'?"]),
    ],
)  # fmt: skip
def test_faults_of_given_profiles(old, new, words):
    text = text_of("cam-eccentric")
    assert old in text
    if "reach" in words[-1]:
        text = text.replace("[12, 0]", "[200, 0]")
    refused(text.replace(old, new, 1), words)


@pytest.mark.parametrize(
    ("scene", "unit", "words"),
    [
        ("cam-measured.csv", "-1 mm", "negative"),
        ("cam-drawing.dxf", "-1 mm", "negative"),
        ("cam-measured.csv", "0 mm", "is zero"),
        ("cam-measured.csv", "1 kg", "is a mass, a length is wanted"),
        ("cam-measured.csv", "nan", "not a finite number"),
        ("cam-measured.csv", "1e-300 m", "no unit of a drawing"),
        ("cam-drawing.dxf", "1e-300 m", "no unit of a drawing"),
        ("cam-measured.csv", "1 cm", "10 mm, but 'cam-measured.csv' says that its unit is 1 mm"),
        ("cam-drawing.dxf", "1 in", "25.4 mm, but 'cam-drawing.dxf' says that its unit is 1 mm"),
    ],
)
def test_what_is_no_unit_of_a_file(scene, unit, words):
    name = scene.partition(".")[0]
    text = text_of(name).replace(f'file = "{scene}"', f'file = "{scene}"\nfile_unit = "{unit}"')
    with pytest.raises(SceneError) as refused:
        mechviz.loads(text, folder=GALLERY_FOLDER)
    assert [f.path for f in refused.value.faults] == ["joints.K.profile.file_unit"] and words in refused.value.faults[0].message


@pytest.mark.parametrize(
    ("points", "words"),
    [
        (lambda t: 40.0 * np.sin(2.0 * t) + 40.0j * np.sin(t), "profiles that cross themselves are no cam"),
        (lambda t: 0.0 * t + 40.0, "its 50 points coincide"),
        (lambda t: 40.0 * np.exp(1j * np.repeat(t[::10], 10)), "all but 5 coincide"),
    ],
    ids=["eight", "one point", "five points"],
)
def test_measured_points_that_are_no_cam(points, words, tmp_path):
    z = points(2.0 * np.pi * np.arange(50) / 50)
    (tmp_path / "p.csv").write_text("x [mm],y [mm]\n" + "".join(f"{p.real:.17g},{p.imag:.17g}\n" for p in z))
    with pytest.raises(SceneError) as refused:
        mechviz.loads(text_of("cam-measured").replace('"cam-measured.csv"', f"'{tmp_path / 'p.csv'}'"))
    assert [f.path for f in refused.value.faults] == ["joints.K.profile.file"] and words in refused.value.faults[0].message


def test_where_a_profile_crosses_itself():
    """An eight whose lobes cross off its points; simple outlines, also hollow ones, do not."""
    t = 2.0 * np.pi * (np.arange(60) + 0.3) / 60
    place = self_crossing(spline_contour(0.01 + 0.04 * np.sin(2 * t) + 0.04j * np.sin(t))[0])
    assert place is not None and abs(place - 0.01) < 1e-5
    assert abs(self_crossing(polygon([0.0, 0.02 + 0.02j, 0.02, 0.02j])) - (0.01 + 0.01j)) < 1e-12
    for simple in (tangent_cam(), lobes(), circle(0.03, 0.01), polygon([0.03, 0.03j, -0.03, -0.03j, 0.001 - 0.001j])):
        assert self_crossing(simple) is None


def test_a_tolerance_that_leaves_nothing_of_the_points():
    t = 2.0 * np.pi * np.arange(40) / 40
    for tolerance in (0.0301, 0.05):
        with pytest.raises(MechanismError) as refused:
            spline_contour(0.03 * np.exp(1j * t), tolerance)
        assert "scatter by 30 mm" in str(refused.value)
    with pytest.raises(SceneError) as told:
        mechviz.loads(text_of("cam-measured").replace('"0.004 mm"', '"50 mm"'), folder=GALLERY_FOLDER)
    assert [f.path for f in told.value.faults] == ["joints.K.profile.tolerance"]
