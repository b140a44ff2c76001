"""Hostile messages to a viewer: of every kind that viser knows, with fields of all sorts, about controls and nodes that are there
and others, from sockets that read and sockets that never do.

    python tests/torture/hostile_messages.py --count 1000000

The viewer's memory stays flat, and it draws the scene correctly afterwards.
"""

from __future__ import annotations

import contextlib
import dataclasses
import random
import re
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))

import msgspec
import numpy as np
from budget import Tally, options
from patience import PATIENCE
from viewer_sockets import CAMERA, opened, replay, send
from viser._messages import Message
from websockets.exceptions import ConnectionClosed
from websockets.protocol import State
from websockets.sync.client import ClientConnection

from mechviz.facade import run

SCENE = "crank-rocker"
MOST_GROWN = 50e6  # bytes
WARMING = 0.1  # of the messages go before memory is looked at
PER_SOCKET = 5000  # messages
FRAME = 7  # that is looked at in the end
COSTLY = ("Measure what accuracy costs", "Setting", "Wanted error")  # what they ask for costs what it costs, whoever asks
NUMBERS = (0, 1, -1, 3.7, 1e-300, 1e15, 1e16, 1e300, -1e308, 2**62, -(2**63), float("nan"), float("inf"), float("-inf"))
TEXTS = ("", "value", "../../etc/passwd", "<img src=x onerror=alert(1)>", "\0", "/", "𝔛" * 50, "x" * 2000)


@dataclasses.dataclass
class Known:
    """What a page has been told: messages that made controls and nodes, from which hostile ones are made."""

    controls: list[dict[str, Any]]
    names: list[str]

    @classmethod
    def of(cls, told: list[dict[str, Any]]) -> Known:
        controls = [m for m in told if "uuid" in m and "props" in m and m["props"].get("label") not in COSTLY]
        return cls(controls, [m["name"] for m in told if "name" in m])


def value(rng: random.Random, depth: int = 0) -> Any:
    """Anything that a message can hold."""
    kind = rng.randrange(9 if depth < 3 else 6)
    if kind < 2:
        return rng.choice(NUMBERS)
    if kind == 2:
        return rng.choice(TEXTS)
    if kind < 5:
        return rng.choice((None, True, False))
    if kind == 5:
        return bytes(rng.choice((0, 10, 30_000)))
    if kind == 6:
        return [value(rng, depth + 1) for _ in range(rng.randrange(5))]
    if kind == 7:
        return [rng.uniform(-5.0, 5.0) for _ in range(rng.choice((2, 3, 4)))]
    return {rng.choice((*TEXTS, "value", "max")): value(rng, depth + 1) for _ in range(rng.randrange(3))}


def update(rng: random.Random, known: Known, share: float) -> dict[str, Any]:
    """A value for a control that is there, in a ``share`` of cases one that fits."""
    control = rng.choice(known.controls)
    props, start = control["props"], control.get("value")
    fitting: Any = value(rng)
    if "options" in props:
        fitting = rng.choice(props["options"])
    elif "_min" in props or "min" in props:
        low, high = props.get("min", 0), props.get("max", 1)
        fitting = rng.uniform(low, high) if isinstance(start, float) else rng.randint(int(low), max(int(low), int(high)))
    elif isinstance(start, bool) or start is None:
        fitting = rng.random() < 0.5
    return {
        "type": "GuiUpdateMessage",
        "uuid": control["uuid"],
        "updates": {"value": fitting if rng.random() < share else value(rng)},
    }


def hostile(rng: random.Random, known: Known, kinds: list[type[Message]], share: float) -> bytes:
    """A message as somebody could send it who has seen what a page is told."""
    if rng.random() < 0.02:
        return rng.randbytes(rng.randrange(200))
    if rng.random() < 0.2:
        return msgspec.msgpack.encode(update(rng, known, share))
    kind = rng.choice(kinds)
    if kind.__name__ == "ViewerCameraMessage" and rng.random() < 0.5:
        message = CAMERA | {"position": [rng.uniform(-5.0, 5.0) for _ in range(3)]}
    else:
        message = {"type": kind.__name__}
        for item in dataclasses.fields(kind):
            if "uuid" in item.name:
                message[item.name] = rng.choice((rng.choice(known.controls)["uuid"], f"{rng.getrandbits(64)}"))
            elif item.name == "name":
                message[item.name] = rng.choice((rng.choice(known.names), f"/{rng.getrandbits(64)}"))
            elif item.name == "owner":
                message[item.name] = rng.choice(("", "0", "1"))
            elif "count" in item.name or "index" in item.name or "bytes" in item.name:
                message[item.name] = rng.choice((0, 1, 2, 10**6))
            elif item.name == "content":
                message[item.name] = bytes(rng.choice((0, 100, 50_000)))
            else:
                message[item.name] = value(rng)
        if rng.random() < 0.1:
            message.pop(rng.choice(list(message)))
    with contextlib.suppress(OverflowError):
        return msgspec.msgpack.encode(message)
    return b""


@contextlib.contextmanager
def viewer() -> Iterator[tuple[int, int]]:
    """A viewer in a process of its own, in a folder that goes with it: its port and its number. Its log is looked at in the end."""
    with tempfile.TemporaryDirectory() as folder, open(Path(folder, "errors"), "w+", encoding="utf-8") as errors:
        command = [sys.executable, "-m", "mechviz", "view", SCENE, "--port", "0"]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=errors, text=True, cwd=folder)
        try:
            assert process.stdout is not None
            match = re.search(r"http://127.0.0.1:(\d+)/", process.stdout.readline())
            assert match, "the viewer does not start"
            yield int(match[1]), process.pid
        finally:
            process.terminate()
            process.communicate(timeout=PATIENCE)
            errors.seek(0)
            logged = errors.read()
            print(logged[-3000:], file=sys.stderr)
    assert " failed\n" not in logged, "the viewer has met with an error that it did not foresee"


