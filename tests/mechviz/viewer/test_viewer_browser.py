"""The viewer in a real browser: controls are used as a person would, and the state that they lead to is read back."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from browsers import REQUESTING, browser, elsewhere, pulling
from browsing import (
    CAMERA,
    CANVAS,
    CURSOR,
    PLACE,
    POSE,
    POSES,
    READY,
    SEEN,
    SIZE,
    camera_rests,
    caught_up,
    heard,
    next_frames,
    open_tab,
    open_viewer,
    picture,
    until,
)

from mechviz import scene
from mechviz.outputs.viewer import playback
from mechviz.outputs.viewer.app import Viewer
from mechviz.outputs.viewer.playback import Curves
from mechviz.outputs.viewer.viser_adapter import buffer_of, uuid_of
from mechviz.outputs.viewer.world.arrows import arc_path
from mechviz.outputs.viewer.world.camera import fit_view
from mechviz.outputs.viewer.world.marks import dot_path
from mechviz.outputs.viewer.world.solids import link_path
from mechviz.runs import run_scene

__all__ = ["browser"]  # a fixture

pytestmark = pytest.mark.browser

# The script that plays is sent when it is first needed: a page that has never had it does not play
PLAYS = "() => !!window.mechvizPlayback && window.mechvizPlayback.running"
DRAWN = "() => [window.__viserTestpoints.rendererInfo.render.frame, performance.now()]"
SHOWN = """async count => { const player = window.mechvizPlayback;
    for (let k = 0; k < count; k++) {
        player.show(k % 361, k % 20 === 0);
        await null;  // React brings it into the page
        if (k % 100 === 99) await new Promise(requestAnimationFrame);
    } }"""
LINKS = ("crank", "coupler", "rocker")
NODES = tuple(link_path(link) for link in LINKS)

# At each picture: where the coupler is, the corners of the torque's arc, and the places of the arrows of the reactions
WATCH = """([coupler, arc]) => { const v = window.__viserMutable, own = v.scene.__r3f, { scene } = (own.root || own).getState();
    const after = scene.onAfterRender, found = (name, is) => { let o = null;
        v.nodeRefFromName[name].traverse(n => { o = o || (is(n) && n); }); return o; };
    window.watched = [];
    scene.onAfterRender = () => {
        const pose = v.nodePoseData[coupler], corners = found(arc, n => n.isMesh).geometry.attributes.position.array;
        const arrows = found('/vectors/reaction', n => n.matricesTexture).matricesTexture.image.data;
        window.watched.push([pose.position.join(), corners.slice(-6).join(), arrows.slice(0, 32).join()]); };
    window.unwatch = () => { scene.onAfterRender = after; }; }"""


@pytest.fixture(scope="module")
def viewer(browser) -> Iterator[Viewer]:
    with Viewer(run_scene(scene.load("kinetostatic-four-bar")), port=0) as shown:
        yield shown


@pytest.fixture(scope="module")
def errors() -> list[str]:
    """What went wrong in the page's scripts."""
    return []


@pytest.fixture(scope="module")
def page(browser, viewer, errors) -> Iterator[Any]:
    opened = open_viewer(browser, viewer, SIZE, NODES)
    opened.on("pageerror", lambda error: errors.append(str(error)))
    _until_fitted(viewer, opened)
    yield opened
    opened.close()


@pytest.fixture(autouse=True)
def at_rest(viewer, page) -> None:
    """Every test starts paused at a frame with large forces."""
    viewer.set_frame(300)
    _until_drawn(viewer, page)
    open_tab(page, "View")


def _pose_of_core(viewer: Viewer, link: str, frame: int) -> np.ndarray:
    x, y, angle = viewer.run.motion.pose(link)[frame]
    return np.array([np.cos(angle / 2), 0.0, 0.0, np.sin(angle / 2), x, y, 0.0])


def _drawn(viewer: Viewer, page: Any) -> bool:
    wanted = np.array([_pose_of_core(viewer, link, viewer.frame) for link in LINKS])
    return bool(np.abs(np.array(page.evaluate(POSES, NODES)) - wanted).max() < 1e-3)


def _until_drawn(viewer: Viewer, page: Any) -> None:
    """Until the frame is there and nothing else is on its way."""
    caught_up(viewer, page)
    until(page, lambda: _drawn(viewer, page), f"poses of frame {viewer.frame} in the browser")
    page.wait_for_function(READY, arg=list(NODES))


def _camera(page: Any) -> np.ndarray:
    """Where the camera is, in the axes of the scene: viser turns those by half a turn about y in its own world."""
    return np.array(page.evaluate(CAMERA)) * [-1.0, 1.0, -1.0]


