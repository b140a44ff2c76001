"""Drawings for CAD programs and cutters (DXF, release 2004) in millimetres, written by ezdxf."""

from __future__ import annotations

import re
from collections.abc import Iterable
from io import StringIO
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ezdxf.document import Drawing

_NO_LAYER = re.compile(r'[<>/\\":;?*|=`,]')  # characters that names of layers must not contain


def new_drawing() -> Drawing:
    """An empty drawing."""
    import ezdxf

    ezdxf.options.write_fixed_meta_data_for_testing = True  # without date and random number: equal drawings give equal files
    return ezdxf.new("R2004", units=4)


def dxf_of(drawing: Drawing) -> str:
    r"""The text of a drawing in ASCII: this release has no Unicode, so that other characters are written as ``\U+00FC``."""
    text = StringIO()
    drawing.write(text)
    return re.sub(r"[^\x00-\x7f]", _escaped, text.getvalue())


def _escaped(match: re.Match[str]) -> str:
    number = ord(match[0])
    return f"\\U+{number:04X}" if number <= 0xFFFF else "?"


def layer_names(names: Iterable[str], prefix: str) -> dict[str, str]:
    """A name of a layer for each of some distinct names. Names of layers that differ in case only would be the same."""
    layers: dict[str, str] = {}
    taken: set[str] = set()
    for name in names:
        stem = layer = prefix + _NO_LAYER.sub("_", name)
        n = 1
        while layer.casefold() in taken:
            n += 1
            layer = f"{stem} {n}"
        taken.add(layer.casefold())
        layers[name] = layer
    return layers
