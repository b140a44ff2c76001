"""Inverse tasks of a lecture: a link from the accelerations of two of its points, a moment of inertia from the times of a swing."""

import cmath
import math

from mechcore.reduction.inverse import inertia_from_swing, inertia_from_two_swings, rates_from_accelerations
from mechcore.reduction.substitute import PointMass, substitute_masses

# S is the origin; 20 m/s² at 50° in A, 30 m/s² at 140° in B
a, b = -0.5 + 0j, math.cos(math.radians(30.0)) - 0.5 - 0.5j
rates = rates_from_accelerations(a, b, cmath.rect(20.0, math.radians(50.0)), cmath.rect(30.0, math.radians(140.0)))
mass, inertia = 10.0, 2.0
force, moment = -mass * rates.at(0j), -inertia * rates.alpha
print(f"omega = ±{rates.omega_squared**0.5:.4f} rad/s, alpha = {rates.alpha:.4f} rad/s²")
print(f"inertia force ({force.real:.3f}, {force.imag:.3f}) N, inertia moment {moment:.3f} N m")

known = [PointMass(None, a.real, a.imag), PointMass(None, b.real, b.imag), PointMass(None, None, 0.2)]
for masses, places in substitute_masses(mass, inertia, known).solutions:
    parts = [-m * rates.at(complex(*xy)) for m, xy in zip(masses, places, strict=True)]
    print(
        "point masses " + ", ".join(f"{m:.4f} kg" for m in masses) + f": together ({sum(parts).real:.3f}, {sum(parts).imag:.3f}) N"
    )

axis, centre = inertia_from_swing(mass=1.5, distance=0.35, period=1.7544, amplitude=math.radians(10.0))
print(f"a swing of 1.7544 s about an axis 350 mm from S: {axis:.5f} kg m² about it, {centre:.5f} kg m² about S")
distance, centre = inertia_from_two_swings(mass=2.0, apart=0.55, periods=(1.4192, 1.3994))
print(f"swings about two axes 550 mm apart: S is {1e3 * distance:.1f} mm from the first, {centre:.5f} kg m² about S")
