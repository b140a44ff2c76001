"""The cache of compiled programs: the user's alone, sound, and made once."""

from __future__ import annotations

import hashlib
import os
import stat
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from mechcore.cache import cache_folder
from mechcore.compiled import toolchain
from mechcore.compiled.toolchain import cached, compiler, library
from mechcore.dynamics.equations.charts import Chart
from mechcore.dynamics.simulate import simulate
from mechcore.errors import MechanismError
from mechcore.motion.solve import compile_mechanism, solve_motion
from mechviz.scene.scene import load

pytestmark = pytest.mark.skipif(compiler() is None, reason="no C compiler")
SOURCE = "double seven(void) { return 7.0; }\n"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    library.cache_clear()
    yield tmp_path / "mechviz"
    library.cache_clear()


def seven() -> float:
    import ctypes

    library.cache_clear()  # as another process
    function = library(SOURCE).seven
    function.restype = ctypes.c_double
    return float(function())


def test_a_library_is_made_once(folder: Path) -> None:
    assert not cached(SOURCE)
    assert seven() == 7.0
    (made,) = folder.iterdir()
    before = made.stat()
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert cached(SOURCE) and seven() == 7.0
    assert (made.stat().st_ino, made.stat().st_mtime_ns) == (before.st_ino, before.st_mtime_ns)


@pytest.mark.parametrize("damage", [lambda d: d[:-100], lambda d: b"", lambda d: d[:600] + b"\0" * 40 + d[640:]])
def test_a_damaged_library_is_made_anew(folder: Path, damage) -> None:
    seven()
    (made,) = folder.iterdir()
    sound = made.read_bytes()
    made.unlink()
    made.write_bytes(damage(sound))  # a new file: the old one is in use
    assert not cached(SOURCE)
    assert seven() == 7.0
    assert cached(SOURCE) and [p.name for p in folder.iterdir()] == [made.name]


def test_writers_at_once_leave_one_sound_library(folder: Path) -> None:
    def made(_: int) -> str:
        return library.__wrapped__(SOURCE)._name  # as processes that do not know of each other

    with ThreadPoolExecutor(6) as pool:
        names = set(pool.map(made, range(12)))
    assert {str(p) for p in folder.iterdir()} == names  # nothing half written beside it
    assert cached(SOURCE) and seven() == 7.0


def test_a_folder_that_others_can_use_is_not_used(folder: Path) -> None:
    folder.mkdir()
    folder.chmod(0o777)
    identity = toolchain._identity(toolchain.required_compiler(), SOURCE)
    planted = folder / f"{identity}-{hashlib.sha256(b'not ours').hexdigest()[:32]}.so"  # even with the right checksum
    planted.write_bytes(b"not ours")
    assert not cached(SOURCE)
    assert seven() == 7.0
    assert planted.read_bytes() == b"not ours" and len(list(folder.iterdir())) == 1


def test_a_link_in_place_of_the_folder_is_not_followed(folder: Path, tmp_path: Path) -> None:
    other = tmp_path / "other"
    other.mkdir(mode=0o700)
    folder.symlink_to(other)
    assert seven() == 7.0
    assert not list(other.iterdir())


def test_another_compiler_makes_another_library(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seven()
    own = tmp_path / "bin" / "cc"
    own.parent.mkdir()
    own.write_text(f'#!/bin/sh\nexec {compiler()[0]} "$@"\n')
    own.chmod(0o755)
    monkeypatch.setattr(toolchain, "compiler", lambda: (str(own),))
    assert not cached(SOURCE)
    assert seven() == 7.0 and len(list(folder.iterdir())) == 2


def test_a_compiler_that_fails_is_told(folder: Path) -> None:
    with pytest.raises(MechanismError, match=r"the C compiler fails: .*error.*Choose the executor numpy"):
        library("this is not C\n")
    assert not list(folder.iterdir())


def test_without_a_compiler_c_is_refused_and_auto_is_numpy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", os.devnull)
    monkeypatch.setattr(toolchain, "find_spec", lambda _: None)
    compiler.cache_clear()
    try:
        mechanism = load("crank-rocker").mechanism
        with pytest.raises(MechanismError, match=r"executor: there is no C compiler.*mechviz\[fast\]"):
            compile_mechanism(mechanism, executor="c")
        assert compile_mechanism(mechanism, executor="auto").executor == "auto"
        monkeypatch.setattr(toolchain, "find_spec", lambda _: True)
        compiler.cache_clear()
        assert compiler()[1:] == ("-m", "ziglang", "cc")
    finally:
        monkeypatch.undo()
        compiler.cache_clear()


def test_the_cache_is_where_the_system_says(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")  # not allowed by the specification: ignored
    assert cache_folder() == Path.home() / ".cache" / "mechviz"
    assert cache_folder().is_absolute()


def test_a_compiler_that_fails_is_told_where_c_is_asked_for(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    own = tmp_path / "cc"
    own.write_text("#!/bin/sh\necho 'error: it is broken' >&2; exit 1\n")
    own.chmod(0o755)
    monkeypatch.setattr(toolchain, "compiler", lambda: (str(own),))
    moved = compile_mechanism(load("crank-rocker").mechanism, executor="c")
    with pytest.raises(MechanismError, match="the C compiler fails: error: it is broken"):
        solve_motion(moved, [0.0, 0.1])
    free = load("swinging-double-pendulum").mechanism
    with pytest.raises(MechanismError, match="the C compiler fails"):
        simulate(compile_mechanism(free, executor="c"), 0.1)
    assert Chart(compile_mechanism(free, executor="auto")).program(long=True) is None  # numpy goes on
