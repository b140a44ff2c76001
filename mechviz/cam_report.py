"""What `mechviz cams` prints: every cam of a scene with its limits, forces, stress, the spring that it needs, its drawn lift."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mechcore.errors import MechanismError
from mechcore.spec import CamDrawn, CamPair

if TYPE_CHECKING:
    from mechcore.cams.happenings import AnyCam
    from mechcore.kinetostatics import Forces
    from mechcore.motion import Motion

__all__ = ["cam_lines", "drawn_lines"]

Real = NDArray[np.float64]


def cam_lines(motion: Motion, forces: Forces | None, *, margin: float | None = None) -> list[str]:
    """Every cam with what is known of it; ``margin`` [N] instead of the scene's, for the least spring."""
    from mechcore.cams.happenings import pair_of, placed_cams

    lines: list[str] = []
    for cam in placed_cams(motion):
        pair = pair_of(motion, cam)
        lines += ["", f"cam {cam.name}: {_kind(pair, cam)}"]
        lines += [f"  {what:<18} {text}" for what, text in _facts(motion, forces, cam, pair, margin)]
    return lines[1:]


def _kind(pair: CamPair, cam: AnyCam) -> str:
    kind = pair.spatial.kind if pair.spatial is not None else "wedge" if pair.bed else "inverse" if pair.inverse else "disc"
    face = type(pair.face).__name__.lower()
    size = getattr(pair.face, "radius", None)
    face = {"arc": "mushroom", "flat": "flat face"}.get(face, face) + (f" of {1e3 * size:.6g} mm" if size else "")
    moves = "translating" if cam.arm == 0.0 else "oscillating"
    return f"{kind}, {moves} follower with a {face}, closure by {pair.closure}"


def _facts(motion: Motion, forces: Forces | None, cam: AnyCam, pair: CamPair, margin: float | None) -> Iterator[tuple[str, str]]:
    from mechcore.cams.happenings import contact_force

    rating = pair.rating
    force = None if forces is None else contact_force(forces, cam)
    rows = cam.rows(motion, 1.0 if force is None else np.nan_to_num(force, nan=1.0))
    x = cam.argument(motion)
    unit = "m/rad²" if cam.arm == 0.0 else "1/rad"
    if cam.bed is not None:
        unit = "1/m" if cam.arm == 0.0 else "rad/m²"
    way = float(np.nanmax(rows.lift) - np.nanmin(rows.lift))
    lift = f"{1e3 * way:.6g} mm" if cam.arm == 0.0 else f"{np.degrees(way):.6g} deg"
    yield "lift", f"{lift}, largest s'' {np.nanmax(np.abs(cam.law(x)[2])):.5g} {unit}"
    steep = np.abs(rows.pressure_angle)
    exact = list(_limits(cam))
    yield from exact
    if np.isfinite(steep).any() and not exact:  # of a given profile: what the run meets
        k = int(np.nanargmax(steep))
        judged = _judged(steep[k], cam.pressure_limit, lambda v: f"{np.degrees(v):.4g} deg")
        yield "pressure angle", f"up to {np.degrees(steep[k]):.5g} deg at {_place(cam, x[k])}{judged}"
    sharp = np.where(rows.radius > 0.0, rows.radius, np.inf)
    if np.isfinite(sharp).any() and not exact and not pair.inverse:
        k = int(np.argmin(sharp))
        yield "curvature", f"least radius of the convex profile {1e3 * sharp[k]:.5g} mm at {_place(cam, x[k])}"
    if force is not None and forces is not None and np.isfinite(force).any():
        low, high = int(np.nanargmin(force)), int(np.nanargmax(force))
        need = margin if margin is not None else None if rating is None else rating.margin
        judged = "" if cam.form or need is None else f"; margin {need:.5g} N: {_verdict(force[low] >= need)}"
        ends = f"{force[low]:.5g} N at {_place(cam, x[low])} to {force[high]:.5g} N at {_place(cam, x[high])}"
        yield "contact force", f"{ends}{judged}"
        if rating is not None and rating.width is not None:
            from mechcore.cams.rating import contact_stress

            found = contact_stress(forces, cam, rating)
            k = int(np.nanargmax(found.pressure))
            judged = _judged(float(found.pressure[k]), rating.limit, lambda v: f"{1e-6 * v:.5g} MPa")
            half = f"strip of {2e3 * found.half_width[k]:.4g} by {1e3 * rating.width:.4g} mm"
            yield "Hertz pressure", f"up to {1e-6 * found.pressure[k]:.5g} MPa at {_place(cam, x[k])}, {half}{judged}"
        if not cam.form and need is not None:
            yield from _springs(forces, cam, need)
    if pair.drawn is not None:
        from mechcore.cams.rating import drawn_lift

        yield "graphical method", _drawn_words(cam, pair.drawn, drawn_lift(cam, pair.drawn).largest)


