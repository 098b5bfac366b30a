"""`bodytrack result segment`: contours by level sets along a result, as pictures."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from doubted import in_doubt
from typer.testing import CliRunner

from tracker.evidence.level_set import LevelSetEvidence
from tracker.evidence.measures.outlines import overlap
from tracker.foundation.arrays import Image, Mask
from tracker.foundation.errors import TrackerError
from tracker.results.result import Result, load_result
from tracker.running.cli import app
from tracker.running.jobs import execute, load_job
from tracker.running.viewing.segmentation import STEPS, Chosen, Segmented, picture_of, segmented
from tracker.synthesis.cpu import CpuSynthesis
from tracker.synthesis.simulation.sequence import Recipe, write_sequence
from tracker.tracking.estimate import Status


def tracked_to(folder: Path, constant_rate_factor: int) -> Path:
    """The result of six simulated frames."""
    recipe = Recipe("arm_swing", seconds=0.24, size=(360, 288), constant_rate_factor=constant_rate_factor)
    config = write_sequence(recipe, folder / "sequence")
    start = ["initialization.use=given", "initialization.poses=truth_poses.csv", 'recordings=["run_json","journal"]']
    # level sets look at pictures of 384 px or less, which enlarged ones are not, as they were filmed
    images = ["reading.downscale=1", "reading.smoothing_px=0"]
    execute(load_job("track", config, [*start, "passes=1", *images]), folder / "result")
    return folder / "result"


@pytest.fixture(scope="module")
def tracked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tracked_to(tmp_path_factory.mktemp("segment"), Recipe.constant_rate_factor)


@pytest.fixture(scope="module")
def result(tracked: Path) -> Result:
    return load_result(tracked)


def silhouettes(result: Result, k: int) -> tuple[Mask, ...]:
    return CpuSynthesis().silhouettes(result.scene.with_poses((result.replays[k].estimates[0].q,)))


def test_chosen_frames_begin_at_a_pose_before_and_end_at_what_is_seen(result: Result) -> None:
    found = list(segmented(result, LevelSetEvidence(), Chosen(every=2, first=1, back=3)))
    assert [one.frame for one in found] == [2, 4]
    one = found[1]
    assert [view.name for view in one.views] == list(result.rig.names)
    for v, view in enumerate(one.views):
        begun, now = silhouettes(result, 1)[v], silhouettes(result, 4)[v]
        np.testing.assert_array_equal(view.silhouette, now)
        for stages in (view.alone, view.held):
            assert len(stages) == len(STEPS["threshold_dynamics"])
            # pictures of 360 px are looked at as they are
            np.testing.assert_array_equal(stages[0], begun)
            assert overlap(stages[-1], now) > 0.75


@pytest.mark.parametrize("way", ["threshold_dynamics", "descent"])
def test_the_prior_draws_the_contour_to_the_pose_found(result: Result, way: str) -> None:
    """The stronger it is; without it nothing changes with its weight."""
    found = []
    for shape in (0.0, 0.03, 10.0):
        by = LevelSetEvidence(way=way, shape=shape)
        found.append(next(iter(segmented(result, by, Chosen(first=5, every=5, back=3)))).overlaps())
    alone, held = np.transpose(found)
    assert held[0] < held[1] < held[2]
    assert held[2] > 0.97
    assert len(set(alone.tolist())) == 1


def test_what_is_seen_is_learnt_on_the_way(result: Result) -> None:
    """The first frame has nothing but its own pose to learn from; doubtful frames teach nothing."""
    doubtful = [replace(one, estimates=(in_doubt(one.estimates[0], whole=True),)) for one in result.replays]
    unlearnt = replace(result, replays=tuple(doubtful))
    plain, other = (list(segmented(of, LevelSetEvidence(), Chosen(every=5))) for of in (result, unlearnt))
    first, last = (
        [np.array_equal(a.alone[-1], b.alone[-1]) for a, b in zip(plain[k].views, other[k].views, strict=True)]
        for k in (0, 1)
    )
    assert all(first)
    assert not all(last)
    assert other[0].statuses == ("doubtful",)


def test_who_is_lost_is_not_segmented(result: Result) -> None:
    gone = [
        replace(one, estimates=(replace(one.estimates[0], status=Status.LOST, q=result.scene.persons[0].q),))
        for one in result.replays
    ]
    replays = (*gone[:3], *result.replays[3:])
    found = list(segmented(replace(result, replays=replays), LevelSetEvidence(), Chosen(every=3, back=2)))
    assert [(one.statuses, len(one.views)) for one in found] == [(("lost",), 0), (("tracked",), 4)]
    np.testing.assert_array_equal(found[1].views[0].alone[0], silhouettes(result, 3)[0])


def colours_of(picture: Image, row: int) -> dict[str, int]:
    """Pixels of the pure colours of start and result in a row of a picture."""
    height = picture.shape[0] // 3
    part = picture[row * height + 24 : (row + 1) * height - 24]
    pure = {"red": (60, 60, 255), "white": (255, 255, 255)}
    return {name: int((np.abs(part.astype(int) - shade).max(axis=2) < 12).sum()) for name, shade in pure.items()}


def test_pictures_show_pose_and_contours(tmp_path: Path) -> None:
    # libx264 encodes equal images in other ways from run to run (299 to 325 white pixels); what is decoded of a
    # lossless recording is the same
    result = load_result(tracked_to(tmp_path, constant_rate_factor=0))
    one: Segmented = next(iter(segmented(result, LevelSetEvidence(), Chosen(first=5, every=5, back=5))))
    picture = picture_of(one, 1200)
    assert picture.shape == (3 * 390, 1200, 3)
    pose, alone, held = (colours_of(picture, row) for row in range(3))
    assert pose["white"] > 300
    assert pose["red"] < 20
    for row in (alone, held):
        assert row["white"] > 300
        assert row["red"] > 20
    unknown = replace(one, views=tuple(replace(view, alone=()) for view in one.views))
    assert colours_of(picture_of(unknown, 1200), 1)["red"] < 20


def test_the_command_writes_a_picture_a_frame(tracked: Path, tmp_path: Path) -> None:
    arguments = ["result", "segment", str(tracked), "--every", "3", "--set", "length=2", "--width", "480"]
    done = CliRunner().invoke(app, [*arguments, "--output", str(tmp_path / "pictures")])
    assert done.exit_code == 0, done.output
    assert sorted(path.name for path in (tmp_path / "pictures").iterdir()) == ["000000.png", "000003.png"]
    assert cv2.imread(str(tmp_path / "pictures" / "000003.png")).shape == (3 * 156, 480, 3)
    assert "frame 3: overlap with the pose found 0." in done.output


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--frames", "40:"], "no such frame"),
        (["--frames", "x"], "expected A:B"),
        (["--set", "lenght=2"], 'unknown key "lenght"'),
    ],
)
def test_what_cannot_be_is_one_line(tracked: Path, tmp_path: Path, options: list[str], words: str) -> None:
    with pytest.raises(TrackerError, match=words):
        CliRunner().invoke(
            app,
            ["result", "segment", str(tracked), *options, "--output", str(tmp_path / "none")],
            catch_exceptions=False,
        )
    assert not (tmp_path / "none").exists()


def test_a_recording_that_is_gone_is_told(tracked: Path, tmp_path: Path) -> None:
    moved = tracked.parent / "moved"
    (tracked.parent / "sequence").rename(moved)
    try:
        with pytest.raises(TrackerError):
            list(segmented(load_result(tracked), LevelSetEvidence(), Chosen()))
    finally:
        moved.rename(tracked.parent / "sequence")
