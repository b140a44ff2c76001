"""A recording as the viewer shows it: read by its contract, nothing is computed anew."""

from __future__ import annotations

from functools import cache

import numpy as np

from mechviz.outputs.page.markdown import html_of
from mechviz.outputs.presentation import presentation_in
from mechviz.outputs.rerun.reader import Recording
from mechviz.outputs.rerun.recorded import RecordedDrawings
from mechviz.outputs.viewer import words
from mechviz.outputs.viewer.show_run import bodies_of
from mechviz.outputs.viewer.view_model import Rolling, ViewModel
from mechviz.picture.nodes import Body, Lines, Picture
from mechviz.quantities.numbers import Numbers


def show_of_recording(recording: Recording) -> ViewModel:
    """What is shown of a recording, complete or interrupted."""
    found = presentation_in(recording)
    numbers = found.catalogue.numbers
    ticks, _ = recording.scalars("data", "links", numbers.frame, "pose")
    head, cut, rest = found.notes.partition("\n## ")
    return ViewModel(
        title=found.title,
        teaches=found.teaches,
        picture=found.picture,
        bodies=bodies_of(found.picture.of(Body, "solids")),
        catalogue=found.catalogue,
        events=found.events,
        # without the title and what the scene teaches, with headings that fit a panel
        notes=words.notes(html_of(f"### {rest}".replace("\n## ", "\n### ") if cut else head)),
        drawings=found.drawings,
        charts=cache(RecordedDrawings(recording, ticks).charts),
        polodes=cache(lambda: polodes_in(found.picture, numbers)),
    )


def polodes_in(picture: Picture, numbers: Numbers) -> dict[str, Rolling]:
    """Pole curves of the links of which they were drawn: from the recorded pose and velocity the instant centre follows."""
    found = {}
    places = {name: xy for name in numbers.joints if (xy := numbers.values("data", "joints", name, "position")) is not None}
    for _, link in (node.owner for node in picture.of(Lines, "polodes")):
        rate = numbers.values("data", "links", link, "velocity")
        if rate is None:
            continue
        pose = numbers.poses[link]
        at, turn = pose[:, 0] + 1j * pose[:, 1], np.exp(1j * pose[:, 2])
        with np.errstate(divide="ignore", invalid="ignore"):
            fixed = at + 1j * (rate[:, 0] + 1j * rate[:, 1]) / rate[:, 2]
        fixed = np.where(np.isfinite(fixed), fixed, np.nan)
        own = [places[n] for n, j in numbers.joints.items() if link in j.links and n in places and np.isfinite(places[n]).all()]
        corners = [complex((complex(*xy[0]) - at[0]) / turn[0]) for xy in own]
        found[link] = Rolling(fixed, (fixed - at) / turn, np.array([*corners, *corners[:1]], complex))
    return found
