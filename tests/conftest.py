"""Which tests run, and which of them in one process: those of a module, which share what it makes, and those of a scene's run.

No test has a deadline. Tests that show one thing with many cases are marked with how many of these are enough to find what broke,
and thorough ones, which try at length, at random or through a browser what shorter ones show as well, are marked as such; with
MECHVIZ_EVERY_CASE=1 in the environment, as in CI, all of them run.
"""

from __future__ import annotations

import gc
import os
import random
import signal
import sys
from collections import defaultdict
from collections.abc import Callable, Iterator

import pytest
from cases import EVERY_CASE, examples
from hypothesis import HealthCheck, settings
from hypothesis.internal.conjecture import providers

# a worker for each core: threads of BLAS would only wait for each other (before numpy is loaded; processes of tests inherit it)
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # processes of tests, and each run: they would compile packages and tests anew
sys.dont_write_bytecode = False

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # started in the background: processes of tests would not be interrupted
    signal.signal(signal.SIGINT, signal.default_int_handler)

gc.set_threshold(100_000, 20, 50)  # thousands of tests are kept, which the usual thresholds would look through again and again

# a busy machine fails no test, and a run here tries the examples of CI: what is random is searched by --hypothesis-profile=search
settings.register_profile("search", deadline=None, suppress_health_check=[HealthCheck.too_slow], derandomize=False, print_blob=True)
settings.register_profile("suite", settings.get_profile("search"), max_examples=examples(60), derandomize=True, database=None)
settings.load_profile("suite")


@pytest.hookimpl(trylast=True)
def pytest_configure(config: pytest.Config) -> None:
    if settings.get_current_profile_name() == "suite":  # no examples from the constants of what happens to be loaded
        providers._get_local_constants = providers.Constants


# modules whose tests of a gallery scene share its run, its solids and its recording
PER_SCENE = {
    "test_recording",
    "test_one_picture",
    "test_meshes",
    "test_gltf",
    "test_scene_gallery",
    "test_cli",
    "test_scene",
    "test_inspector",
    "test_graph",
    "test_graphical",
    "test_friction_scenes",
}
# what takes longest and cannot be divided begins first, so that all workers end together; browsers wait in between, and therefore
# take turns with what does not
FIRST = (
    "test_inspector_browser",
    "test_metamorphic",
    "test_forced",
    "test_viewer_browser",
    "test_compiled_phases",
    "test_share_browser",
    "test_positions",
    "test_view_browser",
    "test_dynamics_friction",
    "test_synthesis_tab",
    "test_machine_faults",
    "test_designs",
    "test_guard",
)


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("random mechanisms")
    group.addoption(
        "--random-cases", type=int, default=examples(30), help=f"how many random mechanisms, of all kinds together ({examples(30)})"
    )
    group.addoption("--random-from", type=int, default=0, help="number of the first of each kind (0)")


@pytest.fixture(scope="session", autouse=True)
def compiled_without_optimising() -> Iterator[None]:
    """A quarter of the time to compile what runs for moments; `test_compiled_motion` shows that no bit depends on it."""
    from mechcore.compiled import toolchain  # not before the number of threads is set

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(toolchain, "COMPILER_OPTIONS", ("-O0", *toolchain.COMPILER_OPTIONS[1:]))
        yield


@pytest.fixture
def random_seeds(request: pytest.FixtureRequest) -> Callable[[int, int], range]:
    """A function of how many kinds there are, and of which one it is: the numbers of its random mechanisms."""
    cases, first = (int(request.config.getoption(o)) for o in ("--random-cases", "--random-from"))
    return lambda kinds, kind: range(first, first + (cases - kind + kinds - 1) // kinds)


def pytest_collection_finish() -> None:
    gc.freeze()  # what has been collected stays until the end


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if not EVERY_CASE and not any("::" in argument for argument in config.args):
        _sample(config, items)
    for item in items:
        module = item.path.stem
        scene = getattr(item, "callspec", None) and (item.callspec.params.get("name") or item.callspec.params.get("made"))
        together = scene if module in PER_SCENE and isinstance(scene, str) else module
        item.add_marker(pytest.mark.xdist_group(together))
    items.sort(key=lambda item: FIRST.index(item.path.stem) if item.path.stem in FIRST else len(FIRST))


def _sample(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave thorough tests out, and of others as many cases as their mark says: the same ones in every run, and of all tests over
    one list."""
    cases: dict[str, list[pytest.Item]] = defaultdict(list)
    for item in items:
        if item.get_closest_marker("sample"):
            cases[item.nodeid.partition("[")[0]].append(item)
    left_out = {item for item in items if item.get_closest_marker("thorough")}
    for own in cases.values():
        mark = own[0].get_closest_marker("sample")
        assert mark is not None
        (count,) = mark.args
        left_out.update(random.Random(0).sample(own, max(len(own) - count, 0)))
    config.hook.pytest_deselected(items=[item for item in items if item in left_out])
    items[:] = [item for item in items if item not in left_out]
