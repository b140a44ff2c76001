"""The viewer in numbers: from a slider to the picture, the price of playing, many browsers, memory over hours.

    python benchmarks/viewer.py [edit] [play] [many] [sent] [page] [--frames N]

Without names all are run, with Chromium and playwright (Debian: apt-get install chromium). Without a graphics card Chromium
draws by software, and that takes most of the time. Each figure of a page is therefore taken with the drawing commands of WebGL
left out, as if a graphics card drew for nothing; everything else of the page, the scripts of viser, three.js and mechviz, the
panels and the plots, is the same; beside it stands the figure as it is. "arrived" is when the new poses, solids and arrows are in
the page, "drawn" when the second frame after that begins, they have been drawn, and a pixel of the picture has been read back. The
bar from slider to picture holds with drawing left out.
``sent`` and ``page`` show N frames (432,000 by default: two hours at 60 a second) as fast as they can be shown: sent by the server,
and played by a page.
"""

from __future__ import annotations

from timing import machine  # first: it sets one thread

import argparse  # isort: skip
import asyncio
import contextlib
import json
import os
import shutil
import statistics
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import viser
import websockets

import mechviz
from mechviz.outputs.viewer import playback
from mechviz.outputs.viewer.app import Viewer
from mechviz.runs import run_scene
from mechviz.scene.scene import Scene

