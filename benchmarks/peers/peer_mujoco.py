"""MuJoCo: open chains with the closing pin cut; positions by Newton's method with the sites' Jacobians, written by hand.

Forces: inverse dynamics twice, without and with the force in the cut, which two equations of the undriven joints give.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from problem import GRAVITY, SLIDER_CRANK

PACKAGES = ("mujoco==4.0.0",)


def slider_crank():
    import mujoco as mj

    p = SLIDER_CRANK
    tiny = 1e-9  # moments of inertia about axes in the plane must not be zero; they play no part
    xml = f"""
    <mujoco>
      <compiler inertiafromgeom="false" balanceinertia="false" boundmass="0" boundinertia="0" angle="radian"/>
      <option gravity="0 {-GRAVITY} 0" integrator="Euler"><flag contact="disable" constraint="disable"/></option>
      <worldbody>
        <body name="crank" pos="0 0 0">
          <joint type="hinge" axis="0 0 1"/>
          <inertial pos="{p.s1} 0 0" mass="{p.m[0]}" diaginertia="{p.j[0]} {p.j[0]} {p.j[0]}"/>
          <body name="rod" pos="{p.r} 0 0">
            <joint type="hinge" axis="0 0 1"/>
            <inertial pos="{p.s2} 0 0" mass="{p.m[1]}" diaginertia="{p.j[1]} {p.j[1]} {p.j[1]}"/>
            <site name="tip" pos="{p.l} 0 0"/>
          </body>
        </body>
        <body name="slider" pos="0 {p.e} 0">
          <joint type="slide" axis="1 0 0"/>
          <inertial pos="0 0 0" mass="{p.m[2]}" diaginertia="{tiny} {tiny} {tiny}"/>
          <site name="end" pos="0 0 0"/>
        </body>
      </worldbody>
    </mujoco>"""
    model = mj.MjModel.from_xml_string(xml)
    data = mj.MjData(model)
    crank, rod, slider = (model.body(k).id for k in ("crank", "rod", "slider"))
    tip, end = model.site("tip").id, model.site("end").id
    jac = np.zeros((3, 3)), np.zeros((3, 3))
    rate = np.zeros((3, 3))

    def solve(angles, stop=1e-14):
        n = len(angles)
        computed = {k: np.empty((n, 2)) for k in "OBC"} | {k: np.empty(n) for k in ("guide", "torque")}
        q, v, a = np.array([0.0, 0.0, p.r + p.l]), np.array([p.speed, 0.0, 0.0]), np.zeros(3)
        before = angles[0]
        for k in range(n):
            q += v * ((angles[k] - before) / p.speed)
            q[0] = before = angles[k]
            for _ in range(20):
                data.qpos[:] = q
                mj.mj_kinematics(model, data)
                mj.mj_comPos(model, data)
                mj.mj_jacSite(model, data, jac[0], None, tip)
                mj.mj_jacSite(model, data, jac[1], None, end)
                both = (jac[0] - jac[1])[:2]
                dq = np.linalg.solve(both[:, 1:], (data.site_xpos[tip] - data.site_xpos[end])[:2])
                q[1:] -= dq
                if abs(dq).max() < stop:
                    break
            v[1:] = -np.linalg.solve(both[:, 1:], both[:, 0]) * p.speed
            data.qpos[:], data.qvel[:] = q, v
            mj.mj_comVel(model, data)
            mj.mj_jacDot(model, data, rate, None, data.site_xpos[tip], rod)  # the slider's is zero
            a[1:] = np.linalg.solve(both[:, 1:], -(rate @ v)[:2])
            data.qacc[:] = a
            data.xfrc_applied[:] = 0.0
            data.xfrc_applied[slider, 0] = p.force
            mj.mj_inverse(model, data)
            # forces on bodies do not enter mj_inverse: the working force is taken to the joints by its Jacobian
            tau = data.qfrc_inverse - jac[1][0] * p.force
            cut = np.linalg.solve(-both[:, 1:].T, tau[1:])  # on the slider, reversed on the rod
            computed["torque"][k] = tau[0] + both[:, 0] @ cut
            arm = data.site_xpos[tip] - data.xipos[rod]  # forces on bodies act at their centres of mass
            data.xfrc_applied[rod, :2] = -cut
            data.xfrc_applied[rod, 5] = -(arm[0] * cut[1] - arm[1] * cut[0])
            data.xfrc_applied[slider, :2] = p.force + cut[0], cut[1]
            mj.mj_rnePostConstraint(model, data)
            computed["O"][k] = data.cfrc_int[crank, 3:5]
            computed["B"][k] = data.cfrc_int[rod, 3:5]
            computed["C"][k] = cut
            computed["guide"][k] = data.cfrc_int[slider, 4]
        return computed

    return solve


ROWS = {"slider-crank": {"MuJoCo mj_inverse + own loop closure": slider_crank}}


def tolerances():
    """The step [rad, m] below which Newton's method stops."""
    solve = slider_crank()
    return {f"Newton to {stop:.0e}": partial(solve, stop=stop) for stop in (1e-1, 1e-2, 1e-4, 1e-8, 1e-14)}


SETTINGS = {("slider-crank", "forces"): {"MuJoCo": tolerances}}
