"""Published numbers: tables of other programs, examples of textbooks (with `exact_here` where the book read a drawing)."""

from __future__ import annotations

import json

import numpy as np
import pytest
from dynamic_mechanisms import chain
from mechanisms import REFERENCE, drawn, four_bar, load, move, slider_crank

from mechcore.dynamics.equations.charts import differences
from mechcore.dynamics.integration.windows import Integrator
from mechcore.dynamics.simulate import simulate
from mechcore.laws.timed import ConstantSpeed
from mechcore.spec.loads import Force

CASES = {c["id"]: c for c in json.loads((REFERENCE / "published.json").read_text())["cases"]}


def of(solver):
    return sorted(k for k, c in CASES.items() if c["solver"] == solver)


def agree(got, expected, case, key):
    tolerance = case["tolerance"]
    got, expected = np.asarray(got, float), np.asarray(expected, float)
    floor = 1e-3 * np.abs(expected).max() if expected.ndim else 0.0  # as published.json states it for lists
    allowed = tolerance.get("rel", 0.0) * np.maximum(np.abs(expected), floor) + tolerance.get("abs", 0.0)
    assert (np.abs(got - expected) <= allowed).all(), (case["id"], key, got, expected)


def exactly(got, case, key):
    assert got == pytest.approx(case["exact_here"][key], rel=2e-9), (case["id"], key)


def net(case):
    i = case["inputs"]
    points = {**i["points"], **{p: at for p, (_, at) in i["carried"].items()}}
    crank = "".join(i["crank"])
    links = {name: [p for p in name if p in points] for name in i["links"]}
    if not any(set(i["crank"]) <= set(own) for own in links.values()):
        links = {crank: list(i["crank"]), **links}
    used = [p for own in links.values() for p in own]
    ground = [p for p in i["points"] if used.count(p) == 1 and p not in i["unknown"]]
    bodies, loads = {}, ()
    dynamics = i.get("dynamics")
    if dynamics:
        bodies = {name: (m, centre, inertia) for name, (m, inertia, centre) in dynamics["mass"].items()}
        at = np.mean([points[p] for p in dynamics["load"]["mean_of"]], axis=0)
        points["load"] = at
        links[dynamics["load"]["link"]].append("load")
        loads = (Force(name="load", link=dynamics["load"]["link"], point="load", vector=tuple(dynamics["load"]["force"])),)
    m = drawn(
        points,
        links,
        [i["crank"][0], *(g for g in ground if g != i["crank"][0])],
        drive=i["crank"][0],
        law=ConstantSpeed(0.0, i["speed_rad_s"]),
        guides=dict(i["guides"]),
        bodies=bodies,
        loads=loads,
        effects=("inertia",) if dynamics else (),
    )
    return m, links


@pytest.mark.parametrize("name", of("net"))
def test_linkages_computed_by_other_programs(name):
    case = CASES[name]
    i = case["inputs"]
    m, links = net(case)
    for label, degrees in i["samples"].items():
        expected = case["expected"][label]
        backwards = -1.0 if label.startswith("-") else 1.0  # the tables reach those positions with the crank reversed
        forces = load(m, [np.radians(degrees)], backwards * i["speed_rad_s"])
        motion = forces.motion
        for p in i["report_points"]:
            link = next(n for n, own in links.items() if p in own)
            got = np.concatenate([motion.point(link, p, d)[0] for d in range(3)])
            agree(got, expected[p], case, (label, p))
        for link in i["report_links"]:
            got = [motion.velocity(link)[0, 2], motion.acceleration(link)[0, 2]]
            agree(got, expected[f"omega_alpha:{link}"], case, (label, link))
        if "dynamics" in i:
            agree(forces.effort(i["crank"][0])[0], expected["torque"], case, (label, "torque"))
            for p in i["joint_order"]:
                joint = next(q for q in m.joints if q.name == p)
                other = next(x for x in joint.links if x in i["dynamics"]["reaction_sign"])
                sign = i["dynamics"]["reaction_sign"][other][p] * (1 if joint.links[1] == other else -1)
                agree(sign * forces.reaction(p)[0, :2], expected[f"reaction:{p}"], case, (label, p))


