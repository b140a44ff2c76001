"""Which tests run in one process: those that share something dear, a recording, its solids or a browser. No test has a deadline."""

from __future__ import annotations

import pytest
from hypothesis import settings

# a busy machine fails no test: examples have no deadline, all else is as hypothesis chooses it (in CI it is another choice)
settings.register_profile("without a clock", settings.default, deadline=None)
settings.load_profile("without a clock")

PER_SCENE = {"test_recording", "test_meshes", "test_gltf", "test_scene_gallery", "test_dynamics_scenes"}
PER_MODULE = {"test_viewer_browser", "test_inspector_browser", "test_share_browser"}


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        module = item.path.stem
        scene = getattr(item, "callspec", None) and (item.callspec.params.get("name") or item.callspec.params.get("made"))
        if module in PER_MODULE:
            item.add_marker(pytest.mark.xdist_group(module))
        elif module in PER_SCENE and isinstance(scene, str):
            item.add_marker(pytest.mark.xdist_group(scene))
