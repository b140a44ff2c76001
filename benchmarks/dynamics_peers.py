"""Peers of forward dynamics: MuJoCo, Pinocchio and exudyn on the chain of four-bars and on Andrews' squeezer, set up by hand.

Each function returns a job that runs once from the start and gives the final angle [rad].
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from dynamic_mechanisms import squeezer
from scipy.integrate import solve_ivp

sys.path.append(str(Path(__file__).resolve().parent / "peers"))

__all__ = [
    "PACKAGES",
    "by_cvode",
    "by_ida",
    "by_scipy",
    "exudyn_chain",
    "exudyn_squeezer",
    "mujoco_chain",
    "mujoco_squeezer",
    "pinocchio_chain",
    "pinocchio_squeezer",
]

PACKAGES = (
    "numpy==2.4.6",
    "pydantic==2.14.3",
    "scipy==1.17.1",
    "mujoco==4.0.0",
    "pin==4.1.0",
    "exudyn==1.13.6",
    "scikit-sundae==1.2.0",
)
TREE = (
    ("K1", None, "O"),
    ("K2", "K1", "P"),
    ("K3", None, "B"),
    ("K5", None, "A"),
    ("K4", "K5", "E"),
    ("K7", None, "A"),
    ("K6", "K7", "H"),
)
START = {"K1": "beta", "K2": "Theta", "K3": "gamma", "K5": "delta", "K4": "Phi", "K7": "epsilon", "K6": "Omega"}


def by_scipy(rhs: Any, start: np.ndarray, duration: float, tolerance: float, method: str) -> float:
    solution = solve_ivp(rhs, (0.0, duration), start, method=method, rtol=tolerance, atol=1e-2 * tolerance)
    return float(solution.y[0, -1])


def by_cvode(rhs: Any, start: np.ndarray, duration: float, tolerance: float) -> float:
    """SUNDIALS' Adams method for ordinary equations."""
    from sksundae.cvode import CVODE

    def fill(t: float, y: np.ndarray, yp: np.ndarray) -> None:
        yp[:] = rhs(t, y)

    solver = CVODE(fill, method="Adams", rtol=tolerance, atol=1e-2 * tolerance, max_num_steps=100_000)
    return float(solver.solve(np.array([0.0, 0.5 * duration, duration]), start).y[-1, 0])


def by_ida(parts: Any, start: np.ndarray, duration: float, tolerance: float) -> float:
    """SUNDIALS' BDF for differential-algebraic equations, of index 2 by Gear, Gupta and Leimkuhler: with the constraints and their
    rates; y = (q, v, Lagrange multipliers, multipliers of the constraints of the rates)."""
    from sksundae.ida import IDA

    n, m = 7, 6
    a, f, _ = parts(start)
    solution = np.linalg.solve(a, f)
    y0 = np.concatenate([start, solution[n:], np.zeros(m)])
    yp0 = np.concatenate([start[n:], solution[:n], np.zeros(2 * m)])

    def residual(_: float, y: np.ndarray, yp: np.ndarray, out: np.ndarray) -> None:
        a, f, closed = parts(y)
        g = a[n:, :n]
        out[:n] = yp[:n] - y[n : 2 * n] - g.T @ y[2 * n + m :]
        out[n : 2 * n] = a[:n] @ np.concatenate([yp[n : 2 * n], y[2 * n : 2 * n + m]]) - f[:n]
        out[2 * n : 2 * n + m] = closed
        out[2 * n + m :] = g @ y[n : 2 * n]

    algebraic = list(range(2 * n, 2 * n + 2 * m))
    atol = np.full(len(y0), 1e-2 * tolerance)
    atol[2 * n :] = 1e3  # multipliers need not be exact, and are not smooth
    solver = IDA(residual, rtol=tolerance, atol=atol, algebraic_idx=algebraic, max_num_steps=100_000)
    return float(solver.solve(np.array([0.0, 0.5 * duration, duration]), y0, yp0).y[-1, 0])


def parts_of(i: dict[str, Any]) -> tuple[dict[str, Any], dict[str, dict[str, tuple[float, float]]]]:
    """Links of the squeezer by name, and their points."""
    links = {link.name: link for link in squeezer(i).links}
    return links, {name: dict(link.points) for name, link in links.items()}


# --- N four-bars in a row ----------------------------------------------------------------------------------------------


