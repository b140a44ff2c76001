"""The shared page in a real browser, from disk and offline: it is used as a person would, and what it draws is looked at."""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browsers import ONE_SAMPLE, REQUESTING, STILL, browser, chromium_or_skip, elsewhere, pulling
from pixels import same

import mechviz
from mechviz.facade import Result
from mechviz.outputs.images.pictures import Look, PictureTime, film, shot
from mechviz.outputs.page.page import make_page
from mechviz.outputs.presentation import presentation_of
from mechviz.runs import run_scene
from recordings import Made, made, ran

__all__ = ["browser"]  # a fixture

pytestmark = pytest.mark.browser


def recorded() -> Made:
    return made("kinetostatic-four-bar")


WIDE, NARROW = {"width": 1200, "height": 800}, {"width": 390, "height": 844}
DRAWN = "(async () => { await mechviz.ready; mechviz.player.drawNow(); })()"
PLACE = """([x, y, z]) => { const s = mechviz.player.stage, m = s.camera.matrices().clip, b = s.canvas.getBoundingClientRect();
    const w = m[3]*x + m[7]*y + m[11]*z + m[15];
    return [b.left + b.width * (0.5 + 0.5 * (m[0]*x + m[4]*y + m[8]*z + m[12]) / w),
            b.top + b.height * (0.5 - 0.5 * (m[1]*x + m[5]*y + m[9]*z + m[13]) / w)]; }"""
FREE = """() => {
    const [picture, ...buttons] = ['picture', 'views', 'groups'].map((id) => document.getElementById(id).getBoundingClientRect());
    const over = buttons.filter((b) => b.height > 0 && b.top < picture.bottom && b.top >= picture.top);
    return [[picture.left, Math.max(picture.top, ...over.map((b) => b.bottom))], [picture.right, picture.bottom]]; }"""
TAG = """name => { const tag = [...document.querySelectorAll('#labels span')].find((s) => s.textContent === name);
    return tag.hidden ? null : tag.style.transform.match(/-?[0-9.]+/g).map(Number); }"""
SOLID = """name => { const p = mechviz.player, link = p.header.links.find((k) => k.name === name), v = p.arrays[link.mesh.vertices];
    return { pose: p.stage.pose(link, p.frame), vertices: Array.from(v) }; }"""
HINT = "GL Driver Message (OpenGL, Performance"  # of the browser, where it draws in software
LARGE = ("kinetostatic-four-bar", "slider-crank-engine", "ten-link-forces", "cam-flat", "scissor-lift", "excavator-arm")
NOTHING = "for (const g of mechviz.player.header.groups) mechviz.player.show(g.name, false)"
TIME = "mechviz.player.time"


