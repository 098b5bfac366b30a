"""Pictures of what stands before the persons: read, and counted neither for nor against a pose."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from recordings import small_simulation

from tracker.evidence.contours import ContourEvidence
from tracker.evidence.measures.outlines import Comparison
from tracker.foundation.errors import CalibrationError, SequenceError
from tracker.images.analysis.contours import ContourAnalysis
from tracker.images.analysis.silhouettes import SilhouetteAnalysis
from tracker.images.plate import Plate, changed
from tracker.images.reading._sequence import load_occluders, with_occluders
from tracker.images.reading.images import ImageReading
from tracker.images.reading.video import VideoReading
from tracker.images.sight import HIDDEN, Sight
from tracker.synthesis.cpu import CpuSynthesis
from tracker.synthesis.simulation.sequence import Simulation, write_sequence


@pytest.fixture(scope="module")
def filmed() -> Simulation:
    return small_simulation(n_frames=3)


def lower_half(picture: np.ndarray) -> np.ndarray:
    mask = np.zeros(picture.shape[:2], dtype=bool)
    mask[picture.shape[0] // 2 :] = True
    return mask


def written(folder, rig, views, size=None) -> str:
    folder.mkdir(exist_ok=True)
    for camera in rig.cameras:
        if camera.name in views:
            width, height = size or camera.size
            picture = np.zeros((height, width, 3), np.uint8)
            picture[height // 2 :] = 255
            cv2.imwrite(str(folder / f"{camera.name}.png"), picture)
    return str(folder / "{view}.png")


def test_views_without_a_picture_have_none(filmed, tmp_path):
    rig = filmed.scene.rig
    found = load_occluders(rig, written(tmp_path / "some", rig, rig.names[:2]), 1)
    assert [one is None for one in found] == [False, False, True, True]
    np.testing.assert_array_equal(found[0], lower_half(filmed.plates[0].picture))
    plates = with_occluders(filmed.plates, found)
    np.testing.assert_array_equal(plates[0].unknown, found[0])
    assert plates[2] is filmed.plates[2]


@pytest.mark.parametrize("factor", [2, 0.5])
def test_they_are_as_large_as_the_images(filmed, tmp_path, factor):
    rig = filmed.scene.rig
    found = load_occluders(rig, written(tmp_path / "all", rig, rig.names), factor)[0]
    assert found.shape == tuple(round(side / factor) for side in filmed.plates[0].picture.shape[:2])
    assert found[-1].all()
    assert not found[: len(found) // 2 - 4].any()


def test_pictures_that_cannot_be_right_are_errors(filmed, tmp_path):
    rig = filmed.scene.rig
    with pytest.raises(SequenceError, match=r"occluders: no file .*FRONT\.png, nor of another view"):
        load_occluders(rig, str(tmp_path / "nowhere" / "{view}.png"), 1)
    with pytest.raises(CalibrationError, match=r"the picture of occluders .*\.png has 20x30 px"):
        load_occluders(rig, written(tmp_path / "small", rig, rig.names, (20, 30)), 1)
    whole = tmp_path / "whole"
    whole.mkdir()
    cv2.imwrite(str(whole / "FRONT.png"), np.full(filmed.plates[0].picture.shape, 255, np.uint8))
    with pytest.raises(SequenceError, match="all of the picture is painted"):
        load_occluders(rig, str(whole / "{view}.png"), 1)
    (whole / "FRONT.png").write_bytes(b"no picture")
    with pytest.raises(SequenceError, match="not an image that can be read"):
        load_occluders(rig, str(whole / "{view}.png"), 1)


def test_a_recording_delivers_plates_that_know(filmed, tmp_path):
    config = write_sequence(filmed.recipe, tmp_path / "recording")
    pattern = written(tmp_path / "occluders", filmed.scene.rig, ["FRONT"])
    told = {"path": str(config.parent / "{view}.mp4"), "rig": config.parent / "rig.toml", "occluders": pattern}
    sequence = VideoReading(**told, background=str(config.parent / "background" / "{view}.png")).open()
    assert sequence.plates[0].occluder is not None
    assert sequence.plates[1].occluder is None
    with pytest.raises(SequenceError, match="occluders and masks"):
        VideoReading(**told, masks=str(tmp_path / "{view}" / "{frame}.png")).open()
    with pytest.raises(SequenceError, match='occluders and background = "none"'):
        VideoReading(**told, background="none").open()
    assert "occluders" in ImageReading.__dataclass_fields__


def test_nothing_is_known_where_something_hides(filmed):
    frame, plate = next(iter(filmed.frames())), filmed.plates[0]
    hides = replace(plate, occluder=lower_half(plate.picture))
    found, usual = changed(frame.images[0], hides), changed(frame.images[0], plate)
    assert not found.foreground[hides.occluder].any()
    assert found.moving[hides.occluder].all()
    np.testing.assert_array_equal(found.foreground[~hides.occluder], usual.foreground[~hides.occluder])
    assert isinstance(hides, Plate)


def test_contours_there_are_neither_explained_nor_missed(filmed):
    """What of the person shows above is measured as ever; the hidden part has no length."""
    frame, scene = next(iter(filmed.frames())), filmed.scene
    hides = tuple(replace(plate, occluder=lower_half(plate.picture)) for plate in filmed.plates)
    sights = [Sight(frame, plates) for plates in (filmed.plates, hides)]
    seen = [ContourAnalysis().observe(sight, None) for sight in sights]
    assert (seen[1].views[0].distance[hides[0].occluder] == HIDDEN).all()
    low = seen[1].views[0].edges[seen[1].views[0].accepted][:, 1]
    assert low.max() < len(hides[0].picture) / 2
    synthesis = CpuSynthesis()
    accounts = [ContourEvidence().account(Comparison(scene, 0, synthesis, one), filmed.poses[0][0]) for one in seen]
    assert 0.2 * accounts[0].visible_px.sum() < accounts[1].visible_px.sum() < 0.8 * accounts[0].visible_px.sum()
    assert accounts[1].explained > accounts[0].explained - 0.1

    # a foot that is put elsewhere behind it costs nothing; one arm above it does
    q = filmed.poses[0][0]
    names = scene.persons[0].body.names
    for name, hidden in (("left_leg_extension", True), ("left_arm_abduction", False)):
        moved = q.copy()
        moved[names.index(name)] += 0.1
        asked = Comparison(scene, 0, synthesis, seen[1])
        costs = ContourEvidence().distances(asked, np.array([q, moved]))
        assert (abs(costs[1] - costs[0]) < 0.05) == hidden, name


def test_an_outline_is_not_that_of_what_hides_the_rest(filmed):
    frame, plate = next(iter(filmed.frames())), filmed.plates[0]
    hides = replace(plate, occluder=lower_half(plate.picture))
    usual, seen = (
        SilhouetteAnalysis().observe(Sight(frame, (one, *filmed.plates[1:])), None).views[0] for one in (plate, hides)
    )
    middle = len(plate.picture) / 2
    above = usual.edges[usual.accepted & (usual.edges[:, 1] < middle - 12)]
    assert 0.9 * len(above) < np.count_nonzero(seen.accepted)
    assert seen.edges[seen.accepted][:, 1].max() < middle - 3
    assert (seen.distance[hides.occluder] == HIDDEN).all()
