"""The refinement in one compiled call ends where its twin, which asks the evidence step by step, ends."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

import numpy as np
import pytest
from observations import bent, four_views, ideal, objective_of, off
from recordings import TrueStart, cycle_for, small_simulation

from tracker.bodies.scene import Person, Scene
from tracker.evidence import Evidence
from tracker.evidence._anchors import Anchors
from tracker.evidence.auto import AutoEvidence, _Seen
from tracker.evidence.contours import ContourEvidence
from tracker.evidence.measures.correspondences import Equations
from tracker.evidence.measures.outlines import Comparison
from tracker.evidence.motion import MotionEvidence, ObservedMotion
from tracker.evidence.similarity.chamfer import ChamferSimilarity
from tracker.evidence.together import TogetherEvidence
from tracker.foundation.arrays import Array
from tracker.kernels.descent import Kinds, Rule
from tracker.synthesis.cpu import CpuSynthesis
from tracker.tracking.estimation import twist_icp
from tracker.tracking.estimation._compiled_descent import compiled_descent
from tracker.tracking.estimation.twist_icp import TwistIcpEstimation
from tracker.tracking.objective import Objective
from tracker.tracking.sequence import track
from tracker.tracking.trajectory import History

STEP_BY_STEP = TwistIcpEstimation._descend


def descended(monkeypatch: pytest.MonkeyPatch, *asked: object) -> tuple[Array, Equations]:
    """Where the twin ends, in Python."""
    with monkeypatch.context() as patch:
        patch.setattr(twist_icp, "compiled_descent", lambda objective: None)
        return STEP_BY_STEP(*asked)  # type: ignore[arg-type]


def assert_the_same(found: tuple[Array, Equations], twin: tuple[Array, Equations]) -> None:
    """Sums in another order differ by rounding, which six steps carry on."""
    np.testing.assert_allclose(found[0], twin[0], rtol=0, atol=1e-7)
    scale = np.abs(twin[1].matrix).max()
    np.testing.assert_allclose(found[1].matrix, twin[1].matrix, rtol=0, atol=1e-6 * scale)
    np.testing.assert_allclose(found[1].vector, twin[1].vector, rtol=0, atol=1e-6 * scale)
    assert found[1].squares == pytest.approx(twin[1].squares, rel=1e-6)
    assert found[1].total == pytest.approx(twin[1].total, rel=1e-6)


@pytest.mark.parametrize("plates", [True, False])
def test_every_refinement_of_a_recording_ends_where_its_twin_does(
    plates: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With all kinds: edges, colours, followed places; of two persons, each of whom stands still for the other."""
    simulation = small_simulation("walking_on_the_spot", n_frames=4, persons=2)
    said: list[Kinds] = []

    def both(self: TwistIcpEstimation, objective: Objective, *asked: object) -> tuple[Array, Equations]:
        found = STEP_BY_STEP(self, objective, *asked)  # type: ignore[arg-type]
        kinds = objective.evidence.kinds(objective.asked)
        assert kinds is not None
        said.append(kinds)
        assert_the_same(found, descended(monkeypatch, self, objective, *asked))
        return found

    monkeypatch.setattr(TwistIcpEstimation, "_descend", both)
    known = simulation.plates if plates else (None,) * len(simulation.plates)
    cycle = replace(cycle_for(simulation, TrueStart(simulation)), evidence=AutoEvidence(), plates=known)
    steps = list(track(simulation.frames(), simulation.scene, cycle))
    assert len(steps) == 4
    assert len(said) >= 8
    assert all(kinds.edges is not None for kinds in said)
    assert any(kinds.colours is not None and kinds.places is not None for kinds in said)
    assert any(kinds.places is None and kinds.most_silent > 0 for kinds in said)


@pytest.fixture(scope="module")
def bent_scene(body) -> Scene:
    return Scene((Person("one", body, bent(body)),), four_views())


def refined_both_ways(objective: Objective, start: Array, monkeypatch: pytest.MonkeyPatch) -> tuple[Array, Equations]:
    """What both ways agree on, from a start far off."""
    asked = TwistIcpEstimation(), objective, start, start, np.geomspace(30.0, 8.0, 6).tolist()
    assert compiled_descent(objective) is not None
    found = STEP_BY_STEP(*asked)
    assert_the_same(found, descended(monkeypatch, *asked))
    return found


