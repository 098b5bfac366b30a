"""Some pictures of a recording, spread over all of it, without decoding every frame."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import islice
from pathlib import Path
from typing import Literal, TypeVar

import av
import numpy as np

from tracker.foundation.arrays import Image
from tracker.foundation.errors import SequenceError
from tracker.images.film import film_of, opened
from tracker.images.footage import FRAME, numbered_images
from tracker.images.reading.images import intact_image

_MOST_DECODED = 1500
"""Frames that are decoded of a film with few key frames, from its first one on."""

_Item = TypeVar("_Item")


def spread_pictures(source: Path, n: int) -> list[Image]:
    """Up to n pictures of one view.

    Of a film these are key frames, which are decoded by themselves, if it has so many.

    Args:
        source: a film, or images with `{frame}` for their number.
        n: how many.

    Returns:
        Pictures (h, w, 3) BGR.

    Raises:
        SequenceError: it cannot be read.
    """
    if FRAME in source.name:
        return [intact_image(path) for path in _spread(numbered_images(source), n)]
    try:
        keys = _spread(_decoded(source, "NONKEY"), n)
        frames = keys if len(keys) == n else _spread(islice(_decoded(source, "DEFAULT"), _MOST_DECODED), n)
    except SequenceError as error:
        raise SequenceError(f"{source} {error}") from error
    except (av.FFmpegError, IndexError, OSError, ValueError) as error:
        raise SequenceError(f"{source} is not a video that can be read: {error}") from error
    if not frames:
        raise SequenceError(f"{source}: no frame of it can be decoded")
    return [np.asarray(frame.to_ndarray(format="bgr24"), dtype=np.uint8) for frame in frames]


def _decoded(path: Path, skipped: Literal["DEFAULT", "NONKEY"]) -> Iterator[av.VideoFrame]:
    """Frames of a film, without those of a kind (FFmpeg's `AVDiscard`)."""
    with opened(path) as container:
        stream = container.streams.video[film_of(container)[0]]
        stream.codec_context.skip_frame = skipped
        yield from container.decode(stream)


def _spread(items: Iterable[_Item], n: int) -> list[_Item]:
    """Up to n of them, evenly spread; never more than twice as many are held."""
    kept: list[_Item] = []
    stride = 1
    for k, item in enumerate(items):
        if k % stride == 0:
            kept.append(item)
        if len(kept) > 2 * n:
            del kept[1::2]
            stride *= 2
    chosen = np.unique(np.linspace(0, len(kept) - 1, min(n, len(kept))).round().astype(int))
    return [kept[k] for k in chosen.tolist()]