@pytest.fixture(scope="module")
def file(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("share") / "page.html"
    path.write_text(make_page(recorded().shown)[0], encoding="utf-8")
    return path


class Opened:
    """The page in a window, with all that it asked for and complained about."""

    def __init__(self, browser: Any, file: Path, script: str = "", **options: Any):
        self.context = browser.new_context(**options)
        self.context.add_init_script(ONE_SAMPLE)
        self.context.add_init_script(script)
        self.context.set_offline(True)
        self.page = self.context.new_page()
        self.page.set_default_timeout(60_000)
        self.troubles: list[str] = []
        self.requests: list[str] = []
        self.page.on(
            "console", lambda m: self.troubles.append(m.text) if m.type in ("error", "warning") and HINT not in m.text else None
        )
        self.page.on("pageerror", lambda e: self.troubles.append(str(e)))
        self.page.on("request", lambda r: self.requests.append(r.url))
        self.load(file)

    def load(self, file: Path) -> None:
        self.page.goto(file.as_uri())
        self.page.evaluate(DRAWN)

    def _heard(self, message: Any) -> None:
        if message.type in ("error", "warning") and HINT not in message.text:
            self.troubles.append(message.text)

    def picture(self, selector: str = "#picture") -> np.ndarray:
        from PIL import Image

        return np.asarray(Image.open(io.BytesIO(self.page.locator(selector).screenshot())).convert("RGB")).astype(int)

    def window(self) -> np.ndarray:
        """All of the window, as (rows, columns, RGB)."""
        from PIL import Image

        return np.asarray(Image.open(io.BytesIO(self.page.screenshot())).convert("RGB")).astype(float)


@pytest.fixture(scope="module")
def wide(browser, file) -> Iterator[Opened]:
    opened = Opened(browser, file, viewport=WIDE)
    yield opened
    opened.context.close()


def reddish(colors: np.ndarray) -> np.ndarray:
    return (colors[..., 0] > 150) & (colors[..., 1] < 110) & (colors[..., 2] < 120)


def test_links_are_drawn_where_their_poses_say(wide):
    """The middle of each link has its colour, in the straight view without arrows, at two moments."""
    page = wide.page
    page.evaluate(
        "for (const g of mechviz.player.header.groups) mechviz.player.show(g.name, false); mechviz.player.show('names', false)"
    )
    page.get_by_role("button", name="Front 2D").click()
    for frame in (15, 40):  # where no link hides these middles
        page.evaluate(f"mechviz.player.seekFrame({frame}); mechviz.player.drawNow()")
        window = wide.window()
        for link, ends in (("crank", ("A", "B")), ("rocker", ("E", "D"))):
            palette = page.evaluate(f"mechviz.player.header.links.find((k) => k.name === '{link}').mesh.palette")
            known = np.array([[int(c[i : i + 2], 16) for i in (1, 3, 5)] for c in palette], float)
            known = known[np.argmax(np.ptp(known, axis=1))]  # the link's own, not the grey of pins
            a, b = (recorded().run.motion.joint_position(p)[frame] for p in ends)
            across = np.array([-(b - a)[1], (b - a)[0]]) / np.hypot(*(b - a))
            half = -recorded().recording.static("mechanism", "links", link, "mesh", component="Mesh3D:vertex_positions")[:, 1].min()
            for part, inside in ((0.0, True), (0.7, True), (-0.7, True), (-1.5, False)):  # of the plate's half width
                x, y = page.evaluate(PLACE, [*(a + 0.5 * (b - a) + part * half * across), 0.0])
                color = window[round(y) - 2 : round(y) + 2, round(x) - 2 : round(x) + 2].mean(axis=(0, 1))
                ways = [v - v.mean() for v in (color, known)]
                likeness = float(ways[0] @ ways[1] / (np.linalg.norm(ways[0]) * np.linalg.norm(ways[1])))
                same = likeness > 0.97 and float(np.ptp(color)) > 0.4 * float(np.ptp(known))
                assert same == inside, (link, frame, part, color, known)
    page.get_by_role("button", name="3D", exact=True).click()


def test_arrows_can_be_shown_and_hidden(wide):
    page = wide.page
    page.evaluate(f"mechviz.player.seekFrame(60); {NOTHING}; mechviz.player.drawNow()")
    assert page.evaluate("mechviz.player.stage.state.arrows") == 0
    without = reddish(wide.picture()).sum()
    button = page.get_by_role("button", name="Reactions")
    button.click()
    assert button.get_attribute("aria-pressed") == "true"
    page.evaluate("mechviz.player.drawNow()")
    assert page.evaluate("mechviz.player.stage.state.arrows") == len(recorded().mechanism.joints)
    assert reddish(wide.picture()).sum() > without + 200


def test_playing_moves_time_and_mechanism_and_space_stops_it(wide):
    page = wide.page
    page.evaluate("mechviz.player.seekFrame(10)")
    before, picture = page.evaluate(TIME), wide.picture()
    page.get_by_role("button", name="Play", exact=True).click()
    page.evaluate(
        f"new Promise((done) => {{ const look = () => {TIME} > {before} + 1e-4 ? done() : requestAnimationFrame(look); look(); }})"
    )
    page.keyboard.press("Escape")
    page.locator("#picture").focus()
    page.keyboard.press(" ")
    assert page.evaluate("mechviz.player.playing") is False
    stopped = page.evaluate(TIME)
    assert stopped > before and np.abs(wide.picture() - picture).max() > 60
    page.evaluate("new Promise((done) => setTimeout(done, 120))")
    assert page.evaluate(TIME) == stopped


def test_arrow_keys_step_by_frames(wide):
    page = wide.page
    page.evaluate("mechviz.player.seekFrame(100)")
    page.locator("#picture").focus()
    page.keyboard.press("ArrowRight")
    assert page.evaluate("mechviz.player.frame") == pytest.approx(101, abs=1e-6)
    page.keyboard.press("Shift+ArrowLeft")
    assert page.evaluate("mechviz.player.frame") == pytest.approx(91, abs=1e-6)


def test_dragging_the_cursor_of_a_plot_moves_the_mechanism(wide):
    page = wide.page
    page.evaluate("mechviz.player.seekFrame(20)")
    page.evaluate("mechviz.player.drawNow()")
    before = wide.picture()
    canvas = page.locator("figure canvas").first.bounding_box()
    assert canvas is not None
    inner = canvas["width"] - 58 - 12  # what the axes leave
    y = canvas["y"] + 60
    page.mouse.move(canvas["x"] + 58 + 0.1 * inner, y)
    page.mouse.down()
    page.mouse.move(canvas["x"] + 58 + 0.4 * inner, y, steps=4)
    page.mouse.move(canvas["x"] + 58 + 0.6 * inner, y, steps=4)
    page.mouse.up()
    page.evaluate("mechviz.player.drawNow()")
    run = recorded().run.motion
    assert page.evaluate(TIME) == pytest.approx(float(run.time[0] + 0.6 * np.ptp(run.time)), rel=0.01)
    assert np.abs(wide.picture() - before).max() > 60
    said = page.locator("figure .values").first.inner_text()
    torque = np.interp(page.evaluate(TIME), recorded().time, recorded().data("drive", "A")[:, 3])
    assert float(said.split()[1].replace("−", "-")) == pytest.approx(torque, rel=1e-3, abs=1e-3)


def test_plots_share_curves_and_are_saved(wide):
    """Curves of one unit in one plot, as a table, a drawing and a picture; and taken away again."""
    page = wide.page
    plots = page.evaluate("mechviz.player.header.plots.map((p) => p.title)")
    first, second = plots.index("Joint A: reaction"), plots.index("Joint B: reaction")
    figure = page.locator("figure").first
    figure.locator(".what").select_option(str(first))
    figure.locator(".beside").select_option(str(second))
    names = page.evaluate("mechviz.player.plots[0].plot.names")
    assert names == [f"Joint {j}: {c}" for j in "AB" for c in ("Fx", "Fy", "|F|")]
    files = {}
    for kind in ("CSV", "SVG", "PNG"):
        with page.expect_download() as offered:
            figure.get_by_role("button", name=kind).click()
        files[kind] = Path(offered.value.path()).read_bytes()
        assert offered.value.suggested_filename == f"Joint-A-reaction-Joint-B-reaction.{kind.lower()}"
    head, *rows = files["CSV"].decode().splitlines()
    assert head.split(",")[:2] == ["angle of drive A [°]", "Joint A: Fx [N]"] and len(rows) == len(recorded().time)
    wanted = np.column_stack([recorded().data("joints", j, "reaction")[:, 0] for j in "AB"])
    table = np.array([[float(x) for x in row.split(",")] for row in rows])
    assert table[:, [1, 4]] == pytest.approx(wanted, rel=1e-5, abs=1e-4)
    from xml.etree import ElementTree

    drawing = ElementTree.fromstring(files["SVG"])
    curves = [p for p in drawing.iter("{http://www.w3.org/2000/svg}path") if (p.get("d") or "").count("L") >= len(rows) - 1]
    assert len(curves) == 6 and files["PNG"].startswith(b"\x89PNG")
    more = [str(k) for k, title in enumerate(plots) if re.fullmatch("Joint [^AB]: reaction", title)][:4]
    for number in more:
        figure.locator(".beside").select_option(number)
    with page.expect_download() as offered:
        figure.get_by_role("button", name="CSV").click()
    long = offered.value.suggested_filename
    assert long.startswith("Joint-A-reaction-Joint-B-reaction") and long.endswith(".csv") and len(long) <= 80
    for number in more:
        figure.locator(".beside").select_option(number)
    figure.locator(".beside").select_option(str(second))
    assert page.evaluate("mechviz.player.plots[0].plot.names") == ["Fx", "Fy", "|F|"]


def test_names_give_way_to_each_other(wide):
    page = wide.page
    boxes = """[...document.querySelectorAll('#labels span:not([hidden])')].map((s) => {
        const b = s.getBoundingClientRect(); return [b.left, b.top, b.right, b.bottom]; })"""
    page.evaluate("mechviz.player.show('names', true); mechviz.player.view('front'); mechviz.player.drawNow()")
    assert len(page.evaluate(boxes)) == len(recorded().mechanism.joints)
    page.evaluate("mechviz.player.stage.camera.zoom(0.02); mechviz.player.drawNow()")
    seen = page.evaluate(boxes)
    assert 1 <= len(seen) < len(recorded().mechanism.joints)
    for k, (left, top, right, bottom) in enumerate(seen):
        for x0, y0, x1, y1 in seen[:k]:
            assert right <= x0 + 1 or x1 <= left + 1 or bottom <= y0 + 6 or y1 <= top + 6
    page.evaluate("mechviz.player.view('3d'); mechviz.player.show('names', false)")


def test_buttons_and_lists_of_the_page(wide):
    """Those that no other test uses: the views, the steps, the slider, the speed, the loop, the axis, plots added and removed."""
    page = wide.page
    angles = "(({yaw, pitch}) => [yaw, pitch])(mechviz.player.stage.camera)"
    for key, view in (("3", "3D"), ("2", "Front 2D"), ("1", "Iso"), ("4", "Top"), ("5", "Side")):
        page.locator("#picture").focus()
        page.keyboard.press(key)
        wanted = page.evaluate(angles)
        page.evaluate("mechviz.player.stage.camera.turn(0.3, 0.2)")
        page.get_by_role("button", name=view, exact=True).click()
        assert page.evaluate(angles) == wanted, view
    fitted = page.evaluate("mechviz.player.stage.camera.distance")
    for fit in (page.get_by_role("button", name="Fit", exact=True).click, page.locator("#picture").dblclick):
        page.evaluate("mechviz.player.stage.camera.zoom(0.5)")
        fit()
        assert page.evaluate("mechviz.player.stage.camera.distance") == pytest.approx(fitted)
    page.locator("#slider").fill(str(page.evaluate("mechviz.player.end")))
    last = page.evaluate("mechviz.player.header.frames") - 1
    assert page.evaluate("mechviz.player.frame") == pytest.approx(last)
    page.get_by_role("button", name="One frame back").click()
    assert page.evaluate("mechviz.player.frame") == pytest.approx(last - 1)
    page.get_by_role("button", name="One frame on").click()
    assert page.evaluate("mechviz.player.frame") == pytest.approx(last)
    page.get_by_label("Speed").select_option("4")
    page.get_by_label("Loop").uncheck()
    page.evaluate("mechviz.player.seekFrame(mechviz.player.header.frames - 4)")
    page.get_by_role("button", name="Play", exact=True).click()
    page.evaluate(
        "new Promise((done) => { const look = () => mechviz.player.playing ? requestAnimationFrame(look) : done(); look(); })"
    )
    assert page.evaluate("mechviz.player.frame") == pytest.approx(last), "without the loop it ends at the last frame"
    page.get_by_label("Loop").check()
    page.get_by_label("Speed").select_option("1")
    page.locator("#axis").select_option(label="time [s]")
    assert page.evaluate("mechviz.player.axis.title") == "time"
    page.locator("#axis").select_option("0")
    count = page.locator("figure:visible").count()
    page.get_by_role("button", name="Add a plot").click()
    assert page.locator("figure:visible").count() == count + 1
    page.get_by_role("button", name="Remove this plot").last.click()
    assert page.locator("figure:visible").count() == count
    page.get_by_role("button", name="3D", exact=True).click()


@pytest.mark.parametrize("speed", ["60 rpm", "-60 rpm"])
def test_cycles_lie_on_each_other_whichever_way_the_drive_turns(browser, tmp_path, speed):
    """Curves of three turns on one, from edge to edge: all corners are where the run says."""
    scene = mechviz.load("crank-rocker").changed({("joints", "A", "drive", "speed"): speed})
    run = run_scene(scene, frames=72, cycles=3)
    file = tmp_path / "page.html"
    file.write_text(make_page(presentation_of(run))[0], encoding="utf-8")
    opened = Opened(browser, file, viewport=WIDE)
    page = opened.page
    page.locator("#axis").select_option(label="angle of drive A, cycles overlaid [°]")
    figure = page.locator("figure").first
    figure.locator(".what").select_option(label="Joint D: angle [°]")
    with page.expect_download() as offered:
        figure.get_by_role("button", name="SVG").click()
    (curve,) = re.findall(r'd="([^"]*)" fill="none"[^>]*stroke-width="1.8"', Path(offered.value.path()).read_text(encoding="utf-8"))
    x, y = np.array([pair.split() for pair in re.split("[ML]", curve)[1:]], float).T
    scale = page.evaluate("(({ X, Y }) => [X(0), X(360), Y(0), Y(1)])(mechviz.player.plots[0].scale)")
    angle, output = 360.0 * (x - scale[0]) / (scale[1] - scale[0]), (y - scale[2]) / (scale[3] - scale[2])
    turned, swung = (np.degrees(run.motion.coordinate(joint)[:, 0]) for joint in "AD")
    assert output == pytest.approx(np.interp(angle, turned[:24], swung[:24], period=360.0), abs=0.2)  # a hundredth of a pixel
    assert angle.min() <= 0.01 and angle.max() >= 359.99 and curve.count("M") >= 3
    assert opened.troubles == []
    opened.context.close()


def test_bands_and_constructions_are_shown_where_there_are_any(browser, tmp_path):
    file = tmp_path / "page.html"
    file.write_text(make_page(presentation_of(ran("parametric-press", 24)))[0], encoding="utf-8")
    opened = Opened(browser, file, viewport=WIDE)
    page = opened.page
    page.get_by_label("What is plotted", exact=True).first.select_option(label="Joint S: displacement [mm]")
    drawn = "figure canvas >> nth=0"
    narrow = opened.picture(drawn)
    page.get_by_label("Tolerance band").select_option("100")
    assert (np.ptp(opened.picture(drawn), axis=2) > 20).sum() > (np.ptp(narrow, axis=2) > 20).sum() + 200
    file.write_text(make_page(presentation_of(ran("plans-four-bar", 24)))[0], encoding="utf-8")
    opened.load(file)
    page.get_by_role("tab", name="Constructions").click()
    before = opened.picture("#constructions canvas >> nth=0")
    page.get_by_role("button", name="One frame on").click()
    page.evaluate(DRAWN)
    assert np.abs(opened.picture("#constructions canvas >> nth=0") - before).max() > 60
    assert opened.troubles == []
    opened.context.close()


def test_an_event_is_jumped_to(wide):
    page = wide.page
    page.get_by_role("tab", name="Events").click()
    events = recorded().recording.events
    page.locator("#events button").nth(len(events) - 1).click()
    assert page.evaluate(TIME) == pytest.approx(events[-1].time, rel=1e-6)
    page.evaluate("mechviz.player.drawNow()")
    assert page.locator("#events button[aria-current=true]").count() == 1
    page.get_by_role("tab", name="Notes").click()
    assert "Computed" in page.locator("#notes").inner_text()
    page.get_by_role("tab", name="Plots").click()


def test_mouse_turns_and_wheel_zooms(wide):
    page = wide.page
    page.evaluate("mechviz.player.view('3d')")
    box = page.locator("#picture").bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    yaw, distance = page.evaluate("[mechviz.player.stage.camera.yaw, mechviz.player.stage.camera.distance]")
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 80, y + 10, steps=3)
    page.mouse.up()
    page.mouse.wheel(0, -300)
    page.wait_for_function(f"mechviz.player.stage.camera.distance < {0.9 * distance}")
    assert page.evaluate("mechviz.player.stage.camera.yaw") < yaw - 0.1


