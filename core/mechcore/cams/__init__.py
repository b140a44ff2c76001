"""Cams: synthesis, analysis, limits, forces; pure functions over arrays.

SI units and radians; plane vectors are complex numbers; angles have the shape (n), derivatives a leading axis (order + 1, n).

Conventions (theory of the lecture). The cam's centre O is the origin. A disc cam turns counter-clockwise by theta (``turn = -1``:
clockwise); its axes are the ground's at theta = 0, so that a ground point q is the cam point ``exp(-i turn theta) q``. A wedge
moves by -x. A translating follower moves up along x = offset, its coordinate is the height h of its reference point; an oscillating
one has the angle psi of its arm from the line pivot -> O. Reference points: knife tip, roller centre, centre of a mushroom's arc,
the middle of a flat face. Normals point from the cam to the follower, radii of curvature are positive where the cam is convex,
pressure angles are positive when the cam lifts the follower.

A tour of the package::

    lift = mechcore.laws.program([Segment(2.0, 0.02, "cycloidal"), Segment(1.0), Segment(1.6, 0.0, "3-4-5"), ...])
    follower = Follower(Translating(offset=0.01), Roller(0.008))        # guide x face
    cam = cam_on_base(lift, follower, base=0.04)                        # or Cam(law, follower) with absolute heights
    s = cam.at(theta)               # Synthesis: pitch, working, normal, contact, pressure_angle, radius, sharpness
    w = cam.working_curve(theta, order=3)    # the profile as a function with derivatives, in the cam's axes
    find_limits(cam); check_limits(cam, Requirement(...)); least_base(...); best_offset(...)
    contact = analyse(cam_contour(cam), follower, theta)                # or circle, bulged (DXF), spline_contour, polar_contour
    equivalent_linkage(s); graphical(...); closing_force(...); first_separation(...); hertz(...)
    SpatialCam(law, Barrel() | BarrelArm(...) | Globoid(...), roller, inner, outer).flank(theta, along, side)
    conjugate(cam, ...); breadth(law); InverseCam(...)

``followers`` guides and faces; ``synthesis`` plane cams, their equivalent linkage; ``limits``, ``sizing`` limits, and the search
for base circle and offset; ``pieces``, ``contour``, ``contact``, ``analysis`` given profiles; ``real_profiles`` their lift, the
graphical method, undercut profiles as cut; ``closures`` yokes, conjugate cams, closure by a spring, jamming, Hertz;
``spatial`` barrel, end, globoidal and inverse cams; ``placement`` cams in their mechanisms.
"""

from mechcore.cams.analysis import Bridge, Contact, analyse
from mechcore.cams.closures import (
    Breadth,
    Closure,
    HertzContact,
    Separation,
    breadth,
    closing_force,
    conjugate,
    first_separation,
    hertz,
    roller_range,
)
from mechcore.cams.contour import (
    Contour,
    arc,
    bulged,
    cam_contour,
    circle,
    line,
    polar_contour,
    polygon,
    spline_contour,
)
from mechcore.cams.followers import Arc, Flat, Follower, Knife, Oscillating, Roller, Translating
from mechcore.cams.limits import CamLimits, Reached, Requirement, Verdict, check_limits, find_limits, judge_limits, undercut_ranges
from mechcore.cams.real_profiles import CutProfile, Graphical, cut_profile, graphical
from mechcore.cams.sizing import Design, best_offset, least_base
from mechcore.cams.spatial import Barrel, BarrelArm, Flank, Globoid, InverseCam, SpatialCam, SpatialLimits, spatial_limits
from mechcore.cams.synthesis import (
    Cam,
    EquivalentLinkage,
    OffsetError,
    Synthesis,
    cam_on_base,
    equivalent_linkage,
    neglected_phase,
    simplified_offset_error,
)

__all__ = [
    "Arc",
    "Barrel",
    "BarrelArm",
    "Breadth",
    "Bridge",
    "Cam",
    "CamLimits",
    "Closure",
    "Contact",
    "Contour",
    "CutProfile",
    "Design",
    "EquivalentLinkage",
    "Flank",
    "Flat",
    "Follower",
    "Globoid",
    "Graphical",
    "HertzContact",
    "InverseCam",
    "Knife",
    "OffsetError",
    "Oscillating",
    "Reached",
    "Requirement",
    "Roller",
    "Separation",
    "SpatialCam",
    "SpatialLimits",
    "Synthesis",
    "Translating",
    "Verdict",
    "analyse",
    "arc",
    "best_offset",
    "breadth",
    "bulged",
    "cam_contour",
    "cam_on_base",
    "check_limits",
    "circle",
    "closing_force",
    "conjugate",
    "cut_profile",
    "equivalent_linkage",
    "find_limits",
    "first_separation",
    "graphical",
    "hertz",
    "judge_limits",
    "least_base",
    "line",
    "neglected_phase",
    "polar_contour",
    "polygon",
    "roller_range",
    "simplified_offset_error",
    "spatial_limits",
    "spline_contour",
    "undercut_ranges",
]
