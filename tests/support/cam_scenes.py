"""What the tests of cams in scenes share: texts of the gallery, solved texts, texts that are refused."""

from __future__ import annotations

from collections.abc import Sequence

import pytest

import mechviz
from mechcore.errors import MechanismError
from mechcore.forces.kinetostatics import Forces, solve_forces
from mechcore.motion.motion import Motion
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion
from mechviz.scene.folder import GALLERY_FOLDER


def text_of(name: str) -> str:
    """A scene of the gallery as its file has it."""
    return (GALLERY_FOLDER / f"{name}.toml").read_text()


def solved(text: str, frames: int = 360) -> tuple[Motion, Forces]:
    """Motion and forces of a scene over one cycle."""
    mechanism = mechviz.loads(text, folder=GALLERY_FOLDER).mechanism
    motion = solve_motion(compile_mechanism(mechanism), default_times(mechanism, frames, 1))
    return motion, solve_forces(motion)


def changed(text: str, old: str, new: str) -> str:
    """The text with one place of it replaced, which must be there."""
    assert old in text
    return text.replace(old, new, 1)


def refused(text: str, words: Sequence[str]) -> None:
    """A scene is refused where it is read or put together, and all the words are said."""
    with pytest.raises(MechanismError) as error:
        compile_mechanism(mechviz.loads(text, folder=GALLERY_FOLDER).mechanism)
    said = " ".join(str(error.value).split())
    for word in words:
        assert word in said, said
