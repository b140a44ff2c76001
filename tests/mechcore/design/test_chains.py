"""Kinematic chains: the published numbers of chains and inversions; none has a rigid part or a bridge."""

from __future__ import annotations

import pytest
from design_cases import design_case

from mechcore.design.chains import kinematic_chains
from mechcore.errors import MechanismError


def test_numbers_of_chains_and_inversions():
    _, expected = design_case("number-synthesis")
    for row in expected["rows"]:
        if row["links"] < 10:
            chains = kinematic_chains(row["links"], row["dof"])
            assert len(chains) == row["chains"]
            assert sum(len(chain.frames) for chain in chains) == row["inversions"]
            assert {len(chain.joints) for chain in chains} == {row["joints"]}
            assert {chain.freedom for chain in chains} == {row["dof"]}
            assert sum(chain.fractionated for chain in chains) == row.get("of_which_fractionated", 0)
    assert [len(kinematic_chains(links, 3)) for links in (6, 8)] == [1, 6]


def test_six_links_are_those_of_watt_and_stephenson():
    """Watt's ternary links are joined to each other, Stephenson's are not; they have two and three inversions."""
    kinds = {}
    for chain in kinematic_chains(6):
        ternary = {link for link, degree in enumerate(chain.degrees) if degree == 3}
        kinds[any(set(joint) == ternary for joint in chain.joints)] = len(chain.frames)
    assert kinds == {True: 2, False: 3}


def test_frames_of_one_kind_have_as_many_joints():
    for chain in kinematic_chains(8):
        assert sorted(sum(chain.frames, ())) == list(range(8))
        assert all(len({chain.degrees[link] for link in group}) == 1 for group in chain.frames)


@pytest.mark.parametrize(("links", "freedom"), [(5, 1), (6, 2), (4, 2), (40, 1), (6, 0)])
def test_numbers_that_no_chain_has_are_refused(links, freedom):
    with pytest.raises(MechanismError, match="links"):
        kinematic_chains(links, freedom)
