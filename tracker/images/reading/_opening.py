"""Opens the selected footage of a reading: frames, plates, masks and occluders."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
import pydantic

from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Image, Mask
from tracker.foundation.configuration.components import (
    NO_PLATES,
    RECORDED,
    FilePath,
    PathPattern,
    PlatePattern,
    ViewPaths,
    component,
)
from tracker.foundation.errors import SequenceError
from tracker.images.plate import Plate
from tracker.images.reading._footage import (
    LEAST_FPS,
    MOST_FPS,
    Footage,
    OnMissing,
    common_length,
    numbered_files,
    opened_views,
    selected,
)
from tracker.images.reading._pictures import Downscale, Lines
from tracker.images.reading._plates import N_SAMPLES, load_plates, recorded_plates
from tracker.images.reading._sequence import (
    MaskFiles,
    OpenSequence,
    OpenViews,
    checked_masks,
    load_occluders,
    mask_paths,
    with_occluders,
)
from tracker.images.reading._timeline import Offsets, chosen_offsets

# Frames of a long recording that make backdrops: all before the last must be decoded.
_MOST_SEARCHED = 1500


@component
class Settings:
    """Settings of every recording of files."""

    path: ViewPaths
    """Files of the views."""

    rig: FilePath | None = None
    """Calibration: a file or folder in any layout that `bodytrack rig convert` reads; none in a calibration job."""

    fps: float | None = pydantic.Field(default=None, ge=LEAST_FPS, le=MOST_FPS, allow_inf_nan=False)
    """Frames per second."""

    views: tuple[str, ...] = ()
    """Cameras to use, in this order; empty for all of the rig."""

    offsets: Offsets = pydantic.Field(default_factory=dict)
    """Image of a view that belongs to frame 0."""

    in_step: Literal["auto", "long", "off"] = "auto"
    """Whether views are brought in step."""

    background: PlatePattern | None = None
    """Clean plates: images or short clips, for instance `background/{view}.png`. Default: plates from most images of
    the recording, if every person walks about in two views or more. "median": the same, with a message for each view
    that has none; "none": no plates."""

    masks: PathPattern | None = None
    """Your own silhouettes, in place of plates or beside them, for instance `masks/{view}/{frame}.png`; pixels that are
    neither black nor transparent are a person."""

    occluders: PathPattern | None = None
    """Pictures of things before the persons, for instance `occluders/{view}.png`, for views that have some: pixels that
    are not black hide the persons (a table, a treadmill). They complete plates, also those that the recording makes."""

    align_background: bool = False
    """Fit each plate to the first frame by its features and its light: for plates from before a small turn or zoom of
    the camera, or with pictures cut differently. The camera must not have been carried elsewhere."""

    start: int = pydantic.Field(default=0, ge=0)
    """First frame."""

    stop: int | None = pydantic.Field(default=None, ge=1)
    """Frame after the last one; None for all."""

    stride: int = pydantic.Field(default=1, ge=1)
    """Deliver every so many frames."""

    downscale: Downscale | None = None
    """Images are averaged over so many pixels in both directions; the rig follows. 0.5 enlarges them twice. Default:
    in tracking the factor that shows persons some 300 px high, else 1."""

    gain: float | None = pydantic.Field(default=None, gt=0, le=10)
    """Images and plates are multiplied by it. Default: in tracking the factor that makes dark images as bright as
    usual, else 1."""

    smoothing_px: float | None = pydantic.Field(default=None, ge=0, le=5)
    """Standard deviation of the Gaussian that smooths images and plates, px of the delivered images. Default:
    in tracking 1 for noisy images, else 0."""

    lines: Lines = "all"
    """For interlaced recordings: use the 1st, 3rd, 5th ... lines (`odd`) or the others (`even`), which were taken at
    one time. The lines between are interpolated, so that images and calibration keep their size. Plates are treated in
    the same way."""

    on_missing: OnMissing = "error"
    """`skip` leaves a view out of the frames that it lacks or that cannot be read."""


def opened(settings: Settings, footage: Footage, rig: Rig) -> OpenSequence:
    """The sequence that the settings choose from the footage.

    Raises:
        SequenceError: lengths, range or plates do not fit.
    """
    views = _chosen_views(settings, footage, tuple(camera.size for camera in rig.cameras))

    def spread(v: int) -> list[Image]:
        return _spread_images(views, footage.lengths[v], v)

    given, occluders = _opened_plates(settings, footage, views, rig), _opened_occluders(settings, rig, views.downscale)
    return OpenSequence(
        **vars(views),
        rig=rig if views.downscale == 1 else rig.downscaled(views.downscale),
        given=given if given is None or not occluders else with_occluders(given, occluders),
        spread=spread,
        masks=None if settings.masks is None else _opened_masks(settings.masks, footage, views),
        occluders=occluders,
    )


def opened_uncalibrated(settings: Settings, footage: Footage) -> OpenViews:
    """The selected views of a recording of cameras without a calibration.

    Raises:
        SequenceError: lengths or range do not fit, or a view lacks the first image, which tells its size.
    """
    views = _chosen_views(settings, footage, ())
    sizes = []
    for name, image in zip(views.names, _first_images(views), strict=True):
        if image is None:
            raise SequenceError(f'view "{name}": no image for the first frame, {views.selection.start}: mend start')
        sizes.append((image.shape[1], image.shape[0]))
    return replace(views, source_sizes=tuple(sizes))


def _chosen_views(settings: Settings, footage: Footage, sizes: tuple[tuple[int, int], ...]) -> OpenViews:
    offsets = chosen_offsets(footage.names, settings.offsets)
    length = common_length(footage.names, footage.lengths, offsets, settings.on_missing, settings.stop)
    return OpenViews(
        names=footage.names,
        source_sizes=sizes,
        fps=footage.fps,
        selection=selected(settings.start, settings.stop, settings.stride, length),
        offsets=offsets,
        downscale=settings.downscale or 1,
        gain=settings.gain or 1.0,
        smoothing_px=settings.smoothing_px or 0.0,
        lines=settings.lines,
        on_missing=settings.on_missing,
        open_views=footage.open_views,
        first_number=footage.first,
        uneven=footage.positions,
    )


def _opened_plates(settings: Settings, footage: Footage, views: OpenViews, rig: Rig) -> tuple[Plate | None, ...] | None:
    pattern = settings.background
    if pattern not in (None, RECORDED, NO_PLATES):
        firsts = _first_images(views) if settings.align_background else None
        return load_plates(rig, pattern, views.delivered, footage.plate_of_clip, firsts)
    if settings.align_background:
        raise SequenceError(
            "align_background: nothing to align, there are no plates but those of these images: unset it"
        )
    if pattern != RECORDED:
        return None if pattern is None and settings.masks is None else (None,) * len(rig)
    return recorded_plates(views.names, lambda v: _spread_images(views, footage.lengths[v], v))


def _opened_occluders(settings: Settings, rig: Rig, factor: float) -> tuple[Mask | None, ...]:
    if settings.occluders is None:
        return ()
    if settings.background == NO_PLATES or settings.masks is not None:
        other = "masks" if settings.masks is not None else f'background = "{NO_PLATES}"'
        raise SequenceError(f"occluders and {other}: they say where plates know nothing; leave out one of the two")
    return load_occluders(rig, settings.occluders, factor)


def _opened_masks(pattern: str, footage: Footage, views: OpenViews) -> MaskFiles:
    paths = mask_paths(pattern, views.names)
    by_name = dict(zip(views.names, paths, strict=True))
    files = opened_views(views.names, lambda name: numbered_files(name, by_name[name]), views.on_missing)
    first = views.first_number
    found = MaskFiles(tuple(one or {} for one in files), views.names, views.source_sizes, first, views.downscale)
    return checked_masks(found, views)


def _spread_images(views: OpenViews, length: int, v: int) -> list[Image]:
    """Images of a view as delivered, spread over its recording; of a long one, over the frames after the first one."""
    if length == 0:
        return []
    offset = views.offsets[v]
    first = 0 if length <= _MOST_SEARCHED else max(offset.number(views.selection.start), 0)
    numbers = np.linspace(first, min(length, first + _MOST_SEARCHED) - 1, N_SAMPLES).round().astype(int)
    view = views.open_views()[v]
    found = (views.image(v, view, offset.frame(int(number))) for number in np.unique(numbers))
    return [image for image in found if image is not None]


def _first_images(views: OpenViews) -> tuple[Image | None, ...]:
    """An image of each view as on disk: that of the first frame."""
    opened = zip(views.open_views(), views.offsets, strict=True)
    return tuple(view.read(max(offset.number(views.selection.start), 0)) for view, offset in opened)
