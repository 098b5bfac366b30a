"""A frame without what is far from the persons who are looked for in it, or may be somebody else."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tracker.bodies.scene import Scene
from tracker.cameras.frame import Frame
from tracker.foundation.arrays import Image, Mask
from tracker.images.plate import in_light_of
from tracker.tracking.initialization import Stages
from tracker.tracking.initialization._persons import Found
from tracker.tracking.initialization._visual_hull import STEP_M, shadow

# What is farther than this from every voxel of a person does not belong to one; of a known person only the joints
# are at hand, so that hands and feet must lie within it.
_AROUND_M = 0.15


def cleared(frame: Frame, scene: Scene, stages: Stages, found: list[Found], known: Sequence[int]) -> Frame:
    """The frame with the plates in place of all that is far from the persons found and the known ones.

    Furniture that was moved, passers-by and persons yet to be found are gone, and who may be the person as well.

    Args:
        frame: the images.
        scene: the rig, and the poses of the known persons.
        stages: with the plates.
        found: the persons found.
        known: numbers of the known persons in the scene.
    """
    persons = (scene.persons[k] for k in known)
    held = [person.body.landmarks_in_world(person.q) for person in persons]
    points = [*(person.points for person in found), *held]
    images: list[Image | None] = []
    masks: list[Mask | None] = []
    for v, (image, plate) in enumerate(zip(frame.images, stages.plates, strict=True)):
        given = frame.mask(v)
        if image is None or (plate is None and given is None):
            images.append(None)
            masks.append(None)
            continue
        near = np.any([shadow(scene.rig, v, places, _AROUND_M) for places in points], axis=0)
        for one in (one for one in found if len(one.others)):
            near &= shadow(scene.rig, v, one.points, STEP_M) | ~shadow(scene.rig, v, one.others, STEP_M)
        images.append(image if plate is None else np.where(near[..., None], image, in_light_of(image, plate)))
        masks.append(None if given is None else given & near)
    return replace(frame, images=tuple(images), masks=tuple(masks))
