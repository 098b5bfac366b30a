"""Start poses from a detector's 2-D keypoints; needs no clean plates."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np

from tracker.bodies.body import BodyModel
from tracker.bodies.keypoint_layouts.views import KeypointFiles, KeypointViews
from tracker.bodies.keypoints import Skeleton, limbs, meant, skeletons, swapped_sides
from tracker.bodies.scene import Person, Scene
from tracker.cameras.frame import Frame
from tracker.evidence import Evidence
from tracker.evidence.auto import AutoEvidence
from tracker.evidence.keypoints import KeypointEvidence
from tracker.evidence.together import TogetherEvidence
from tracker.foundation.arrays import Array, Integers
from tracker.foundation.configuration.components import component
from tracker.foundation.errors import ConfigError, InitializationError, SequenceError
from tracker.images.plate import Plate
from tracker.tracking.hypotheses import beside_turned
from tracker.tracking.initialization import Stages
from tracker.tracking.initialization._inverse_kinematics import fitted_pose
from tracker.tracking.initialization._persons import place
from tracker.tracking.start import Hypothesis, Start

_LEAST_MARKS = 6
"""Number of landmarks in space that fix a pose for a start: hips and shoulders, and two more."""

_FAR_M = 0.15
"""Mean distance from which on the keypoints are not the body's, metres."""

_HELD_M = 0.3
"""Keypoints this close on average to a person with a known pose are that person's: a running stride in a frame,
metres."""


@component
class KeypointInitialization(KeypointFiles):
    """Triangulates the keypoints of all views robustly and fits the bodies to them by inverse kinematics."""

    def check(self, scene: Scene, plates: tuple[Plate | None, ...]) -> str:
        """Opens the files and checks which points of each body their keypoints mean; see `Initialization.check`."""
        try:
            views = self.checked(scene.rig)
        except SequenceError as error:
            raise ConfigError(str(error)) from error
        for person in scene.persons:
            n_meant = len(meant(views.names, person.body).rows)
            if n_meant < _LEAST_MARKS:
                raise ConfigError(
                    f'{self.path}: {n_meant} of the keypoints mean points of model "{person.body.name}", expected '
                    f"{_LEAST_MARKS}; keypoints: {', '.join(views.names)}; landmarks: "
                    f"{', '.join(person.body.landmark_names)}; "
                    "[keypoints] of a model file says what other names mean"
                )
        return f"keypoints, {views.order}{views.numbering}, in {self.path}"

    def start(self, frame: Frame, scene: Scene, stages: Stages) -> Start:
        """The poses that fit the keypoints best; `at` assigns the persons, or else the fit of each body.

        It compares them with the same poses turned round: detectors and tables of keypoints may have left and right
        exchanged in all views. The poses stay, and are no less sure: keypoints show sides that outlines do not.
        """
        try:
            views = self.checked(scene.rig)
            found = self.found(views, frame, scene.rig)
        except SequenceError as error:
            raise InitializationError(str(error)) from error
        persons, sought = _skeletons(views, found, scene, stages), _sought(scene, stages)
        fits, places = _fitted(persons, sought, views.names, scene, stages)
        if places is None:
            beside = " beside those with known poses" if stages.held else ""
            seen = ", ".join(f"{len(view)} in {name}" for view, name in zip(found, views.views, strict=True))
            raise InitializationError(
                f"frame {frame.index}: keypoints of {len(sought)} person(s) sought, the views agree on {len(persons)}"
                f"{beside} (detected: {seen}); {self._way_out(views, frame, scene, stages)}"
            )
        poses = [person.q for person in scene.persons]
        for k, row, n in zip(sought, fits, places, strict=True):
            poses[k] = row[n][0]
        other_side = swapped_sides(views.names, scene.persons[0].body.mirror)
        turned = {
            k: _fit(scene.persons[k].body, views.names, _exchanged(persons[n], other_side))[0]
            for k, n in zip(sought, places, strict=True)
        }
        ranking = _beside_turned(frame, scene.with_poses(tuple(poses)), turned, stages)
        return Start(tuple(poses), (), ranking, by_keypoints=True)

    def _way_out(self, views: KeypointViews, frame: Frame, scene: Scene, stages: Stages) -> str:
        """Advice if there is no start: the layout that fits, if the number of keypoints misled."""
        order, gaps = views.order, views.gaps_told(frame)
        fitting = next((other for other in order.others if self._fits(other, frame, scene, stages)), None)
        if fitting:
            return f'they were read as {order.taken_for}, and fit the body as {fitting}: set layout = "{fitting}"'
        return (
            f"check that they are {order.taken_for}, the calibration, and that keypoints and frames have the same "
            f"numbers{f' ({gaps})' if gaps else ''}"
        )

    def _fits(self, layout: str, frame: Frame, scene: Scene, stages: Stages) -> bool:
        """Whether the bodies fit the keypoints in another order."""
        views = KeypointViews.open(self.path, scene.rig.names, layout=layout)
        found = self.found(views, frame, scene.rig)
        persons = _skeletons(views, found, scene, stages)
        return _fitted(persons, _sought(scene, stages), views.names, scene, stages)[1] is not None


def _sought(scene: Scene, stages: Stages) -> list[int]:
    """The persons without known poses."""
    return [k for k in range(len(scene.persons)) if k not in stages.held]


