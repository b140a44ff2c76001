"""Closed forms for the loop equations with two unknowns: these solve every dyad (Assur group of class II).

In the loop form there are only four, whatever the order of revolute and prismatic joints in the group:

============== ================================== ==================
`theta_theta`  ``A e1 + B e2 = C``                RRR
`theta_slide`  ``A e + s D = C``                  RRP, PRR
`arm_slide`    ``(A + s d) e = C``                RPR
`slide_slide`  ``s1 D1 + s2 D2 = C``              RPP, PRP, PPR
============== ================================== ==================

with ``e = exp(i angle)``, |D| = |d| = 1. All arguments broadcast, frames last. Where the links do not meet, the result is NaN, and
`error_*` gives the closure error. ``mode`` (+1 or -1) is the assembly mode: it is an input and never guessed.
"""

from __future__ import annotations

from typing import overload

import numpy as np

from mechcore.arrays import Complex, Flags, Plane, Real, Values, modulus
from mechcore.numerics.frames import QUIET, determined

ROUNDING = 4e-15  # relative closure error below which links count as meeting, at a dead point


@overload
def cross(a: Complex, b: Complex) -> Real: ...
@overload
def cross(a: Plane, b: Plane) -> Values: ...
def cross(a: Plane, b: Plane) -> Values:
    """z component of the cross product of plane vectors (...) -> (...)."""
    return a.real * b.imag - a.imag * b.real


def four_areas(a: Values, b: Values, d: Values) -> Real:
    """Four times the area of triangles with sides a, b, d (...) [m] -> (...) [m^2]; NaN where they do not close.

    Heron's formula as a product of differences of sides, after W. Kahan, "Miscalculating Area and Angles of a Needle-like
    Triangle": near a dead point the triangle is a needle. At a relative distance of 1e-12 from it this formula keeps all digits of
    the sides, the cosine rule keeps 5. (Kahan also sorts the sides. Here ``d`` is a computed distance, whose own rounding error is
    as large as what sorting would save.)
    """
    total, difference = a + b, modulus(a - b)
    short, spare = total - d, d - difference
    product = total + d
    product *= short
    product *= spare
    product *= d + difference
    if not np.minimum.reduce(product, axis=None, initial=0.0) >= 0:
        least = -ROUNDING * total
        product = _rounded(product, (short > least) & (spare > least))
    root: Real = np.sqrt(product)
    return root


def _rounded(square: Values, close: Flags | bool) -> Values:
    """The radicand: NaN where it is negative, zero where it is negative by rounding only (``close``)."""
    return np.where(square < 0, np.where(close, 0.0, np.nan), square)


def leg(r: Values, y: Values) -> Real:
    """Other leg of right triangles with hypotenuse r and leg y (...) [m] -> (...) [m]; NaN where |y| > r."""
    product = r - y
    product *= r + y
    if not np.minimum.reduce(product, axis=None, initial=0.0) >= 0:
        product = _rounded(product, modulus(y) - r < ROUNDING * r)
    root: Real = np.sqrt(product)
    return root


def _quotient(z: Plane, by: Plane) -> Plane:
    """z / by; if ``by`` is of numpy, without its warnings, which complex quotients give even for NaN."""
    if type(by) is complex:  # excludes numpy's complex128, a subclass
        return z / by
    with np.errstate(**QUIET):
        return z / by


def _with_mode(x: Real, mode: Values) -> Real:
    return x if isinstance(mode, float) and mode == 1.0 else mode * x


def theta_theta(a: Plane, b: Plane, c: Plane, mode: Values) -> tuple[Complex, Complex]:
    """e1, e2 of ``a e1 + b e2 = c``. mode +1: the vector ``a e1`` lies left of ``c``.

    Both rotations have modulus 1, and the sum closes to a few rounding errors however thin the triangle is, because the
    components along and across ``c`` are each accurate in the relative sense.
    """
    ra, rb, d2 = modulus(a), modulus(b), (c * c.conjugate()).real
    half = 0.5 / determined(d2)
    across = _with_mode(half * four_areas(ra, rb, np.sqrt(d2)), mode)
    apex: Complex = np.empty(across.shape, complex)
    np.multiply((ra - rb) * (ra + rb), half, out=apex.real)
    apex.imag = across
    e1: Complex = 0.5 + apex
    e2: Complex = 0.5 - apex
    e1 *= c
    e2 *= c
    e1 *= _quotient(1.0, a)
    e2 *= _quotient(1.0, b)
    return e1, e2


def error_theta_theta(a: Plane, b: Plane, c: Plane) -> Values:
    """Closure error of a theta_theta group (...) [m]: the gap between its links, 0 where they meet."""
    ra, rb, d = modulus(a), modulus(b), modulus(c)
    error: Values = np.maximum(np.maximum(d - (ra + rb), modulus(ra - rb) - d), 0.0)
    return error


def theta_slide(a: Plane, along: Plane, c: Plane, mode: Values) -> tuple[Complex, Values]:
    """e, s of ``a e + s along = c``. mode +1: the end of ``a`` lies ahead, in the direction of ``along``, mode -1: behind."""
    turned = c if isinstance(along, complex) and along == 1 else c * along.conjugate()
    ra, y = modulus(a), turned.imag
    x = _with_mode(leg(ra, y), mode)
    e = np.empty(x.shape, complex)
    e.real, e.imag = x, y
    e *= _quotient(along, a)
    return e, turned.real - x


def error_theta_slide(a: Plane, along: Plane, c: Plane) -> Values:
    """Closure error of a theta_slide group (...) [m]: the gap between the link's end and the guide, 0 where they meet."""
    error: Values = np.maximum(modulus((c * along.conjugate()).imag) - modulus(a), 0.0)
    return error


def arm_slide(a: Plane, d: Plane, c: Plane, mode: Values) -> tuple[Plane, Values]:
    """e, s of ``(a + s d) e = c``. mode +1: the slide lies ahead of the foot of the perpendicular on the guide, -1: behind."""
    foot = a * d.conjugate()
    r, y = modulus(c), foot.imag
    x = _with_mode(leg(r, y), mode)
    return _quotient(c * d.conjugate(), x + 1j * y), x - foot.real


def error_arm_slide(a: Plane, d: Plane, c: Plane) -> Values:
    """Closure error of an arm_slide group (...) [m]: the gap between the guide and the point, 0 where they meet."""
    error: Values = np.maximum(modulus((a * d.conjugate()).imag) - modulus(c), 0.0)
    return error


def slide_slide(d1: Plane, d2: Plane, c: Plane) -> tuple[Values, Values]:
    """s1, s2 of ``s1 d1 + s2 d2 = c``; NaN where the guides are parallel."""
    det = determined(np.asarray(cross(d1, d2)))
    return np.divide(cross(c, d2), det), np.divide(cross(d1, c), det)