def _fitted(viewer: Viewer, page: Any) -> np.ndarray:
    """Where the camera stands that sees everything in the present window."""
    _, _, width, height = page.evaluate(CANVAS)
    return fit_view(viewer.scene.bounds, width / height, core=viewer.scene.current.bounds).position


def _at(page: Any, place: np.ndarray) -> bool:
    """Whether the camera is there, to half a percent of its distance.

    The server knows a window by the pixels of its picture. A browser that is busy draws fewer of them (386 x 612 for 442 x 700),
    and their ratio differs by rounding.
    """
    return bool(np.abs(_camera(page) - place).max() < 5e-3 * np.linalg.norm(place))


def _until_fitted(viewer: Viewer, page: Any) -> None:
    until(page, lambda: _at(page, _fitted(viewer, page)), "the camera fitted to the window")


def _red(shot: np.ndarray) -> int:
    """Number of pixels in the colour of reactions."""
    r, g, b = shot[..., 0], shot[..., 1], shot[..., 2]
    return int(((r > 130) & (g < 75) & (b < 95)).sum())


def test_the_page_shows_the_mechanism(viewer, page, errors):
    until(page, lambda: "Kinetostatics of a four-bar" in page.title(), "its title")

    def seen() -> bool:
        shot = picture(page)
        amber = (np.abs(shot - [214, 165, 88]).max(axis=-1) < 40).sum()  # the coupler
        white = (shot.min(axis=-1) > 225).mean()
        return bool(amber > 1500 and 0.4 < white < 0.97 and _red(shot) > 200)

    until(page, seen, "coupler, reactions and background in the picture")
    assert not errors


def test_nothing_is_loaded_from_elsewhere_whatever_the_page_is_told(viewer, page):
    """Pictures, frames, scripts and requests of the page go nowhere but to the viewer itself."""
    with elsewhere() as (there, asked):
        hostile = viewer.server.gui.add_html(pulling(there))
        caught_up(viewer, page)
        assert page.evaluate(REQUESTING, there) == ["refused", "refused"]
        hostile.remove()
    assert not asked


def test_a_frame_is_typed(viewer, page):
    page.get_by_label("Frame", exact=True).last.fill("120")
    until(page, lambda: viewer.frame == 120, "the frame that was typed")
    _until_drawn(viewer, page)


def test_play_moves_the_mechanism_and_pause_stops_it(viewer, page):
    page.get_by_role("button", name="Play", exact=True).click()
    until(page, lambda: viewer.playing and viewer.frame != 300, "playing")
    before = page.evaluate(POSE, NODES[1])
    until(page, lambda: page.evaluate(POSE, NODES[1]) != before, "a new pose in the browser")
    page.get_by_role("button", name="Pause", exact=True).click()
    until(page, lambda: not viewer.playing, "paused")
    _until_drawn(viewer, page)
    frame, pose = viewer.frame, page.evaluate(POSE, NODES[1])
    next_frames(page, 6)
    caught_up(viewer, page)
    assert viewer.frame == frame and page.evaluate(POSE, NODES[1]) == pose


def test_the_browser_plays_by_itself_and_nothing_is_sent_meanwhile(viewer, page):
    traffic: list[int] = []
    assert viewer.session.wait(until_idle=True)  # what each effect contributes has been found and told
    viewer.play()
    until(page, lambda: page.evaluate(PLAYS), "playing in the browser")
    buffer = buffer_of(viewer.server)
    first = page.evaluate("() => window.mechvizPlayback.frames")
    before = buffer.message_counter
    until(page, lambda: page.evaluate("() => window.mechvizPlayback.frames") >= first + 5, "some frames")
    traffic.append(buffer.message_counter - before)
    page.evaluate("() => { const p = window.mechvizPlayback; p.running = false; p.show(123, true); }")
    page.wait_for_function(READY, arg=list(NODES))
    for link in LINKS:
        assert np.abs(np.array(page.evaluate(POSE, link_path(link))) - _pose_of_core(viewer, link, 123)).max() < 1e-6
    torque = viewer.run.forces.effort("A")[123]
    page.get_by_text(f"{torque:.5g} N m".replace("-", "−")).first.wait_for()
    assert page.evaluate(CURSOR, uuid_of(viewer.plots.slots[0].chart)) == pytest.approx([123.0, 123.0])
    assert traffic == [0] and viewer.player.is_remote
    viewer.pause()
    _until_drawn(viewer, page)
    frame = viewer.frame
    page.get_by_text(f"frame {frame} of 360").first.wait_for()
    assert not viewer.player.is_remote