ARGS = ["--no-sandbox", "--disable-quic", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
ARGS += ["--disable-gpu-compositing", "--enable-precise-memory-info", "--js-flags=--expose-gc"]
FREE = """for (const name of ['drawArrays', 'drawElements', 'drawArraysInstanced', 'drawElementsInstanced', 'drawRangeElements',
    'clear'])
    WebGL2RenderingContext.prototype[name] = () => {};"""  # drawing costs nothing
SIZE = {"width": 900, "height": 560}
MOVES = 80
DENSE = 90.0  # frames of the run a second while playing: more than are shown, so that each picture is another
TINY = {"width": 320, "height": 240}
LARGEST = playback.LARGEST_MOTION
KIND = {False: "drawn by software", True: "drawing left out"}
PLAYED = "() => window.mechvizPlayback ? window.mechvizPlayback.frames : 0"
LISTEN = (
    f"import asyncio, json, sys; sys.path.insert(0, {str(Path(__file__).parent)!r}); import viewer;"
    "print(json.dumps(asyncio.run(viewer.listen('ws://127.0.0.1:{port}', {count}, {seconds}))))"
)

# In the page: set a slider as a hand would, wait until the coupler stands elsewhere, then until that has been drawn.
MOVE = """([uuid, value, node]) => new Promise(done => {
    const m = window.__viserMutable, pose = () => m.nodePoseData[node].position.join() + m.nodePoseData[node].wxyz.join();
    const drawn = () => m.nodePoseData[node].poseUpdateState === 'updated', own = m.scene.__r3f;
    const gl = (own.root || own).getState().gl.getContext(), pixel = new Uint8Array(4);
    const before = pose(), start = performance.now();
    m.sendMessage({type: 'GuiUpdateMessage', uuid, updates: {value}});
    const look = () => {
        const now = performance.now();
        if (now - start > 5000) return done(null);
        if (pose() === before) { setTimeout(look, 0); return; }
        const finish = () => {
            if (!drawn()) { requestAnimationFrame(finish); return; }
            gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);  // waits for all that has been drawn
            done([now - start, performance.now() - start]);
        };
        requestAnimationFrame(() => requestAnimationFrame(finish));
    };
    look(); })"""


# In the page: show frames, the panels with each fifth as while it plays, and let the page draw now and then.
SHOWN = """async ([count, frames]) => { const player = window.mechvizPlayback; let drew = performance.now();
    for (let k = 0; k < count; k++) {
        player.show(k % frames, k % 5 === 0);
        await null;
        if (performance.now() - drew > 100) { await new Promise(requestAnimationFrame); drew = performance.now(); }
    } }"""


def chain(stages: int) -> Scene:
    """Four-bars one behind the other, each rocker the crank of the next: two moving links a stage, and the first crank."""
    frame = {f"O{k}": [300.0 * k, 0.0] for k in range(stages + 1)}
    links: dict[str, Any] = {"frame": {"points": frame}, "crank0": {"points": {"O0": [0, 0], "B0": [60, 0]}}}
    swing = {"oscillation": {"centre": 90, "amplitude": 20, "period": "2 s"}}
    joints: dict[str, Any] = {"O0": {"revolute": ["frame", "crank0"], "drive": swing}}
    for k in range(stages):
        links[f"coupler{k}"] = {"points": {f"B{k}": [0, 0], f"C{k}": [300, 0]}}
        links[f"crank{k + 1}"] = {"points": {f"O{k + 1}": [0, 0], f"C{k}": [60, 0], f"B{k + 1}": [0, 60]}}
        joints[f"B{k}"] = {"revolute": [f"crank{k}", f"coupler{k}"]}
        joints[f"C{k}"] = {"revolute": [f"coupler{k}", f"crank{k + 1}"], "side": "left"}
        joints[f"O{k + 1}"] = {"revolute": [f"crank{k + 1}", "frame"]}
    return Scene.build(
        name="chain", title=f"{2 * stages + 1} bodies", units={"length": "mm", "angle": "deg"}, links=links, joints=joints
    )


def browser(playwright: Any) -> Any:
    path = shutil.which("chromium") or "/usr/bin/chromium"
    return playwright.chromium.launch(executable_path=path, headless=True, args=ARGS)


def opened(chromium: Any, viewer: Viewer, nodes: list[str], free: bool, size: dict[str, int] = SIZE, query: str = "") -> Any:
    """A page of its own (a context, as another person's browser), with the mechanism in it; ``free``: nothing is drawn."""
    page = chromium.new_page(viewport=size)
    page.set_default_timeout(300_000)
    if free:
        page.add_init_script(FREE)
    page.goto(viewer.url + query)
    page.wait_for_function(
        "names => { const m = window.__viserMutable; return !!m && !!m.messageQueue && names.every(n => m.nodeRefFromName[n]); }",
        arg=nodes,
    )
    return page


class Spent:
    """Processor time [ms] of the main thread of a page."""

    def __init__(self, page: Any):
        self._session = page.context.new_cdp_session(page)
        self._session.send("Performance.enable", {"timeDomain": "threadTicks"})

    def __call__(self) -> dict[str, float]:
        return {m["name"]: 1e3 * m["value"] for m in self._session.send("Performance.getMetrics")["metrics"]}

    def since(self, before: dict[str, float], count: float) -> str:
        """In words: a move or frame, of ``count``."""
        now = self()
        total, script = ((now[k] - before[k]) / max(count, 1) for k in ("TaskDuration", "ScriptDuration"))
        return f"{total:.1f} ms of processor time in the page's main thread ({script:.1f} ms of it scripts)"


def edit() -> None:
    """A slider is moved again and again; each move waits for the picture of the one before."""
    from playwright.sync_api import sync_playwright

    with Viewer(
        run_scene(mechviz.load("kinetostatic-four-bar")), port=0
    ) as viewer:  # the server alone, as when a slider is dragged
        viewer.session.wait(until_idle=True)
        crank = next(p for p in viewer.session.parameters if p.label == "crank A–B")
        spent, walls = [], []
        for value in 0.1 + 0.02 * np.sin(np.arange(MOVES + 10)):
            start, clock = time.process_time(), time.perf_counter()
            viewer.session.set_value(crank, round(float(value), 5))
            viewer.session.wait()
            spent.append(1e3 * (time.process_time() - start))
            walls.append(1e3 * (time.perf_counter() - clock))
        print(
            f"edit: the server, without a browser: {statistics.median(spent[10:]):.1f} ms of processor time a move (least "
            f"{min(spent):.1f}), {statistics.median(walls[10:]):.1f} ms on the clock"
        )

    with sync_playwright() as playwright:
        chromium = browser(playwright)
        for free in (False, True):
            _drag(chromium, free)
        chromium.close()


def _drag(chromium: Any, free: bool) -> None:
    """Move a slider in a page again and again."""
    with Viewer(run_scene(mechviz.load("kinetostatic-four-bar")), port=0) as viewer:
        page = opened(chromium, viewer, ["/mechanism/coupler"], free)
        page.wait_for_timeout(3000)
        viewer.session.wait(until_idle=True)
        slider, spent = viewer.inspector.controls.sliders["links.crank.points.B[0]"]._impl.uuid, Spent(page)
        result, solved, server = [], [], 0.0
        for k, value in enumerate(0.1 + 0.02 * np.sin(np.arange(MOVES + 10))):
            if k == 10:
                before, server = spent(), time.process_time()
            result.append(page.evaluate(MOVE, [slider, round(float(value), 5), "/mechanism/coupler"]))
            solved.append(viewer.session.status.seconds * 1e3)
        server = 1e3 * (time.process_time() - server) / MOVES
        print(f"edit: {KIND[free]}: a move costs {server:.1f} ms of the server, {spent.since(before, MOVES)}")
        page.close()
    result, solved = [f for f in result[10:] if f is not None], solved[10:]
    for what, times in (("solved and sent", solved), ("arrived", [f[0] for f in result]), ("drawn", [f[1] for f in result])):
        median, most = statistics.median(times), np.percentile(times, 95)
        print(f"edit: {KIND[free]}: {what:16s} median {median:6.1f} ms, 95 % below {most:6.1f} ms ({len(times)})")


def dense(viewer: Viewer) -> None:
    """Play so fast that each picture shows another frame."""
    moments = viewer.inspector.view_model.time
    viewer.player.set_rate(DENSE * float(moments[-1] - moments[0]) / (len(moments) - 1))


def cpu(seconds: float) -> float:
    """Part of one core that this process uses over some seconds."""
    start, before = time.perf_counter(), time.process_time()
    time.sleep(seconds)
    return (time.process_time() - before) / (time.perf_counter() - start)


async def listen(url: str, count: int, seconds: float) -> list[float]:
    """Messages a second at each of ``count`` web sockets over some seconds."""

    async def one() -> float:
        async with websockets.connect(url, subprotocols=[f"viser-v{viser.__version__}"], max_size=None) as socket:
            end = time.perf_counter() + 2.0
            while time.perf_counter() < end:  # what was there before
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(socket.recv(), 0.2)
            n, start = 0, time.perf_counter()
            while time.perf_counter() < start + seconds:
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(socket.recv(), 0.5)
                    n += 1
            return n / (time.perf_counter() - start)

    return list(await asyncio.gather(*(one() for _ in range(count))))


def listeners(viewer: Viewer, count: int, seconds: float) -> list[float]:
    """``count`` browsers of which only the sockets are there, in a process of their own: their processor time does not count."""
    code = LISTEN.format(port=viewer.port, count=count, seconds=seconds)
    process = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env={**os.environ}, check=True)
    return list(json.loads(process.stdout.splitlines()[-1]))