def test_tabs_and_camera_obey_the_keyboard(wide):
    page = wide.page
    page.locator("#tab-plots").focus()
    time = page.evaluate(TIME)
    for key, tab in (("ArrowRight", "tab-events"), ("End", "tab-notes"), ("ArrowRight", "tab-plots")):
        page.keyboard.press(key)
        assert page.evaluate("document.activeElement.id") == tab
        panel = page.locator(f"#{tab}").get_attribute("aria-controls")
        assert page.locator(f"#{panel}").is_visible()
        assert page.locator("[role=tabpanel]:visible").count() == page.locator("[role=tab]:not([tabindex='-1'])").count() == 1
        scrolls = "e => !!e.querySelector('select, button, [tabindex]') || e.tabIndex === 0"
        assert page.locator("[role=tabpanel]:visible").evaluate(scrolls), "it can be scrolled with the keys"
    assert page.evaluate(TIME) == time, "keys of the tabs are no steps in time"
    page.locator("#picture").focus()
    page.keyboard.press("3")
    for key, value, sign in (("w", "pitch", 1), ("s", "pitch", -1), ("a", "yaw", -1), ("d", "yaw", 1), ("+", "distance", -1)):
        before = page.evaluate(f"mechviz.player.stage.camera.{value}")
        page.keyboard.press(key)
        assert (page.evaluate(f"mechviz.player.stage.camera.{value}") - before) * sign > 0.0, key
    page.keyboard.press("0")


