"""Smooth pieces of given profiles on [0, 1], with exact derivatives; plane vectors as complex numbers."""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import cached_property
from typing import Protocol

import numpy as np

from mechcore.arrays import Complex, Real
from mechcore.cams.followers import Flat
from mechcore.cams.synthesis import Cam
from mechcore.laws.curve import MotionCurve
from mechcore.numerics import jets
from mechcore.records import dataclass


class Smooth(Protocol):
    """A smooth piece on [0, 1]."""

    def __call__(self, u: Real, order: int) -> Complex:
        """Parameters (n) -> points and derivatives (order + 1, n)."""
        ...

    def offset(self, u: Real, distance: float, order: int) -> Complex:
        """The curve ``distance`` to the right of the direction of travel, with derivatives (order + 1, n)."""
        ...


class _Offset(ABC):
    """The offset of any piece whose own derivatives go one order further."""

    @abstractmethod
    def __call__(self, u: Real, order: int) -> Complex: ...

    def offset(self, u: Real, distance: float, order: int) -> Complex:
        c = self(u, order + 1)
        return c[: order + 1] - 1j * distance * jets.unit(c[1:])


@dataclass(frozen=True)
class StraightPiece(_Offset):
    a: complex
    b: complex

    def __call__(self, u: Real, order: int) -> Complex:
        out = np.zeros((order + 1, np.size(u)), complex)
        out[0] = self.a + (self.b - self.a) * u
        if order > 0:
            out[1] = self.b - self.a
        return out


@dataclass(frozen=True)
class ArcPiece(_Offset):
    centre: complex
    radius: float
    start: float
    sweep: float

    def __call__(self, u: Real, order: int) -> Complex:
        k = np.arange(order + 1)[:, None]
        out = (1j * self.sweep) ** k * self.radius * np.exp(1j * (self.start + self.sweep * np.asarray(u)))
        out[0] += self.centre
        return np.asarray(out)


@dataclass(frozen=True, eq=False)
class PolynomialPiece(_Offset):
    """Complex polynomial, ascending coefficients in u."""

    c: Complex

    def __call__(self, u: Real, order: int) -> Complex:
        out = np.empty((order + 1, np.size(u)), complex)
        c = self.c
        for k in range(order + 1):
            out[k] = np.polynomial.polynomial.polyval(u, c) if len(c) else 0.0
            c = c[1:] * np.arange(1, len(c))
        return out


@dataclass(frozen=True, eq=False)
class PolarPiece(_Offset):
    """r(phi) exp(i phi) from phi0 over a range, r one piece of a motion curve."""

    law: MotionCurve
    phi0: float
    span: float

    def __call__(self, u: Real, order: int) -> Complex:
        phi = self.phi0 + self.span * np.asarray(u)
        inside = np.clip(phi, self.phi0 + 1e-15, self.phi0 + self.span)  # the piece's own limits at both ends
        r = self.law(inside, order, "left")
        turn = (1j ** np.arange(order + 1))[:, None] * np.exp(1j * phi)
        return np.asarray(jets.product(r, turn) * (self.span ** np.arange(order + 1))[:, None])


@dataclass(frozen=True, eq=False)
class CamPiece:
    """A range of a synthesised cam between two knots of its law, run so that the outside is on the right."""

    cam: Cam
    piece: int
    backwards: bool
    first: float = 0.0  # share of the law's piece at which this one begins and ends
    last: float = 1.0

    @cached_property
    def _single(self) -> Cam:
        piece, x0 = self.cam.law.pieces[self.piece], self.cam.law.knots[self.piece]
        return Cam(MotionCurve((piece,), float(x0)), self.cam.follower, self.cam.turn, self.cam.wedge, self.cam.outer)

    def _curve(self, u: Real, distance: float, order: int) -> Complex:
        law = self.cam.law
        piece, x0 = law.pieces[self.piece], law.knots[self.piece]
        s = self.first + (self.last - self.first) * (1.0 - u if self.backwards else np.asarray(u))
        single = self._single
        angle = x0 + piece.length * s
        # extrapolation beyond the ends is the piece's own analytic continuation
        if isinstance(self.cam.follower.face, Flat):
            w = single.working_curve(angle, order + 1 if distance else order, "left")
            if distance:
                outward = 1j * jets.unit(w[1:]) * np.where(np.real(self._along(single, angle, w)) < 0.0, -1.0, 1.0)
                w = w[: len(outward)] + distance * outward
            w = w[: order + 1]
        else:
            p = single.pitch_curve(angle, order + 1, "left")
            shift = distance - self.cam.flank * self.cam.follower.radius
            w = p[: order + 1] + shift * 1j * self.cam.turn * jets.unit(p[1:]) if shift else p[: order + 1]
        rate = piece.length * (self.last - self.first) * (-1.0 if self.backwards else 1.0)
        return w * (rate ** np.arange(len(w)))[:, None]

    @staticmethod
    def _along(cam: Cam, angle: Real, w: Complex) -> Complex:
        """Positive where the profile runs along the face's direction."""
        s = cam.at(angle)
        return np.asarray(np.conj(s.normal / 1j) * w[1])

    def __call__(self, u: Real, order: int) -> Complex:
        return self._curve(u, 0.0, order)

    def offset(self, u: Real, distance: float, order: int) -> Complex:
        return self._curve(u, distance, order)


@dataclass(frozen=True, eq=False)
class MovedPiece:
    """A piece turned (and stretched by 1) and shifted: ``shift + turn z``."""

    piece: Smooth
    shift: complex
    turn: complex

    def __call__(self, u: Real, order: int) -> Complex:
        out = self.turn * self.piece(u, order)
        out[0] += self.shift
        return out

    def offset(self, u: Real, distance: float, order: int) -> Complex:
        out = self.turn * self.piece.offset(u, distance, order)
        out[0] += self.shift
        return out


def moved_piece(piece: Smooth, shift: complex, turn: complex) -> Smooth:
    """A turned and shifted piece; lines, arcs and polynomials stay what they are."""
    if isinstance(piece, StraightPiece):
        return StraightPiece(shift + turn * piece.a, shift + turn * piece.b)
    if isinstance(piece, ArcPiece):
        return ArcPiece(shift + turn * piece.centre, piece.radius, piece.start + float(np.angle(turn)), piece.sweep)
    if isinstance(piece, PolynomialPiece):
        c = turn * piece.c
        c[0] += shift
        return PolynomialPiece(c)
    return MovedPiece(piece, shift, turn)