def play() -> None:
    """Processor time of the server while 51 bodies play at 60 frames a second, sent frame by frame and played by the browser."""
    run = run_scene(chain(25), frames=360)
    with Viewer(run, port=0) as viewer:
        viewer.session.wait(until_idle=True)
        dense(viewer)
        idle = cpu(2.0)
        for box in viewer.switches.families:
            viewer.scene.arrows.switch(box, False)
        viewer.scene.joints.switch(False)
        largest, playback.LARGEST_MOTION = playback.LARGEST_MOTION, 0
        viewer.inspector.playback.change()
        rates: list[float] = []
        other = threading.Thread(target=lambda: rates.extend(listeners(viewer, 1, 8.0)))
        viewer.play()
        other.start()
        time.sleep(5.0)
        pushed = cpu(4.0)
        other.join()
        viewer.pause()
        bodies = len(run.motion.mechanism.links) - 1
        print(f"play: {bodies} bodies, every frame sent: {100 * pushed:.0f} % of a core, {rates[0]:.0f} messages a second")
        playback.LARGEST_MOTION = largest
        viewer.inspector.playback.change()
        viewer.play()
        time.sleep(2.0)
        own = cpu(4.0)
        print(f"play: the same played by the browsers: {100 * own:.0f} % of a core, nothing sent (idle {100 * idle:.0f} %)")
        viewer.pause()
        from playwright.sync_api import sync_playwright

        with sync_playwright() as playwright:
            chromium = browser(playwright)
            for free in (False, True):
                page = opened(chromium, viewer, ["/mechanism/coupler24"], free)
                viewer.play()
                page.wait_for_function("() => !!window.mechvizPlayback && window.mechvizPlayback.frames > 60")
                spent = Spent(page)
                before, frames, start = spent(), page.evaluate(PLAYED), time.perf_counter()
                page.wait_for_timeout(6000)
                count = page.evaluate(PLAYED) - frames
                rate = count / (time.perf_counter() - start)
                print(f"play: in a page, {KIND[free]}: {rate:.0f} frames a second; a frame costs {spent.since(before, count)}")
                viewer.pause()
                page.close()
            chromium.close()


def many() -> None:
    """Twenty browsers at once, each frame sent to all of them."""
    run = run_scene(mechviz.load("kinetostatic-four-bar"))
    with Viewer(run, port=0) as viewer:
        viewer.session.wait(until_idle=True)
        dense(viewer)
        playback.LARGEST_MOTION = 0
        viewer.inspector.playback.change()
        viewer.play()
        rates = listeners(viewer, 20, 8.0)
        viewer.pause()
        print(f"many: 20 sockets, frames pushed: {min(rates):.0f} to {max(rates):.0f} messages a second at each")
        playback.LARGEST_MOTION = LARGEST
        viewer.inspector.playback.change()
        for free in (False, True):
            _pages(viewer, 20, free)