def projected(page: Any, corners: np.ndarray) -> np.ndarray:
    """Where the corners of a box (2, 3) are on the page (8, 2)."""
    return np.array(page.evaluate(f"places => places.map({PLACE})", np.array(np.meshgrid(*corners.T)).reshape(3, -1).T.tolist()))


def free_part(page: Any) -> tuple[np.ndarray, np.ndarray]:
    """Top left and bottom right of the part of the picture that no button covers."""
    low, high = page.evaluate(FREE)
    return np.array(low), np.array(high)


def test_all_of_the_motion_is_in_the_free_part_of_the_picture(wide):
    low, high = free_part(wide.page)
    for view in ("front", "3d", "top", "iso", "right"):
        wide.page.evaluate(f"mechviz.player.view('{view}')")
        spots = projected(wide.page, recorded().shown.picture.bounds)
        assert (spots >= low - 3.0).all() and (spots <= high).all(), view


@pytest.mark.thorough
def test_mechanisms_fill_the_free_part_of_the_picture(browser, tmp_path):
    """Two thirds of its height or its width at least, whatever the window and whatever arrows there are."""
    file = tmp_path / "page.html"
    opened = None
    for name in LARGE:
        shown = presentation_of(ran(name, 24))
        file.write_text(make_page(shown, plots=False)[0], encoding="utf-8")
        if opened is None:
            opened = Opened(
                browser, file, viewport=WIDE, device_scale_factor=0.25, script=STILL
            )  # the camera tells where things are
        else:
            opened.load(file)
        for width, height in ((1600, 1000), (1280, 720), (390, 844)):
            opened.page.set_viewport_size({"width": width, "height": height})
            opened.page.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
            for view in ("front", "3d"):
                opened.page.evaluate(f"mechviz.player.view('{view}')")
                low, high = free_part(opened.page)
                size = np.ptp(projected(opened.page, shown.picture.bounds), axis=0)
                assert (size / (high - low)).max() > 2.0 / 3.0, (name, width, view)
    opened.context.close()


