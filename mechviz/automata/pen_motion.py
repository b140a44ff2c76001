"""The motion of a pen along strokes: at a constant speed, slower at corners, with a bounded jerk, in one turn of a shaft.

Each stroke is drawn from rest to rest under a bounded acceleration; the pen is lifted, goes straight to the next stroke, and is
lowered. This motion over time is smoothed by a cubic B-spline (four successive averages over a time h), so that its jerk is
continuous and at most (2/3) |change of velocity| / h^2 at a corner. A corner of turn d that is passed at the speed v is cut by
(7/15) v h sin(d/2); where the line would miss its stroke by more than is allowed, the pen is slower.

The motion can also be written as a program for three motors: tables over time of two crossed slides and of the pen's lift.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from scipy.ndimage import minimum_filter1d

from mechcore.arrays import Complex, Real
from mechcore.errors import Fault, MechanismError
from mechcore.records import dataclass
from mechcore.texts import as_length
from mechviz.scene.folder import SceneFolder
from mechviz.scene.scene import Scene, loads

SMOOTHING_REACH = 2.0  # the smoothing reaches this many h to either side
_SMOOTH = 0.3  # h over the time in which the pen comes to full speed
_FINE = 3.0  # samples of a stroke within h at full speed
_GRID = 6  # places of the smoothed motion within h
_SLOWEST = 0.01  # of the full speed
_ROUNDS = 40  # of slowing down where the line misses its stroke
_RAMPS = (0.004, 0.0057, 0.008, 0.0113, 0.016, 0.0226, 0.032, 0.045)  # trial distances to full speed, over the size of the drawing
_WINDOW = 10  # samples to either side among which the nearest place of a line is sought
PEN_DOWN = 0.25  # of the lift: below it the pen is on the paper
_OFF = 0.36  # of the time of a cycloidal lift: after it the pen is higher than that
_NOTHING = 1e-9  # largest range that is left out [rad]
_EVEN = 0.2  # deviation from the full speed, relative to it, up to which a speed counts as even


@dataclass(frozen=True, eq=False)
class PenMotion:
    """Places (N,) [m] of the pen at equal steps of the shaft's angle from 0 on, and the shaft's angles [rad] of its strokes and
    lifts.

    ``strokes``: begin and end of each, while the pen rests on the paper; ``pen_up``: after each stroke begin and end of the
    lifting, begin and end of the lowering. ``error`` [m]: the largest distance between the line and its strokes, in both
    directions. ``even``: the share of the line that is drawn at the full speed, within a fifth. Peaks of derivatives by the angle:
    ``speed`` [m/rad], ``acceleration`` [m/rad^2], ``jerk`` [m/rad^3].
    """

    places: Complex
    strokes: tuple[tuple[float, float], ...]
    pen_up: tuple[tuple[float, float, float, float], ...]
    error: float
    even: float
    speed: float
    acceleration: float
    jerk: float

    @property
    def angles(self) -> Real:
        """Shaft angles (N,) of the places."""
        return 2.0 * np.pi * np.arange(len(self.places)) / len(self.places)

    @property
    def lifts(self) -> list[tuple[float, float | None]]:
        """Successive ranges [rad] of the turn, each with the position of the pen at its end: 1 up, 0 down, None unchanged."""
        strides: list[tuple[float, float | None]] = []
        at = 0.0
        for rising, up, falling, down in self.pen_up:
            steps = [(rising - at, None), (up - rising, 1.0), (falling - up, None), (down - falling, 0.0)]
            strides += [(over, to) for over, to in steps if over > _NOTHING]
            at = down
        return strides


def plan_motion(
    strokes: Sequence[Complex],
    error: float,
    rise: float,
    size: Callable[[float, float], float] = lambda speed, acceleration: acceleration,
    *,
    stated: float | None = None,
) -> PenMotion:
    """The motion along strokes (n,) [m] that misses them by at most ``error`` [m], with ``rise`` [rad] of the shaft for each lift
    of the pen.

    The distance in which the pen comes to full speed is chosen for the least ``size`` of the largest speed [m/rad] and acceleration
    [m/rad^2], by the shaft's angle. Raises `MechanismError` where the error cannot be reached; ``stated``: the error for the
    message, where it is another one.
    """
    if not error > 0.0:
        raise MechanismError(Fault("error", f"{as_length(error)}: a line cannot be drawn without any error.", "Give more."))
    if not 2.0 * len(strokes) * rise < math.pi:
        raise MechanismError(
            Fault("strokes", f"{len(strokes)} strokes: the pen would be lifted most of the time.", "Join strokes.")
        )
    every = np.concatenate(list(strokes))
    extent = max(np.ptp(every.real), np.ptp(every.imag))
    motions = [motion for part in _RAMPS if (motion := _planned(strokes, error, rise, part * extent)) is not None]
    if not motions:
        allowed = as_length(error if stated is None else stated)
        why = f"an error of {allowed} on a drawing of {as_length(float(extent))} cannot be reached."
        raise MechanismError(Fault("error", why, "Allow a larger error, or draw it smaller."))
    return min(motions, key=lambda motion: size(motion.speed, motion.acceleration))


def _planned(strokes: Sequence[Complex], error: float, rise: float, ramp: float) -> PenMotion | None:
    """The motion that comes to full speed (1) over the distance ``ramp`` [m]; None where it misses strokes by more than allowed."""
    a = 0.5 / ramp
    h = _SMOOTH / a
    fine = h / _FINE
    lines = [_sampled(stroke, fine) for stroke in strokes]
    caps = [np.ones(len(line)) for line in lines]
    for _ in range(_ROUNDS):
        timed = _timed(lines, caps, a, h, rise)
        smooth = _Smooth.of(timed, h)
        worst = 0.0
        for k, line in enumerate(lines):
            drawn = smooth.at(timed.times[k])
            distance = np.maximum(_apart(line, drawn), _apart(drawn, line))
            worst = max(worst, float(distance.max()))
            slower = np.clip(np.sqrt(0.8 * error / np.maximum(distance, 1e-300)), 0.7, 1.0)
            caps[k] = np.maximum(caps[k] * minimum_filter1d(slower, 2 * _WINDOW + 1), _SLOWEST)
        if worst <= error:
            return _finished(timed, smooth, worst, h)
    return None


@dataclass(frozen=True, eq=False)
class _Timed:
    """The pen's motion before the smoothing: ``times`` of the samples of each stroke; ``knots`` (times) and ``places`` of the whole
    cycle, which lasts ``total``; begins and ends of ``strokes`` and ``pen_up`` as in `PenMotion`, in time."""

    times: list[Real]
    knots: Real
    places: Complex
    total: float
    strokes: list[tuple[float, float]]
    pen_up: list[tuple[float, float, float, float]]


def _timed(lines: list[Complex], caps: list[Real], a: float, h: float, rise: float) -> _Timed:
    """The samples of all strokes with their times, and of the travel between them; lifts take a fixed share of the whole time."""
    own = [_times(line, cap, a) for line, cap in zip(lines, caps, strict=True)]
    strides = [_sampled(np.array([line[-1], lines[(k + 1) % len(lines)][0]]), h) for k, line in enumerate(lines)]
    between = [_times(stride, np.ones(len(stride)), a) for stride in strides]
    total = sum(t[-1] for t in (*own, *between))
    for _ in range(60):  # lifts take a fixed share of the whole time: this iteration is a contraction
        lift = rise / (2.0 * np.pi) * total
        before = 2.0 * SMOOTHING_REACH * h + _OFF * lift  # the smoothed pen rests, then lifts a quarter
        waits = [max(before, 0.5 * (2.0 * lift + 2.0 * SMOOTHING_REACH * h - t[-1])) for t in between]
        total, last = sum(t[-1] for t in (*own, *between)) + 2.0 * sum(waits), total
        if abs(total - last) < 1e-12 * total:
            break
    clock, times, knots, places, strokes, pen_up = SMOOTHING_REACH * h, [], [], [], [], []
    for line, t, stride, t_stride, wait in zip(lines, own, strides, between, waits, strict=True):
        times.append(clock + t)
        strokes.append((clock - SMOOTHING_REACH * h, clock + t[-1] + SMOOTHING_REACH * h))
        clock += t[-1]
        begin = clock + SMOOTHING_REACH * h
        knots += [times[-1], clock + wait + t_stride]
        places += [line, stride]
        clock += 2.0 * wait + t_stride[-1]
        pen_up.append((begin, begin + lift, clock - SMOOTHING_REACH * h - lift, clock - SMOOTHING_REACH * h))
    knots.append(np.array([total + SMOOTHING_REACH * h]))
    places.append(lines[0][:1])
    return _Timed(times, np.concatenate(knots), np.concatenate(places), total, strokes, pen_up)


@dataclass(frozen=True, eq=False)
class _Smooth:
    """A periodic motion of the pen after the smoothing: its places on a grid of times, and the spectrum that they come from."""

    grid: Real
    places: Complex
    spectrum: Complex
    rates: Complex
    total: float

    @classmethod
    def of(cls, timed: _Timed, h: float) -> _Smooth:
        count = int(np.ceil(timed.total * _GRID / h))
        grid = timed.total * np.arange(count) / count
        x, y = (np.interp(grid, timed.knots, part, period=timed.total) for part in (timed.places.real, timed.places.imag))
        frequency = np.fft.fftfreq(count, timed.total / count)
        spectrum = np.fft.fft(x + 1j * y) * np.sinc(frequency * h) ** 4
        return cls(grid, np.fft.ifft(spectrum), spectrum, np.asarray(2j * np.pi * frequency, complex), timed.total)

    def at(self, times: Real) -> Complex:
        x, y = (np.interp(times, self.grid, part, period=self.total) for part in (self.places.real, self.places.imag))
        return np.asarray(x + 1j * y)

    def rate(self, order: int) -> Complex:
        return np.fft.ifft(self.spectrum * self.rates**order)


def _finished(timed: _Timed, smooth: _Smooth, error: float, h: float) -> PenMotion:
    """The motion by the angle of the shaft, at places a time step of about h apart."""
    turn = 2.0 * np.pi / timed.total
    count = max(int(np.ceil(timed.total / h)), 32)
    n = len(smooth.grid)
    spectrum = np.fft.fftshift(smooth.spectrum)
    half = min(count, n) // 2
    kept = np.zeros(count, complex)  # resampled without any change below half of the new rate
    kept[:half], kept[-half:] = spectrum[n // 2 : n // 2 + half], spectrum[n // 2 - half : n // 2]
    places = np.fft.ifft(kept) * (count / n)
    drawn = np.zeros(n, bool)
    for begin, end in timed.strokes:
        drawn |= (smooth.grid >= begin) & (smooth.grid <= end)
    speed = np.abs(smooth.rate(1))
    drawn_length = float(speed[drawn].sum())
    even = float(speed[drawn & (speed > 1.0 - _EVEN)].sum()) / drawn_length if drawn_length > 0.0 else 0.0
    fine = np.zeros(n, complex)
    fine[:half], fine[-half:] = spectrum[n // 2 : n // 2 + half], spectrum[n // 2 - half : n // 2]
    peaks = [float(np.abs(np.fft.ifft(fine * smooth.rates**k)).max()) / turn**k for k in (1, 2, 3)]
    return PenMotion(
        places,
        tuple((turn * a, turn * b) for a, b in timed.strokes),
        tuple((turn * a, turn * b, turn * c, turn * d) for a, b, c, d in timed.pen_up),
        error,
        even,
        *peaks,
    )


def _sampled(z: Complex, step: float) -> Complex:
    """Points of a polyline at most ``step`` apart, its corners among them."""
    counts = np.maximum(1, np.ceil(np.abs(np.diff(z)) / step).astype(int))
    return np.concatenate([*(a + (b - a) * np.arange(n) / n for a, b, n in zip(z[:-1], z[1:], counts, strict=True)), z[-1:]])


def _times(z: Complex, cap: Real, a: float) -> Real:
    """Times of samples that are passed from rest to rest, as fast as their largest speeds ``cap`` and the acceleration ``a``
    allow."""
    lengths = np.abs(np.diff(z))
    square = np.minimum(cap, 1.0) ** 2
    square[0] = square[-1] = 0.0
    done = np.concatenate([[0.0], np.cumsum(lengths)])
    rising = np.minimum.accumulate(square - 2.0 * a * done) + 2.0 * a * done
    falling = (np.minimum.accumulate((rising + 2.0 * a * done)[::-1]))[::-1] - 2.0 * a * done
    v = np.sqrt(np.maximum(falling, 0.0))
    mean = 0.5 * (v[1:] + v[:-1])
    short = mean <= 0.0  # one step from rest to rest: up to its middle and down again
    dt = np.where(short, 2.0 * np.sqrt(lengths / a), lengths / np.where(short, 1.0, mean))
    return np.concatenate([[0.0], np.cumsum(dt)])


def _apart(points: Complex, line: Complex) -> Real:
    """Distances of points (n,) from a line through as many points, sought near the same index."""
    n = len(points)
    best = np.full(n, np.inf)
    at = np.arange(n)
    for shift in range(-_WINDOW, _WINDOW):
        j = np.clip(at + shift, 0, n - 2)
        a, b = line[j], line[j + 1]
        stride = b - a
        u = np.clip(np.real((points - a) * np.conj(stride)) / np.maximum(np.abs(stride) ** 2, 1e-300), 0.0, 1.0)
        best = np.minimum(best, np.abs(points - a - u * stride))
    return best


def csv_table(header: str, length: float, values: Real) -> bytes:
    """A CSV table of periodic values (N,) at equal steps over a length; the last row repeats the first one."""
    places = length * np.arange(len(values) + 1) / len(values)
    rows = (f"{a:.12g},{b:.7f}" for a, b in zip(places, np.append(values, values[0]), strict=True))
    return (header + "\n" + "\n".join(rows) + "\n").encode()


def quoted(words: str) -> str:
    """A text of TOML."""
    return '"' + words.replace("\\", "\\\\").replace('"', '\\"') + '"'


def place_words(z: complex) -> str:
    """A point in millimetres."""
    return f"[{1e3 * z.real:.9g}, {1e3 * z.imag:.9g}]"


_LIFT = 0.04  # of the pen, over the size of the drawing
_GUIDE = 0.3  # how far below the drawing the guide is, over its size


def plotter_scene(motion: PenMotion, period: float, *, title: str, name: str) -> Scene:
    """Two slides that draw, driven over time by the tables ``name-x.csv`` and ``name-y.csv`` of its folder, and a third that lifts.

    ``period`` [s]: of one turn of the motion.
    """
    low, high = motion.places.real.min() + 1j * motion.places.imag.min(), motion.places.real.max() + 1j * motion.places.imag.max()
    size = max((high - low).real, (high - low).imag)
    lift, below = _LIFT * size, low.imag - _GUIDE * size
    axes = {"x": motion.places.real, "y": motion.places.imag}
    files = {f"{name}-{axis}.csv": _table(values, period) for axis, values in axes.items()}
    last = f"{{ duration = {period:.12g}, law = {{ position = {{ file = %s, periodic = true }} }} }}"
    lines = [
        f"title = {quoted(title)}",
        'learning_goal = "A program of three axes in step: two slides lead the pen, a third one lifts it between strokes."',
        'units = { length = "mm", angle = "deg" }',
        "",
        "[run]",
        f"frames = {2 * len(motion.places)}",
        "",
        "[links]",
        f"frame = {{ points = {{ O = {place_words(1j * below)}, L = {place_words(high.real + 0.3 * size + 1j * low.imag)} }} }}",
        f"carriage = {{ points = {{ X = [0, 0], Q = {place_words(-1j * below)} }} }}",
        "pen = { points = { P = [0, 0] } }",
        "lifter = { points = { L = [0, 0] } }",
        "",
        "[pens.P]",
        'point = "pen.P"',
        'joint = "Z"',
        f"at_most = {1e3 * PEN_DOWN * lift:.6g}",
    ]
    guides = {"X": ("frame", "carriage", "O", "X", "[1, 0]"), "Y": ("carriage", "pen", "Q", "P", "[0, 1]")}
    for joint, (first, second, at, point, along) in guides.items():
        lines += [
            "",
            f"[joints.{joint}]",
            f'prismatic = ["{first}", "{second}"]',
            f'at = ["{at}", "{point}"]',
            f"along = {along}",
            f"drive.start = {1e3 * axes[joint.lower()][0]:.9g}",
            f"drive.segments = [{last % quoted(f'{name}-{joint.lower()}.csv')}]",
        ]
    steps = []
    for over, to in motion.lifts:
        goal = "" if to is None else f', to = {1e3 * lift * to:.6g}, law = "cycloidal"'
        steps.append(f"    {{ duration = {over * period / (2.0 * math.pi):.12g}{goal} }},")
    lines += [
        "",
        "[joints.Z]",
        'prismatic = ["frame", "lifter"]',
        'at = ["L", "L"]',
        "along = [0, 1]",
        "drive.start = 0",
        "drive.segments = [",
        *steps,
        "]",
    ]
    return loads("\n".join(lines) + "\n", name, SceneFolder(contents=files))


def _table(values: Real, period: float) -> bytes:
    return csv_table("time [s],position [mm]", period, 1e3 * np.asarray(values))
