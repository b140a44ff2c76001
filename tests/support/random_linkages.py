"""Random linkages for hypothesis, and the balance of forces of their links."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st
from mechanisms import four_bar, pin, slider_crank

from mechcore.forces.kinetostatics import Forces
from mechcore.laws.timed import ConstantSpeed
from mechcore.spec.loads import Force, Torque
from mechcore.spec.mechanism import Drive, Link, Mechanism

ANGLES = np.linspace(0.0, 2.0 * np.pi, 73)


SPEED, ACCELERATION = 7.0, 30.0


EFFECTS = ("inertia", "gravity")


number = st.floats(-1.0, 1.0).map(lambda x: x if abs(x) > 1e-9 else 0.0)  # next to nothing is nothing: no force of 1e-320 N


@st.composite
def bodies(draw, names):
    return {n: (5.0 * abs(draw(number)), (draw(number), draw(number)), 2.0 * abs(draw(number))) for n in names}


@st.composite
def crank_rockers(draw):
    """Four-bars whose crank (1 m) turns fully: valid by construction, so nothing is filtered away."""
    frame = draw(st.floats(1.1, 5.0))
    reach = (frame + 1.0) * draw(st.floats(1.01, 3.0))  # coupler + rocker: meets at the outer dead centre
    excess = (frame - 1.0) * draw(st.floats(-0.99, 0.99))  # coupler - rocker: folds at the inner one
    turn = draw(st.floats(-np.pi, np.pi))
    return four_bar(
        E=(frame * np.cos(turn), frame * np.sin(turn)),
        AB=1.0,
        BD=(reach + excess) / 2,
        DE=(reach - excess) / 2,
        mode=draw(st.sampled_from(["left", "right"])),
        coupler_point=(draw(number), draw(number)),
        bodies=draw(bodies(["crank", "coupler", "rocker"])),
        effects=EFFECTS,
        loads=(
            Force(name="P", link="coupler", point="P", vector=(draw(number) * 50, draw(number) * 50), axes="link"),
            Torque(name="M", link="rocker", moment=draw(number) * 20),
        ),
    )


@st.composite
def slider_cranks(draw):
    """Slider-cranks whose crank (1 m) turns fully."""
    offset = draw(st.floats(-2.0, 2.0))
    return slider_crank(
        r=1.0,
        l=(1.0 + abs(offset)) * draw(st.floats(1.02, 4.0)),
        e=offset,
        branch=draw(st.sampled_from(["ahead", "behind"])),
        bodies=draw(bodies(["crank", "rod", "piston"])),
        effects=EFFECTS,
        loads=(Force(name="F", link="piston", point="C", vector=(draw(number) * 100, draw(number) * 100)),),
    )


@st.composite
def six_bars(draw):
    """A crank-rocker whose rocker pin carries a dyad to the frame, long enough to reach over the whole swing."""
    base = draw(crank_rockers())
    names = {link.name: link for link in base.links}
    frame, rocker = names["frame"], names["rocker"]
    e = np.array(frame.points["E"])
    carried = (draw(st.floats(0.2, 1.0)), draw(number))
    far = draw(st.floats(1.1, 3.0)) * 3.0  # N lies far enough for the pin H to circle nowhere near it
    turn = draw(st.floats(-np.pi, np.pi))
    n = e + far * np.array([np.cos(turn), np.sin(turn)])
    radius = float(np.hypot(*carried))
    nearest, farthest = far - radius, far + radius
    total = farthest * draw(st.floats(1.02, 2.0))
    difference = nearest * draw(st.floats(-0.98, 0.98))
    more = draw(bodies(["link", "output"]))

    def link(name, points):
        mass, centre, inertia = more[name]
        return Link(name=name, points=points, mass=mass, centre=centre, inertia=inertia)

    swap = {
        "frame": Link(name="frame", points={**frame.points, "N": (float(n[0]), float(n[1]))}),
        "rocker": Link(
            name="rocker",
            points={**rocker.points, "H": carried},
            mass=rocker.mass,
            centre=rocker.centre,
            inertia=rocker.inertia,
        ),
    }
    return Mechanism(
        name="six-bar",
        frame="frame",
        links=(
            *(swap.get(x.name, x) for x in base.links),
            link("link", {"H": (0.0, 0.0), "K": ((total + difference) / 2, 0.0)}),
            link("output", {"N": (0.0, 0.0), "K": ((total - difference) / 2, 0.0)}),
        ),
        joints=(*base.joints, pin("H", "rocker", "link"), pin("K", "link", "output"), pin("N", "output", "frame")),
        drives=(Drive(joint="A", law=ConstantSpeed(0.0, 1.0)),),
        effects=EFFECTS,
        loads=base.loads,
        modes={**base.modes, "K": draw(st.sampled_from(["left", "right"]))},
    )


def balance_of_links(forces: Forces) -> float:
    """Largest force and moment left over on any link, about its frame's origin, relative to the largest acting there.

    Newton-Euler on each link by itself, from published results only: nothing here knows of loops or trees.
    """
    m = forces.motion
    worst = 0.0
    for link in m.model.bodies.values():
        if link.name == m.mechanism.frame:
            continue
        origin = m.pose(link.name)[:, :2]
        acting = []  # (force, moment, at)
        for p in m.model.connections:
            if link.name in p.links:
                sign = 1.0 if p.links[1] == link.name else -1.0
                at = forces.position(p.name)
                driven = [forces.wrench(p.name)] if p.name in {d.joint for d in m.mechanism.drives} else []
                for wrench in (forces.reaction(p.name), *driven):
                    acting.append((sign * wrench[:, :2], sign * wrench[:, 2], at))
        for result in forces.loads.values():
            if link.name in result.links:
                sign = 1.0 if result.link == link.name else -1.0
                acting.append((sign * result.values[:, :2], sign * result.values[:, 2], result.values[:, 3:]))
        inertia = forces.inertia(link.name)
        acting.append((inertia[:, :2], inertia[:, 2], m.centre_of_mass(link.name)))
        force = sum(f for f, _, _ in acting)
        moments = [mm + (at - origin)[:, 0] * f[:, 1] - (at - origin)[:, 1] * f[:, 0] for f, mm, at in acting]
        largest_force = max(np.abs(f).max() for f, _, _ in acting) or 1.0
        largest_moment = max(max(np.abs(mm).max() for mm in moments), 1e-3 * largest_force * m.model.length_scale)
        worst = max(worst, np.abs(force).max() / largest_force, np.abs(sum(moments)).max() / largest_moment)
    return worst