def test_names_stand_at_their_joints_in_every_view(wide):
    """At the front of the pin, which is the foremost of all solids there."""
    page, frame = wide.page, 40
    page.evaluate(f"mechviz.player.seekFrame({frame}); mechviz.player.show('names', true)")
    solids = [page.evaluate(SOLID, link) for link in recorded().shown.picture.poses]
    for view in ("front", "3d", "iso", "top", "right"):
        page.evaluate(f"mechviz.player.view('{view}'); mechviz.player.drawNow()")
        left, top = (page.locator("#labels").bounding_box()[k] for k in ("x", "y"))
        seen = 0
        for joint in ("A", "B", "D", "E"):
            at = recorded().run.motion.joint_position(joint)[frame]
            front = max(z for solid in solids for z in pin_fronts(np.reshape(solid["vertices"], (-1, 3)), solid["pose"], at))
            shown = page.evaluate(TAG, joint)
            if shown is not None:  # names give way to each other
                seen += 1
                x, y = page.evaluate(PLACE, [*at, front])
                assert np.hypot(left + shown[0] - x, top + shown[1] + 16.0 - y) < 2.0, (view, joint)
        assert seen > 1, view


def pin_fronts(vertices: np.ndarray, pose: list[float], at: np.ndarray) -> list[float]:
    """Heights of what a solid has around a joint, within a hundredth of the mechanism."""
    x, y, angle = pose
    world = (vertices[:, 0] + 1j * vertices[:, 1]) * np.exp(1j * angle) + complex(x, y)
    near = np.abs(world - complex(*at)) < 0.025 * recorded().shown.picture.size
    return vertices[near, 2].tolist() or [-np.inf]


