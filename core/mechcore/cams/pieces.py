"""Smooth pieces of given profiles on [0, 1], with exact derivatives; plane vectors as complex numbers."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Protocol

import numpy as np

from mechcore.arrays import Complex, Index, Real, numbers
from mechcore.cams.followers import Flat
from mechcore.cams.synthesis import Cam
from mechcore.laws.curve import MotionCurve
from mechcore.numerics import jets
from mechcore.records import dataclass


class SmoothPiece(Protocol):
    """A smooth piece on [0, 1]."""

    def __call__(self, u: Real, order: int) -> Complex:
        """Parameters (n) -> points and derivatives (order + 1, n)."""
        ...

    def offset(self, u: Real, distance: float, order: int) -> Complex:
        """The curve ``distance`` to the right of the direction of travel, with derivatives (order + 1, n)."""
        ...


class _Offset(ABC):
    """The offset of any piece, from the derivatives of the piece up to one order more."""

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
        return np.asarray(jets.jet_product(r, turn) * (self.span ** np.arange(order + 1))[:, None])


@dataclass(frozen=True, eq=False)
class CamPiece:
    """A range of a synthesised cam between two knots of its law, traversed so that the outside is on the right."""

    cam: Cam
    piece: int
    backwards: bool
    first: float = 0.0  # share of the law's piece at which this one begins and ends
    last: float = 1.0

    @property
    def ends(self) -> tuple[float, float]:
        """Shares of the law's piece at parameters 0 and 1."""
        return (self.last, self.first) if self.backwards else (self.first, self.last)

    def __call__(self, u: Real, order: int) -> Complex:
        return self.offset(u, 0.0, order)

    def offset(self, u: Real, distance: float, order: int) -> Complex:
        u = numbers(u)
        ends = np.repeat(np.array([self.ends]).T, u.size, axis=1)
        return on_cam(self.cam, np.full(u.size, self.piece), ends, u, distance, order)


def ends_of(cam: Cam, pieces: Sequence[CamPiece], distance: float) -> tuple[Complex, Complex]:
    """Starts and ends (n) of ranges of a cam, ``distance`` outside the profile."""
    ends = np.array([p.ends for p in pieces]).T
    own, zeros = np.array([p.piece for p in pieces]), np.zeros(len(pieces))
    return on_cam(cam, own, ends, zeros, distance, 0)[0], on_cam(cam, own, ends, zeros + 1.0, distance, 0)[0]


def on_cam(cam: Cam, piece: Index, ends: Real, u: Real, distance: float, order: int) -> Complex:
    """Points ``distance`` outside the profile, with derivatives (order + 1, n), at parameters ``u`` (n) of ranges of the law's
    pieces (n). ``ends`` (2, n): shares of the piece at which a range begins and ends. Pieces are continued beyond their ends."""
    length = cam.law.lengths[piece]
    share = ends[1] - ends[0]
    angle = cam.law.knots[piece] + length * (ends[0] + share * u)
    if isinstance(cam.follower.face, Flat):
        w = cam.working_curve(angle, order + 1 if distance else order, piece)
        if distance:  # the profile runs along the face's direction, or against it
            along = np.real(np.conj(cam.at(angle, piece=piece).normal / 1j) * w[1])
            w = w[: order + 1] + distance * 1j * jets.unit(w[1:]) * np.where(along < 0.0, -1.0, 1.0)
    else:
        p = cam.pitch_curve(angle, order + 1, piece)
        shift = distance - cam.flank * cam.follower.radius
        w = p[: order + 1] + shift * 1j * cam.turn * jets.unit(p[1:]) if shift else p[: order + 1]
    return np.asarray(w * (share * length) ** np.arange(order + 1)[:, None])


@dataclass(frozen=True, eq=False)
class MovedPiece:
    """A piece turned by a unit number and shifted: ``shift + turn z``."""

    piece: SmoothPiece
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


def moved_piece(piece: SmoothPiece, shift: complex, turn: complex) -> SmoothPiece:
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
