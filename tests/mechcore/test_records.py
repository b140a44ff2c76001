"""Dataclasses that are written when they are first needed are those of the standard library."""

from __future__ import annotations

import copy
import dataclasses
import subprocess
import sys
from threading import Barrier, Thread

import pytest

from mechcore.records import dataclass as lazy


def classes(decorate):
    @decorate(frozen=True, kw_only=True)
    class Base:
        name: str = "a"
        rows: tuple[float, ...] = dataclasses.field(default=(), repr=False)

    @decorate(frozen=True)
    class Point(Base):
        x: float
        y: float = 2.0
        made: list[int] = dataclasses.field(default_factory=list, compare=False)

        def __post_init__(self):
            self.made.append(len(self.rows))

    class Plain(Point):
        def __init__(self, x):
            super().__init__(x, name="plain")

    return Base, Point, Plain


def told(base, point, plain):
    """What can be told of the classes, without the addresses in it."""
    p = point(1.0, name="p")
    with pytest.raises(dataclasses.FrozenInstanceError):
        p.x = 3.0
    with pytest.raises(TypeError):
        point()
    return (
        repr(p).rpartition(".")[2], p == point(1.0, name="p"), p == point(1.5), hash(p) == hash(point(1.0, name="p")), p.made,
        dataclasses.replace(p, y=4.0).y, [f.name for f in dataclasses.fields(point)], repr(plain(5.0)).rpartition(".")[2],
        base().name, point.__match_args__, copy.copy(p) == p, dataclasses.is_dataclass(plain),
    )  # fmt: skip


def test_they_do_what_those_of_the_library_do():
    assert told(*classes(lazy)) == told(*classes(dataclasses.dataclass))


def test_their_fields_are_known_before_there_is_an_instance():
    _, point, plain = classes(lazy)
    assert [f.name for f in dataclasses.fields(plain)] == ["name", "rows", "x", "y", "made"]
    assert point(1.0) == point(x=1.0)


def test_threads_may_make_the_first_instances_at_once():
    for _ in range(20):
        *_, plain = classes(lazy)
        found, gate = [], Barrier(4)

        def make(kind=plain, found=found, gate=gate):
            gate.wait()
            found.append(kind(1.0))

        threads = [Thread(target=make) for _ in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert found == [plain(1.0)] * 4


def test_what_another_process_made_is_whole():
    """Unpickled instances are not made by ``__init__``."""
    code = (
        "import pickle; from mechcore.spec import Revolute; "
        "print(pickle.dumps(Revolute(name='A', links=('f', 'g'), points=('A', 'A'))).hex())"
    )
    written = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    read = (
        "import pickle; a, b = (pickle.loads(bytes.fromhex('" + written.strip() + "')) for _ in 'ab'); "
        "assert a == b and hash(a) == hash(b) and 'A' in repr(a), a"
    )
    subprocess.run([sys.executable, "-c", read], check=True)