def test_a_picture_whose_memory_was_taken_away_comes_back(wide):
    """As telephones do with pages in the background."""
    page = wide.page
    page.evaluate("mechviz.player.seekFrame(60); mechviz.player.view('front'); mechviz.player.drawNow()")
    before = wide.picture()
    page.evaluate(
        """new Promise((done) => { const gl = mechviz.player.stage.gl, lose = gl.getExtension("WEBGL_lose_context");
        const back = () => { mechviz.player.drawNow(); setTimeout(() => lose.restoreContext()); };
        gl.canvas.addEventListener("webglcontextlost", back);
        gl.canvas.addEventListener("webglcontextrestored", () => done()); lose.loseContext(); })"""
    )
    assert not page.evaluate("mechviz.player.stage.gl.isContextLost()")
    assert same(wide.picture(), before) and np.ptp(before, axis=2).max() > 80


@pytest.mark.parametrize("way", ["file", "notebook"])
def test_nothing_is_loaded_from_elsewhere_whatever_the_page_holds(browser, file, tmp_path, way):
    """As if a text of the recording had become markup."""
    with elsewhere() as (there, asked):
        page = file.read_text(encoding="utf-8").replace("<header>", f"<header>{pulling(there)}", 1)
        if way == "notebook":
            page = f'<iframe srcdoc="{escape(page, quote=True)}" sandbox="allow-scripts"></iframe>'
        changed = tmp_path / "changed.html"
        changed.write_text(page, encoding="utf-8")
        opened = browser.new_page()
        opened.goto(changed.as_uri())
        inside = opened.frames[0 if way == "file" else 1]
        inside.wait_for_selector("header img", state="attached")
        assert inside.evaluate(REQUESTING, there) == ["refused", "refused"]
        opened.close()
    assert not asked


