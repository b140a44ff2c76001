"""Kinematic chains as sketches and as scenes: links as polygons of their joints, in a layout with few crossings."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from mechcore.arrays import Complex, Index, Real
from mechcore.design.chains import Chain
from mechcore.errors import MechanismError
from mechviz.runs import run_scene
from mechviz.scene.scene import Scene
from mechviz.studies.synthesis.linkages import LinkageSolution

WEIGHT_TRIES = 8  # random weights that are tried for each outer loop
RADIUS = 100.0  # [mm] of the circle of the outer loop
ENOUGH_ROOM = 20.0  # [mm] between joints, without crossings: the search for other loops ends
DRIVE_NUDGE = 5.0  # [deg] amplitude of the drive of a chain that cannot be run over its reachable range


def chain_layout(chain: Chain) -> Complex:
    """Positions (J,) [mm] of a chain's joints: a long loop on a circle, the others at weighted means of their neighbours (Tutte).

    Several loops and random weights are tried; the layout with the fewest crossings and the largest distances is chosen."""
    rng = np.random.default_rng(0)
    members = [[j for j, joint in enumerate(chain.joints) if link in joint] for link in range(chain.links)]
    near = {j: [k for own in members if j in own for k in own if k != j] for j in range(len(chain.joints))}
    best: tuple[float, Complex] | None = None
    for loop in outer_loops(chain):
        for _ in range(WEIGHT_TRIES):
            places = _spread(near, loop, rng)
            quality = _quality(chain, members, places)
            if best is None or quality > best[0]:
                best = quality, places
        if best is not None and best[0] > ENOUGH_ROOM:
            break
    assert best is not None
    return best[1]


def outer_loops(chain: Chain, most: int = 24) -> list[list[int]]:
    """Up to ``most`` loops of a chain, the longest first, each as its joints in order."""
    number = {joint: k for k, joint in enumerate(chain.joints)}
    near = {link: [a if b == link else b for a, b in chain.joints if link in (a, b)] for link in range(chain.links)}
    loops: list[list[int]] = []

    def go(path: list[int]) -> None:
        for link in near[path[-1]]:
            if link == path[0] and len(path) > 2 and path[1] < path[-1]:
                loops.append([number[min(a, b), max(a, b)] for a, b in zip(path, [*path[1:], path[0]], strict=True)])
            elif link > path[0] and link not in path:
                go([*path, link])

    for start in range(chain.links):
        go([start])
    return sorted(loops, key=len, reverse=True)[:most]


def _spread(near: dict[int, list[int]], loop: list[int], rng: np.random.Generator) -> Complex:
    """Positions of joints: those of a loop unevenly on a circle, the others at randomly weighted means of those on the same
    links."""
    places = np.zeros(len(near), complex)
    angles = np.sort(np.arange(len(loop)) + rng.uniform(-0.2, 0.2, len(loop))) * 2.0 * np.pi / len(loop) + np.pi / 2.0
    places[loop] = RADIUS * np.exp(1j * angles) * rng.uniform(0.85, 1.0, len(loop))
    inner = [j for j in near if j not in loop]
    if inner:
        matrix = np.eye(len(inner))
        right = np.zeros(len(inner), complex)
        for row, j in enumerate(inner):
            weights = rng.uniform(0.4, 1.6, len(near[j]))
            for k, weight in zip(near[j], weights / weights.sum(), strict=True):
                if k in inner:
                    matrix[row, inner.index(k)] -= weight
                else:
                    right[row] += weight * places[k]
        places[inner] = np.linalg.solve(matrix, right)
    return places


def _quality(chain: Chain, members: list[list[int]], places: Complex) -> float:
    """Quality of a layout: the least distance of two joints (or twice that of a joint from the line through two others of the same
    link), less ``RADIUS`` for each crossing of links."""
    distances = [abs(places[a] - places[b]) for a, b in combinations(range(len(places)), 2)]
    for own in members:
        for a, b, c in combinations(own, 3):
            side = places[b] - places[a]
            distances.append(2.0 * abs(np.imag(np.conj(side) * (places[c] - places[a]))) / max(abs(side), 1e-9))
    rings = [outline(chain, link, places) for link in range(chain.links)]
    edges = [edge for ring in rings for edge in zip(ring, np.roll(ring, 1), strict=True)]
    crossings = sum(_cross(*first, *second) for first, second in combinations(edges, 2) if len({*first, *second}) == 4)
    return float(min(distances) - RADIUS * crossings)


def _cross(a: complex, b: complex, c: complex, d: complex) -> bool:
    """Whether two segments cross."""

    def left(p: complex, q: complex, r: complex) -> float:
        return float(np.imag(np.conj(q - p) * (r - p)))

    return left(a, b, c) * left(a, b, d) < 0.0 and left(c, d, a) * left(c, d, b) < 0.0


def outline(chain: Chain, link: int, places: Complex) -> Complex:
    """Corners of a link's polygon: the positions of its joints, ordered by angle about their mean."""
    own: Index = np.array([j for j, joint in enumerate(chain.joints) if link in joint])
    around: Real = np.angle(places[own] - places[own].mean())
    return np.asarray(places[own[np.argsort(around)]])


