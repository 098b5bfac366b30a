"""How few colours each part of a body has at a pose: shows limbs that contours do not show well.

A forearm before the chest is skin before a shirt; one wrongly hanging before a hip has trousers' colours. It learns
nothing, so that it works in the first frame.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tracker.bodies.body import BodyModel
from tracker.bodies.scene import Scene
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Image, Integers, Mask, Numbers16, frozen
from tracker.images.operations.appearance import appearance
from tracker.images.sight import Sight
from tracker.kernels.regions import N_COLOURS, encode
from tracker.synthesis.cpu import CpuSynthesis

# Pictures are so much smaller: forearms of persons 300 px high are still ten pixels wide.
_SMALLER = 2
# Margin around a person, as a share of the size, where the foreground is unknown. See docs/lab/part_colours.md.
_AROUND = 0.25
# Whatever renderer a run has: small pictures of one pose are the CPU's, and the same on every machine.
_SYNTHESIS = CpuSynthesis()


@dataclass(frozen=True)
class PartColours:
    """The colours of one frame around the persons."""

    rig: Rig
    """Of the smaller pictures."""

    numbers: tuple[Numbers16, ...]
    """Of each view the colours of the pixels that count."""

    places: tuple[Integers, ...]
    """Of each view their places in the picture, row by row."""

    n_px: tuple[int, ...]
    """Approximate number of pixels of all pictures that each person covers."""

    def impurities(self, scene: Scene, person: int, poses: Array) -> Array:
        """Mixture of the colours of a person's parts: their entropy given the part, nats for each pixel of the person.

        Both sides' parts have the same colours, as clothes do; pixels that count without a part are one part more.

        Args:
            scene: all persons, the others at their poses.
            person: owner of the parts.
            poses: (B, dof) of the person, rad and metres; similar poses take the least
                time.

        Returns:
            (B,)
        """
        kinds, small = _kinds(scene, person), Scene(scene.persons, self.rig)
        nats = [self._entropy(ids, kinds) for ids in _SYNTHESIS.ids_of_poses(small, person, poses)]
        return np.array(nats) / max(self.n_px[person], 1)

    def _entropy(self, ids: Sequence[NDArray[Any]], kinds: Integers) -> float:
        """Nats in the colours of each view's pixels (H, W); see `_kinds`."""
        counts = np.zeros((int(kinds.max()) + 1) * N_COLOURS, dtype=np.int64)
        for seen, numbers, places in zip(ids, self.numbers, self.places, strict=True):
            # the last kind is that of -1, of no part
            kind = kinds[seen.ravel()[places]]
            counts += np.bincount(kind * N_COLOURS + numbers, minlength=len(counts))
        return _entropy(counts.reshape(-1, N_COLOURS))


def colours_when_asked(sight: Sight) -> Callable[[Scene], PartColours]:
    """The colours of a frame, made around the scene that is asked about first: most frames need none."""
    made: list[PartColours] = []

    def at(scene: Scene) -> PartColours:
        if not made:
            made.append(part_colours(sight, scene))
        return made[0]

    return at


def part_colours(sight: Sight, scene: Scene) -> PartColours:
    """The colours of a frame, of the known foreground, and of all pixels around the persons elsewhere.

    Args:
        sight: the images.
        scene: the persons where they may be, as a whole.
    """
    rig = scene.rig.downscaled(_SMALLER)
    alone = [_SYNTHESIS.silhouettes(Scene((person,), rig)) for person in scene.persons]
    numbers, places = [], []
    for v, image in enumerate(sight.frame.images):
        model = np.any([masks[v] for masks in alone], axis=0)
        counted = np.zeros(0, dtype=np.int64) if image is None else np.flatnonzero(_counted(sight, v, model))
        numbers.append(np.zeros(0, np.uint16) if image is None else _encoded(image, model.shape)[counted])
        places.append(counted)
    covered = (sum(int(np.count_nonzero(mask)) for mask in masks) for masks in alone)
    return PartColours(rig, tuple(numbers), tuple(places), tuple(covered))


def _counted(sight: Sight, view: int, model: Mask) -> Mask:
    """Pixels (h, w) of a smaller picture that count: the foreground, and unknown ones near the persons."""
    foreground, unknown = sight.silhouette(view), sight.unknown(view)
    near = _around(model)
    if foreground is None:
        return near
    known = _reduced(foreground, model.shape)
    return known if unknown is None else known | (near & _reduced(unknown, model.shape))


def _around(model: Mask) -> Mask:
    """(h, w) the box around a silhouette, with a margin."""
    near = np.zeros_like(model)
    rows, columns = (np.flatnonzero(model.any(axis=axis)) for axis in (1, 0))
    if len(rows):
        more = round(_AROUND * max(np.ptp(rows), np.ptp(columns)))
        first = max(rows[0] - more, 0), max(columns[0] - more, 0)
        near[first[0] : rows[-1] + more + 1, first[1] : columns[-1] + more + 1] = True
    return near


def _reduced(mask: Mask, shape: tuple[int, ...]) -> Mask:
    return np.asarray(cv2.resize(mask.astype(np.uint8), shape[1::-1], interpolation=cv2.INTER_NEAREST) > 0)


def _encoded(image: Image, shape: tuple[int, ...]) -> Numbers16:
    """(h w,) colour numbers of an image, smaller."""
    small = np.asarray(cv2.resize(image, shape[1::-1], interpolation=cv2.INTER_AREA))
    numbers: Numbers16 = np.empty(shape[0] * shape[1], dtype=np.uint16)
    encode(appearance(small, (0, 0, shape[1], shape[0])), numbers)
    return numbers


def _kinds(scene: Scene, person: int) -> Integers:
    """(P + 1,) for each part of a scene, and for no part: the number under which its colours are counted."""
    own = _paired(scene.persons[person].body)
    first, n_kinds = scene.first_part(person), int(own.max(initial=-1)) + 1
    kinds = np.full(len(scene.shapes) + 1, n_kinds, dtype=np.int64)
    kinds[first : first + len(own)] = own
    kinds[-1] = n_kinds + 1
    return kinds


def _paired(body: BodyModel) -> Integers:
    """(P,) the number of each part, or of the other side's if that comes first."""
    names = [part.name for part in body.parts]
    others = (body.mirror.of(name) for name in names)
    numbers = [min(n, names.index(other) if other in names else n) for n, other in enumerate(others)]
    return frozen(numbers, np.int64)


def _entropy(counts: Integers) -> float:
    """Nats in all of rows of counts (R, N): for each count the negative logarithm of its share of the row."""
    total, seen = counts.sum(axis=1), counts[counts > 0]
    return float((total[total > 0] * np.log(total[total > 0])).sum() - (seen * np.log(seen)).sum())