@pytest.mark.parametrize("seed", range(3))
def test_limits_hold_in_both_ways(bent_scene: Scene, seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """The pose sought lies beyond what elbows and knees may do: they stay at their limits, and the rest moves on."""
    person = bent_scene.persons[0]
    narrow = tuple(
        replace(one, limits=(one.limits[0], 0.3)) if one.name.endswith("_extension") else one
        for one in person.body.parameters
    )
    stiff = replace(person.body, parameters=narrow)
    start = stiff.clamped(person.q + off(stiff, 5.0, 0.03, seed))
    scene = Scene((Person("one", stiff, start),), bent_scene.rig)
    q, _ = refined_both_ways(objective_of(scene, ideal(bent_scene)), start, monkeypatch)
    hinges = [k for k, name in enumerate(stiff.names) if name.endswith("_extension")]
    assert (q[hinges] == 0.3).any()
    assert (q <= stiff.limits[:, 1]).all()


def test_what_was_long_hidden_counts_in_neither_way(bent_scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    body, q = bent_scene.persons[0].body, bent_scene.persons[0].q
    start = body.clamped(q + off(body, 3.0, 0.02, 0))
    objective = objective_of(bent_scene.with_pose(0, start), ideal(bent_scene))
    hidden = np.zeros((4, len(body.parts)), dtype=np.bool_)
    hidden[:2, body.parts_of("left_arm")] = True
    history = replace(History.start(0.0, q), unseen=np.where(hidden, 1000, 0))
    assert history.hidden is not None
    shown, _ = refined_both_ways(objective, start, monkeypatch)
    without, _ = refined_both_ways(replace(objective, history=history), start, monkeypatch)
    assert np.abs(without - shown).max() > 1e-4


def test_a_body_with_room_for_too_few_samples_is_traced_again(
    bent_scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A sample each half pixel: more than 64 of a part."""
    dense, start = CpuSynthesis(step_px=0.4), bent_scene.persons[0].q
    objective = objective_of(bent_scene, ideal(bent_scene))
    objective = replace(objective, asked=replace(objective.asked, synthesis=dense))
    assert objective.asked.fine(start).counts.max() > 64 * len(bent_scene.shapes)
    refined_both_ways(objective, start, monkeypatch)


class Written(ContourEvidence):
    """One that somebody has written in Python: nothing is known of its equations."""

    asked_px: ClassVar[list[float]] = []

    def equations(self, asked: Comparison, q: Array, gate_px: float) -> Equations:
        self.asked_px.append(gate_px)
        return super().equations(asked, q, 0.7 * gate_px)


def beside_contours(contours: Objective, *written: Evidence, chosen: bool) -> Objective:
    """The same question put to contours and to others, perhaps as those that `auto` has chosen."""
    n = len(written)
    both = TogetherEvidence(
        of=(ContourEvidence(), *written),
        ranking=(1.0, *[0.0] * n),
        refining=(0.3, *[1.0] * n),
        exact_px=(1.2, *[0.8] * n),
    )
    observed = (contours.asked.observed,) * (n + 1)
    if not chosen:
        return replace(contours, asked=replace(contours.asked, observed=observed), evidence=both)
    return replace(contours, asked=replace(contours.asked, observed=_Seen(both, observed)), evidence=AutoEvidence())


@pytest.mark.parametrize("chosen", [False, True])
def test_who_is_not_compiled_is_asked_in_every_step(
    bent_scene: Scene, chosen: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    body, q = bent_scene.persons[0].body, bent_scene.persons[0].q
    objective = beside_contours(objective_of(bent_scene, ideal(bent_scene)), Written(), chosen=chosen)
    start = body.clamped(q + off(body, 2.0, 0.01, 0))
    refined_both_ways(objective, start, monkeypatch)
    Written.asked_px.clear()
    gates = np.geomspace(30.0, 8.0, 6).tolist()
    fresh = beside_contours(objective_of(bent_scene, ideal(bent_scene)), Written(), chosen=chosen)
    TwistIcpEstimation(rest_deg=0, rest_m=0)._descend(fresh, start, start, gates)
    assert Written.asked_px == pytest.approx(gates)


def test_contours_that_were_hidden_are_hidden_from_who_is_asked(
    bent_scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    body, q = bent_scene.persons[0].body, bent_scene.persons[0].q
    hidden = np.zeros((4, len(body.parts)), dtype=np.bool_)
    hidden[:2, body.parts_of("left_arm")] = True
    history = replace(History.start(0.0, q), unseen=np.where(hidden, 1000, 0))
    objective = beside_contours(objective_of(bent_scene, ideal(bent_scene)), Written(), chosen=False)
    start = body.clamped(q + off(body, 3.0, 0.02, 0))
    refined_both_ways(replace(objective, history=history), start, monkeypatch)


@pytest.mark.parametrize(("weight", "is_compiled"), [(1.0, True), (0.5, False)])
def test_who_stands_beside_kinds_that_are_weighed_changes_none_of_their_weights(
    bent_scene: Scene, weight: float, is_compiled: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As keypoints stand beside what `auto` has chosen: what contours leave over raises them against the others."""
    body, q = bent_scene.persons[0].body, bent_scene.persons[0].q
    inner = beside_contours(objective_of(bent_scene, ideal(bent_scene)), Written(), chosen=True)
    outer = TogetherEvidence(of=(inner.evidence, Written()), ranking=(1.0, 0.0), refining=(weight, 0.7))
    edges = inner.asked.observed.observed[0]
    objective = replace(inner, asked=replace(inner.asked, observed=(inner.asked.observed, edges)), evidence=outer)
    assert (compiled_descent(objective) is not None) == is_compiled
    start = body.clamped(q + off(body, 2.0, 0.01, 0))
    if is_compiled:
        refined_both_ways(objective, start, monkeypatch)


def test_one_kind_that_is_weighed_keeps_its_weight(bent_scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a first frame, in which colours say nothing yet."""
    body, q = bent_scene.persons[0].body, bent_scene.persons[0].q
    contours = objective_of(bent_scene, ideal(bent_scene))
    seen = contours.asked.observed
    silent = TogetherEvidence(of=(ContourEvidence(), MotionEvidence()), ranking=(1.0, 0.0), refining=(0.3, 1.0))
    outer = TogetherEvidence(of=(silent, Written()), ranking=(1.0, 0.0), refining=(1.0, 1.0))
    observed = ((seen, ObservedMotion((True,) * 4, Anchors.none(), np.zeros(0))), seen)
    objective = replace(contours, asked=replace(contours.asked, observed=observed), evidence=outer)
    refined_both_ways(objective, body.clamped(q + off(body, 2.0, 0.01, 0)), monkeypatch)


class Faulty(ContourEvidence):
    """One that fails."""

    def equations(self, asked: Comparison, q: Array, gate_px: float) -> Equations:
        raise ZeroDivisionError("a fault of its own")


class OfAnotherBody(ContourEvidence):
    """One whose equations have other parameters."""

    def equations(self, asked: Comparison, q: Array, gate_px: float) -> Equations:
        return Equations.nothing(3)


@pytest.mark.parametrize(
    ("written", "error", "told"),
    [(Faulty(), ZeroDivisionError, "of its own"), (OfAnotherBody(), ValueError, "answer.matrix")],
)
def test_a_fault_of_who_is_asked_is_told(
    bent_scene: Scene, written: Evidence, error: type[Exception], told: str
) -> None:
    objective, start = objective_of(bent_scene, ideal(bent_scene)), bent_scene.persons[0].q
    with pytest.raises(error, match=told):
        TwistIcpEstimation()._descend(beside_contours(objective, written, chosen=False), start, start, [30.0])


def test_where_nothing_is_compiled_all_is_asked_for_in_python(bent_scene: Scene) -> None:
    objective = objective_of(bent_scene, ideal(bent_scene))
    assert compiled_descent(replace(objective)) is not None
    assert compiled_descent(replace(objective, evidence=Written())) is None
    votes = replace(objective, evidence=ContourEvidence(similarity=ChamferSimilarity(votes=True)))
    assert compiled_descent(votes) is None
    alone = TogetherEvidence(of=(Written(),), ranking=(1.0,), refining=(1.0,))
    asked = replace(objective.asked, observed=(objective.asked.observed,))
    assert compiled_descent(replace(objective, asked=asked, evidence=alone)) is None


def test_equations_that_hold_nothing_are_no_step(bent_scene: Scene) -> None:
    """Nothing seen and nothing held: the equations have no solution, in either way."""
    body, q = bent_scene.persons[0].body, bent_scene.persons[0].q
    objective = objective_of(bent_scene, ideal(bent_scene))
    nothing, refine = np.zeros(body.dof), compiled_descent(objective)
    assert refine is not None
    with pytest.raises(np.linalg.LinAlgError):
        refine(Rule(q, -1e9 * np.ones(body.dof), q, nothing, 0.0, nothing), q, np.array([30.0]))
