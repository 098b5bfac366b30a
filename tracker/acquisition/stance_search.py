"""A start without background plates: a person in T- or A-pose is looked for all over the floor, on edges alone."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pydantic

from tracker.analysis import Analysis
from tracker.analysis.contours import ContourAnalysis
from tracker.arrays import Array, Mask
from tracker.body import BodyModel
from tracker.components import component
from tracker.errors import InitializationError
from tracker.evidence.contours import ContourEvidence
from tracker.frame import Frame
from tracker.initialization import Stages
from tracker.rig import Rig
from tracker.scene import Scene
from tracker.similarity.chamfer import ChamferSimilarity
from tracker.start import Start

_BATCH = 256


@component
class StanceSearch:
    """Tries standing poses at every place and turn whose joints all views show; refines the best ones.

    For one person, upright on the floor.
    """

    stances_deg: tuple[dict[str, float], ...] | None = None
    """Poses tried, degrees; a name stands for both sides. None takes those of the body's file."""

    floor_m: float = 0.0
    """Height of the floor, metres."""

    step_m: float = pydantic.Field(default=0.1, gt=0)
    """Step of the places, metres."""

    step_deg: float = pydantic.Field(default=15.0, gt=0, le=90)
    """Step of the turns, degrees."""

    hypotheses: int = pydantic.Field(default=8, ge=1)
    """Poses that are refined; they differ by at least two steps, or 60 degrees."""

    outlier_px: float = pydantic.Field(default=25.0, gt=0)
    """Distance at which a contour point is an outlier in the coarse search, px."""

    analysis: Analysis = ContourAnalysis()
    """Finds the edges of the coarse search."""

    def start(self, frame: Frame, scene: Scene, stages: Stages) -> Start:
        """The pose of one person; see `tracker.initialization.Initialization.start`."""
        if len(scene.persons) != 1:
            raise InitializationError("without background plates only one person can be looked for; give the poses")
        body = scene.persons[0].body
        candidates = self._candidates(body, scene.rig)
        stages.progress(f"looking for a T- or A-pose: {len(candidates)} poses")
        edges = ContourEvidence(analysis=self.analysis, similarity=ChamferSimilarity(outlier_px=self.outlier_px))
        coarse = replace(stages, evidence=edges).objective(frame, scene, 0)
        distances = np.concatenate([coarse(candidates[i : i + _BATCH]) for i in range(0, len(candidates), _BATCH)])
        best, most = None, -np.inf
        for q in self._apart(body, candidates, distances):
            expected = stages.synthesis.contours(scene, 0, q[None])
            estimate = stages.estimation.estimate(stages.objective(frame, scene, 0, expected), q[None])
            if estimate.account.explained > most:
                best, most = estimate.q, estimate.account.explained
        assert best is not None
        return Start((best,))

    def _candidates(self, body: BodyModel, rig: Rig) -> Array:
        """(N, dof) poses on the floor whose landmarks are in all images."""
        root = body.root
        centres = np.array([camera.centre for camera in rig.cameras])
        low, high = centres[:, :2].min(axis=0), centres[:, :2].max(axis=0)
        axes = [np.arange(a, b + self.step_m, self.step_m) for a, b in zip(low, high, strict=True)]
        turns = np.radians(np.arange(-180.0, 180.0, self.step_deg))
        found = []
        for stance in body.start.stances_deg if self.stances_deg is None else self.stances_deg:
            q = body.rest()
            for name, value_deg in stance.items():
                q[body.columns(name)] = np.radians(value_deg)
            q[root.shifts] = 0.0
            q[root.shifts[2]] = self.floor_m - _lowest(body, q)
            places = np.array(list(product(*axes, turns)))
            poses = np.tile(q, (len(places), 1))
            poses[:, [*root.shifts[:2], root.turn]] = places
            found.append(poses[_shown(body, poses, rig)])
        candidates = np.concatenate(found)
        if not len(candidates):
            raise InitializationError("there is no place on the floor that all views show with a whole person on it")
        return body.clamped(candidates)

    def _apart(self, body: BodyModel, poses: Array, distances: Array) -> list[Array]:
        """The best poses that differ in place or turn."""
        root = body.root
        chosen: list[Array] = []
        for i in np.argsort(distances, kind="stable"):
            q = poses[i]
            near = [
                np.linalg.norm((q - other)[root.shifts]) < 2.5 * self.step_m
                and abs((q[root.turn] - other[root.turn] + np.pi) % (2 * np.pi) - np.pi) < np.radians(60)
                for other in chosen
            ]
            if not any(near):
                chosen.append(q)
            if len(chosen) == self.hypotheses:
                break
        return chosen


def _lowest(body: BodyModel, q: Array) -> float:
    """Lowest end of a part at a pose, metres."""
    placed = body.world_from_part(q)
    ends = [placed @ np.array([0.0, 0.0, sign, 0.0]) * body.shapes[:, 2:3] + placed[..., 3] for sign in (-1.0, 1.0)]
    thick = body.shapes[:, :2].min(axis=1)
    return float(min((end[:, 2] - thick).min() for end in ends))


def _shown(body: BodyModel, poses: Array, rig: Rig) -> Mask:
    """(N,) poses whose landmarks lie in the images of all views."""
    shown = np.ones(len(poses), dtype=np.bool_)
    for i in range(0, len(poses), 4096):
        part = slice(i, i + 4096)
        points = body.landmarks_in_world(poses[part])
        for camera in rig.cameras:
            pixels = camera.project(points)
            inside = (pixels > 0) & (pixels < np.array(camera.size) - 1)
            shown[part] &= (inside & np.isfinite(pixels)).all(axis=(1, 2))
    return shown