BETWEEN = """node => { const p = window.mechvizPlayback, m = window.__viserMutable, pushed = [], queue = m.messageQueue;
    p.running = false;
    const pose = () => [...m.nodePoseData[node].wxyz, ...m.nodePoseData[node].position];
    const real = queue.push;
    queue.push = (...messages) => { pushed.push(...messages); return queue.length; };
    const arrows = () => { const found = pushed.splice(0).filter(x => x.name === '/vectors/reaction' && x.updates);
        return found.length ? Array.from(found[0].updates.points) : null; };
    const look = (...at) => { p.show(...at); return [pose(), arrows()]; };
    const out = { low: look(100, false), middle: look(100, false, 100, 0.5), high: look(101, false) };
    const track = p.motion.poses.find(t => t.name === node), x = track.p[3 * 101];
    for (let k = 101; k < p.motion.count; k++) track.p[3 * k] += 10;
    out.leap = look(100, false, 100, 0.9);
    for (let k = 101; k < p.motion.count; k++) track.p[3 * k] -= 10;
    track.p[3 * 101] = x;
    for (let i = 404; i < 408; i++) track.q[i] *= -1;
    out.flipped = look(100, false, 100, 0.5);
    for (let i = 404; i < 408; i++) track.q[i] *= -1;
    p.motion.points.find(t => t.name === '/vectors/reaction').steady[100] = 0;
    out.others = look(100, false, 100, 0.5);
    queue.push = real;
    return out; }"""


def test_between_frames_a_page_draws_what_lies_between_them_but_where_something_leaps(viewer, page):
    viewer.inspector.playback.change()
    viewer.play()
    until(page, lambda: page.evaluate(PLAYS), "playing in the browser")
    outcomes = page.evaluate(BETWEEN, link_path("coupler"))
    (low, low_arrows), (high, high_arrows) = ([np.array(part) for part in outcomes[name]] for name in ("low", "high"))
    (middle, middle_arrows), (flipped, _) = ([np.array(part) for part in outcomes[name]] for name in ("middle", "flipped"))
    assert np.abs(high - low).max() > 1e-4 and len(low_arrows) == len(high_arrows) > 0
    assert np.abs(middle - (low + high) / 2).max() < 1e-6 and np.abs(flipped - middle).max() < 1e-9
    assert np.linalg.norm(middle[:4]) == pytest.approx(1.0, abs=1e-12)
    assert np.abs(middle_arrows - (low_arrows + high_arrows) / 2).max() < 1e-6
    assert np.abs(np.array(outcomes["leap"][0]) - low).max() < 1e-9, "it stays where it is until it has leapt"
    assert outcomes["others"][1] == low_arrows.tolist(), "arrows of others than before are not mixed with them"
    viewer.inspector.playback.change()
    viewer.pause()
    _until_drawn(viewer, page)


POINT = """() => { const dot = document.querySelector('.mechviz-diagram circle');
    return [dot.getAttribute('cx'), dot.getAttribute('cy')]; }"""


def test_a_diagram_moves_while_the_browser_plays_if_it_is_seen(viewer, page):
    diagrams = viewer.inspector.diagrams
    open_tab(page, "Diagrams")
    viewer.play()
    until(page, lambda: diagrams.watched, "the page has said so")
    place = page.evaluate(POINT)
    until(page, lambda: page.evaluate(POINT) != place, "the point moves along its curve")
    until(page, lambda: viewer.player.is_remote, "played by the browser")
    open_tab(page, "Plots")
    until(page, lambda: not diagrams.watched, "nobody sees it any more")


def test_what_has_arrived_is_taken_at_once_and_drawn_in_a_few_frames(viewer, page):
    taken = page.evaluate(
        """name => { const m = window.__viserMutable;
            m.messageQueue.push({ type: "SetPositionMessage", name, position: [1, 2, 3] });
            m.requestRender();
            return [m.messageQueue.length, ...m.nodePoseData[name].position]; }""",
        NODES[1],
    )
    assert taken == [0, 1, 2, 3], "without waiting for a frame"
    next_frames(page, 3)
    before, _ = page.evaluate(DRAWN)
    viewer.set_frame(301)
    _until_drawn(viewer, page)
    drawn, began = page.evaluate(DRAWN)
    assert drawn > before
    next_frames(page, 20)
    again, ended = page.evaluate(DRAWN)
    # viser draws one frame a second in any case; after the last message it would go on for a quarter of a second
    assert again - drawn <= 5 + (ended - began) / 1000


