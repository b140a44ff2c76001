"""The pressure of a gas on a piston, from an indicator diagram."""

from __future__ import annotations

import numpy as np

from mechcore.arrays import Flags, Index, Real, Values
from mechcore.effects.base import Configuration, LoadEffect, Wrench, coordinate, rate
from mechcore.errors import Fault, MechanismError
from mechcore.spec.loads import GasPressure
from mechcore.texts import as_length

OVER = 1e-6  # part of the stroke by which rounding may carry the piston past its dead centres


class CylinderGas(LoadEffect[GasPressure]):
    """On the piston, and on the cylinder's head the opposite. The branch of the diagram follows from the sense of the motion."""

    needs = frozenset({"positions", "velocities"})

    limited = True

    def _from_top(self, at: Configuration) -> Values:
        """Distance of the piston from top dead centre [m]."""
        away = self.load.top - coordinate(at, self.load.joint)
        return away if self.load.head == "ahead" else -away

    def displacement(self, at: Configuration) -> Real:
        """Distance of the piston from top dead centre [m], within the stroke."""
        within: Real = np.clip(self._from_top(at), 0.0, self.load.cycle.stroke)
        return within

    def check(self, at: Configuration) -> None:
        load, x = self.load, self._from_top(at)
        low, high = float(np.nanmin(x)), float(np.nanmax(x))
        stroke = load.cycle.stroke
        if low < -OVER * stroke or high > (1.0 + OVER) * stroke:
            sign = -1.0 if load.head == "ahead" else 1.0
            why = (
                f"the piston leaves its stroke: the coordinate of {load.joint} runs from {as_length(load.top + sign * low)} to "
                f"{as_length(load.top + sign * high)}; stated are top = {as_length(load.top)}, stroke = {as_length(stroke)}, "
                f"head {load.head}."
            )
            raise MechanismError(Fault(f"loads.{self.name}", why, "Give the dead centres of this mechanism as top and stroke."))

    def _strokes(self, at: Configuration) -> tuple[Real, Flags, Flags]:
        """Displacement [m], whether the piston moves away from the head, whether the gas fires in this turn."""
        load = self.load
        x = self.displacement(at)
        speed = rate(at, load.joint)
        outward: Flags = np.less_equal(speed, 0.0) if load.head == "ahead" else np.greater_equal(speed, 0.0)
        firing = np.ones(np.shape(outward), bool)
        if load.cycle.strokes == 4:
            # the piston says where a stroke ends, the crank only which turn it is: counted from a quarter of a turn before the
            # top dead centre in strokes that lead away from it, and up to a quarter of a turn behind it in those that lead to it
            joint = load.drive if load.drive is not None else at.model.mechanism.drives[0].joint
            turned = (coordinate(at, joint) - load.fires) * np.where(rate(at, joint) < 0.0, -1.0, 1.0)
            firing = np.mod(turned + np.where(outward, 0.5 * np.pi, 1.5 * np.pi), 4.0 * np.pi) < 2.0 * np.pi
        return x, outward, firing

    def pressure(self, at: Configuration) -> Real:
        """Absolute pressure in the cylinder [Pa]."""
        return self.load.cycle.pressure(*self._strokes(at))

    @property
    def piecewise(self) -> bool:
        return True

    def phase(self, at: Configuration) -> Index:
        x, outward, firing = self._strokes(at)
        part = getattr(self.load.cycle, "part", None)
        return 2 * outward + firing + (0 if part is None else 4 * part(x, outward, firing))

    def switch(self, at: Configuration) -> Values | None:
        return rate(at, self.load.joint)  # branches of the diagram meet at dead centres; valves open without a jump

    def wrenches(self, at: Configuration) -> list[Wrench]:
        load, model = self.load, at.model
        j = model.joint_index[load.joint]
        guide = model.joints[j].guide
        piston, cylinder = model.ends[j][1 - guide], model.ends[j][guide]
        push = (self.pressure(at) - load.back) * load.area
        along = at.guide(j) * (-1.0 if load.head == "ahead" else 1.0)
        place = at.joint_point(j)
        arm, other_arm = place - at.origins[piston], place - at.origins[cylinder]
        return [Wrench(self.name, "gas", piston, push * along, 0.0, arm, self.cause, cylinder, other_arm)]
