"""Peers on mechanisms of several freedoms: Pinocchio on the double pendulum and on the five-bar, with scipy's DOP853.

Each function returns a job that runs once from the start and gives the final angle of the first drive [rad].
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from dynamics_peers import by_scipy

from mechcore.motion.solve import compile_mechanism, solve_motion
from mechcore.spec.mechanism import Mechanism

__all__ = ["pinocchio_five_bar", "pinocchio_pendulum"]


def _tree(mechanism: Mechanism, hinges: Sequence[tuple[str, str, str]]) -> tuple[Any, dict[str, int], np.ndarray]:
    """A tree of hinges (parent, link, point), with the number of each link's joint; joint angles and their rates at the start, as
    mechviz puts the mechanism together."""
    import pinocchio as pin

    start = solve_motion(compile_mechanism(mechanism), [0.0])
    links = {link.name: link for link in mechanism.links}
    model, index = pin.Model(), {mechanism.frame: 0}
    model.gravity.linear = np.array([*mechanism.gravity, 0.0])
    q, v = [], []
    for parent, name, point in hinges:
        place = pin.SE3(np.eye(3), np.array([*links[parent].points[point], 0.0]))
        index[name] = model.addJoint(index[parent], pin.JointModelRZ(), place, name)
        link = links[name]
        inertia = pin.Inertia(link.mass, np.array([*link.centre, 0.0]), np.diag([1e-9, 1e-9, link.inertia]))
        model.appendBodyToJoint(index[name], inertia, pin.SE3.Identity())
        q.append(start.pose(name)[0, 2] - start.pose(parent)[0, 2])
        v.append(start.velocity(name)[0, 2] - start.velocity(parent)[0, 2])
    return model, index, np.array([*q, *v])


def pinocchio_pendulum(mechanism: Mechanism, tolerance: float, duration: float) -> Callable[[], float]:
    """`aba`, the articulated-body algorithm: an open chain needs nothing else."""
    import pinocchio as pin

    model, _, start = _tree(mechanism, [("frame", "upper", "O"), ("upper", "lower", "J")])
    data, tau, n = model.createData(), np.zeros(model.nv), model.nq

    def rhs(_: float, y: np.ndarray) -> np.ndarray:
        return np.concatenate([y[n:], pin.aba(model, data, y[:n], y[n:], tau)])

    return lambda: by_scipy(rhs, start, duration, tolerance, "DOP853")


def pinocchio_five_bar(mechanism: Mechanism, tolerance: float, duration: float) -> Callable[[], float]:
    """Both arms with their rods as a tree, closed at C, `constraintDynamics` without correction: at these tolerances the integrator
    keeps the loop closed by itself."""
    import pinocchio as pin

    hinges = [("frame", "left", "A"), ("left", "left rod", "B"), ("frame", "right", "E"), ("right", "right rod", "D")]
    model, index, start = _tree(mechanism, hinges)
    (x, y_), (u, w) = (next(k for k in mechanism.links if k.name == name).points["C"] for name in ("left rod", "right rod"))
    ends = [pin.SE3(np.eye(3), np.array([*at, 0.0])) for at in ((x, y_), (u, w))]
    closed = pin.RigidConstraintModel(
        pin.ContactType.CONTACT_3D, model, index["left rod"], ends[0], index["right rod"], ends[1],
        pin.ReferenceFrame.LOCAL_WORLD_ALIGNED,
    )  # fmt: skip
    closed.setBaumgarteCorrectorParameters(pin.BaumgarteCorrectorParameters(0.0, 0.0))
    constraints, datas = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
    constraints.append(closed)
    datas.append(closed.createData())
    data, n = model.createData(), model.nq
    pin.initConstraintDynamics(model, data, constraints, datas)
    settings = pin.ProximalSettings(1e-12, 1e-12, 20)
    springs = [(index[load.links[1]] - 1, load.stiffness, load.free_angle) for load in mechanism.loads]
    tau = np.zeros(model.nv)

    def rhs(_: float, y: np.ndarray) -> np.ndarray:
        for k, stiffness, free in springs:
            tau[k] = -stiffness * (y[k] - free)
        return np.concatenate([y[n:], pin.constraintDynamics(model, data, y[:n], y[n:], tau, constraints, datas, settings)])

    return lambda: by_scipy(rhs, start, duration, tolerance, "DOP853")