def mujoco_chain(n: int, steps: int, duration: float = 10.0) -> Callable[[], float]:
    """Hinges of uprights and bars, the far end of every bar joined by a soft constraint at its hardest."""
    import mujoco as mj

    h = duration / steps
    body = '<inertial pos="{}" mass="1" diaginertia="0.0834 0.0834 0.08333333333333333"/>'
    parts, joins = [], []
    for k in range(n + 1):
        bar = ""
        if k < n:
            bar = f'<body name="bar{k}" pos="0 1 0"><joint type="hinge" axis="0 0 1"/>{body.format("0.5 0 0")}</body>'
            joins.append(f'<connect body1="bar{k}" body2="upright{k + 1}" anchor="1 0 0"/>')
        inner = f'<joint name="j{k}" type="hinge" axis="0 0 1"/>{body.format("0 0.5 0")}{bar}'
        parts.append(f'<body name="upright{k}" pos="{k} 0 0">{inner}</body>')
    model = mj.MjModel.from_xml_string(
        f"""<mujoco><compiler inertiafromgeom="false" angle="radian"/>
        <option gravity="0 -9.81 0" integrator="RK4" timestep="{h}" tolerance="1e-12"><flag contact="disable"/></option>
        <default><equality solref="{2 * h} 1" solimp="0.9999 0.9999 0.001"/></default>
        <worldbody>{"".join(parts)}</worldbody><equality>{"".join(joins)}</equality></mujoco>"""
    )
    data = mj.MjData(model)
    uprights = [model.joint(f"j{k}").dofadr[0] for k in range(n + 1)]
    bars = [d for d in range(model.nv) if d not in uprights]

    def run() -> float:
        mj.mj_resetData(model, data)
        data.qvel[uprights], data.qvel[bars] = -1.0, 1.0  # bars keep their direction: they turn back on the uprights
        for _ in range(steps):
            mj.mj_step(model, data)
        return float(data.qpos[uprights[0]]) + np.pi / 2

    return run


def pinocchio_chain(n: int, steps: int, rtol: float = 0.0, duration: float = 10.0) -> Callable[[], float]:
    """Hinges of uprights and bars, closed by constraints with Baumgarte's stabilisation; steps by Runge's and Kutta's method."""
    import pinocchio as pin

    model = pin.Model()
    model.gravity.linear = np.array([0.0, -9.81, 0.0])
    plain = np.eye(3)

    def hang(parent: int, place: list[float], centre: list[float]) -> int:
        j = model.addJoint(parent, pin.JointModelRZ(), pin.SE3(plain, np.array(place)), f"j{model.njoints}")
        model.appendBodyToJoint(j, pin.Inertia(1.0, np.array(centre), np.diag([0.0834, 0.0834, 1.0 / 12.0])), pin.SE3.Identity())
        return j

    uprights, bars = [], []
    for k in range(n + 1):
        uprights.append(hang(0, [float(k), 0.0, 0.0], [0.0, 0.5, 0.0]))
        if k < n:
            bars.append(hang(uprights[k], [0.0, 1.0, 0.0], [0.5, 0.0, 0.0]))
    corrector = pin.BaumgarteCorrectorParameters(100.0, 20.0)
    constraints = pin.StdVec_RigidConstraintModel()
    for k in range(n):
        far, top = (pin.SE3(plain, np.array(p)) for p in ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0]))
        c = pin.RigidConstraintModel(
            pin.ContactType.CONTACT_3D, model, bars[k], far, uprights[k + 1], top, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        )
        c.setBaumgarteCorrectorParameters(corrector)
        constraints.append(c)
    data = model.createData()
    datas = pin.StdVec_RigidConstraintData()
    for c in constraints:
        datas.append(c.createData())
    pin.initConstraintDynamics(model, data, constraints, datas)
    settings = pin.ProximalSettings(1e-12, 1e-12, 20)
    still = np.zeros(model.nv)
    index = [model.joints[j].idx_v for j in uprights]
    others = [model.joints[j].idx_v for j in bars]
    v0 = np.zeros(model.nv)
    v0[index], v0[others] = -1.0, 1.0

    def rhs(_: float, y: np.ndarray) -> np.ndarray:
        q, v = y[: model.nq], y[model.nq :]
        a = pin.constraintDynamics(model, data, q, v, still, constraints, datas, settings)
        return np.concatenate([v, a])

    def run() -> float:
        y = np.concatenate([np.zeros(model.nq), v0])
        if not steps:
            return by_scipy(rhs, y, duration, rtol, "DOP853") + np.pi / 2
        h = duration / steps
        for _ in range(steps):
            k1 = rhs(0.0, y)
            k2 = rhs(0.0, y + 0.5 * h * k1)
            k3 = rhs(0.0, y + 0.5 * h * k2)
            y = y + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + rhs(0.0, y + h * k3))
        return float(y[index[0]]) + np.pi / 2

    return run