@pytest.mark.thorough
def test_a_long_play_leaves_the_memory_as_it_is(viewer, page):
    """As many frames as in twenty seconds, without the waits between them. Two hours: benchmarks/viewer.py."""
    devtools = page.context.new_cdp_session(page)

    def heap() -> float:
        devtools.send("HeapProfiler.collectGarbage")
        return float(devtools.send("Runtime.getHeapUsage")["usedSize"])

    viewer.play()
    until(page, lambda: page.evaluate(PLAYS), "playing in the browser")
    page.evaluate("() => { window.mechvizPlayback.running = false; }")
    page.evaluate(SHOWN, 200)
    before = heap()
    page.evaluate(SHOWN, 1200)
    assert heap() - before < 1e6, "of the page, of which a frame must not keep the places of its arrows"
    viewer.pause()
    _until_drawn(viewer, page)
    kept = buffer_of(viewer.server).message_from_id
    before = len(kept)
    for frame in range(200):
        viewer.inspector.draw(frame, True)
    assert len(kept) <= before + 5, "of the server, for browsers that come later"
    viewer.set_frame(300)


def test_what_a_browser_cannot_play_by_itself_is_sent(viewer, page, monkeypatch):
    monkeypatch.setattr("mechviz.outputs.viewer.playback.LARGEST_MOTION", 1000)
    viewer.inspector.playback.change()
    try:
        viewer.play()
        until(page, lambda: viewer.frame not in (300, 0), "playing")
        before = page.evaluate(POSE, NODES[1])
        until(page, lambda: page.evaluate(POSE, NODES[1]) != before, "a new pose in the browser")
        assert not viewer.player.is_remote and not page.evaluate(PLAYS)
        viewer.pause()
        _until_drawn(viewer, page)
    finally:
        monkeypatch.undo()
        viewer.inspector.playback.change()


def test_a_word_to_play_that_comes_after_the_word_to_stop_is_not_heeded(viewer, page, monkeypatch):
    """The one goes to a browser, the other to all of them: a busy server may send the later one first."""
    late: list[tuple[Any, str, str]] = []
    say = playback.run_script

    def held(target: Any, source: str, key: str) -> None:
        if target is viewer.server:
            say(target, source, key)
        else:
            late.append((target, source, key))

    with monkeypatch.context() as patch:
        patch.setattr(playback, "run_script", held)
        viewer.play()
        assert viewer.player.wait() and viewer.player.is_remote
        viewer.set_frame(40)
        _until_drawn(viewer, page)
    assert [key for *_, key in late][-1] == "play"
    for words in late:
        say(*words)
    heard(viewer)
    assert not page.evaluate(PLAYS)
    viewer.play()
    page.wait_for_function(PLAYS)


@pytest.mark.parametrize("frame", [0, 91, 360])
def test_scrubbing_brings_the_frame_and_its_poses(viewer, page, frame):
    box = page.locator(f'[id="{uuid_of(viewer.timeline.slider)}"] ~ div input')
    box.fill(str(frame))
    until(page, lambda: viewer.frame == frame, "the frame")
    _until_drawn(viewer, page)
    page.get_by_text(f"frame {frame} of 360").first.wait_for()


def test_keys_play_and_step_without_turning_the_camera(viewer, page):
    left, top, _, _ = page.evaluate(CANVAS)
    page.mouse.click(left + 20, top + 20)
    camera = page.evaluate(CAMERA)
    for key, frame in (("ArrowRight", 301), ("ArrowRight", 302), ("ArrowLeft", 301), ("ArrowUp", 311), ("Home", 0), ("End", 360)):
        page.keyboard.down(key)
        until(page, lambda frame=frame: viewer.frame == frame, f"{key} to {frame}")
        next_frames(page, 3)  # held: viser would turn the camera as long as an arrow key is down
        page.keyboard.up(key)
    assert page.evaluate(CAMERA) == camera
    page.keyboard.press("Space")
    until(page, lambda: viewer.playing, "space plays")
    page.keyboard.press("Space")
    until(page, lambda: not viewer.playing, "space pauses")
    thumb = page.locator(f'[id="{uuid_of(viewer.timeline.slider)}"] [role=slider]')
    viewer.set_frame(10)
    _until_drawn(viewer, page)
    thumb.focus()
    page.keyboard.press("ArrowRight")
    until(page, lambda: viewer.frame == 11, "one step of the slider")
    heard(viewer)
    assert viewer.frame == 11, "the slider has the key, the hotkey must not have it too"


TOLD = "() => { const b = document.getElementById('mechviz-hover'); return b.style.display === 'none' ? '' : b.innerText; }"