def test_everything_was_in_the_file(wide, file):
    """After all that the tests before have done."""
    assert wide.requests == [file.as_uri()]
    assert wide.troubles == []


def test_a_phone_in_the_dark(browser, file):
    opened = Opened(browser, file, viewport=NARROW, has_touch=True, is_mobile=True, color_scheme="dark")
    page = opened.page
    assert page.evaluate("document.documentElement.scrollWidth") <= NARROW["width"]
    picture = page.locator("#picture").bounding_box()
    footer = page.locator("footer").bounding_box()
    assert picture is not None and footer is not None
    assert picture["width"] > 350 and picture["height"] > 250 and picture["y"] + picture["height"] < footer["y"]
    assert footer["y"] + footer["height"] <= NARROW["height"] + 1
    views = page.locator("#views").bounding_box()
    assert views is not None and views["y"] >= picture["y"] + picture["height"], "no button lies over the picture"
    colors = opened.picture()
    assert np.median(colors) < 60 and np.ptp(colors, axis=2).max() > 80  # a dark ground, and coloured parts on it
    for control in page.locator("footer button").all():
        box = control.bounding_box()
        assert box is not None and box["height"] >= 40 and box["x"] + box["width"] <= NARROW["width"]
    before = page.evaluate(TIME)
    page.locator("#play").tap()
    page.evaluate(
        f"new Promise((done) => {{ const look = () => {TIME} !== {before} ? done() : requestAnimationFrame(look); look(); }})"
    )
    assert opened.troubles == []
    opened.context.close()


