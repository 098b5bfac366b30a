"""Chooses the start by the recording."""

from __future__ import annotations

import contextlib
from dataclasses import replace

from tracker.bodies.scene import Scene
from tracker.cameras.frame import Frame
from tracker.foundation.arrays import Mask
from tracker.foundation.configuration.components import FilePath, component
from tracker.foundation.errors import ConfigError, InitializationError, ModelError
from tracker.images.plate import Plate
from tracker.images.sight import LEAST_COVERED, Sight
from tracker.tracking.initialization import Initialization, Stages
from tracker.tracking.initialization._foregrounds import foregrounds
from tracker.tracking.initialization._in_place import InPlace, beside, staying
from tracker.tracking.initialization._person_sized import check_size
from tracker.tracking.initialization._upper_bodies import has_upper_body_alone
from tracker.tracking.initialization.given import GivenInitialization
from tracker.tracking.initialization.keypoints import KeypointInitialization
from tracker.tracking.initialization.pca import PcaInitialization
from tracker.tracking.initialization.stance import StanceInitialization
from tracker.tracking.start import Start


@component
class AutoInitialization:
    """Given poses if there are any; `pca` with the background plates of two views or more.

    Without plates `pca` before the most frequent colours of the views; if that does not show a person, `stance`, also
    in a frame whose light is so far from that of the plates that no person stands out. 2-D keypoints come first, if
    there are some, and the rest if they do not show every person. Without plates `stance` searches for several persons
    where something moves. For bodies that stay in place, an arm of a robot, the search covers poses all over their
    limits.
    """

    poses: FilePath | None = None
    """CSV of start poses or joints, as for `given`. The search for a person who is lost later uses the background
    plates, if two views have one."""

    keypoints: KeypointInitialization | None = None
    """Start by 2-D keypoints, if there are some; `keypoints` of a run sets it."""

    pca: PcaInitialization = PcaInitialization()
    """Start before known backgrounds."""

    stance: StanceInitialization = StanceInitialization()
    """Start without background plates."""

    def check(self, scene: Scene, plates: tuple[Plate | None, ...]) -> str:
        """Refuses what the chosen start cannot do; see `tracker.tracking.initialization.Initialization.check`."""
        check_size(scene)
        n_plates = sum(plate is not None for plate in plates)
        if n_plates == 1 and self.poses is None:
            raise ConfigError(
                "one view has a background plate, expected none or at least two: add the plates of the others to "
                "[reading] background, or leave it out and the person is looked for on edges alone"
            )
        fixed = [] if self.poses is not None else staying(scene)
        moving = tuple(person for k, person in enumerate(scene.persons) if k not in fixed)
        told = [self._told(replace(scene, persons=moving), plates)] if moving else []
        return "; ".join([*told, *(f"{scene.persons[k].name} where its model stands" for k in fixed)])

    def _told(self, scene: Scene, plates: tuple[Plate | None, ...]) -> str:
        """Choice of the start for persons who do not stay in place."""
        chosen = self._chosen(plates)
        if self.keypoints is not None and self.poses is None:
            others = replace(self, keypoints=None)._told(scene, plates)
            return f"{self.keypoints.check(scene, plates)}; if they do not show every person, {others}"
        if chosen is self.stance and _upper_body_alone(scene, ()):
            return "an upper body, at the tops of moving regions; no background plates"
        return chosen.check(scene, plates)

    def start(self, frame: Frame, scene: Scene, stages: Stages) -> Start:
        """Poses of all persons in one frame; see `tracker.tracking.initialization.Initialization.start`."""
        fixed = () if self.poses is not None and not stages.seen_before else tuple(staying(scene))
        if not set(fixed) - set(stages.held):
            return self._of_moving(frame, scene, stages)
        found = InPlace().start(frame, scene, stages)
        held = tuple(sorted({*stages.held, *fixed}))
        if len(held) == len(scene.persons):
            return found
        start = self._of_moving(frame, scene.with_poses(found.poses), replace(stages, held=held))
        return beside(start, found)

    def _of_moving(self, frame: Frame, scene: Scene, stages: Stages) -> Start:
        """Poses of all persons except those that stay in place, which are held."""
        if self.keypoints is not None and (self.poses is None or stages.seen_before):
            try:
                return self.keypoints.start(frame, scene, stages)
            except InitializationError as error:
                stages.progress(f"start: not by keypoints, {error}")
        known = tuple(frame.mask(v) if plate is None else plate for v, plate in enumerate(stages.plates))
        chosen = self._chosen(known, stages.seen_before)
        alone = len(scene.persons) - len(stages.held) == 1
        if chosen is self.pca and alone and _in_another_light(frame, stages.plates):
            return self.stance.start(frame, scene, stages)
        # Of several persons who sway in one place backdrops show most: poses that cover the rest are 0.4 to 0.7 m off.
        if chosen in (self.pca, self.stance) and any(one is None for one in known) and (alone or chosen is self.pca):
            # A body without an axis has no place before backdrops, and stances on the floor.
            with contextlib.suppress(InitializationError, ModelError):
                return self._before_backdrops(frame, scene, stages)
        return chosen.start(frame, scene, stages)

    def _before_backdrops(self, frame: Frame, scene: Scene, stages: Stages) -> Start:
        """The foreground against the most frequent colours of the views.

        Raises:
            InitializationError: it is not a person, or only a part of one.
        """
        stages.progress("start: foreground against the usual colours of the views")
        made = stages.backdrops() or stages.plates
        known = tuple(plate or one for plate, one in zip(stages.plates, made, strict=True))
        if sum(plate is not None for plate in known) < max(2, 1 + sum(plate is not None for plate in stages.plates)):
            raise InitializationError(f"frame {frame.index}: nothing moves in the recording")
        start = self.pca.start(frame, scene, replace(stages, plates=known))
        if _upper_body_alone(scene, stages.held):
            return start  # its legs may be anywhere
        covered = Sight(frame, known).covered(stages.synthesis.silhouettes(scene.with_poses(start.poses)))
        if covered < LEAST_COVERED:
            raise InitializationError(
                f"frame {frame.index}: {covered:.0%} of the person found lies before what moves, expected at least "
                f"{LEAST_COVERED:.0%}"
            )
        return start

    def _chosen(self, plates: tuple[Plate | Mask | None, ...], seen_before: bool = False) -> Initialization:
        n_plates = sum(plate is not None for plate in plates)
        if self.poses is not None and not (seen_before and n_plates >= 2):
            return GivenInitialization(poses=self.poses)
        return self.pca if n_plates else self.stance


def _upper_body_alone(scene: Scene, held: tuple[int, ...]) -> bool:
    """Whether one person is sought, by a model whose legs do not move: it needs no floor, and no whole person."""
    sought = [person for k, person in enumerate(scene.persons) if k not in held]
    return len(sought) == 1 and has_upper_body_alone(sought[0].body)


def _in_another_light(frame: Frame, plates: tuple[Plate | None, ...]) -> bool:
    """Whether so many images differ everywhere from their plates that no person stands out in two views."""
    shown = [plate if image is not None else None for image, plate in zip(frame.images, plates, strict=True)]
    n_plates = sum(plate is not None for plate in shown)
    n_usable = sum(mask is not None for mask in foregrounds(frame, plates))
    return n_usable < 2 <= n_plates