def test_the_pointer_is_told_what_it_rests_on(viewer, page):
    b, d = (np.array(page.evaluate(PLACE, f"/joints/{name}/dot")) for name in "BD")
    page.mouse.move(*b)
    until(page, lambda: page.evaluate(TOLD) == "joint B\nrevolute, crank and coupler", "the joint")
    page.mouse.move(*(0.5 * (b + d)))
    until(page, lambda: page.evaluate(TOLD).startswith("link coupler"), "the link")
    viewer.set_frame(60)  # it moves away below the pointer
    until(page, lambda: "coupler" not in page.evaluate(TOLD), "nothing, or another link")
    left, top, _, _ = page.evaluate(CANVAS)
    page.mouse.move(left + 5, top + 5)
    until(page, lambda: page.evaluate(TOLD) == "", "nothing beside the mechanism")


def test_space_after_a_click_on_a_button_plays(viewer, page):
    page.get_by_role("button", name="Step ▸", exact=True).click()
    until(page, lambda: viewer.frame == 301, "one step")
    page.keyboard.press("Space")
    until(page, lambda: viewer.playing, "playing")
    page.get_by_role("button", name="Pause", exact=True).click()
    until(page, lambda: not viewer.playing, "paused")
    page.keyboard.press("Space")
    until(page, lambda: viewer.playing, "playing again, not paused twice")


def test_a_button_that_the_keyboard_has_reached_keeps_its_space(viewer, page):
    page.get_by_role("button", name="Step ▸", exact=True).focus()
    page.keyboard.press("Space")
    until(page, lambda: viewer.frame == 301, "one step")
    heard(viewer)
    assert viewer.frame == 301 and not viewer.playing


def test_speed_loop_and_steps(viewer, page):
    player, cycle = viewer.player, viewer.inspector.view_model.cycle
    page.get_by_role("button", name="◂ Step", exact=True).click()
    until(page, lambda: viewer.frame == 299, "one step back")
    for seconds in (2, 8):
        page.get_by_label("Speed", exact=True).click()
        label = next(option for option in viewer.timeline.speed.options if option.startswith(f"{seconds} s a cycle"))
        page.get_by_role("option", name=label, exact=True).click()
        until(page, lambda rate=cycle / seconds: player.rate == pytest.approx(rate), label)
    page.get_by_role("button", name="Loop ✓", exact=True).click()
    page.get_by_role("button", name="Loop ✗", exact=True).wait_for()
    viewer.set_frame(360)
    page.get_by_role("button", name="Step ▸", exact=True).click()
    heard(viewer)
    assert not player.loop and viewer.frame == 360, "no way on from the end"
    page.get_by_role("button", name="Loop ✗", exact=True).click()
    page.get_by_role("button", name="Loop ✓", exact=True).wait_for()
    page.get_by_role("button", name="Step ▸", exact=True).click()
    until(page, lambda: viewer.frame == 1, "on over the end: the last frame is the first")


NOW = "() => Number(document.querySelector('.mechviz-now').getAttribute('x1'))"


def test_events_are_jumped_to_and_the_health_strip_goes_along(viewer, page):
    view_model = viewer.inspector.view_model
    frames = [viewer.timeline.frame_at(e.time) for e in view_model.events]
    assert len(frames) == 4
    page.get_by_label("Jump to event", exact=True).click()
    page.get_by_role("option", name="limit position: coordinate largest").click()
    until(page, lambda: viewer.frame == frames[1], "the event")
    until(page, lambda: page.evaluate(NOW) == pytest.approx(1000.0 * frames[1] / 360, abs=0.1), "the strip's cursor")
    _until_drawn(viewer, page)
    left, top, _, _ = page.evaluate(CANVAS)
    page.mouse.click(left + 20, top + 20)
    camera = page.evaluate(CAMERA)
    page.keyboard.down("e")
    until(page, lambda: viewer.frame == frames[2], "the next one")
    next_frames(page, 3)  # held: viser would move the camera
    page.keyboard.up("e")
    assert page.evaluate(CAMERA) == camera
    strip = page.get_by_role("img", name="Health of the run")
    assert not strip.is_visible(), "a dot, as all is well"
    page.locator(".mechviz-strip summary").click()
    said = strip.get_attribute("aria-label")
    for health in view_model.health:
        assert f"{health.name}: at most" in said
    rows = strip.locator("rect").evaluate_all("rects => rects.map(r => [r.getAttribute('fill'), Number(r.getAttribute('width'))])")
    assert len(rows) == len(view_model.health) and {color for color, _ in rows} == {"#2ea060"}, "all is well all the time"
    assert strip.locator("path").count() == len(frames)
    page.locator(".mechviz-strip summary").click()


