"""Public interface of ``import mechviz as mv``: ``run`` solves a scene and ``open`` reads a recording. Both return a `Result`,
which gives quantities by name, plots, pictures, pages and the browser view."""

from __future__ import annotations

import webbrowser
from collections.abc import Iterator, Sequence
from functools import cached_property
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mechcore.arrays import Real
from mechcore.compiled.motion import Executor
from mechviz.figures import save_chart
from mechviz.files import OutputError, check_target, replacing
from mechviz.outputs.exports.tables import plot_figure
from mechviz.outputs.images.drawing import svg_of, write_svg
from mechviz.outputs.images.pictures import VIEW_NAMES, Look, picture_time
from mechviz.outputs.images.pictures import shot as take
from mechviz.outputs.page.page import make_page
from mechviz.outputs.presentation import Presentation, presentation_in, presentation_of
from mechviz.outputs.rerun.reader import Recording
from mechviz.outputs.rerun.recorded import recorded_numbers
from mechviz.outputs.rerun.writer import RecordingSummary, write_recording
from mechviz.progress import progress_bar
from mechviz.quantities.catalogue import Axis, Catalogue, Quantity, QuantityGroup
from mechviz.quantities.events import events_of
from mechviz.runs import Run, run_scene
from mechviz.scene.faults import did_you_mean
from mechviz.scene.scene import Scene, load
from mechviz.studies.designs.sensitivity import Sensitivity, sensitivity

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from mechcore.forces.kinetostatics import Forces
    from mechcore.motion.events import Event
    from mechcore.motion.motion import Motion
    from mechviz.outputs.viewer.app import Viewer

FRAME_HEIGHT = 640  # [px] of the frame in a notebook


def bundle_of(shown: Presentation, text: str) -> dict[str, str]:
    """MIME bundle for a notebook: the page as HTML, a drawing as SVG, and ``text`` as plain text.

    A notebook shows the page. Where the page cannot run, as in a printed notebook, the drawing is shown.
    """
    page, _ = make_page(shown)
    frame = (
        f'<iframe srcdoc="{escape(page, quote=True)}" sandbox="allow-scripts allow-downloads" '
        f'title="{escape(shown.title, quote=True)}" '
        f'style="width: 100%; height: {FRAME_HEIGHT}px; border: 0"></iframe>'
    )
    return {"text/html": frame, "image/svg+xml": svg_of(shown, width=800, height=500), "text/plain": text}


def _check_ending(path: str | Path, ending: str) -> None:
    if Path(path).suffix.lower() != ending:
        raise OutputError(f"'{path}' does not end in {ending}.", "Give a name that does.")


LONG_RUN = 1.0  # [s] after which a run shows its progress


class UnknownKey(KeyError):
    """A result has no quantity, or a plot no axis, of this name. The message suggests the known name that was probably meant."""

    def __str__(self) -> str:
        return str(self.args[0])


