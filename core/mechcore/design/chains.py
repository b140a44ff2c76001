"""Number synthesis: planar kinematic chains of links and simple revolute joints, up to isomorphism, and their inversions.

A chain is a connected graph with links as vertices and joints as edges. It has no bridge (every joint lies on a loop), no rigid
part, and ``3 (links - 1) - 2 joints`` degrees of freedom. Chains are built by ear decomposition: a loop, then paths of new binary
links between two links, or from a link back to itself.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from itertools import combinations, pairwise

from mechcore.errors import Fault, MechanismError
from mechcore.records import dataclass

ChainJoints = tuple[tuple[int, int], ...]
MOST_LINKS = 10  # the 230 chains of ten links take a minute


@dataclass(frozen=True)
class Chain:
    """A chain of links 0 ... links-1: the pairs of links that its joints connect, and its links grouped by distinct inversions
    (``frames``: orbits of the automorphisms)."""

    links: int
    joints: ChainJoints
    frames: tuple[tuple[int, ...], ...]

    @property
    def freedom(self) -> int:
        """Degrees of freedom of the chain with one link held."""
        return 3 * (self.links - 1) - 2 * len(self.joints)

    @property
    def degrees(self) -> tuple[int, ...]:
        """Number of joints of each link."""
        return tuple(sum(link in joint for joint in self.joints) for link in range(self.links))

    @property
    def fractionated(self) -> bool:
        """Whether removing some link disconnects the chain."""
        return any(not _connected(self.links, self.joints, without=link) for link in range(self.links))


@lru_cache(maxsize=16)
def kinematic_chains(links: int, freedom: int = 1) -> tuple[Chain, ...]:
    """All chains of so many links and degrees of freedom, one of each isomorphism class, sorted by the degrees of their links:
    those with links of the most joints last.

    Numbers agree with the published tables: 1, 2, 16, 230 chains of 4, 6, 8, 10 links and one degree of freedom.
    """
    if not 3 < links <= MOST_LINKS:
        raise MechanismError(Fault("links", f"{links} links.", f"Take 4 to {MOST_LINKS}."))
    if freedom < 1 or (3 * (links - 1) - freedom) % 2 or links < freedom + 3:
        odd = "an even number of links" if freedom % 2 else "an odd number of links"
        raise MechanismError(
            Fault("freedom", f"no chain of {links} links with simple joints has {freedom} degrees of freedom.",
                  f"With {freedom} take {odd}, at least {freedom + 3}." if freedom > 0 else "Take one or more.")
        )  # fmt: skip
    chains = [_chain(links, joints) for joints in _grown(links) if 3 * (links - 1) - 2 * len(joints) == freedom]
    return tuple(sorted(chains, key=lambda chain: (sorted(chain.degrees, reverse=True), chain.joints)))


def _chain(links: int, joints: ChainJoints) -> Chain:
    """A chain with its inversions: two links give the same one where the graphs that mark either of them are isomorphic."""
    kinds: dict[object, list[int]] = {}
    for link in range(links):
        kinds.setdefault(_canonical(links, joints, link), []).append(link)
    return Chain(links, joints, tuple(tuple(group) for group in kinds.values()))


@lru_cache(maxsize=16)
def _grown(links: int) -> tuple[ChainJoints, ...]:
    """Canonical graphs of so many links without a rigid part, of any freedom."""
    grown: dict[ChainJoints, None] = {}
    if links >= 4:
        grown[_canonical(links, tuple((k, (k + 1) % links) for k in range(links)))] = None
    for before in range(4, links + 1):
        added = links - before
        seeds = list(_grown(before)) if added else []
        if added == 0:  # joints between existing links, as long as they give new graphs
            seeds = list(grown)
        while seeds:
            new = [
                joints
                for seed in seeds
                for joints in dict.fromkeys(_canonical(links, ear) for ear in _with_ear(before, seed, added))
                if joints not in grown and not _has_rigid_part(links, joints)
            ]
            grown.update(dict.fromkeys(new))
            seeds = list(dict.fromkeys(new)) if added == 0 else []
    return tuple(grown)


def _with_ear(links: int, joints: ChainJoints, added: int) -> Iterator[ChainJoints]:
    """Graphs with a path of ``added`` new links between two links, or, for three or more, from a link to itself."""
    new = tuple(range(links, links + added))
    ends = [*combinations(range(links), 2), *(((k, k) for k in range(links)) if added >= 3 else ())]
    for first, last in ends:
        path = (first, *new, last)
        ear = tuple((min(pair), max(pair)) for pair in pairwise(path))
        if added or ear[0] not in joints:
            yield (*joints, *ear)


def _has_rigid_part(links: int, joints: ChainJoints) -> bool:
    """Whether three or more of the links cannot move relative to each other."""
    masks = [(1 << a) | (1 << b) for a, b in joints]
    for part in range(1, 1 << links):
        size = part.bit_count()
        if size >= 3 and 3 * (size - 1) - 2 * sum(mask & part == mask for mask in masks) < 1:
            return True
    return False


def _connected(links: int, joints: ChainJoints, without: int) -> bool:
    left = set(range(links)) - {without}
    reached, front = set[int](), [min(left)]
    while front:
        link = front.pop()
        if link not in reached:
            reached.add(link)
            front += [b if a == link else a for a, b in joints if link in (a, b) and without not in (a, b)]
    return reached == left


def _canonical(links: int, joints: ChainJoints, marked: int | None = None) -> ChainJoints:
    """The canonical form of a graph (with a marked link), the same for all numberings: colour refinement, then all choices within
    the first ambiguous colour."""
    near: list[list[int]] = [[] for _ in range(links)]
    for a, b in joints:
        near[a].append(b)
        near[b].append(a)

    def refined(colours: list[int]) -> list[int]:
        while True:
            keys = [(colours[k], tuple(sorted(colours[n] for n in near[k]))) for k in range(links)]
            order = {key: rank for rank, key in enumerate(sorted(set(keys)))}
            new = [order[key] for key in keys]
            if len(order) == len(set(colours)):
                return new
            colours = new

    def best(colours: list[int]) -> ChainJoints:
        colours = refined(colours)
        if len(set(colours)) == links:
            return tuple(sorted((min(colours[a], colours[b]), max(colours[a], colours[b])) for a, b in joints))
        chosen = min(c for c in set(colours) if colours.count(c) > 1)
        members = [k for k in range(links) if colours[k] == chosen]
        return min(best([2 * c + (c == chosen and k != member) for k, c in enumerate(colours)]) for member in members)

    return best([int(k != marked) if marked is not None else 0 for k in range(links)])
