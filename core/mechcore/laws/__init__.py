"""Laws of motion.

``timed``: drives, a coordinate as a function of time (constant speed, zones, oscillation, segments, tables).
``curve``: ``MotionCurve``, a coordinate as a piecewise analytic function of a master angle, exact derivatives of any order;
``catalogue``: the rise laws of the literature (``rise("cycloidal")``), all normalised 0 -> 1 over 0 -> 1, and
the families behind them (sine-constant-cosine acceleration, sums of harmonics); ``boundary_conditions``: polynomials and B-splines
from conditions, measured tables smoothed, laws given by acceleration or velocity;
``segment_laws``: laws between the states at the two ends of a segment (polynomials, splines, given accelerations and velocities,
least peaks); ``program``: segments over a turn or over time, and drives that follow a master angle (several axes on one master);
``factors``: jumps, extremes and the peak factors Cv, Ca, Cj;
``signals``: sine, step, ramp and chirp, which loads and the speeds of drives follow.
"""

from mechcore.laws.boundary_conditions import (
    BoundaryCondition,
    Smoothing,
    from_acceleration,
    measured_table,
    polynomial_law,
    spline_law,
)
from mechcore.laws.catalogue import RISES, acceleration_zones, harmonic_sum, rise, scca
from mechcore.laws.curve import MotionCurve
from mechcore.laws.factors import Jump, LawExtreme, PeakFactors, extremes, jumps, peak, peak_factors
from mechcore.laws.program import CurveOverMaster, Segment, over_time, program
from mechcore.laws.segment_laws import (
    BoundaryPolynomial,
    Dwell,
    GivenAcceleration,
    GivenPosition,
    GivenVelocity,
    LeastPeak,
    NormalisedLaw,
    OptimalLaw,
    SegmentLaw,
    Spline,
    fourier_curve,
    joined_table,
    least_peak,
)
from mechcore.laws.signals import Chirp, Ramp, Signal, SignalPosition, SignalSpeed, Sine, Step
from mechcore.laws.timed import (
    ConstantSpeed,
    Law,
    Oscillation,
    Piecewise,
    Rest,
    Table,
    TableLaw,
    moves,
    zones,
)

__all__ = [
    "RISES",
    "BoundaryCondition",
    "BoundaryPolynomial",
    "Chirp",
    "ConstantSpeed",
    "CurveOverMaster",
    "Dwell",
    "GivenAcceleration",
    "GivenPosition",
    "GivenVelocity",
    "Jump",
    "Law",
    "LawExtreme",
    "LeastPeak",
    "MotionCurve",
    "NormalisedLaw",
    "OptimalLaw",
    "Oscillation",
    "PeakFactors",
    "Piecewise",
    "Ramp",
    "Rest",
    "Segment",
    "SegmentLaw",
    "Signal",
    "SignalPosition",
    "SignalSpeed",
    "Sine",
    "Smoothing",
    "Spline",
    "Step",
    "Table",
    "TableLaw",
    "acceleration_zones",
    "extremes",
    "fourier_curve",
    "from_acceleration",
    "harmonic_sum",
    "joined_table",
    "jumps",
    "least_peak",
    "measured_table",
    "moves",
    "over_time",
    "peak",
    "peak_factors",
    "polynomial_law",
    "program",
    "rise",
    "scca",
    "spline_law",
    "zones",
]
