"""Plots as files: figures of quantities against time or a drive, and their numbers as a table."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from io import BytesIO, StringIO
from typing import TYPE_CHECKING

import numpy as np

from mechviz.figures import DOTS, chart, chart_svg
from mechviz.quantities.catalogue import Axis, Quantity, Together

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PANEL = 7.0, 2.4  # width and height of a plot [in]
KINDS = ("CSV", "SVG", "PNG")


def plot_figure(title: str, quantities: Sequence[Quantity | Together], axis: Axis) -> Figure:
    """A figure of matplotlib with a panel for each quantity."""
    width, height = PANEL
    with chart(width, height * len(quantities) + 0.8) as figure:
        figure.suptitle(title)
        panels = figure.subplots(len(quantities), squeeze=False, sharex=True)[:, 0]
        for panel, quantity in zip(panels, quantities, strict=True):
            panel.plot(axis.values, quantity.values(), label=quantity.curves)
            panel.set(ylabel=quantity.unit, title=quantity.label)
            if len(quantity.curves) > 1:
                panel.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
        panels[-1].set_xlabel(axis.title)
    return figure


def plot_file(kind: str, title: str, quantity: Quantity | Together, axis: Axis) -> bytes:
    """A plot as a file of one of ``KINDS``; a table has the axis first, in the units that the plot shows."""
    if kind == "CSV":
        text = StringIO()
        rows = csv.writer(text)
        rows.writerow([axis.title, *(f"{name} [{quantity.unit}]" for name in quantity.curves)])
        rows.writerows(np.column_stack([axis.values, quantity.values()]).tolist())
        return text.getvalue().encode()
    figure = plot_figure(title, [quantity], axis)
    if kind == "SVG":
        return chart_svg(figure).encode()
    stream = BytesIO()
    figure.savefig(stream, format="png", dpi=DOTS)
    return stream.getvalue()
