"""Pitch curves of disc cams from their laws of lift, for the constraints in absolute coordinates."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mechcore import spec as sp

if TYPE_CHECKING:
    from absolute_constraints import Constraints

TURN = 2.0 * np.pi


class Cam:
    """The pitch curve of a disc cam in the axes of its link, by the cam's angle at which the follower stands there."""

    def __init__(self, joint: sp.CamJoint, second: Constraints):
        self.joint = joint
        guide = second.joint[joint.guide]
        self.cam, self.follower = (second.body[k] for k in joint.links)
        carrier = next(k for k in guide.links if k != joint.links[1])
        assert carrier == second.m.frame
        pin = next(p for p in second.m.joints if isinstance(p, sp.Revolute) and set(p.links) == {carrier, joint.links[0]})
        self.axis = second.at(carrier, pin.points[pin.links.index(carrier)])
        self.own = second.at(joint.links[0], pin.points[pin.links.index(joint.links[0])])
        self.radius = 0.0 if self.flat else joint.face.radius
        point = second.at(joint.links[1], joint.point)
        if isinstance(guide, sp.Prismatic):
            side = guide.links.index(carrier)
            assert guide.guide == side
            self.up = second.direction(guide)
            turn = guide.angle if side == 0 else -guide.angle
            own = second.at(joint.links[1], guide.points[1 - side])
            foot = second.at(carrier, guide.points[side]) + np.exp(1j * turn) * (point - own)
            self.offset = float(((foot - self.axis) / (self.up / 1j)).real)
            self.arm = 0.0
        else:
            side = guide.links.index(carrier)
            self.pivot = second.at(carrier, guide.points[side])
            self.arm = abs(point - second.at(joint.links[1], guide.points[1 - side]))
            self.left = 1.0 if joint.side == "left" else -1.0

    @property
    def flat(self) -> bool:
        return type(self.joint.face).__name__ == "Flat"

    def lift(self, x: float) -> tuple[float, float, float]:
        """Lift and derivatives by the argument of the law."""
        assert self.joint.lift is not None
        x = float(np.mod(x, TURN))
        for piece in self.joint.lift.pieces:
            if x <= piece.length:
                break
            x -= piece.length
        out = [0.0, 0.0, 0.0]
        p = np.polynomial.Polynomial(piece.poly)
        for k in range(3):
            out[k] += float(p.deriv(k)(x)) if k else float(p(x))
        for w, a, b in piece.waves:
            s, c = np.sin(w * x), np.cos(w * x)
            out[0] += a * s + b * c
            out[1] += w * (a * c - b * s)
            out[2] += -w * w * (a * s + b * c)
        return out[0], out[1], out[2]

    def reference(self, x: float) -> tuple[complex, complex, complex]:
        """The follower's point as the frame sees it from the cam's axis, and derivatives by the argument."""
        h, h1, h2 = self.lift(x)
        if not self.arm:
            base = np.sqrt((self.joint.base + self.radius) ** 2 - self.offset**2)
            return (base + h) * self.up + self.offset * self.up / 1j, h1 * self.up, h2 * self.up
        towards = self.axis - self.pivot
        d, reach = abs(towards), self.joint.base + self.radius
        psi = np.arccos((d * d + self.arm**2 - reach**2) / (2.0 * d * self.arm)) + h
        e = self.arm * towards / d * np.exp(1j * self.left * psi)
        first = 1j * self.left * e * h1
        return self.pivot - self.axis + e, first, 1j * self.left * (e * h2 + 1j * self.left * e * h1 * h1)

    def curve(self, x: float) -> tuple[complex, complex, complex]:
        """Place in the cam's axes, from the cam's axis, and derivatives by the argument: the cam's angle is sense (x - phase)."""
        s = float(self.joint.sense)
        turn = np.exp(-1j * s * (x - self.joint.phase))
        z, z1, z2 = self.reference(x)
        return turn * z, turn * (z1 - 1j * s * z), turn * (z2 - 2j * s * z1 - z)
