"""Commands load when they are used: the list of commands says what their functions say, and the light ones stay light."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from mechviz.commands.main import COMMANDS, load_command

NAMES = [name for commands in COMMANDS.values() for name in commands]
HEAVY = ("numpy", "scipy", "shapely", "trimesh", "rerun", "viser", "pyarrow")


@pytest.mark.parametrize("name", NAMES)
def test_the_list_says_of_a_command_what_its_own_help_says(name):
    (line,) = [commands[name] for commands in COMMANDS.values() if name in commands]
    own = " ".join(str(load_command(name).help).split())
    assert own.startswith(line)


def test_a_check_loads_nothing_of_motions_under_forces_and_of_constructions():
    loaded = modules_of(["check", "crank-rocker"])
    assert "mechcore.motion.solve" in loaded
    assert not [
        m for m in loaded if m.startswith(("mechcore.dynamics.simul", "mechcore.constructions", "mechviz.meshes", "mechviz.runs"))
    ]


@pytest.mark.parametrize(
    ("arguments", "allowed"),
    [
        (["--help"], set()),
        (["scenes"], set()),
        (["check", "crank-rocker"], {"numpy"}),
        (["check", "triad"], {"numpy"}),
        (["plan", "crank-rocker"], {"numpy"}),
        (["export", "--help"], {"numpy", "shapely"}),
        (["share", "--help"], {"numpy", "shapely"}),
    ],
)
def test_a_command_loads_only_what_it_needs(arguments, allowed):
    assert set(HEAVY) & modules_of(arguments) <= allowed


def modules_of(arguments: list[str]) -> set[str]:
    """All modules that a command has loaded when it ends."""
    code = "import atexit, sys; atexit.register(lambda: print(*sys.modules)); from mechviz.commands.main import app; "
    path = os.pathsep.join(path for path in sys.path if path)
    done = subprocess.run(
        [sys.executable, "-c", f"{code}app({arguments!r})"], capture_output=True, text=True, env={**os.environ, "PYTHONPATH": path}
    )
    assert done.returncode == 0
    return set(done.stdout.splitlines()[-1].split())
