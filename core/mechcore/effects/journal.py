"""A journal in its bearing: the force where they touch, and the losses there.

The normal force is that of Hunt and Crossley (Coefficient of restitution interpreted as damping in vibroimpact, 1975),
F = k d^n (1 + a d'), d the indentation; it needs no memory of the impact, pulls never, and starts and ends at zero. The effects
act on the massless journal of a `mechcore.spec.clearance` joint, so that the revolute joint that holds it transmits the whole
force.
"""

from __future__ import annotations

import math
from typing import TypeVar

import numpy as np

from mechcore.arrays import Complex, Index, Real
from mechcore.effects.base import Configuration, LoadEffect, Wrench, relative_speed
from mechcore.spec.loads import JournalContact, JournalLoss

AnyContact = TypeVar("AnyContact", bound=JournalContact)

PRESSING, LOSING, RUBBING = "contact", "contact loss", "contact friction"
IN_PAIRS = (PRESSING, LOSING, RUBBING)
"""Kinds of these wrenches: what they amount to is the reaction of their joint."""


def rubbing_name(joint: str) -> str:
    """Name of the moment of friction in the bearing of a joint with clearance."""
    return f"{joint} friction"


def loss_factor(restitution: float, speed: float) -> float:
    """The factor a [s/m] of F = k d^n (1 + a d') for which an impact at ``speed`` [m/s] rebounds with ``restitution`` (0 to 1) of
    it, whatever the masses, k and n.

    From m v dv = -F dd on the way in and out: x (1 + e) = ln((1 + x) / (1 - e x)) with x = a v.
    """
    from scipy.optimize import brentq

    if restitution >= 1.0:
        return 0.0
    e = restitution

    def left(x: float) -> float:
        return x * (1.0 + e) - math.log1p(x) + math.log1p(-e * x)

    low, high = 0.5 * (1.0 - e), (1.0 - 1e-15) / e  # the root lies above (1 - e): near it for small losses
    while left(low) < 0.0:
        low *= 0.5
    return float(brentq(left, low, high, xtol=1e-15, rtol=1e-14)) / speed


class _Journal(LoadEffect[AnyContact]):
    """Where the journal is in its bearing; results have a leading frame axis."""

    def eccentricity(self, at: Configuration, derivative: int = 0) -> Complex:
        """Journal's centre from the bearing's, or its rate, in the axes of the bearing's link (complex)."""
        x, y = (at.drives[at.model.driven[at.model.joint_index[joint]]][derivative] for joint in self.load.slides)
        return x + 1j * y

    def indentation(self, at: Configuration) -> tuple[Real, Complex, Real]:
        """How far the journal is pressed in (negative: free), the normal from bearing to journal, and k d^n [N]."""
        e = self.eccentricity(at)
        away = np.abs(e)
        load = self.load
        depth = away - load.radial
        pressed = np.maximum(depth, 0.0)
        normal = e / np.where(away > 0.0, away, 1.0)
        return depth, normal, load.stiffness * pressed * (pressed / load.radial) ** (load.exponent - 1.0)

    def between(self, at: Configuration, force: Complex, name: str, kind: str, moment: Real | float = 0.0) -> list[Wrench]:
        """``force`` (axes of the bearing's link) at the journal's centre on the journal, the opposite on the bearing; ``moment`` on
        the shaft, the opposite on the bearing."""
        model, load = at.model, self.load
        bearing, journal, shaft = (model.index[k] for k in load.links)
        place = at.origins[journal]
        turned = force * at.rotation(bearing)
        wrenches = [Wrench(name, kind, journal, turned, 0.0, 0j, self.cause, bearing, place - at.origins[bearing])]
        if moment is not None and np.any(moment):
            arms = place - at.origins[shaft], place - at.origins[bearing]
            wrenches.append(Wrench(rubbing_name(load.joint), RUBBING, shaft, 0j, moment, arms[0], self.cause, bearing, arms[1]))
        return wrenches

    @property
    def piecewise(self) -> bool:
        return True

    def phase(self, at: Configuration) -> Index:
        """1 where journal and bearing touch."""
        return 1 * (self.indentation(at)[0] > 0.0)


class JournalPressure(_Journal[JournalContact]):
    """The elastic part of the contact, k d^n; its energy is zero where they do not touch."""

    cause = "elastic"

    def wrenches(self, at: Configuration) -> list[Wrench]:
        _, normal, force = self.indentation(at)
        return self.between(at, -force * normal, self.name, PRESSING)

    def potential(self, at: Configuration) -> Real:
        depth, _, force = self.indentation(at)
        return force * np.maximum(depth, 0.0) / (self.load.exponent + 1.0)


class JournalFriction(_Journal[JournalLoss]):
    """Losses in the contact: the part a d' of the normal force, and friction of the coefficient mu between the surfaces,
    smooth at rest: mu N v / sqrt(v^2 + slow^2)."""

    cause = "viscous"
    needs = frozenset({"positions", "velocities"})

    def wrenches(self, at: Configuration) -> list[Wrench]:
        load = self.load
        _, normal, force = self.indentation(at)
        rate = self.eccentricity(at, 1)
        inward = np.real(np.conj(normal) * rate)
        lost = force * np.maximum(load.loss * inward, -1.0)  # surfaces only press on each other
        on_journal = -lost * normal
        moment: Real | float = 0.0
        if load.friction:
            bearing, _, shaft = (at.model.index[k] for k in load.links)
            slip = np.real(np.conj(1j * normal) * rate) + load.radius * relative_speed(at, bearing, shaft)
            rub = load.friction * (force + lost) * slip / np.sqrt(slip * slip + load.slow**2)
            on_journal = on_journal - rub * 1j * normal
            moment = -load.radius * rub
        return self.between(at, on_journal, self.name, LOSING, moment)

    def phase(self, at: Configuration) -> Index:
        """1 where they touch, 2 where they part so fast that nothing presses any more."""
        depth, normal, _ = self.indentation(at)
        parting = self.load.loss * np.real(np.conj(normal) * self.eccentricity(at, 1)) < -1.0
        return np.where(depth > 0.0, 1 + parting, 0)
