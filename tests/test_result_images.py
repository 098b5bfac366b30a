"""The images of a finished run are those that were tracked."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import av
import cv2
import numpy as np
import pytest
import tomli_w

from tracker.foundation.errors import ConfigError
from tracker.results.result import load_result
from tracker.running.jobs import described, execute, load_job
from tracker.running.jobs._delivery import opened_even
from tracker.running.viewing.images import images_of
from tracker.synthesis.simulation.sequence import Recipe, write_sequence

START = ["initialization.use=given", "initialization.poses=truth_poses.csv"]


@pytest.fixture(scope="module")
def config(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two frames of a dark and noisy room."""
    recipe = Recipe("arm_swing", seconds=0.08, size=(256, 208), light=0.3, noise_grey=4)
    return write_sequence(recipe, tmp_path_factory.mktemp("dark") / "sequence")


def test_what_the_run_has_chosen_for_its_images_holds_for_those_who_look_at_them(config: Path, tmp_path: Path) -> None:
    job = load_job("track", config, [*START, 'recordings=["run_json","journal"]'])
    assert (job.reading.gain, job.reading.smoothing_px) == (None, None)
    result = load_result(execute(job, tmp_path / "out").folder)
    chosen = result.details["images"]
    assert chosen["gain"] > 1.4
    assert chosen["smoothing_px"] > 0
    for shown, tracked in zip(images_of(result), opened_even(job.reading).frames(), strict=True):
        np.testing.assert_array_equal(shown.images, tracked.images)


def test_settings_that_cannot_be_are_one_line(config: Path, tmp_path: Path) -> None:
    (tmp_path / "config.toml").write_text(tomli_w.dumps(described(load_job("track", config))))
    for images in (["gain"], {"gain": "bright"}, {"gain": -1}):
        with pytest.raises(ConfigError, match="gain"):
            images_of(SimpleNamespace(folder=tmp_path, details={"images": images}))


def test_pictures_of_occluders_are_not_needed(config: Path, tmp_path: Path) -> None:
    """Plates are not made: with occluders, which only plates have, a run could not be viewed or aligned."""
    table = described(load_job("track", config))
    table["reading"]["occluders"] = str(tmp_path / "{view}.png")
    (tmp_path / "config.toml").write_text(tomli_w.dumps(table))
    assert len(list(images_of(SimpleNamespace(folder=tmp_path, details={})))) == 2


def test_still_pictures_are_looked_at_too(config: Path, tmp_path: Path) -> None:
    for video in config.parent.glob("*.mp4"):
        with av.open(str(video)) as opened:
            image = next(opened.decode(video=0)).to_ndarray(format="bgr24")
        cv2.imwrite(str(tmp_path / f"{video.stem}.png"), image)
    table = described(load_job("track", config))
    table["reading"] = {
        "use": "stills",
        "path": str(tmp_path / "{view}.png"),
        "rig": table["reading"]["rig"],
        "background": str(tmp_path / "none.png"),  # not needed
    }
    (tmp_path / "config.toml").write_text(tomli_w.dumps(table))
    (frame,) = images_of(SimpleNamespace(folder=tmp_path, details={}))
    assert [image.shape for image in frame.images] == [(208, 256, 3)] * 4