def exudyn_chain(n: int, steps: int, duration: float = 10.0) -> Callable[[], float]:
    """Rigid bodies in the plane, joints as constraints; generalised-alpha with the engine's own settings."""
    from peer_exudyn import Scene

    scene = Scene(1, 1.0)
    scene.settings.timeIntegration.generalizedAlpha.useNewmark = False
    scene.settings.timeIntegration.generalizedAlpha.useIndex2Constraints = False
    weight, uprights, nodes = (0.0, -9.81), [], []
    for k in range(n + 1):
        body, node = scene.body(1.0, 1.0 / 12.0, weight, (k, 0.5, np.pi / 2), (0.5, 0.0, -1.0))
        scene.pin(scene.ground, (k, 0.0), body, (-0.5, 0.0))
        uprights.append(body)
        nodes.append(node)
    for k in range(n):
        bar, _ = scene.body(1.0, 1.0 / 12.0, weight, (k + 0.5, 1.0, 0.0), (1.0, 0.0, 0.0))
        scene.pin(uprights[k], (0.5, 0.0), bar, (-0.5, 0.0))
        scene.pin(bar, (0.5, 0.0), uprights[k + 1], (0.5, 0.0))
    scene.mbs.Assemble()
    return _exudyn_run(scene, nodes[0], steps, duration, np.pi / 2)


def _exudyn_run(scene: Any, node: int, steps: int, duration: float, start: float) -> Callable[[], float]:
    integration = scene.settings.timeIntegration
    integration.numberOfSteps, integration.endTime = steps, duration

    def run() -> float:
        scene.mbs.SolveDynamic(scene.settings)
        return float(scene.mbs.GetNodeOutput(node, scene.exu.OutputVariableType.Coordinates)[2]) + start

    return run


# --- Andrews' squeezing mechanism ---------------------------------------------------------------------------------------


def pinocchio_squeezer(i: dict[str, Any], tolerance: float, duration: float = 0.03, damping: float = 0.0) -> Callable[[], float]:
    """Hinges along the tree, point F closed three times, `constraintDynamics` with scipy's DOP853; the crank may be damped."""
    import pinocchio as pin

    links, points = parts_of(i)
    model, plain, index = pin.Model(), np.eye(3), {}
    for name, parent, at in TREE:
        x, y = points[parent or "frame"][at]
        j = model.addJoint(index.get(parent, 0), pin.JointModelRZ(), pin.SE3(plain, np.array([x, y, 0.0])), name)
        link = links[name]
        about = np.diag([1e-9, 1e-9, link.inertia])
        model.appendBodyToJoint(j, pin.Inertia(link.mass, np.array([*link.centre, 0.0]), about), pin.SE3.Identity())
        index[name] = j
    corrector = pin.BaumgarteCorrectorParameters(0.0, 0.0)
    constraints, datas = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
    for name in ("K3", "K4", "K6"):
        a, b = (pin.SE3(plain, np.array([*points[k]["F"], 0.0])) for k in ("K2", name))
        c = pin.RigidConstraintModel(
            pin.ContactType.CONTACT_3D, model, index["K2"], a, index[name], b, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        )
        c.setBaumgarteCorrectorParameters(corrector)
        constraints.append(c)
        datas.append(c.createData())
    data = model.createData()
    pin.initConstraintDynamics(model, data, constraints, datas)
    settings = pin.ProximalSettings(1e-12, 1e-12, 20)
    k = SimpleNamespace(**i)
    crank, lever = (model.joints[index[name]].idx_v for name in ("K1", "K3"))
    tau = np.zeros(model.nv)

    def rhs(_: float, y: np.ndarray) -> np.ndarray:
        q, v = y[: model.nq], y[model.nq :]
        s, c = np.sin(q[lever]), np.cos(q[lever])
        dx, dy = k.sd * c + k.sc * s, k.sd * s - k.sc * c
        x, y_ = dx + k.xb - k.xc, dy + k.yb - k.yc
        length = np.hypot(x, y_)
        pull = -k.c0 * (length - k.lo) / length
        tau[crank], tau[lever] = k.mom - damping * v[crank], pull * (dx * y_ - dy * x)
        return np.concatenate([v, pin.constraintDynamics(model, data, q, v, tau, constraints, datas, settings)])

    start = np.zeros(model.nq + model.nv)
    for name, angle in START.items():
        start[model.joints[index[name]].idx_q] = i["initial_q"][angle]

    def run() -> float:
        return by_scipy(rhs, start, duration, tolerance, "DOP853")

    return run