@pytest.mark.parametrize("name", of("fourbar"))
def test_four_bars_of_textbooks(name):
    case = CASES[name]
    i = case["inputs"]
    m = four_bar(E=(i["d"], 0.0), AB=i["a"], BD=i["b"], DE=i["c"], start=np.radians(i["theta_deg"]))
    motion = move(m, [np.radians(i["theta_deg"])], i["omega"])
    got = {
        "omega3": motion.velocity("coupler")[0, 2],
        "omega4": motion.velocity("rocker")[0, 2],
        "alpha3": motion.acceleration("coupler")[0, 2],
        "alpha4": motion.acceleration("rocker")[0, 2],
        "vC": np.hypot(*motion.point("rocker", "D", 1)[0]),
        "vCB": abs(motion.velocity("coupler")[0, 2]) * i["b"],
        "aC": np.hypot(*motion.point("rocker", "D", 2)[0]),
    }
    for key, value in got.items():
        exactly(abs(value), case, key)
    for key, value in case["expected"].items():
        agree(abs(got[key]), value, case, key)


@pytest.mark.parametrize("name", of("rodpoint"))
def test_points_on_connecting_rods_of_textbooks(name):
    case = CASES[name]
    i = case["inputs"]
    m = slider_crank(r=i["r"], l=i["l"], rod_point=(i["fraction_from_crankpin"] * i["l"], 0.0))
    motion = move(m, [np.radians(i["theta_deg"])], i["omega"], i.get("alpha", 0.0))
    got = {
        "v": np.hypot(*motion.point("rod", "P", 1)[0]),
        "a": np.hypot(*motion.point("rod", "P", 2)[0]),
        "omega_rod": abs(motion.velocity("rod")[0, 2]),
        "alpha_rod": abs(motion.acceleration("rod")[0, 2]),
    }
    for key, value in got.items():
        exactly(value, case, key)
        agree(value, case["expected"][key], case, key)


@pytest.mark.parametrize("name", ["khurmi_15_4", "khurmi_15_5"])
def test_piston_motion_of_textbooks(name):
    case = CASES[name]
    i = case["inputs"]
    motion = move(slider_crank(r=i["r"], l=i["l"]), [np.radians(i["theta_deg"])], i["omega"])
    s = motion.coordinate("S")[0]
    exactly(-s[1], case, "v")
    exactly(-s[2], case, "a")


@pytest.mark.parametrize("name", of("piston"))
def test_greatest_piston_speed_of_textbooks(name):
    """Where the exact speed is greatest the acceleration vanishes; the books give the approximate series."""
    case = CASES[name]
    i, exact = case["inputs"], case["exact_here"]
    s = move(slider_crank(r=i["r"], l=i["l"]), [np.radians(exact["theta_vmax_deg"])], i["omega"]).coordinate("S")[0]
    assert -s[1] == pytest.approx(exact["vmax"], rel=2e-9)
    assert abs(s[2]) < 1e-6 * i["r"] * i["omega"] ** 2


@pytest.mark.parametrize("name", of("engine"))
def test_turning_moment_of_engines_in_textbooks(name):
    """The exact value; the books print the series to the second harmonic, which is compared at their tolerance of 0.1 %."""
    case = CASES[name]
    i = case["inputs"]
    force = i["F_gas"] + i.get("weight", 0.0)
    m = slider_crank(
        r=i["r"],
        l=i["l"],
        bodies={"piston": (i["m_recip"], (0.0, 0.0), 0.0)},
        effects=("inertia",),
        loads=(Force(name="gas", link="piston", point="C", vector=(-force, 0.0)),),
    )
    forces = load(m, [np.radians(i["theta_deg"])], i["omega"])
    exactly(-forces.effort("O")[0], case, "T")
    exactly(abs(forces.reaction("S")[0, 1]), {"id": name, "exact_here": {"FN": abs(case["exact_here"]["FN"])}}, "FN")
    exactly(np.hypot(*forces.reaction("C")[0, :2]), {"id": name, "exact_here": {"FQ": abs(case["exact_here"]["FQ"])}}, "FQ")


