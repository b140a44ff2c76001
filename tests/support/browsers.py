"""Headless Chromium for tests: found, or the test is skipped, unless the environment says that it has to be there."""

from __future__ import annotations

import os

import pytest

from mechviz.outputs.images.browser import ChromiumError, find_chromium

ARGS = [
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
]


def chromium_or_skip() -> str:
    """The path of Chromium."""
    try:
        return find_chromium()
    except ChromiumError as error:
        missing(str(error))
        raise


def missing(words: str) -> None:
    """No test without what is missing."""
    if os.environ.get("MECHVIZ_REQUIRE_BROWSER") == "1":
        pytest.fail(f"{words}, and MECHVIZ_REQUIRE_BROWSER=1 asks for it")
    pytest.skip(words)