def mujoco_squeezer(i: dict[str, Any], steps: int, duration: float = 0.03) -> Callable[[], float]:
    """Hinges along the tree, point F closed three times by soft constraints at their hardest, Runge-Kutta steps of order 4."""
    import mujoco as mj

    links, points = parts_of(i)
    h = duration / steps

    def body(name: str, parent: str | None, at: str) -> str:
        x, y = points[parent or "frame"][at]
        link = links[name]
        inner = "".join(body(*row) for row in TREE if row[1] == name)
        site = f'<site name="D" pos="{points[name]["D"][0]} {points[name]["D"][1]} 0"/>' if name == "K3" else ""
        about = f"{0.51 * link.inertia} {0.51 * link.inertia} {link.inertia}"
        return (
            f'<body name="{name}" pos="{x} {y} 0"><joint name="{name}" type="hinge" axis="0 0 1"/>'
            f'<inertial pos="{link.centre[0]} {link.centre[1]} 0" mass="{link.mass}" diaginertia="{about}"/>{site}{inner}</body>'
        )

    bodies = "".join(body(*row) for row in TREE if row[1] is None)
    at_c = points["frame"]["C"]
    far = points["K2"]["F"]
    joins = "".join(f'<connect name="{k}" body1="K2" body2="{k}" anchor="{far[0]} {far[1]} 0"/>' for k in ("K3", "K4", "K6"))
    model = mj.MjModel.from_xml_string(
        f"""<mujoco><compiler inertiafromgeom="false" angle="radian" boundmass="0" balanceinertia="true"/>
        <option gravity="0 0 0" integrator="RK4" timestep="{h}" tolerance="1e-14"><flag contact="disable"/></option>
        <default><equality solref="{2 * h} 1" solimp="0.9999 0.9999 0.001"/></default>
        <worldbody><site name="C" pos="{at_c[0]} {at_c[1]} 0"/>{bodies}</worldbody><equality>{joins}</equality>
        <tendon><spatial stiffness="{i["c0"]}" springlength="{i["lo"]}"><site site="C"/><site site="D"/></spatial></tendon>
        </mujoco>"""
    )
    for k in ("K3", "K4", "K6"):  # where F is on the second link: the model is compiled with all angles zero
        model.equality(k).data[3:6] = [*points[k]["F"], 0.0]
    data = mj.MjData(model)

    def run() -> float:
        mj.mj_resetData(model, data)
        for name, angle in START.items():
            data.qpos[model.joint(name).qposadr[0]] = i["initial_q"][angle]
        data.qfrc_applied[model.joint("K1").dofadr[0]] = i["mom"]
        for _ in range(steps):
            mj.mj_step(model, data)
        return float(data.qpos[model.joint("K1").qposadr[0]])

    return run


def exudyn_squeezer(i: dict[str, Any], steps: int, duration: float = 0.03) -> Callable[[], float]:
    """Rigid bodies in the plane, joints as constraints; generalised-alpha with the engine's own settings."""
    from peer_exudyn import Scene

    links, points = parts_of(i)
    sketch = dict(squeezer(i).sketch)
    scene = Scene(1, 1.0)
    scene.settings.timeIntegration.generalizedAlpha.useNewmark = False
    scene.settings.timeIntegration.generalizedAlpha.useIndex2Constraints = False
    bodies, nodes = {"frame": scene.ground}, {}
    for name, _, _ in TREE:
        link, (x, y, angle) = links[name], sketch[name]
        centre = complex(x, y) + complex(*link.centre) * np.exp(1j * angle)
        bodies[name], nodes[name] = scene.body(link.mass, link.inertia, None, (centre.real, centre.imag, angle), (0.0, 0.0, 0.0))

    def place(name: str, point: str) -> tuple[float, float]:
        x, y = points[name][point]
        cx, cy = links[name].centre if name != "frame" else (0.0, 0.0)
        return x - cx, y - cy

    joints = [(parent or "frame", name, at) for name, parent, at in TREE] + [("K2", k, "F") for k in ("K3", "K4", "K6")]
    for first, second, at in joints:
        scene.pin(bodies[first], place(first, at), bodies[second], place(second, at))
    ends = [
        scene.mbs.AddMarker(scene.items.MarkerBodyPosition(bodyNumber=bodies[b], localPosition=[*place(b, p), 0.0]))
        for b, p in (("frame", "C"), ("K3", "D"))
    ]
    scene.mbs.AddObject(scene.items.SpringDamper(markerNumbers=ends, stiffness=i["c0"], referenceLength=i["lo"]))
    turn = scene.mbs.AddMarker(scene.items.MarkerNodeCoordinate(nodeNumber=nodes["K1"], coordinate=2))
    scene.mbs.AddLoad(scene.items.LoadCoordinate(markerNumber=turn, load=i["mom"]))
    scene.mbs.Assemble()
    return _exudyn_run(scene, nodes["K1"], steps, duration, i["initial_q"]["beta"])