def _pages(viewer: Viewer, count: int, free: bool) -> None:
    """Real pages, each with its own context, small windows, all in the processes of one Chromium, that play by themselves."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        chromium = browser(playwright)
        pages = [opened(chromium, viewer, ["/mechanism/coupler"], free, TINY, "?fixedDpr=0.5") for _ in range(count)]
        viewer.play()
        for page in pages:
            page.wait_for_function("() => !!window.mechvizPlayback && window.mechvizPlayback.frames > 5")
        start = [(page.evaluate(PLAYED), page.evaluate("performance.now()")) for page in pages]
        server = cpu(10.0)
        rates = []
        for page, (frames, began) in zip(pages, start, strict=True):
            rates.append(1e3 * (page.evaluate(PLAYED) - frames) / (page.evaluate("performance.now()") - began))
        viewer.pause()
        chromium.close()
    print(
        f"many: {count} pages in one Chromium on {os.cpu_count()} cores, {KIND[free]}: {min(rates):.1f} to {max(rates):.1f} frames "
        f"a second at each, {sum(rates):.0f} together; the server {100 * server:.0f} % of a core",
        flush=True,
    )


def memory(pid: int | str = "self") -> float:
    """Resident memory of a process [MB]."""
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def _told(what: str, frames: int, spent: float, seen: list[float], where: str) -> None:
    middle = seen[len(seen) // 2]
    print(
        f"hours: {what}: {frames} frames in {spent:.0f} s ({1e3 * spent / frames:.2f} ms each); {where} {seen[0]:.0f} MB at the "
        f"start, {middle:.0f} MB in the middle, {seen[-1]:.0f} MB at the end, at most {max(seen):.0f} MB",
        flush=True,
    )


def sent(frames: int) -> None:
    """Hours of play sent by the server, frame after frame with nothing between them, each fifth with plots and numbers."""
    run = run_scene(mechviz.load("kinetostatic-four-bar"))
    with Viewer(run, port=0) as viewer:
        viewer.session.wait(until_idle=True)
        other = subprocess.Popen(
            [sys.executable, "-c", LISTEN.format(port=viewer.port, count=1, seconds=1e6)], stdout=subprocess.DEVNULL
        )
        time.sleep(3.0)
        seen, start = [], time.perf_counter()
        for k in range(frames):
            viewer.inspector.draw(k % run.motion.frames, k % 5 != 0)
            if k % max(frames // 10, 1) == frames // 20:
                seen.append(memory())
        spent = time.perf_counter() - start
        other.terminate()
        other.wait()
    _told("sent by the server to a socket", frames, spent, seen, "memory of the server")


def page(frames: int) -> None:
    """Hours of play in a page that plays by itself, frame after frame, drawn now and then."""
    from playwright.sync_api import sync_playwright

    run = run_scene(mechviz.load("kinetostatic-four-bar"))
    with Viewer(run, port=0) as viewer, sync_playwright() as playwright:
        viewer.session.wait(until_idle=True)
        chromium = browser(playwright)
        page = opened(chromium, viewer, ["/mechanism/coupler"], True)
        viewer.play()
        page.wait_for_function("() => !!window.mechvizPlayback && window.mechvizPlayback.frames > 5")
        page.evaluate("() => { window.mechvizPlayback.running = false; }")
        seen, heap, start = [], [], time.perf_counter()
        for _ in range(20):
            page.evaluate(SHOWN, [frames // 20, run.motion.frames])
            heap.append(page.evaluate("() => { gc(); return performance.memory.usedJSHeapSize / 1e6; }"))
            seen.append(memory())
        spent = time.perf_counter() - start
        viewer.pause()
        chromium.close()
    _told("played by a page", 20 * (frames // 20), spent, heap, "live memory of its scripts")
    print(f"hours: {[round(h, 1) for h in heap]} MB one after the other; the server meanwhile {seen[0]:.0f} to {seen[-1]:.0f} MB")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", nargs="*", choices=["edit", "play", "many", "sent", "page", []])
    parser.add_argument("--frames", type=int, default=432_000)
    chosen = parser.parse_args()
    print(machine())
    long = {"sent": sent, "page": page}
    for name in chosen.what or ["edit", "play", "many", *long]:
        if name in long:
            long[name](chosen.frames)
        else:
            {"edit": edit, "play": play, "many": many}[name]()
