"""Names at the pointer: what a link, a joint, an arrow or a traced point is called, while the pointer rests on it.

viser has no event of hovering. So a script in the page looks by itself what lies below the pointer, with the hooks that viser 1.1.1
shows to scripts (``__viserMutable``); where they are not there, no names appear.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import viser

from mechviz.outputs.viewer.view_model import ViewModel
from mechviz.outputs.viewer.viser_adapter import run_script
from mechviz.outputs.viewer.world.arrows import arc_path, arrows_by_family
from mechviz.outputs.viewer.world.marks import dot_path, joint_groups, joint_path
from mechviz.outputs.viewer.world.solids import link_path
from mechviz.picture.nodes import Arc
from mechviz.quantities.vectors import FAMILIES

SCRIPT = Path(__file__).with_name("hover.js").read_text(encoding="utf-8")

Name = tuple[str, str, tuple[str, ...]]
KINDS = {"pin_slot": "pin in a slot"}


def hover_names(show: ViewModel) -> dict[str, Name]:
    """By the node that is drawn: what it is called, more words, and the names of its parts where it draws several things."""
    found: dict[str, Name] = {}
    for link in show.poses:
        found[link_path(link)] = (f"link {link}", "the fixed link" if link == show.frame else "click to look closer", ())
    driven = {drive.name for drive in show.drives}
    for names, _ in joint_groups(show.joints, 1e-6 * show.size):
        words = [_joint(show, name) + (", driven" if name in driven else "") for name in names]
        if len(names) > 1:
            words = [f"{name}: {text}" for name, text in zip(names, words, strict=True)]
        found[f"{joint_path(names)}/dot"] = (f"joint {', '.join(names)}", "; ".join(words), ())
    for name in show.paths:
        found[dot_path(name)] = (f"point {name}", "a traced point, on its path", ())
    for family, arrows in arrows_by_family(show).items():
        kind = FAMILIES[family]
        items = tuple(f"{kind.label}: {arrow.vector.item}" for arrow in arrows)
        found[f"/vectors/{family}"] = (kind.label, f"{kind.meaning} [{kind.unit}]", items)
    for arc in show.picture.of(Arc):
        family, item = arc.group, arc.moment.item
        found[arc_path(family, item)] = (f"{FAMILIES[family].label}: {item}", "a moment [N m]", ())
    return found


def _joint(show: ViewModel, name: str) -> str:
    """What a joint is: ``revolute, crank and coupler``."""
    joint = show.numbers.joints[name]
    return f"{KINDS.get(joint.kind, joint.kind)}, {' and '.join(joint.links)}"


class HoverNames:
    """Tells all browsers, now and later, what is called how; ``update`` takes another run."""

    def __init__(self, server: viser.ViserServer, show: ViewModel):
        self._server = server
        self._names: Mapping[str, Name] = {}
        self.update(show)

    def update(self, show: ViewModel) -> None:
        names = hover_names(show)
        if names == self._names:
            return
        self._names = names
        run_script(self._server, f"{SCRIPT}window.mechvizHover.names = {json.dumps(names)};", "hover")