def chain_solutions(chains: tuple[Chain, ...]) -> list[LinkageSolution]:
    """Solutions: every inversion of chains with one degree of freedom, driven at a joint of the frame. The layout of the chain is
    the sketch, from which the motion starts."""
    out = []
    for number, chain in enumerate(chains, 1):
        places = chain_layout(chain)
        for inversion, group in enumerate(chain.frames, 1):
            title = f"Chain {number} of {chain.links} links, inversion {inversion}"
            scene = _scene(chain, group[0], places, f"chain-{chain.links}-{number}-{inversion}", title)
            degrees = sorted(chain.degrees, reverse=True)
            numbers = {"chain": str(number), "frame": str(inversion), "joints of the frame": str(chain.degrees[group[0]]),
                       "joints of the links": " ".join(map(str, degrees))}  # fmt: skip
            out.append(LinkageSolution(scene if _runs(scene) else _nudged(scene), numbers))
    return out


def _runs(scene: Scene) -> bool:
    """Whether a scene can be solved."""
    try:
        run_scene(scene, frames=24)
    except MechanismError:
        return False
    return True


def _nudged(scene: Scene) -> Scene:
    """The scene with a drive that only oscillates by a small angle about the sketch."""
    name, joint = next((name, joint) for name, joint in scene.document.joints.items() if joint.drive is not None)
    (link,) = {*scene.document.links} & {*joint.links} - {"frame"}
    first, second = (complex(*scene.document.sketch[point]) for point in list(scene.document.links[link].points)[:2])
    swing = {"centre": float(np.degrees(np.angle(second - first))), "amplitude": DRIVE_NUDGE, "period": "2 s"}
    return scene.changed({("joints", name, "drive"): {"oscillation": swing}})


def _scene(chain: Chain, frame: int, places: Complex, name: str, title: str) -> Scene:
    """Scene of a chain with a fixed link, driven at the joint of the frame whose other link has the fewest joints."""
    names = {link: "frame" if link == frame else f"link{link}" for link in range(chain.links)}
    own = [(chain.degrees[a if b == frame else b], j) for j, (a, b) in enumerate(chain.joints) if frame in (a, b)]
    driven = min(own)[1]
    joints: dict[str, dict[str, object]] = {}
    for j, (a, b) in enumerate(chain.joints):
        pair = [names[a], names[b]] if b != frame else [names[b], names[a]]
        joints[f"J{j + 1}"] = {"revolute": pair} | ({"drive": {"speed": "30 rpm", "range": "reachable"}} if j == driven else {})
    links = {
        names[link]: {"points": [f"J{j + 1}" for j, joint in enumerate(chain.joints) if link in joint]}
        for link in range(chain.links)
    }
    return Scene.build(
        name=name,
        title=title,
        learning_goal="Number synthesis counts the ways to join links; holding another link of a chain gives another mechanism.",
        units={"length": "mm", "angle": "deg"},
        links=links,
        joints=joints,
        sketch={f"J{j + 1}": [round(float(z.real), 3), round(float(z.imag), 3)] for j, z in enumerate(places)},
    )
