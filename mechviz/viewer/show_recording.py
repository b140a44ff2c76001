"""A recording as the viewer shows it: read by its contract, nothing is computed anew."""

from __future__ import annotations

from functools import cache
from html import escape

import numpy as np

from ..picture import Body
from ..quantities import Catalogue
from ..record import Recording
from ..record.numbers import numbers_in
from ..record.read_picture import picture_in
from .recorded_plans import RecordedPlans
from .show import Show
from .show_run import bodies_of

__all__ = ["show_of_recording"]


def show_of_recording(recording: Recording) -> Show:
    """What is shown of a recording, complete or interrupted. KeyError and ValueError where it does not keep to the contract."""
    numbers = numbers_in(recording)
    for link, pose in numbers.poses.items():
        if not np.isfinite(pose).all():
            raise ValueError(f"the pose of link {link} is not finite")
    picture, catalogue = picture_in(recording, numbers), Catalogue(numbers)
    places = {name: xy for name in numbers.joints if (xy := numbers.values("data", "joints", name, "position")) is not None}
    ticks, _ = recording.scalars("data", "links", numbers.frame, "pose")
    plans = RecordedPlans(recording, ticks, dict(numbers.poses), {k: v for k, v in places.items() if np.isfinite(v).all()})
    head, cut, rest = recording.notes.partition("\n## ")
    said = recording.properties
    return Show(
        title=str(said.get("title") or said.get("scene") or recording.path.stem),
        # in the notes it stands between the title and what was computed
        teaches=" ".join(line.strip() for line in head.splitlines() if line.strip() and not line.startswith(("#", "**"))),
        picture=picture,
        bodies=bodies_of(picture.of(Body, "solids")),
        catalogue=catalogue,
        events=recording.events,
        # without the title and what the scene teaches, with headings that fit a panel
        notes=escape(f"#### {rest}".replace("\n## ", "\n#### ") if cut else head, quote=False),
        drawings=cache(plans.drawings),
        charts=cache(plans.charts),
        polodes=cache(plans.polodes),
        overlays=cache(plans.overlays),
    )