class Result:
    """Results of a solved scene or of a recording, returned by `run` and `open`.

    ``result["joint.B.reaction"]`` gives the values of a quantity at the frames; ``result.keys()`` lists the keys of all quantities.
    Values are in display units: those of the scene, such as mm, °, N and N m, with m/s, rad/s and MPa. A notebook displays a result
    as a page.
    """

    def __init__(self, source: Run | Recording):
        self._source = source

    # -- quantities ---------------------------------------------------------------------------------------------------
    def keys(self) -> tuple[str, ...]:
        """Keys of all quantities, such as ``drive.A.torque``, in the order of the catalogue."""
        return tuple(self.catalogue.by_key)

    def __getitem__(self, key: str) -> Real:
        """Values (F, n) of a quantity in its unit, with a column for each of its curves: see `quantity`. Raises `UnknownKey`."""
        return self.quantity(key).values()

    def __iter__(self) -> Iterator[str]:
        return iter(self.keys())

    def __len__(self) -> int:
        return len(self.keys())

    def __contains__(self, key: object) -> bool:
        return key in self.catalogue.by_key

    def quantity(self, key: str) -> Quantity:
        """A quantity with its ``unit``, its ``label`` and the names of its ``curves``. Raises `UnknownKey`."""
        if key not in self:
            raise UnknownKey(f"There is no quantity '{key}'. {did_you_mean(str(key), self.keys(), what='There are')}")
        return self.catalogue[key]

    @cached_property
    def catalogue(self) -> Catalogue:
        """All quantities, the axes of plots, and the health of the solution: closure errors and condition."""
        return self._source.catalogue if isinstance(self._source, Run) else Catalogue(recorded_numbers(self._source))

    @property
    def time(self) -> Real:
        """Times (F,) of the frames [s]."""
        return self.catalogue.numbers.time

    @property
    def events(self) -> tuple[Event, ...]:
        """Events of the run, sorted by time: dead points, limits, peaks, stops, jams. A recording rounds their times to
        nanoseconds."""
        if not isinstance(self._source, Run):
            return self._source.events
        return events_of(self._source)

    # -- source ---------------------------------------------------------------------------------------------------------
    @property
    def title(self) -> str:
        """The scene's title."""
        return self._source.scene.title if isinstance(self._source, Run) else self._source.parsed_properties.title

    @property
    def scene(self) -> Scene:
        """The scene that was solved; a recording contains it. Raises `SceneError`, `RecordingError`."""
        return self._source.scene if isinstance(self._source, Run) else self._source.scene()

    @property
    def solved(self) -> Run:
        """The run with everything that was computed. Raises `OutputError` for a recording, which holds values but no solution."""
        if isinstance(self._source, Run):
            return self._source
        what = f"'{self._source.path}' is a recording: it holds values, not the solution."
        raise OutputError(what, "Solve its scene: mechviz.run(result.scene).")

    @property
    def motion(self) -> Motion:
        """Positions, velocities and accelerations in SI units. Raises `OutputError` for a recording."""
        return self.solved.motion

    @property
    def forces(self) -> Forces | None:
        """Reactions, efforts and power in SI units; None where the scene names no effects and no loads. Raises `OutputError` for a
        recording."""
        return self.solved.forces

    @cached_property
    def presentation(self) -> Presentation:
        """The presentation from which pages and pictures are made. Raises `RecordingError` for a damaged recording."""
        return presentation_of(self._source) if isinstance(self._source, Run) else presentation_in(self._source)

    def sensitivity(self, of: str, by: str | Sequence[str] = ()) -> Sensitivity:
        """Exact derivatives of a quantity, or of one number of it such as ``joint.B.reaction:max``, with respect to inputs of the
        scene.

        ``by`` names parameters of the scene, or numbers of it by their places; by default all parameters that are not computed from
        others. Raises `MechanismError`, and `OutputError` for a recording.
        """
        return sensitivity(self.solved, of, by)

    # -- outputs ------------------------------------------------------------------------------------------------------
    def record(self, path: str | Path) -> RecordingSummary:
        """Write a rerun recording (.rrd) and return a summary of it. An existing file is replaced only when the new one is
        complete. Raises `OutputError`, also where the result is a recording."""
        _check_ending(path, ".rrd")
        return write_recording(self.solved, path)

    def view(self, port: int = 8080, *, open_browser: bool = False, block: bool = True) -> Viewer | None:
        """Show the result in the browser at http://127.0.0.1:PORT until Ctrl-C; port 0 selects a free one. Raises `ViewerError`.

        Without ``block``, as in a notebook, it returns the `Viewer` at once, which serves the page at its ``url`` until its
        ``close``. ``open_browser`` opens the page in a browser.
        """
        from mechviz.outputs.viewer import app

        if block:
            app.serve(self._source, port, open_browser)
            return None
        viewer = app.Viewer(self._source, port)
        if open_browser:
            webbrowser.open(viewer.url)
        return viewer

    def share(self, path: str | Path, *, most: int = 1000) -> Path:
        """Write one HTML file that plays in any browser without a network, with at most ``most`` frames; returns its path. Raises
        `OutputError`."""
        _check_ending(path, ".html")
        target = Path(path)
        check_target(target)
        with replacing(target) as temporary:
            temporary.write_text(make_page(self.presentation, most=most)[0], encoding="utf-8")
        return target

    def shot(
        self,
        path: str | Path,
        *,
        at: float | None = None,
        frame: int | None = None,
        angle: float | None = None,
        view: str = "3d",
        size: tuple[int, int] = (1280, 800),
        dark: bool = False,
    ) -> Path:
        """Write a picture and return its path: a drawing from the front (.svg), or the solids in a view (.png), which needs
        Chromium.

        It shows the time ``at`` [s], the ``frame`` of this number, or the time at which the drive first reaches ``angle`` [°]; by
        default the time at which a page opens. ``view``: 3d, front, iso, top, left, right or back. ``size``: width and height [px].
        Raises `OutputError`.
        """
        target, drawing = Path(path), Path(path).suffix.lower() == ".svg"
        if target.suffix.lower() not in (".svg", ".png"):
            raise OutputError(f"'{path}' ends neither in .png nor in .svg.", "Give a name that does.")
        if view not in VIEW_NAMES or (drawing and view not in ("3d", "front")):
            offered = "'front'" if drawing else ", ".join(VIEW_NAMES)
            raise OutputError(f"'{path}' cannot be taken from the view '{view}'.", f"There are: {offered}.")
        check_target(target)
        place = picture_time(self.presentation, at=at, frame=frame, angle=None if angle is None else float(np.radians(angle)))
        if drawing:
            return write_svg(self.presentation, target, time=place.time, width=size[0], height=size[1], dark=dark)
        return take(self.presentation, target, Look(*size, view, dark), place)

    def plot(self, *keys: str | tuple[str, ...], path: str | Path | None = None, against: str | None = None) -> Figure:
        """A matplotlib figure with a panel for each key, or for each tuple of keys of one unit. It is also written to ``path``
        (.svg, .png, .pdf) if that is given.

        ``against`` is the abscissa: ``"time"`` or the joint of a drive; by default the first drive that runs in one direction only,
        else time. Without keys the figure shows the quantities with which the viewer opens. Raises `UnknownKey`, and `OutputError`
        where the units in a tuple differ or the file cannot be written.
        """
        quantities = [self._together(key) for key in keys] or list(self.catalogue.initial_quantities)
        figure = plot_figure(self.title, quantities, self._axis(against))
        if path is not None:
            save_chart(figure, Path(path))
        return figure

    def _together(self, keys: str | tuple[str, ...]) -> Quantity | QuantityGroup:
        if isinstance(keys, str):
            return self.quantity(keys)
        parts = tuple(self.quantity(key) for key in keys)
        if len({q.unit for q in parts}) != 1:
            raise OutputError(f"One plot cannot show {', '.join(q.title for q in parts)}.", "Give quantities of one unit.")
        return QuantityGroup(parts)

    def _axis(self, against: str | None) -> Axis:
        axes = {axis.of: axis for axis in self.catalogue.axes}
        if against is None:
            return next(iter(axes.values()))
        if against not in axes:
            raise UnknownKey(f"A plot cannot run against '{against}'. {did_you_mean(against, axes, what='There are')}")
        return axes[against]

    def __repr__(self) -> str:
        source = self._source
        name = source.scene.name if isinstance(source, Run) else source.path.name
        return f"Result of {name}: {len(self.time)} frames, {len(self)} quantities"

    def _repr_mimebundle_(self, include: object = None, exclude: object = None) -> dict[str, str]:
        """Display in a notebook: the page with solids, plots and events on one timeline."""
        return bundle_of(self.presentation, repr(self))