def test_a_notebook_cell_plays_in_its_frame(browser, tmp_path):
    cell = tmp_path / "cell.html"
    cell.write_text(
        f"<!doctype html><meta charset=utf-8>{Result(recorded().run)._repr_mimebundle_()['text/html']}", encoding="utf-8"
    )
    context = browser.new_context(viewport=WIDE)
    page = context.new_page()
    page.goto(cell.as_uri())
    frame = page.frame_locator("iframe")
    frame.locator("#play").click()
    frame.locator("#play[aria-label=Pause]").wait_for()
    (inner,) = page.frames[1:]
    assert inner.evaluate(
        "(async () => { await mechviz.ready; mechviz.player.drawNow(); return mechviz.player.stage.state.arrows; })()"
    )
    context.close()


def test_a_picture_is_what_was_asked_for(tmp_path):
    from PIL import Image

    chromium_or_skip()
    time = float(recorded().time[60])
    path = shot(recorded().shown, tmp_path / "a.png", Look(400, 300, "front", shown=("reaction",)), PictureTime(time))
    with Image.open(path) as image:
        assert image.size == (400, 300)
        colors = np.asarray(image.convert("RGB")).astype(int)
    assert reddish(colors).sum() > 100 and np.ptp(colors, axis=2).max() > 100
    assert [p.name for p in tmp_path.iterdir()] == ["a.png"]


@pytest.mark.thorough
def test_a_film_moves_and_an_interrupted_one_leaves_nothing(tmp_path):
    from PIL import Image

    chromium_or_skip()
    path, seen = tmp_path / "a.gif", []

    def interrupt(done: int, total: int) -> None:
        seen.append((done, total))
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        film(recorded().shown, path, Look(160, 120), seconds=0.3, rate=10, progress=interrupt)
    assert seen == [(1, 3), (2, 3)] and not list(tmp_path.iterdir())
    film(recorded().shown, path, Look(160, 120), seconds=0.3, rate=10)
    with Image.open(path) as image:
        assert image.n_frames == 3 and image.size == (160, 120) and image.info["duration"] == 100
        frames = []
        for k in range(3):
            image.seek(k)
            frames.append(np.asarray(image.convert("RGB")).astype(int))
    assert np.abs(frames[1] - frames[0]).max() > 60 and np.abs(frames[2] - frames[1]).max() > 60