def test_marks_go_and_come_back_and_a_plot_runs_against_time(viewer, page):
    page.get_by_label("Grid", exact=True).uncheck()
    until(page, lambda: not page.evaluate(SEEN, "/grid"), "no grid")
    page.get_by_label("Grid", exact=True).check()
    until(page, lambda: page.evaluate(SEEN, "/grid"), "the grid")
    b = np.array(page.evaluate(PLACE, "/joints/B/dot")) - page.evaluate(CANVAS)[:2]
    x, y = (int(v) for v in b)

    def written() -> np.ndarray:
        """What is above and beside the joint, where its name is."""
        return picture(page)[y - 26 : y - 4, x + 4 : x + 26]

    before = written()
    page.get_by_label("Joint names", exact=True).uncheck()
    until(page, lambda: (np.abs(written() - before) > 60).sum() > 20, "no names")
    page.get_by_label("Joint names", exact=True).check()
    until(page, lambda: (np.abs(written() - before) > 60).sum() < 5, "the names again")
    axis = page.get_by_label("Plot against", exact=True)
    abscissa = "uuid => { const c = window.__viserTestpoints.uplots[uuid]?.chart; return c ? Array.from(c.data[0]).at(-1) : 0; }"
    for choice, last in (("time [s]", viewer.run.motion.time[-1]), ("angle of drive A [°]", 360.0)):
        axis.click()
        page.get_by_role("option", name=choice, exact=True).click()
        slots = viewer.plots.slots
        for slot in slots:
            until(page, lambda s=slot, x=last: page.evaluate(abscissa, uuid_of(s.chart)) == pytest.approx(x), f"against {choice}")


def test_a_family_of_arrows_goes_and_comes_back(viewer, page):
    assert page.evaluate(SEEN, "/vectors/reaction")
    before = _red(picture(page))
    page.get_by_label("Reactions", exact=True).uncheck()
    until(page, lambda: not page.evaluate(SEEN, "/vectors/reaction"), "no reactions")
    until(page, lambda: _red(picture(page)) < 0.3 * before, "a picture without reactions")
    page.get_by_label("Reactions", exact=True).check()
    until(page, lambda: page.evaluate(SEEN, "/vectors/reaction"), "reactions again")
    assert not page.evaluate(SEEN, "/vectors/velocity")
    page.get_by_label("Velocity", exact=True).check()
    until(page, lambda: page.evaluate(SEEN, "/vectors/velocity"), "velocities")
    size = page.locator(f'[id="{uuid_of(viewer.switches.sizes["Size of velocities"])}"] ~ div input')
    caught_up(viewer, page)
    before = viewer.server.scene.get_handle_by_name("/vectors/velocity").points.copy()
    size.fill("2")
    until(
        page,
        lambda: np.allclose(
            np.diff(viewer.server.scene.get_handle_by_name("/vectors/velocity").points, axis=1),
            2.0 * np.diff(before, axis=1),
            atol=1e-6,
        ),
        "twice as long",
    )
    size.fill("1")
    page.get_by_label("Velocity", exact=True).uncheck()
    until(page, lambda: not page.evaluate(SEEN, "/vectors/velocity"), "no velocities")


def test_arrows_grow_and_the_legend_says_so(viewer, page):
    def longest() -> float:
        points = viewer.server.scene.get_handle_by_name("/vectors/reaction").points
        return float(np.linalg.norm(points[:, 1] - points[:, 0], axis=1).max())

    before = longest()
    page.locator(f'[id="{uuid_of(viewer.switches.size)}"] ~ div input').fill("2")
    until(page, lambda: longest() == pytest.approx(2.0 * before, rel=1e-5), "arrows twice as long")
    page.get_by_text("Scale: 50 N").first.wait_for(state="attached")
    page.locator(f'[id="{uuid_of(viewer.switches.size)}"] ~ div input').fill("1")
    until(page, lambda: longest() == pytest.approx(before, rel=1e-5), "arrows as before")


def test_the_cursor_of_a_plot_moves_and_another_quantity_can_be_chosen(viewer, page):
    slot, first = viewer.plots.slots[0], viewer.plots.slots[0].quantity.title
    for frame in (45, 270):
        viewer.set_frame(frame)
        until(page, lambda f=frame: page.evaluate(CURSOR, uuid_of(slot.chart)) == pytest.approx([f, f]), "the cursor")
    page.locator(f'[id="{uuid_of(slot.choice)}"]').click()
    page.get_by_role("option", name="joint B: reaction [N]").click()
    until(page, lambda: slot.quantity.label == "joint B: reaction", "the new quantity")
    heard(viewer)  # its chart is there, too
    uuid = uuid_of(slot.chart)
    page.wait_for_function("uuid => !!window.__viserTestpoints.uplots[uuid]?.chart", arg=uuid)
    until(page, lambda: page.evaluate(CURSOR, uuid) == pytest.approx([270, 270]), "the cursor of the new plot")
    curve = page.evaluate("uuid => Array.from(window.__viserTestpoints.uplots[uuid].chart.data[1])", uuid)
    assert max(curve) == pytest.approx(viewer.run.forces.reaction("B")[:, 0].max())
    viewer.plots.choose(slot, first)


