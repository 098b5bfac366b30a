"""Where bodies that are placed by hand begin: as a run found them in a frame, as its start has them, or standing."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from tracker.bodies.scene import Scene
from tracker.cameras.frame import Frame
from tracker.foundation.errors import ConfigError
from tracker.results.result import load_result
from tracker.running.jobs import load_job
from tracker.running.viewing.hand_poses import standing
from tracker.running.viewing.images import chosen_images, reading_of, single_frame
from tracker.tracking.initialization.given import GivenInitialization


def begun_in_result(folder: Path, number: int) -> tuple[Scene, Frame]:
    """The persons where a run found them, or took them to be, and the images of the frame.

    Args:
        folder: of the result.
        number: of the frame.

    Raises:
        TrackerError: the result has no such frame, or the recording is not there any more.
    """
    result = load_result(folder)
    replay = next((one for one in result.replays if one.index == number), None)
    if replay is None:
        nearest = min(result.frames.tolist(), key=lambda one: abs(one - number), default=None)
        raise ConfigError(f"{folder}: no frame {number}" + ("" if nearest is None else f", the nearest is {nearest}"))
    _, frame = single_frame(reading_of(result, chosen_images(result)), number)
    return result.scene.with_poses(tuple(estimate.q for estimate in replay.estimates)), frame


def begun_in_run(config: Path, overrides: Sequence[str], number: int) -> tuple[Scene, Frame]:
    """The persons where the configuration's start has them, else standing before the cameras, and the images.

    Args:
        config: of a run.
        overrides: as of `bodytrack run --set`.
        number: of the frame.

    Raises:
        TrackerError: the configuration, a model or the start cannot be used, or the recording has no such frame.
    """
    job = load_job("track", config, overrides)
    sequence, frame = single_frame(job.reading, number)
    scene = standing(Scene(job.at_rest(), sequence.rig))
    given = job.initialization
    if isinstance(given, GivenInitialization) and given.poses.is_file():
        scene = scene.with_poses(given.poses_of(scene, number))
    return scene, frame
