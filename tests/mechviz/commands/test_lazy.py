"""Commands load when they are used: the list of commands says what their functions say, and the light ones stay light."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from mechviz.commands.main import COMMANDS, load_command

HEAVY = ("numpy", "scipy", "shapely", "trimesh", "rerun", "viser", "pyarrow")


def test_the_list_says_of_a_command_what_its_own_help_says():
    for commands in COMMANDS.values():
        for name, line in commands.items():
            assert " ".join(str(load_command(name).help).split()).startswith(line), name


@pytest.mark.parametrize(
    ("arguments", "allowed"),
    [
        (["--help"], set()),
        (["scenes"], set()),
        (["check", "triad"], {"numpy"}),
        (["plan", "crank-rocker"], {"numpy"}),
        (["share", "--help"], {"numpy", "shapely"}),
    ],
)
def test_a_command_loads_only_what_it_needs(arguments, allowed):
    loaded = modules_of(arguments)
    assert set(HEAVY) & loaded <= allowed
    if arguments[0] == "check":  # nothing of motions under forces and of constructions
        others = ("mechcore.dynamics.simul", "mechcore.constructions", "mechviz.meshes", "mechviz.runs")
        assert "mechcore.motion.solve" in loaded and not [m for m in loaded if m.startswith(others)]


def modules_of(arguments: list[str]) -> set[str]:
    """All modules that a command has loaded when it ends."""
    code = "import atexit, sys; atexit.register(lambda: print(*sys.modules)); from mechviz.commands.main import app; "
    path = os.pathsep.join(path for path in sys.path if path)
    done = subprocess.run(
        [sys.executable, "-c", f"{code}app({arguments!r})"], capture_output=True, text=True, env={**os.environ, "PYTHONPATH": path}
    )
    assert done.returncode == 0
    return set(done.stdout.splitlines()[-1].split())