def run(
    scene: Scene | str | Path,
    *,
    frames: int | None = None,
    cycles: int | None = None,
    accuracy: float | None = None,
    executor: Executor = "auto",
    progress: bool = True,
) -> Result:
    """Solve a scene and return its `Result`. ``scene``: a scene, the name of a gallery scene, or the path of a scene file.

    ``frames`` over the whole run and ``cycles`` of the first drive are by default those of the scene. ``accuracy`` is the target
    relative error, such as 1e-6, from which frames and tolerances follow. ``executor`` is "numpy", "c", or "auto", which uses C
    where compiling pays. With ``progress``, runs longer than a second show it on a terminal and in a notebook. Raises `SceneError`
    with every fault of the scene, and `MechanismError` where the mechanism cannot perform the motion.
    """
    solved = scene if isinstance(scene, Scene) else load(scene)
    settings: dict[str, Any] = {"frames": frames, "cycles": cycles, "accuracy": accuracy, "executor": executor}
    if not progress:
        return Result(run_scene(solved, **settings))
    with progress_bar(f"solving {solved.name}", after=LONG_RUN) as bar:
        return Result(run_scene(solved, **settings, progress=bar.stage, advance=lambda t, end: bar(round(1e3 * t / end), 1000)))


def open(path: str | Path, *, most: int | None = None) -> Result:
    """Read a recording (.rrd) and return its `Result`. If ``most`` is given, only that many frames of a longer recording are read,
    evenly spaced. Raises `RecordingError`."""
    return Result(Recording(path, most=most))
