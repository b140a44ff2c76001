"""Recordings as rerun's own viewer shows them, drawn without a screen."""

from __future__ import annotations

import io
import os
import socket
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from patience import PATIENCE
from PIL import Image
from pixels import same

from recordings import Made, made

pytestmark = pytest.mark.picture
REQUIRED = bool(os.environ.get("MECHVIZ_REQUIRE_PICTURES"))


def free_port() -> int:
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return int(s.getsockname()[1])


@contextmanager
def viewer(folder: Path) -> Iterator[Any]:
    """A viewer without a window, reachable from this machine only. Skips where there is no Vulkan driver."""
    import rerun_cli
    from rerun.experimental import ViewerClient

    binary = Path(rerun_cli.__file__).parent / "rerun"  # the command in the environment is a shim that would orphan the viewer
    port = free_port()
    env = {**os.environ, "HOME": str(folder), "XDG_RUNTIME_DIR": str(folder)}
    subprocess.run([binary, "analytics", "disable"], env=env, capture_output=True, check=False)
    log = folder / "viewer.log"
    with open(log, "wb") as out:
        command = [binary, "--headless", "--hide-welcome-screen", "--bind", "127.0.0.1", "--port", str(port)]
        process = subprocess.Popen(command, env=env, stdout=out, stderr=out)
    try:
        yield connected(ViewerClient, process, port, log)
    finally:
        process.terminate()
        try:
            process.wait(timeout=PATIENCE)
        except subprocess.TimeoutExpired:
            process.kill()


def connected(client: Any, process: subprocess.Popen[bytes], port: int, log: Path) -> Any:
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        if process.poll() is not None:
            why = [line for line in log.read_text(errors="replace").splitlines() if "anick" in line or "rror" in line]
            words = f"rerun's viewer does not start; it needs a Vulkan driver such as mesa-vulkan-drivers: {' '.join(why)[:300]}"
            pytest.fail(words) if REQUIRED else pytest.skip(words)
        try:
            result = client.connect(f"rerun+http://127.0.0.1:{port}/proxy")
            result.get_state()
            return result
        except Exception:
            time.sleep(0.2)
    pytest.fail("rerun's viewer does not answer")


def shown(v: Any, m: Made, view: str) -> np.ndarray:
    """A view of a recording at a third of its run, as pixels (H, W, 3)."""
    v.open(str(m.path))
    end = time.monotonic() + PATIENCE
    while not (result := [w for w in v.get_state().views if w.name == view]):
        assert time.monotonic() < end, f"no view '{view}' among {[w.name for w in v.get_state().views]}"
        time.sleep(0.1)
    v.set_time("time", duration=float(m.time[len(m.time) // 3]), play_state="paused")
    before = None
    while True:  # the first pictures may come before the meshes are on the card
        png = v.take_screenshot(result[0].view_id, max_size=640)
        picture = np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).astype(int)
        if before is not None and same(before, picture) and fraction_of_background(picture) < 0.97:
            return picture
        assert time.monotonic() < end, "the picture does not come to rest, or stays empty"
        before = picture


def fraction(picture: np.ndarray, color: tuple[int, ...], near: float = 0.06) -> float:
    """Part of the pixels whose hue and saturation are those of a colour, in any light."""

    def tint(rgb: np.ndarray) -> np.ndarray:
        return rgb / np.maximum(rgb.sum(axis=-1, keepdims=True), 1)

    bright = picture.max(axis=-1) > 60
    return float(np.mean(bright & (np.abs(tint(picture) - tint(np.array(color))).max(axis=-1) < near)))


@pytest.mark.sample(1)
@pytest.mark.parametrize(
    ("name", "view", "families"),
    [
        ("kinetostatic-four-bar", "Mechanism with forces", ("reaction", "applied", "drive")),
        ("crank-rocker", "Mechanism with velocities and accelerations", ("velocity", "acceleration")),
        ("slider-crank-compressor", "Mechanism with forces", ()),
    ],
)
def test_a_recording_shows_the_mechanism(tmp_path, name, view, families):
    from mechviz.picture.build import solids_of
    from mechviz.quantities.vectors import VECTOR_FAMILIES

    m = made(name)
    with viewer(tmp_path) as v:
        picture = shown(v, m, view)
        state = v.get_state()
    assert not any(w.reports for w in state.views), [(w.name, w.reports) for w in state.views if w.reports]
    back = fraction_of_background(picture)
    assert 0.3 < back < 0.97, f"{100 * back:.0f} % of the picture is background"
    for link, solid in solids_of(m.run).links.items():
        if link in ("crank", "coupler", "rocker", "rod"):
            assert fraction(picture, solid.color[:3]) > 0.001, f"{link} is not to be seen"
    for family in families:
        assert fraction(picture, VECTOR_FAMILIES[family].on_dark) > 0.0003, f"no arrows of the family {family}"
    edges = np.concatenate([picture[:4].reshape(-1, 3), picture[-4:].reshape(-1, 3)])
    assert np.ptp(edges, axis=0).max() < 40, "the mechanism reaches beyond the picture"


def fraction_of_background(picture: np.ndarray) -> float:
    from mechviz.outputs.rerun.blueprint import BACKGROUND_COLOR

    return float(np.mean(np.abs(picture - np.array(BACKGROUND_COLOR[:3])).max(axis=-1) < 12))