def memory(process: int) -> float:
    """Of a process [bytes]."""
    match = re.search(r"VmRSS:\s+(\d+) kB", Path(f"/proc/{process}/status").read_text(encoding="ascii"))
    assert match, "the viewer has ended"
    return 1024.0 * int(match[1])


def drained(socket: ClientConnection) -> None:
    """Read all that comes, in a thread, until the connection ends."""

    def read() -> None:
        with contextlib.suppress(ConnectionClosed):
            for _ in socket:
                pass

    threading.Thread(target=read, daemon=True).start()


def heard(port: int, socket: ClientConnection, frame: int) -> None:
    """Wait until the viewer has dealt with all that a socket has sent: it shows the frame that is asked for last, or has closed
    the socket."""
    end, shown = time.monotonic() + PATIENCE, -1
    with opened(port) as page:
        slider = next(m for m in replay(page) if "props" in m and m["props"].get("label") == "Frame")["uuid"]
    while shown != frame and socket.protocol.state is State.OPEN:
        assert time.monotonic() < end, "the viewer does not hear"
        with contextlib.suppress(ConnectionClosed):  # again: an edit asked for before may show another frame only now
            send(socket, {"type": "GuiUpdateMessage", "uuid": slider, "updates": {"value": frame}})
        with opened(port) as page:
            told = [m for m in replay(page) if m.get("uuid") == slider]
        shown = next(v for m in reversed(told) for v in (m.get("value"), m.get("updates", {}).get("value")) if v is not None)


def attack(port: int, process: int, tally: Tally, seed: int, share: float) -> tuple[list[float], Counter[str]]:
    """Send messages from one socket after the other, with a ``share`` of fitting values for controls; the viewer's memory now and
    then [bytes], and what became of the sockets."""
    rng = random.Random(seed)
    kinds = [kind for kind in Message.get_subclasses() if dataclasses.is_dataclass(kind)]
    sizes, ends = [memory(process)], Counter[str]()
    while tally.tried < tally.count and not tally.over():
        with opened(port) as socket:
            known = Known.of(replay(socket))
            send(socket, CAMERA)
            reads = rng.random() < 0.5
            if reads:
                drained(socket)
            end = "stayed open"
            for _ in range(min(PER_SOCKET, tally.count - tally.tried)):
                tally.tried += 1
                try:
                    send(socket, hostile(rng, known, kinds, share))
                except ConnectionClosed as closed:
                    end = f"was closed: {closed.rcvd.code if closed.rcvd else None}"
                    break
            else:
                if not reads:  # it would not see either that it has been closed
                    drained(socket)
                heard(port, socket, tally.tried % FRAME)
            ends[end] += 1
        sizes.append(memory(process))
        tally.tell(f", {sizes[-1] / 1e6:.0f} MB")
    return sizes, ends


def draws(port: int) -> None:
    """Undo all edits in a browser and go to a frame: the links have to be where the scene says."""
    motion = run(SCENE).motion
    with opened(port) as socket:
        known = Known.of(replay(socket))
        drained(socket)
        send(socket, CAMERA)
        by_label = {m["props"]["label"]: m["uuid"] for m in known.controls if "label" in m["props"]}

        def choose(label: str, chosen: str | int) -> None:
            send(socket, {"type": "GuiUpdateMessage", "uuid": by_label[label], "updates": {"value": chosen}})
            time.sleep(1.0)

        end = time.monotonic() + PATIENCE
        expected = {f"/mechanism/{link}": 0.5 * motion.pose(link)[FRAME, 2] for link in ("crank", "coupler", "rocker")}
        while True:
            choose("Changes", "Reset")  # again after each look: an edit of a socket that has closed may be heard after a reset
            for frame in (FRAME - 1, FRAME):  # and a reset that is solved later goes on at its own frame
                choose("Frame", frame)
            with opened(port) as page:
                told = {m["name"]: m["wxyz"] for m in replay(page) if m["type"] == "SetOrientationMessage"}
            wrong = {
                node: told.get(node)
                for node, a in expected.items()
                if not np.allclose(told.get(node, np.zeros(4)), [np.cos(a), 0.0, 0.0, np.sin(a)], atol=1e-9)
            }
            if not wrong:
                return
            assert time.monotonic() < end, f"the picture is wrong: {wrong}"


def grown(sizes: list[float]) -> float:
    """How much larger memory became after the first messages [bytes]."""
    first = max(int(WARMING * len(sizes)), 1)
    return max(sizes[first:]) - max(sizes[:first])


def main() -> int:
    parser = options(__doc__, 1_000_000)
    parser.add_argument("--share", type=float, default=0.02, help="of fitting values for controls, most of them edits (0.02)")
    given = parser.parse_args()
    tally = Tally(given.count, given.seconds)
    try:
        with viewer() as (port, process):
            sizes, ends = attack(port, process, tally, given.first, given.share)
            print(f"sockets: {dict(ends)}")
            print(
                "memory [MB]:", *(f"{size / 1e6:.0f}" for size in sizes[:: max(len(sizes) // 20, 1)]), f"-> {sizes[-1] / 1e6:.0f}"
            )
            print(f"grown by {grown(sizes) / 1e6:.1f} MB")
            if grown(sizes) > MOST_GROWN:
                tally.fault("memory has grown")
            draws(port)
    except AssertionError as error:
        tally.fault(str(error))
    return tally.end()


if __name__ == "__main__":
    sys.exit(main())