def _limits(cam: AnyCam) -> Iterator[tuple[str, str]]:
    """The lecture's conditions for a cam that is made from its law: pressure angle, undercut, and the face of a flat follower."""
    from mechcore.cams import Flat, find_limits, spatial_limits
    from mechcore.cams.placed import PlacedCam
    from mechcore.cams.placed_spatial import PlacedSpatial

    def degrees(value: float) -> str:
        return f"{np.degrees(value):.4g} deg"

    if isinstance(cam, PlacedSpatial):
        s = spatial_limits(cam.cam, (1, -1) if cam.form else (1,))
        judged = _judged(s.pressure.value, cam.pressure_limit, degrees)
        yield "pressure angle", f"up to {np.degrees(s.pressure.value):.5g} deg at {_place(cam, s.pressure.angle)}{judged}"
        yield "undercut", f"{_verdict(not s.undercut)}; rollers up to {1e3 * s.greatest_roller.value:.5g} mm"
    if not isinstance(cam, PlacedCam) or cam.given is not None:
        return
    found = find_limits(cam.cam)
    ends = [
        f"{word} up to {np.degrees(abs(reached.value)):.5g} deg at {_place(cam, reached.angle)}"
        for word, reached in (("rise", found.rise), ("return", found.fall))
    ]
    worst = max(found.rise.value, found.fall.value)
    yield "pressure angle", f"{', '.join(ends)}{_judged(worst, cam.pressure_limit, degrees)}"
    radius = (
        [] if found.convex is None else [f"least radius {1e3 * found.convex.value:.5g} mm at {_place(cam, found.convex.angle)}"]
    )
    if found.greatest_roller is not None and np.isfinite(found.greatest_roller.value):
        radius.append(f"radii of the follower up to {1e3 * found.greatest_roller.value:.5g} mm")
    yield "undercut", "; ".join([_verdict(not found.undercut), *radius])
    if isinstance(cam.face, Flat) and found.distance_left is not None and found.distance_right is not None:
        left, right = abs(found.distance_left.value), abs(found.distance_right.value)
        judged = ""
        if np.isfinite([cam.face.left, cam.face.right]).any():
            judged = f"; face {1e3 * cam.face.left:.5g} and {1e3 * cam.face.right:.5g} mm: "
            judged += _verdict(left <= cam.face.left and right <= cam.face.right)
        yield "face", f"the contact goes {1e3 * left:.5g} mm to the left and {1e3 * right:.5g} mm to the right{judged}"


def _verdict(passed: bool) -> str:
    return "pass" if passed else "FAIL"


def _judged(value: float, limit: float | None, words: Callable[[float], str]) -> str:
    return "" if limit is None else f"; limit {words(limit)}: {_verdict(value <= limit)}"


def _place(cam: AnyCam, x: float) -> str:
    if cam.bed is not None:
        return f"{1e3 * x:.5g} mm"
    return f"{np.degrees(x) % 360.0:.5g} deg"


def _springs(forces: Forces, cam: AnyCam, need: float) -> Iterator[tuple[str, str]]:
    """The least spring for a margin, in words."""
    from mechcore.cams.rating import least_springs

    x = cam.argument(forces.motion)
    try:
        found = least_springs(forces, cam, need)
    except MechanismError as error:
        yield "least spring", "; ".join(f.message for f in error.faults)
        return
    if not found:
        yield "least spring", "no spring presses this follower"
    for spring in found:
        ways = []
        if spring.stiffness is not None:
            ways.append(f"{1e-3 * spring.stiffness:.5g} N/mm with its free length")
        if spring.free_length is not None:
            ways.append(f"a free length of {1e3 * spring.free_length:.5g} mm with its stiffness")
        words = " or ".join(ways) if ways else "none: this spring is slack, or pulls, where it is needed"
        yield "least spring", f"{spring.spring}: {words}, to keep {need:.5g} N (decided at {_place(cam, x[spring.frames[0]])})"


def _drawn_words(cam: AnyCam, drawn: CamDrawn, largest: Real) -> str:
    s, v, a = 100.0 * largest
    read = ""
    if drawn.resolution:
        size = f"{1e3 * drawn.resolution:g} mm" if cam.arm == 0.0 else f"{np.degrees(drawn.resolution):g} deg"
        read = f", read to {size}"
    return (
        f"steps of {np.degrees(drawn.step):.6g} deg, {drawn.lines}s{read}: off by {s:.4g} % of the largest lift, "
        f"{v:.4g} % of the velocity, {a:.4g} % of the acceleration"
    )


def drawn_lines(motion: Motion, drawn: CamDrawn | None = None) -> list[str]:
    """The tables of the graphical method, drawn beside exact at every point of the drawing, of each disc cam.

    ``drawn``: instead of what the scene says. Lift in mm or deg, its derivatives with respect to the cam's angle [rad].
    """
    from mechcore.cams.happenings import pair_of, placed_cams
    from mechcore.cams.rating import drawn_lift

    lines: list[str] = []
    for cam in placed_cams(motion):
        how = drawn or pair_of(motion, cam).drawn
        if how is None:
            continue
        try:
            found = drawn_lift(cam, how)
        except MechanismError as error:
            lines += ["", *(f"cam {cam.name}: {f.message}" for f in error.faults)]
            continue
        unit, factor = ("mm", 1e3) if cam.arm == 0.0 else ("deg", float(np.degrees(1.0)))
        lines += ["", f"cam {cam.name}, graphical method: {_drawn_words(cam, how, found.largest)}"]
        lines.append(f"  {'cam':>7} {'s':>10} {'error':>10} {'ds':>10} {'error':>10} {'dds':>10} {'error':>10}")
        lines.append(
            f"  {'deg':>7} {unit:>10} {unit:>10} {unit + '/rad':>10} {unit + '/rad':>10} {unit + '/rad²':>10} {unit + '/rad²':>10}"
        )
        for k, angle in enumerate(found.angle):
            cells = (f"{factor * v:10.4f}" for i in range(3) for v in (found.drawn[i, k], found.error[i, k]))
            lines.append(f"  {np.degrees(angle):7.2f} " + " ".join(cells))
    return lines[1:]