def test_hostile_values_and_failures_are_told_and_survived(viewer, page, monkeypatch, errors):
    uuid = uuid_of(viewer.timeline.slider)
    for value in ("NaN", "Infinity", "-1e300", "'x'", "null"):
        page.evaluate(
            f"uuid => window.__viserMutable.sendMessage({{type: 'GuiUpdateMessage', uuid, updates: {{value: {value}}}}})", uuid
        )
    heard(viewer)
    assert 0 <= viewer.frame <= 360

    def fail(_frames: int) -> None:
        raise ValueError("a test made this fail")

    monkeypatch.setattr(viewer.player, "seek", fail)
    page.get_by_role("button", name="Start", exact=True).click()
    page.get_by_text("ValueError: a test made this fail").wait_for(state="attached")
    monkeypatch.undo()
    page.get_by_role("button", name="Start", exact=True).click()
    until(page, lambda: viewer.frame == 0, "the start")
    _until_drawn(viewer, page)
    assert not errors


@pytest.mark.thorough
def test_two_browsers_show_the_same_frame_through_their_own_cameras(viewer, page, browser):
    other = open_viewer(browser, viewer, {"width": 1000, "height": 500}, NODES)
    try:
        _until_fitted(viewer, other)
        viewer.set_frame(200)
        _until_drawn(viewer, other)
        _until_drawn(viewer, page)
        before, theirs = page.evaluate(CAMERA), other.evaluate(CAMERA)
        other.mouse.move(450, 100)
        other.mouse.wheel(0, -400)
        until(other, lambda: other.evaluate(CAMERA) != theirs, "zoomed in one browser")
        assert page.evaluate(CAMERA) == before
        assert len(viewer.server.get_clients()) == 2
    finally:
        other.close()
    until(page, lambda: len(viewer.server.get_clients()) == 1, "one has gone")


def _zoom(page: Any) -> None:
    """Zoom by hand, until that is seen."""
    before = _camera(page)
    page.mouse.move(550, 200)
    page.mouse.wheel(0, -600)
    until(page, lambda: np.abs(_camera(page) - before).max() > 0.05 * np.linalg.norm(before), "zoomed by hand")


def test_the_view_is_fitted_to_the_window_and_comes_back(viewer, page):
    _until_fitted(viewer, page)
    fitted = _camera(page)
    page.set_viewport_size({"width": 1400, "height": 700})
    until(page, lambda: not _at(page, fitted), "a new fit for a wider window")
    _until_fitted(viewer, page)
    page.set_viewport_size(SIZE)
    until(page, lambda: _at(page, fitted), "the old fit for the old window")
    _zoom(page)
    page.get_by_role("button", name="Front", exact=True).click()
    until(page, lambda: _at(page, fitted), "back at the front")


def test_the_front_is_reached_before_the_browser_has_told_that_its_camera_moved(viewer, page):
    """A busy browser reports its camera late, after the click: what the server last heard is not where the camera is."""
    _until_fitted(viewer, page)
    fitted = _camera(page)
    page.evaluate("""() => { const m = window.__viserMutable; m.mechvizSend = m.sendMessage; m.mechvizHeld = 0;
        m.sendMessage = (message) => {
            if (message.type === 'ViewerCameraMessage') m.mechvizHeld += 1; else m.mechvizSend(message); }; }""")
    try:
        _zoom(page)
        until(page, lambda: page.evaluate("() => window.__viserMutable.mechvizHeld") > 0, "a message held back")
        page.get_by_role("button", name="Front", exact=True).click()
        until(page, lambda: _at(page, fitted), "back at the front")
    finally:
        page.evaluate("() => { const m = window.__viserMutable; m.sendMessage = m.mechvizSend; }")


def test_after_a_return_to_the_front_the_view_follows_the_window_again(viewer, page):
    _until_fitted(viewer, page)
    _zoom(page)
    page.get_by_role("button", name="Front", exact=True).click()
    _until_fitted(viewer, page)
    for size in ({"width": 1300, "height": 600}, SIZE):
        page.set_viewport_size(size)
        _until_fitted(viewer, page)


LOOKING = """() => { const c = window.__viserMutable.camera; return c.getWorldDirection(c.position.clone()).toArray(); }"""