def test_inertia_force_of_a_connecting_rod():
    case = CASES["khurmi_15_19"]
    i = case["inputs"]
    m = slider_crank(r=i["r"], l=i["l"], bodies={"rod": (i["m"], (i["l"] - i["PG"], 0.0), 1.0)}, effects=("inertia",))
    forces = load(m, [np.radians(i["theta_deg"])], i["omega"])
    exactly(-forces.motion.coordinate("S")[0, 2], case, "aP")
    exactly(np.hypot(*forces.inertia("rod")[0, :2]), case, "F_rod")


@pytest.mark.parametrize("sample", ["0", "45"])
def test_jansen_leg(sample):
    case = CASES["pyslvs_jansen"]
    names = "OBCDEFGH"  # crank pivot, crank pin, frame pivot, upper, left, lower, knee, foot
    points = dict(zip(names, case["inputs"]["points"], strict=True))
    links = {"crank": "OB", "j": "BD", "k": "BF", "bde": "CDE", "c": "CF", "f": "EG", "ghi": "GFH"}
    start = np.arctan2(points["B"][1], points["B"][0])
    m = drawn(points, links, ["O", "C"], drive="O", law=ConstantSpeed(0.0, 1.0))
    motion = move(m, [np.radians(float(sample)) - start])
    agree(motion.point("ghi", "H")[0], case["expected"][sample], case, sample)
    np.testing.assert_allclose(motion.point("ghi", "H")[0], case["exact_here"][sample], rtol=1e-9)


def test_four_bars_in_a_row_through_their_singular_position():
    """IFToMM library of computational benchmarks, A02; the published run kept its energy to 1.8e-5 J."""
    case = CASES["iftomm_A02_n2"]
    end = [case["inputs"]["t_end"]]
    for method in ("energy", "gauss"):
        simulation = simulate(chain(case["inputs"]["N"]), end[0], tolerance=1e-11, method=method)
        motion = simulation.motion(end)
        for key, derivative in (("B0", 0), ("vB0", 1)):
            got = motion.point("upright0", "B0", derivative)[0]
            agree(got, case["expected"][key], case, key)
            exactly(got, case, key)


class Bristles:
    """Friction of Canudas de Wit, Olsson, Astrom and Lischinsky (LuGre): a mass on a spring whose far end moves evenly; the second
    coordinate is the integral of the bristles' deflection z, which z' = v - sigma_0 |v| z / g(v) decides."""

    def __init__(self, i):
        self.i = i

    def __call__(self, q, v, t):
        i = self.i
        x, w, z = q[:, 0], v[:, 0], v[:, 1]
        level = i["Fc"] + (i["Fs"] - i["Fc"]) * np.exp(-((w / i["vs"]) ** 2))
        bending = w - i["sigma0"] * np.abs(w) / level * z
        friction = i["sigma0"] * z + np.sqrt(i["sigma0"]) * bending + i["sigma2"] * w
        return np.stack([(i["k"] * (i["u_rate"] * t - x) - friction) / i["m"], bending], axis=1)

    def slopes(self, q, v, t, a):
        return differences(self, q, v, t, a, (np.full(2, 1e-7), np.full(2, 1e-7)))


def test_stick_slip_with_bristles():
    """Time constants of 0.003 s to some seconds in one motion: the integrator's Radau windows."""
    case = CASES["lugre_stick_slip"]
    end, none = case["inputs"]["t_end"], np.zeros(2)
    result = Integrator(Bristles(case["inputs"]), tolerance=1e-8, scale=np.array([1.0, 1e-5]), stiff=True).run(none, none, 0.0, end)
    q, v, _ = result(end)
    for key, got in (("x", q[0, 0]), ("v", v[0, 0]), ("z", v[0, 1])):
        agree(got, case["expected"][key], case, key)
        exactly(got, case, key)
    assert len(result.windows) < 500