def _skeletons(views: KeypointViews, found: list[Array], scene: Scene, stages: Stages) -> list[Skeleton]:
    """The skeletons that the views agree on, without those of known poses."""
    body = scene.persons[0].body
    other_side, groups = swapped_sides(views.names, body.mirror), limbs(views.names, body)
    persons = skeletons(scene.rig, found, other_side, groups, len(scene.persons) + 1)
    return _without(persons, views.names, [scene.persons[k] for k in stages.held])


def _fitted(
    persons: list[Skeleton], sought: list[int], names: tuple[str, ...], scene: Scene, stages: Stages
) -> tuple[list[list[tuple[Array, float]]], tuple[int, ...] | None]:
    """For each person sought the fit to each skeleton, and the chosen skeleton; None if one of them has none."""
    fits = [[_fit(scene.persons[k].body, names, one) for one in persons] for k in sought]
    told = [None if stages.seen_before else scene.persons[k].at for k in sought]
    return fits, _assigned([_costs(persons, row, at) for row, at in zip(fits, told, strict=True)])


def _exchanged(person: Skeleton, other_side: Integers) -> Skeleton:
    """The skeleton with left and right exchanged: it faces the other way."""
    return replace(person, points=person.points[other_side], n_views=person.n_views[other_side])


def _beside_turned(
    frame: Frame, scene: Scene, turned: dict[int, Array], stages: Stages
) -> tuple[tuple[Hypothesis, ...], ...]:
    """For each person the pose found and turned round, the better one first; empty for persons not sought."""
    if stages.seen_before or all(image is None for image in frame.images):
        return ()
    stages = replace(stages, evidence=_of_images(stages.evidence))
    return tuple(
        beside_turned(frame, scene, k, turned[k], stages) if k in turned else () for k in range(len(scene.persons))
    )


def _of_images(evidence: Evidence) -> Evidence:
    """The evidence without keypoints: these would confirm their own sides."""
    if isinstance(evidence, KeypointEvidence):
        return AutoEvidence()
    if not isinstance(evidence, TogetherEvidence):
        return evidence
    left = [k for k, one in enumerate(evidence.of) if not isinstance(one, KeypointEvidence)]
    ranking, refining = (tuple(own[k] for k in left) for own in (evidence.ranking, evidence.refining))
    if not sum(ranking) > 0 or not sum(refining) > 0:
        return AutoEvidence()
    of = tuple(_of_images(evidence.of[k]) for k in left)
    exact_px = tuple(evidence.exact_px[k] for k in left if evidence.exact_px)
    return TogetherEvidence(of=of, ranking=ranking, refining=refining, exact_px=exact_px)


def _fit(body: BodyModel, names: tuple[str, ...], person: Skeleton) -> tuple[Array, float]:
    """The pose of a body that fits a skeleton, and the mean distance left, metres; infinite if too little is seen."""
    marks = meant(names, body)
    marks = marks.of(np.flatnonzero(np.isfinite(person.points[marks.rows]).all(axis=1)))
    rows = marks.rows
    if len(rows) < _LEAST_MARKS:
        return body.rest(), np.inf
    pose, left = fitted_pose(body, marks, person.points[rows], np.minimum(person.n_views[rows] / 3, 1.0))
    return pose, float(left.mean())


def _without(persons: list[Skeleton], names: tuple[str, ...], held: list[Person]) -> list[Skeleton]:
    """The skeletons without those of persons with known poses."""
    left = list(persons)
    for person in held:
        gaps = [_gap_m(person, names, one) for one in left]
        if min(gaps, default=np.inf) < _HELD_M:
            del left[int(np.argmin(gaps))]
    return left


def _gap_m(person: Person, names: tuple[str, ...], skeleton: Skeleton) -> float:
    """Mean distance of keypoints from a person's pose, metres; infinite if too few can be compared."""
    marks = meant(names, person.body)
    gaps = np.linalg.norm(
        person.body.points_in_world(person.q, marks.points, marks.ends) - skeleton.points[marks.rows], axis=1
    )
    gaps = gaps[np.isfinite(gaps)]
    return float(gaps.mean()) if len(gaps) >= _LEAST_MARKS else np.inf


def _costs(persons: list[Skeleton], fits: list[tuple[Array, float]], at: tuple[float, float] | None) -> list[float]:
    """Cost of assigning each skeleton to a body, metres: distance from the body's given place.

    Without a given place the rest of the fit. Infinite if the body is too far from the keypoints.
    """
    if at is None:
        far_m = [left for _, left in fits]
    else:
        seen = (one.points[np.isfinite(one.points).all(axis=1)] for one in persons)
        far_m = [float(np.linalg.norm(place(points) - at)) for points in seen]
    return [cost if left < _FAR_M else np.inf for cost, (_, left) in zip(far_m, fits, strict=True)]


def _assigned(costs: list[list[float]]) -> tuple[int, ...] | None:
    """For each body its skeleton, at the least total cost; None if one of them has none."""
    n_persons = len(costs[0]) if costs else 0
    orders = [
        order
        for order in itertools.permutations(range(n_persons), len(costs))
        if all(row[n] < np.inf for row, n in zip(costs, order, strict=True))
    ]
    return min(orders, key=lambda order: sum(row[n] for row, n in zip(costs, order, strict=True)), default=None)