def test_in_2d_dragging_moves_the_picture_and_turns_nothing(viewer, page):
    def dragged() -> float:
        """By how much the direction of the view changes while the mouse is dragged."""
        left, top, _, _ = page.evaluate(CANVAS)
        before, place = np.array(page.evaluate(LOOKING)), _camera(page)
        page.mouse.move(left + 40, top + 40)
        page.mouse.down()
        page.mouse.move(left + 70, top + 80, steps=3)
        page.mouse.up()
        until(page, lambda: np.abs(_camera(page) - place).max() > 0.01, "the camera moved")
        return float(np.abs(np.array(page.evaluate(LOOKING)) - before).max())

    page.get_by_role("button", name="2D", exact=True).click()
    until(page, lambda: page.evaluate("() => window.__viserMutable.camera.fov") < 2.0, "hardly any perspective")
    camera_rests(page)
    assert dragged() < 1e-9
    page.get_by_role("button", name="Front", exact=True).click()
    _until_fitted(viewer, page)
    assert dragged() > 0.05, "elsewhere it turns"
    page.get_by_role("button", name="Front", exact=True).click()
    _until_fitted(viewer, page)


def test_reset_view_leads_out_of_2d(viewer, page):
    drag = "() => { const c = window.__viserMutable.cameraControl; return c.mouseButtons.left === c.constructor.ACTION.ROTATE; }"
    page.get_by_role("button", name="2D", exact=True).click()
    until(page, lambda: page.evaluate("() => window.__viserMutable.camera.fov") < 2.0, "hardly any perspective")
    until(page, lambda: not page.evaluate(drag), "dragging moves the picture")
    page.evaluate("() => window.__viserMutable.resetCameraPose(true)")  # what viser's button calls
    _until_fitted(viewer, page)
    until(page, lambda: page.evaluate("() => window.__viserMutable.camera.fov") > 10.0, "the usual angle of view")
    until(page, lambda: page.evaluate(drag), "dragging turns again")
    assert {viewer.scene.cameras.preset(client) for client in viewer.server.get_clients().values()} == {"front"}


def test_a_plot_of_many_frames_is_drawn_point_by_point(viewer, page):
    """uPlot goes over to columns of pixels from four points a pixel on, and loses the cursor line there."""
    wide = page.evaluate("uuid => window.__viserTestpoints.uplots[uuid].chart.bbox.width / devicePixelRatio", _first_chart(viewer))
    many = np.random.default_rng(1).normal(size=(20_000, 1))
    assert len(Curves(np.arange(20_000.0), many).at(7)[0]) < 4.0 * wide


EXTENT = "() => { const c = window.__viserMutable.canvas; return [c.clientWidth, c.clientHeight]; }"


def _first_chart(viewer: Viewer) -> str:
    return uuid_of(viewer.plots.slots[0].chart)


def test_plans_stand_beside_the_mechanism_and_switches_hide_them_paths_and_point_masses(browser):
    document = scene.load("plans-four-bar").document.model_dump(exclude_defaults=True)
    document["links"]["coupler"]["point_masses"] = [{"mass": 0.4, "at": "P"}]
    with Viewer(run_scene(scene.Scene.build(name="plans", **document), frames=24), port=0) as shown:
        opened = open_viewer(browser, shown, SIZE, [link_path("crank")])
        try:
            opened.wait_for_function(SEEN, arg="/drawings/velocity")
            until(opened, lambda: list(shown.scene.polygons.screen) == opened.evaluate(EXTENT), "the size of the picture told")
            open_tab(opened, "View")
            opened.get_by_text("Velocity polygon", exact=True).first.wait_for()
            opened.get_by_label("Velocity polygon", exact=True).uncheck()
            until(opened, lambda: not opened.evaluate(SEEN, "/drawings/velocity"), "the plan hidden")
            assert opened.evaluate(SEEN, "/drawings/force")
            ball = f"{link_path('coupler')}/mass_0"
            for label, nodes in (("Paths", ("/paths/coupler.P", dot_path("coupler.P"))), ("Point masses", (ball,))):
                for on in (False, True):
                    opened.get_by_label(label, exact=True).set_checked(on)
                    until(opened, lambda n=nodes, on=on: all(opened.evaluate(SEEN, x) == on for x in n), f"{label}: {on}")
        finally:
            opened.close()


def test_the_first_picture_of_a_move_has_all_of_it(viewer, page):
    page.evaluate(WATCH, [link_path("coupler"), arc_path("drive", "A")])
    viewer.set_frame(323)
    _until_drawn(viewer, page)
    next_frames(page, 20)
    watched = page.evaluate("() => { window.unwatch(); return window.watched; }")
    first = next(seen for seen in watched if seen[0] == watched[-1][0])
    assert first == watched[-1], "the arc and the arrows stand where they belong, as the link does"
