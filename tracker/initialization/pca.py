"""Iterative-PCA bootstrapping (Gavrila & Davis 1996, section 4.1): start poses from the moving foreground."""

from __future__ import annotations

from itertools import product

import numpy as np
import pydantic
from scipy.optimize import least_squares

from tracker.arrays import Array, Mask
from tracker.body import BodyModel
from tracker.components import component
from tracker.errors import InitializationError, ModelError
from tracker.estimation.best_first import BestFirstEstimation
from tracker.frame import Frame
from tracker.imaging.background import foreground
from tracker.initialization import Stages
from tracker.initialization._torso_axis import TorsoAxis, person_regions, region_axes, torso_axis
from tracker.objective import Objective
from tracker.observation import Observation
from tracker.scene import Scene
from tracker.start import AxisFit, Start

_BATCH = 128


@component
class PcaInitialization:
    """Background subtraction, iterated PCA in every view, the torso's axis in space, then a coarse-to-fine search.

    Persons must not overlap in the images and stand upright before a known background.
    """

    min_area: float = pydantic.Field(default=0.002, gt=0, lt=1)
    """Least share of an image that a person's region covers in a view that counts."""

    turn: str = "torso_twist"
    """Parameter of the turn about the body's axis, which the axis alone does not show."""

    turn_step_deg: float = pydantic.Field(default=15.0, gt=0, le=90)
    """Step of the turn over the full circle in the coarse search, degrees."""

    coarse_deg: dict[str, tuple[float, ...]] = pydantic.Field(
        default={
            "left_arm_abduction": (10.0, 45.0, 90.0),
            "right_arm_abduction": (10.0, 45.0, 90.0),
            "left_arm_elevation": (0.0, 50.0),
            "right_arm_elevation": (0.0, 50.0),
        }
    )
    """Values of further parameters tried with every turn in the coarse search, degrees."""

    hypotheses: int = pydantic.Field(default=4, ge=1)
    """Coarse poses that are searched finely; their turns are at least `apart_deg` apart."""

    apart_deg: float = pydantic.Field(default=40.0, ge=0)
    """Least difference of the turns of two hypotheses, degrees."""

    fine: BestFirstEstimation = BestFirstEstimation(
        range_deg=60.0, step_deg=20.0, range_m=0.1, step_m=0.05, halvings=2, patience=3
    )
    """Search around each hypothesis."""

    head: str = "head_top"
    """Landmark at the upper end of the axis."""

    base: str = "pelvis"
    """Landmark on the axis that the torso turns about."""

    def start(self, frame: Frame, scene: Scene, stages: Stages) -> Start:
        """Poses of all persons in one frame; see `tracker.initialization.Initialization.start`."""
        masks = _foregrounds(frame, stages, scene)
        stages.progress("bootstrapping: torso axis from the foreground")
        persons = person_regions(masks, len(scene.persons), scene.rig)
        pixels = [int(self.min_area * camera.size[0] * camera.size[1]) for camera in scene.rig.cameras]
        evidence = []
        for k, regions in enumerate(persons):
            axes = region_axes(regions, min(pixels))
            axis = torso_axis(scene.rig, regions, axes)
            evidence.append(
                tuple(
                    AxisFit(region, tuple(one.ends for one in found)) if region is not None and found else None
                    for region, found in zip(regions, axes, strict=True)
                )
            )
            scene = scene.with_pose(k, self._upright(scene.persons[k].body, axis))
        observation = stages.analysis.observe(frame, None, stages.backgrounds)
        for k in range(len(scene.persons)):
            scene = self._search(frame, scene, k, stages, observation)
        return Start(tuple(person.q for person in scene.persons), tuple(evidence))

    def _upright(self, body: BodyModel, axis: TorsoAxis) -> Array:
        """The rest pose with head and pelvis on the axis."""
        for name in (self.head, self.base):
            if name not in body.landmark_names:
                raise ModelError(f'bootstrapping needs the landmark "{name}", model "{body.name}" has none')
        marks = [body.landmark_names.index(self.head), body.landmark_names.index(self.base)]
        columns = body.group(body.coarse_groups[0])
        rest = body.rest()
        length = float(np.linalg.norm(np.subtract(*body.landmarks_in_world(rest)[marks])))
        targets = np.array([axis.head_top, axis.head_top - length * axis.direction])

        def residual(values: Array) -> Array:
            q = rest.copy()
            q[columns] = values
            gap: Array = (body.landmarks_in_world(q)[marks] - targets).ravel()
            return gap

        start = rest[columns]
        start[~body.rotates[columns]] = 0.0
        q = rest.copy()
        q[columns] = least_squares(residual, start).x
        return body.clamped(q)

    def _search(self, frame: Frame, scene: Scene, k: int, stages: Stages, observation: Observation) -> Scene:
        """Coarse-to-fine search of the turn and the limbs of person k."""
        body = scene.persons[k].body
        objective = Objective(scene, k, stages.synthesis, stages.similarity, observation)
        stages.progress("bootstrapping: coarse search of the turn and the limbs")
        coarse = self._coarse(body, scene.persons[k].q)
        distances = np.concatenate([objective(coarse[i : i + _BATCH]) for i in range(0, len(coarse), _BATCH)])
        best, best_distance = scene.persons[k].q, np.inf
        for n, q in enumerate(self._apart(body, coarse, distances), start=1):
            stages.progress(f"bootstrapping: hypothesis {n} of {self.hypotheses}")
            searched = self.fine.estimate(objective, q[None])
            # Ranked against all foreground edges, not only those near its own contours: a wrong pose leaves
            # whole limbs of the observation unexplained.
            refined = stages.estimation.estimate(objective, searched.q[None])
            if refined.distance_px < best_distance:
                best, best_distance = refined.q, refined.distance_px
        return scene.with_pose(k, best)

    def _coarse(self, body: BodyModel, q: Array) -> Array:
        """(N, dof) all combinations of the turn and the coarse values."""
        turns = np.radians(np.arange(-180.0, 180.0, self.turn_step_deg))
        columns = [body.index(self.turn), *(body.index(name) for name in self.coarse_deg)]
        values = [turns, *(np.radians(value) for value in self.coarse_deg.values())]
        combinations = np.array(list(product(*values)))
        poses = np.tile(q, (len(combinations), 1))
        poses[:, columns] = combinations
        return body.clamped(poses)

    def _apart(self, body: BodyModel, poses: Array, distances: Array) -> list[Array]:
        """The best poses whose turns differ."""
        turn = body.index(self.turn)
        chosen: list[Array] = []
        for i in np.argsort(distances, kind="stable"):
            gaps = [abs((poses[i, turn] - q[turn] + np.pi) % (2 * np.pi) - np.pi) for q in chosen]
            if not gaps or min(gaps) >= np.radians(self.apart_deg):
                chosen.append(poses[i])
            if len(chosen) == self.hypotheses:
                break
        return chosen


def _foregrounds(frame: Frame, stages: Stages, scene: Scene) -> tuple[Mask | None, ...]:
    known = [plate is not None for plate in stages.backgrounds]
    if sum(known) < 2:
        raise InitializationError(
            f"bootstrapping needs the background of at least two views, {sum(known)} given: add "
            '`background = "background/{view}.png"` to [reading], or use = "given" in [initialization]'
        )
    return tuple(
        None if image is None or plate is None else foreground(image, plate)
        for image, plate in zip(frame.images, stages.backgrounds, strict=True)
    )
