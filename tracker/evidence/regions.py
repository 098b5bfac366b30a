"""Evidence of regions: the colours of the body's parts and of their surroundings, on lines across the contours.

It needs no clean plates; in images of monochrome cameras texture replaces colours. After M. Stoiber et al., A Sparse
Gaussian Approach to Region-Based 6DoF Object Tracking, ACCV 2020, with a pair of colour tables for each part and view.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from functools import lru_cache

import cv2
import numpy as np
import pydantic

from tracker.bodies.contours import Contours
from tracker.bodies.scene import Scene
from tracker.evidence import GUESSED, Evidence, EvidencePicture
from tracker.evidence._colours import FLOOR, Colours, colour_numbers, picture_around
from tracker.evidence._shares import UNKNOWN, over_views
from tracker.evidence.measures.account import Account
from tracker.evidence.measures.correspondences import Equations
from tracker.evidence.measures.outlines import Comparison
from tracker.foundation.arrays import Array, Array32, Image, Integers, Mask
from tracker.foundation.configuration.components import component
from tracker.foundation.geometry.superquadrics import box_bounds
from tracker.images.sight import Sight
from tracker.kernels.descent import Colours as Beside
from tracker.kernels.descent import Kinds
from tracker.kernels.regions import (
    HIDDEN,
    Lines,
    Picture,
    Rule,
    Samples,
    find_shifts,
    longest_lines,
    parts_beside,
    shift_equations,
)
from tracker.kernels.rows import SuperquadricRow

# As for contours: a sample and its neighbours share one line of pixels and one interpolation.
_PX_PER_OBSERVATION = 16.0

# Margin of the colours read in advance, over that around a prediction: 24 px of 720 more, the movement of persons from
# one frame to the next. Where they move farther colours are read again.
_AHEAD = 1.4

# Distance where nothing can be compared, px: half of a line on the wrong side, as in a picture of one colour.
_NOTHING_PX = 8.0


@dataclass(frozen=True)
class ObservedRegions:
    """The colours around the persons, and the knowledge of them."""

    picture: Picture
    memory: Colours | None
    """Knowledge from the frames before."""

    expected: Contours | None
    """Contours of the prediction: they teach the colours if there was no frame before; None if they must not."""

    _first: list[Colours] = field(default_factory=list, repr=False, compare=False)

    def colours(self, scene: Scene, spans: tuple[float, float]) -> Colours | None:
        """The colours known, of a scene near the predicted poses; None without a prediction.

        A first pose is not confirmed by its own colours: a limb on the background finds the same colours on both sides
        of its contour.
        """
        if self.memory is None and self.expected is not None and not self._first:
            everything = np.ones((len(scene.rig), len(scene.shapes)), dtype=np.bool_)
            self._first.append(_taught(None, self.picture, scene, self.expected, everything, spans))
        return self._first[0] if self._first else self.memory


@component
class RegionEvidence(Evidence):
    """Colour of the parts on lines across their contours, learnt where parts can be trusted.

    In a first frame the colours are those at the start pose; without a start, or if it is only a guess, the evidence is
    silent.
    """

    from_start: bool = True
    """Learn from a start pose before it is judged. Without plates nothing else holds it. With plates, colours can wait
    for a trusted frame, so that a wrong start is not confirmed by the colours it covers."""

    step_m: float = pydantic.Field(default=0.005, gt=0)
    """Distance of the samples on a line on the body, metres; at least a pixel."""

    reach: int = pydantic.Field(default=7, ge=2)
    """Largest shift of a contour that a line can show, steps."""

    widest: float = pydantic.Field(default=2.0, ge=1)
    """Largest factor that widens the steps while the pose may still be far off."""

    slack: float = pydantic.Field(default=0.07, gt=0, lt=0.5)
    """Share of the samples on a line that belong to the other side in spite of their colour, 0 to 1."""

    news: float = pydantic.Field(default=0.15, gt=0, le=1)
    """Share of a new frame in the colour tables: four frames forget half."""

    around: float = pydantic.Field(default=1 / 12, ge=0, le=1)
    """Margin around the prediction, as a share of an image's longer side; colours beyond it do not count. 60 px of 720
    are more than twice the reach of lines of 22 steps there."""

    def look(self, sight: Sight, around: Contours) -> None:
        """Reads the colours around the persons in advance."""
        colour_numbers(sight, around, _AHEAD * self.around)

    def observe(self, sight: Sight, expected: Contours | None, memory: Colours | None = None) -> ObservedRegions:
        """Colours around the persons; see `tracker.evidence.Evidence.observe`."""
        picture = picture_around(sight, expected, self.around)
        if memory is GUESSED:
            return ObservedRegions(picture, None, None)
        return ObservedRegions(picture, memory, expected if self.from_start else None)

    def distances(self, asked: Comparison, poses: Array) -> Array:
        """(B,) length of a line across the contour on the wrong side, averaged over contour and views, px."""
        misfits = self._misfits(asked, poses)
        if misfits is None:
            return np.zeros(len(poses))
        return over_views(_mean_px(misfits.sum(axis=2)), _NOTHING_PX)

    def equations(self, asked: Comparison, q: Array, gate_px: float) -> Equations:
        """Moves the contours to where the colours change; see `find_shifts`."""
        body, colours = asked.body, self._colours(asked)
        if colours is None:
            return Equations.nothing(body.dof)
        contours, cameras = asked.fine(q), asked.scene.rig.packed
        samples = _samples_of(contours)
        beside = _seen_beside(asked.scene, asked.placements(q[None]), contours, self.step_m)[0]
        picture, wanted, rule = asked.observed.picture, asked.ends > -2, self.rule(gate_px)
        shifts = np.empty((*samples.parts.shape, 3), dtype=np.float32)
        find_shifts(picture, colours.looks, samples, beside, cameras, wanted, rule, shifts)
        found = shift_equations(shifts, samples, asked.ends, cameras, asked.twists(q), body.moves, _PX_PER_OBSERVATION)
        return Equations(*found)

    def kinds(self, asked: Comparison) -> Kinds | None:
        """The lines across contours; empty before any colour is known."""
        if type(self) is not RegionEvidence:
            return None
        colours = self._colours(asked)
        if colours is None:
            return Kinds(most_silent=1.0)
        lines = Lines(asked.observed.picture, colours.looks, asked.ends > -2, self.rule())
        return Kinds(colours=Beside(1.0, 0.0, lines, _bounds(asked.scene.shapes.tobytes()), _PX_PER_OBSERVATION))

    def account(self, asked: Comparison, q: Array) -> Account:
        """Contour with the right colours on both sides is explained; a region misses nothing of the images."""
        n_views, n_parts = len(asked.scene.rig), len(asked.body.parts)
        misfits = self._misfits(asked, q[None])
        if misfits is None:
            nothing = np.zeros(n_parts)
            return Account(0.0, np.full(n_views, np.nan), np.full(n_parts, np.nan), nothing, nothing, nothing)
        per_view, per_part = (_mean_px(misfits[0].sum(axis=axis)) for axis in (1, 0))
        visible, _, explained = misfits[0].sum(axis=0)[asked.own].T
        distance_px = float(over_views(per_view[None], _NOTHING_PX)[0])
        by_view = misfits[0][:, asked.own].transpose(2, 0, 1) * np.array([1.0, 0.0, 1.0])[:, None, None]
        by_view = np.stack([by_view[0], by_view[2], by_view[1]])
        return Account(distance_px, per_view, per_part[asked.own], visible, explained, np.zeros(n_parts), by_view)

    def learned(
        self, memory: Colours | None, sight: Sight, scene: Scene, fitted: Contours, trusted: Mask
    ) -> Colours | None:
        """The colours beside the contours of trusted parts; see `Colours.after`."""
        if not trusted.any():
            return memory
        # As far as lines reach; in small images and close by farther than `around`. Otherwise learning would depend on
        # earlier reads of this sight, and a resumed run that replays its journal has none.
        longest_px = np.empty(len(scene.rig))
        longest_lines(_samples_of(fitted), scene.rig.packed, self.step_m, longest_px)
        picture = picture_around(sight, fitted, self.around, longest_px)
        return _taught(memory, picture, scene, fitted, trusted, self._spans)

    def pictures(self, asked: Comparison, sight: Sight, view: int) -> tuple[EvidencePicture, ...]:
        """White: a pixel has the colours of the nearest contour's part; black: those of the surroundings.

        Blue: a thing that has hidden the part has this colour, or the part's colours are unknown in this view.
        """
        image, colours = sight.frame.images[view], self._colours(asked)
        found = asked.fine(asked.scene.persons[asked.person].q).of(view)
        own = (found.parts >= asked.own.start) & (found.parts < asked.own.stop)
        if image is None or colours is None or not own.any():
            return (EvidencePicture("regions: no colour is known yet, or the view does not show the person", None),)
        start, x, y, width, height = asked.observed.picture.layout[view].tolist()
        codes = asked.observed.picture.codes[start : start + width * height].reshape(height, width)
        nearest = _nearest_parts(image.shape[:2], found.pixels[own], found.parts[own])[y : y + height, x : x + width]
        inside, picture = colours.posteriors[view][nearest, codes], np.zeros(image.shape, dtype=np.uint8)
        picture[y : y + height, x : x + width] = inside[..., None]
        picture[y : y + height, x : x + width][(inside == HIDDEN) | ~colours.known[view][nearest]] = UNKNOWN
        return (EvidencePicture("colours of the nearest part", picture),)

    @property
    def _spans(self) -> tuple[float, float]:
        return self.step_m, self.news

    def _colours(self, asked: Comparison) -> Colours | None:
        known: Colours | None = asked.observed.colours(asked.scene, self._spans)
        return known

    def rule(self, gate_px: float = 0.0) -> Rule:
        """Sampling of lines if the contour may be so far off, px."""
        return Rule(self.step_m, self.reach, self.slack, FLOOR, gate_px, self.widest)

    def _misfits(self, asked: Comparison, poses: Array) -> Array | None:
        """(B, V, P, 3) see `tracker.synthesis.Synthesis.region_misfits`; None before any colour is known."""
        colours = self._colours(asked)
        if colours is None:
            return None
        lines = Lines(asked.observed.picture, colours.looks, asked.ends > -2, self.rule())
        misfits: Array = asked.synthesis.region_misfits(asked.scene, asked.person, poses, lines)
        return misfits


def _samples_of(contours: Contours) -> Samples:
    """The samples of the first pose."""
    return Samples(contours.positions[0], contours.points[0], contours.parts[0], contours.counts[0])


def _seen_beside(scene: Scene, placements: Array, contours: Contours, step_m: float) -> Integers:
    """(B, V, M, 2) the part seen beside each contour sample of parts at placements (B, P, 4, 4)."""
    found = np.empty((*contours.parts.shape, 2), dtype=np.int64)
    samples = contours.positions, contours.points, contours.parts, contours.counts
    parts_beside(placements, scene.shapes, _bounds(scene.shapes.tobytes()), scene.rig.packed, *samples, step_m, found)
    return found


@lru_cache(maxsize=8)
def _bounds(shapes: bytes) -> Array:
    """The bounds of packed shapes, kept for those last used."""
    return box_bounds(np.frombuffer(shapes).reshape(-1, SuperquadricRow.N_COLUMNS))


def _taught(
    memory: Colours | None,
    picture: Picture,
    scene: Scene,
    contours: Contours,
    trusted: Mask,
    spans: tuple[float, float],
) -> Colours:
    """The knowledge after the contours of the scene at its poses have taught the colours of trusted parts (V, P)."""
    memory = memory or Colours.none(len(scene.rig), scene.shapes)
    samples = _samples_of(contours)
    beside = _seen_beside(scene, scene.world_from_parts(), _first_of(contours), spans[0])[0]
    there = np.arange(samples.parts.shape[1]) < samples.counts[:, None]
    useful = (
        there
        & trusted[np.arange(len(trusted))[:, None], np.where(there, samples.parts, 0)]
        & (samples.positions[..., 4] > 0)
    )
    return memory.after(picture, samples, beside, scene.rig.packed, useful, spans)


def _first_of(contours: Contours) -> Contours:
    """The first pose alone."""
    return Contours(*(getattr(contours, field.name)[:1] for field in fields(Contours)))


def _mean_px(misfits: Array) -> Array:
    """(...,) misfit per contour of sums (..., 3) from `region_misfits`; NaN without contour."""
    mean: Array = misfits[..., 1] / np.where(misfits[..., 0] > 0, misfits[..., 0], np.nan)
    return mean


def _nearest_parts(shape: tuple[int, ...], pixels: Array32, parts: Integers) -> Integers:
    """(H, W) the part of the contour sample (N, 2) nearest to each pixel."""
    blank: Image = np.ones(shape, dtype=np.uint8)
    x, y = np.clip(np.rint(pixels).astype(np.int64), 0, np.array([shape[1], shape[0]]) - 1).T
    blank[y, x] = 0
    labels = cv2.distanceTransformWithLabels(blank, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)[1]
    part_of = np.zeros(int(labels.max()) + 1, dtype=np.int64)
    part_of[labels[y, x]] = parts
    nearest: Integers = part_of[labels]
    return nearest
