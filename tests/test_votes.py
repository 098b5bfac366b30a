"""Segments of edges vote for the limb that they are paired with (Rosenhahn et al. 2006, section 2.2)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from observations import objective_of, observed, off

from tracker.bodies.scene import Person, Scene
from tracker.evidence.measures.correspondences import Equations, limbs_of, oriented_pairs, voted_pairs
from tracker.evidence.measures.outlines import Comparison
from tracker.evidence.silhouettes import SilhouetteEvidence
from tracker.evidence.similarity.chamfer import ChamferSimilarity
from tracker.foundation.arrays import Array, Integers
from tracker.images.sight import Observation
from tracker.synthesis.cpu import CpuSynthesis

GATE_PX, DIRECTION_DEG = 30.0, 40.0


@pytest.fixture(scope="module")
def drawn(truth: Scene) -> tuple[Observation, Integers]:
    """The true contours as edges, a segment of each part; and the true limb of each packed point."""
    contours = CpuSynthesis(step_px=2.0, n_eta=17, n_omega=32).contours(truth)
    plain = observed(contours, truth.rig)
    views, limbs = [], []
    for v, view in enumerate(plain.views):
        assert view is not None
        parts = contours.of(v).parts[~contours.of(v).between]
        views.append(replace(view, segments=parts))
        limbs.append(limbs_of(truth)[parts][np.argsort(view.edges[:, 1], kind="stable")])
    return Observation(tuple(views)), np.concatenate(limbs)


def asked_at(truth: Scene, observation: Observation, seed: int) -> tuple[Comparison, Array]:
    """The question at a pose that is off by 8 degrees and 3 cm."""
    body = truth.persons[0].body
    q = body.clamped(truth.persons[0].q + off(body, 8.0, 0.03, seed=seed))
    return objective_of(truth, observation).asked, q


def test_segments_are_numbered_in_the_order_of_the_points(drawn: tuple[Observation, Integers]) -> None:
    observation, _ = drawn
    segments, packed = observation.packed_segments, observation.packed
    assert len(segments) == len(packed.points)
    for v, view in enumerate(observation.views):
        assert view is not None
        own = slice(packed.first[v], packed.first[v + 1])
        others = np.concatenate([segments[: own.start], segments[own.stop :]])
        assert not np.isin(segments[own], others).any()
        for row, number in zip(packed.points[own][::17], segments[own][::17], strict=True):
            place = int(np.flatnonzero((view.edges == row[:2]).all(axis=1))[0])
            assert view.segments[place] - view.segments[view.scene].min() == number - segments[own].min()


def test_a_segment_is_paired_with_one_limb_and_more_often_with_its_own(
    truth: Scene, drawn: tuple[Observation, Integers]
) -> None:
    """Ten poses that are off: the share of pairs with the limb that drew the edge, one by one and voted for."""
    observation, true_limbs = drawn
    limbs, shares = limbs_of(truth), []
    for seed in range(10):
        asked, q = asked_at(truth, observation, seed)
        contours, right = asked.fine(q), []
        for pairs in (
            oriented_pairs(contours, observation.packed, GATE_PX, DIRECTION_DEG),
            voted_pairs(asked, contours, GATE_PX, DIRECTION_DEG, limbs),
        ):
            theirs = limbs[contours.parts[0][pairs[:, 0], pairs[:, 1]]]
            right.append((theirs == true_limbs[pairs[:, 2]]).mean())
        segments = observation.packed_segments[pairs[:, 2]]
        assert all(len(set(theirs[segments == number].tolist())) == 1 for number in np.unique(segments))
        shares.append(right)
    plain, voted = np.transpose(shares)
    assert plain.mean() < 0.9
    assert (voted > plain).all()
    assert 1 - voted.mean() < 0.7 * (1 - plain.mean())


def test_of_a_single_limb_the_pairs_are_those_without_votes(truth: Scene, drawn: tuple[Observation, Integers]) -> None:
    observation, _ = drawn
    asked, q = asked_at(truth, observation, 0)
    contours, one = asked.fine(q), np.zeros(len(truth.shapes), dtype=np.int64)
    # segments that nobody votes for are left out, here those of single points
    pairs = oriented_pairs(contours, observation.packed, GATE_PX, DIRECTION_DEG)
    voting = np.unique(observation.packed_segments[pairs[pairs[:, 3] == 1, 2]])
    expected = pairs[np.isin(observation.packed_segments[pairs[:, 2]], voting)]
    found = voted_pairs(asked, contours, GATE_PX, DIRECTION_DEG, one)
    assert {tuple(pair) for pair in found.tolist()} == {tuple(pair) for pair in expected.tolist()}


def test_limbs_are_those_of_each_person(truth: Scene) -> None:
    person = truth.persons[0]
    limbs = limbs_of(Scene((person, Person("two", person.body, person.q)), truth.rig))
    n_parts = len(person.body.parts)
    assert not np.isin(limbs[:n_parts], limbs[n_parts:]).any()
    for group in person.body.fine_groups:
        assert len(set(limbs[:n_parts][person.body.parts_of(group)].tolist())) == 1


def test_silhouettes_vote_as_edges_do(truth: Scene, drawn: tuple[Observation, Integers]) -> None:
    """With votes the equations are others, and no less is seen of the pose."""
    observation, _ = drawn
    asked, q = asked_at(truth, observation, 1)
    plain, voted = (ChamferSimilarity(votes=votes).equations(asked, q, GATE_PX) for votes in (False, True))
    assert not np.allclose(plain.matrix, voted.matrix)
    assert np.linalg.matrix_rank(voted.matrix) == np.linalg.matrix_rank(plain.matrix)
    masks = CpuSynthesis().silhouettes(truth)
    question = replace(asked, observed=SilhouetteEvidence().seen(masks))
    found: list[Equations] = [
        SilhouetteEvidence(votes=votes).equations(question, q, GATE_PX) for votes in (False, True)
    ]
    assert not np.allclose(found[0].matrix, found[1].matrix)
    assert found[1].total > 0.5 * found[0].total


def test_no_edges_are_no_pairs(truth: Scene) -> None:
    nothing = Observation((None,) * len(truth.rig))
    asked, q = asked_at(truth, nothing, 0)
    assert len(voted_pairs(asked, asked.fine(q), GATE_PX, DIRECTION_DEG, limbs_of(truth))) == 0
