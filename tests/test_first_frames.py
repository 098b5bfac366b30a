"""The first frames of a recording are decoded once, whoever looks at them, in whatever order."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import islice

import pytest

from tracker.cameras.frame import Frame
from tracker.images.first_frames import FirstFrames


class Recorded:
    """A recording that counts the frames that are decoded."""

    def __init__(self, n_frames: int) -> None:
        self.n_frames, self.n_decoded = n_frames, 0

    def __call__(self) -> Iterator[Frame]:
        for k in range(self.n_frames):
            self.n_decoded += 1
            yield Frame(k, k / 25, (None,))


def numbers(frames: Iterator[Frame]) -> list[int]:
    return [frame.index for frame in frames]


@pytest.mark.parametrize("n_frames", [0, 3, 10, 11])
def test_what_is_kept_is_decoded_once(n_frames: int) -> None:
    recorded = Recorded(n_frames)
    frames = FirstFrames(recorded, 10)
    assert numbers(islice(frames(), 4)) == list(range(n_frames))[:4]
    assert numbers(islice(frames(), 10)) == list(range(n_frames))[:10]
    assert recorded.n_decoded == n_frames  # one more is looked for, to know whether there is one
    assert numbers(frames()) == list(range(n_frames))
    assert recorded.n_decoded == n_frames


def test_who_goes_beyond_goes_on_decoding_and_others_begin_anew() -> None:
    recorded = Recorded(15)
    frames = FirstFrames(recorded, 10)
    one, other = frames(), frames()
    assert numbers(islice(one, 12)) == list(range(12))
    assert recorded.n_decoded == 12
    assert numbers(other) == list(range(15))
    assert recorded.n_decoded == 12 + 15
    assert numbers(one) == [12, 13, 14]


def test_they_are_forgotten_when_the_tracking_is_past_them() -> None:
    recorded = Recorded(50)
    frames = FirstFrames(recorded, 10)
    one, late = frames(), frames()
    assert numbers(islice(late, 3)) == [0, 1, 2]
    assert numbers(islice(one, 21)) == list(range(21))
    before = recorded.n_decoded
    assert numbers(islice(late, 2)) == [3, 4]
    assert recorded.n_decoded == before + 5
    assert numbers(one) == list(range(21, 50))


def test_threads_see_the_same_frames() -> None:
    recorded = Recorded(200)
    frames = FirstFrames(recorded, 200)
    with ThreadPoolExecutor(4) as pool:
        seen = list(pool.map(lambda _: numbers(frames()), range(8)))
    assert seen == [list(range(200))] * 8
    assert recorded.n_decoded == 200
