"""Drake: positions by its inverse kinematics; forces by inverse dynamics with the closing pin cut and closed by hand.

The reactions of the pins follow from its accelerations of the bodies by Newton's law.
"""

from __future__ import annotations

import numpy as np
from problem import FOUR_BAR, GRAVITY, SLIDER_CRANK

PACKAGES = ("drake==1.51.1",)
LARGE = True


def plant_of(bodies):
    """A plant from (name, parent, place on the parent, slides, mass, centre, inertia)."""
    from pydrake.math import RigidTransform
    from pydrake.multibody.plant import MultibodyPlant
    from pydrake.multibody.tree import FixedOffsetFrame, PrismaticJoint, RevoluteJoint, SpatialInertia, UnitInertia

    plant = MultibodyPlant(0.0)
    plant.mutable_gravity_field().set_gravity_vector([0.0, -GRAVITY, 0.0])
    for name, parent, place, slides, mass, centre, inertia in bodies:
        about = inertia / mass
        at = np.array([centre, 0.0, 0.0])
        unit = UnitInertia(about, about, about).ShiftFromCenterOfMass(-at)
        body = plant.AddRigidBody(name, SpatialInertia(mass, at, unit))
        frame = plant.world_frame() if parent is None else plant.GetBodyByName(parent).body_frame()
        made = PrismaticJoint if slides else RevoluteJoint
        axis = [1.0, 0.0, 0.0] if slides else [0.0, 0.0, 1.0]
        held = plant.AddFrame(FixedOffsetFrame(f"{name} held", frame, RigidTransform([*place, 0.0])))
        plant.AddJoint(made(name, held, body.body_frame(), axis))
    plant.Finalize()
    return plant


def four_bar():
    from pydrake.multibody.inverse_kinematics import InverseKinematics
    from pydrake.solvers import SnoptSolver

    p = FOUR_BAR
    plant = plant_of(
        (
            ("crank", None, (0.0, 0.0), False, 1.0, 0.0, 0.1),
            ("coupler", "crank", (p.crank, 0.0), False, 1.0, 0.0, 0.1),
            ("rocker", None, (p.ground, 0.0), False, 1.0, 0.0, 0.1),
        )
    )
    coupler, rocker = (plant.GetFrameByName(k) for k in ("coupler", "rocker"))
    ik = InverseKinematics(plant, with_joint_limits=False)
    program, q = ik.prog(), ik.q()
    end = np.array([p.rocker, 0.0, 0.0])
    ik.AddPositionConstraint(coupler, [p.coupler, 0.0, 0.0], rocker, end, end)
    driven = program.AddBoundingBoxConstraint(0.0, 0.0, q[0])
    solver = SnoptSolver()
    context = plant.CreateDefaultContext()
    world = plant.world_frame()
    places = [(plant.GetFrameByName("crank"), [p.crank, 0, 0]), (rocker, end), (coupler, [*p.p, 0])]

    def solve(angles):
        computed = np.empty((3, len(angles), 2))
        guess = np.array([0.0, 0.8, 1.8])
        for k, angle in enumerate(angles):
            driven.evaluator().set_bounds([angle], [angle])
            guess[1] += guess[0] - angle
            guess[0] = angle
            result = solver.Solve(program, guess)
            if not result.is_success():
                raise RuntimeError(f"no solution at crank angle {angle}")
            guess = result.GetSolution(q)
            plant.SetPositions(context, guess)
            for i, (frame, place) in enumerate(places):
                computed[i, k] = plant.CalcPointsPositions(context, frame, place, world)[:2, 0]
        return {(n, 0): computed[i] for i, n in enumerate("BCP")}

    return solve


def slider_crank():
    from pydrake.multibody.math import SpatialForce
    from pydrake.multibody.tree import JacobianWrtVariable, MultibodyForces

    p = SLIDER_CRANK
    plant = plant_of(
        (
            ("crank", None, (0.0, 0.0), False, p.m[0], p.s1, p.j[0]),
            ("rod", "crank", (p.r, 0.0), False, p.m[1], p.s2, p.j[1]),
            ("slider", None, (0.0, p.e), True, p.m[2], 0.0, 1e-3),
        )
    )
    bodies = [plant.GetBodyByName(k) for k in ("crank", "rod", "slider")]
    rod, slider = (b.body_frame() for b in bodies[1:])
    world = plant.world_frame()
    context = plant.CreateDefaultContext()
    weight = np.array([0.0, -GRAVITY])
    tip, end = np.array([p.l, 0.0, 0.0]), np.zeros(3)
    wrt = JacobianWrtVariable.kV
    forces = MultibodyForces(plant)
    indices = [int(b.index()) for b in bodies]

    def solve(angles):
        n = len(angles)
        computed = {k: np.empty((n, 2)) for k in "OBC"} | {k: np.empty(n) for k in ("guide", "torque")}
        q, v, a = np.array([0.0, 0.0, p.r + p.l]), np.array([p.speed, 0.0, 0.0]), np.zeros(3)
        before = angles[0]
        for k in range(n):
            q += v * ((angles[k] - before) / p.speed)
            q[0] = before = angles[k]
            for _ in range(20):
                plant.SetPositions(context, q)
                both = plant.CalcJacobianTranslationalVelocity(context, wrt, rod, tip, world, world)[:2]
                both = both - plant.CalcJacobianTranslationalVelocity(context, wrt, slider, end, world, world)[:2]
                gap = plant.CalcPointsPositions(context, rod, tip, world) - plant.CalcPointsPositions(context, slider, end, world)
                dq = np.linalg.solve(both[:, 1:], gap[:2, 0])
                q[1:] -= dq
                if abs(dq).max() < 1e-14:
                    break
            v[1:] = -np.linalg.solve(both[:, 1:], both[:, 0]) * p.speed
            plant.SetPositions(context, q)
            plant.SetVelocities(context, v)
            bias = plant.CalcBiasTranslationalAcceleration(context, wrt, rod, tip, world, world)[:2, 0]  # the slider's is zero
            a[1:] = np.linalg.solve(both[:, 1:], -bias)
            plant.CalcForceElementsContribution(context, forces)  # gravity
            push = SpatialForce(tau=np.zeros(3), f=np.array([p.force, 0.0, 0.0]))
            bodies[2].AddInForceInWorld(context, push, forces)
            tau = plant.CalcInverseDynamics(context, a, forces)
            cut = np.linalg.solve(-both[:, 1:].T, tau[1:])  # on the slider, reversed on the rod
            computed["torque"][k] = tau[0] + both[:, 0] @ cut
            spatial = plant.CalcSpatialAccelerationsFromVdot(context, a)
            needed = []
            for body, i, mass, centre in zip(bodies, indices, p.m, (p.s1, p.s2, 0.0), strict=True):
                turn = body.EvalPoseInWorld(context).rotation().matrix()
                spin = body.EvalSpatialVelocityInWorld(context).rotational()[2]
                arm = (turn @ (centre, 0.0, 0.0))[:2]
                alpha = spatial[i].rotational()[2]
                at = spatial[i].translational()[:2] + alpha * np.array([-arm[1], arm[0]]) - spin**2 * arm
                needed.append(mass * (at - weight))
            computed["C"][k] = cut
            computed["B"][k] = needed[1] + cut
            computed["O"][k] = needed[0] + computed["B"][k]
            computed["guide"][k] = needed[2][1] - cut[1]
        return computed

    return solve


ROWS = {
    "four-bar": {"Drake inverse kinematics": four_bar},
    "slider-crank": {"Drake inverse dynamics + own loop closure": slider_crank},
}
