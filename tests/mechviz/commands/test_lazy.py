"""Commands load when they are used: the list of commands says what their functions say, and the light ones stay light."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from mechviz.commands.main import COMMANDS, load_command

NAMES = [name for commands in COMMANDS.values() for name in commands]
HEAVY = ("numpy", "shapely", "trimesh", "rerun", "viser", "pyarrow")


@pytest.mark.parametrize("name", NAMES)
def test_the_list_says_of_a_command_what_its_own_help_says(name):
    (line,) = [commands[name] for commands in COMMANDS.values() if name in commands]
    own = " ".join(str(load_command(name).help).split())
    assert own.startswith(line)


@pytest.mark.parametrize(
    ("arguments", "allowed"),
    [
        (["--help"], set()),
        (["scenes"], set()),
        (["plan", "crank-rocker"], {"numpy", "shapely"}),
        (["export", "--help"], {"numpy", "shapely"}),
        (["share", "--help"], {"numpy", "shapely"}),
    ],
)
def test_a_command_loads_only_what_it_needs(arguments, allowed):
    code = "import atexit, sys; atexit.register(lambda: print(*sys.modules)); from mechviz.commands.main import app; "
    path = os.pathsep.join(path for path in sys.path if path)
    done = subprocess.run(
        [sys.executable, "-c", f"{code}app({arguments!r})"], capture_output=True, text=True, env={**os.environ, "PYTHONPATH": path}
    )
    assert done.returncode == 0
    assert {name for name in HEAVY if name in done.stdout.splitlines()[-1].split()} <= allowed
