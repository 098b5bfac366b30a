"""Recordings made wrong in one way each: the look at their first frames says which."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from recordings import small_simulation

from tracker.bodies.scene import Scene
from tracker.cameras.camera import Camera
from tracker.cameras.frame import Frame
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Image
from tracker.foundation.configuration.components import available, find
from tracker.images.inspection import Inspection, Survey, findings, other_colours, survey
from tracker.images.inspection._survey import N_FRAMES
from tracker.images.plate import Plate
from tracker.images.reading.video import VideoReading
from tracker.synthesis.simulation.sequence import Simulation

LATE = 6
N_HALF = 70


@pytest.fixture(scope="module")
def longer() -> Simulation:
    """A person who walks along an arc, off the middle of the rig, for as long as is looked at."""
    walking = small_simulation("walking_on_the_spot", n_frames=N_FRAMES)
    return replace(walking, poses=(along_an_arc(walking.poses[0], turn_rad=np.pi * N_FRAMES / N_HALF),))


@pytest.fixture(scope="module")
def simulation(longer: Simulation) -> Simulation:
    """The same for half a circle."""
    return replace(longer, recipe=replace(longer.recipe, seconds=N_HALF / 25), poses=(longer.poses[0][:N_HALF],))


def along_an_arc(poses: Array, first_deg: float = 20.0, turn_rad: float = np.pi) -> Array:
    there = np.array(poses)
    angles = np.radians(first_deg) + np.linspace(0, turn_rad, len(there))
    there[:, 0] += 0.8 * np.cos(angles)
    there[:, 1] += 0.8 * np.sin(angles)
    return there


@pytest.fixture(scope="module")
def frames(longer: Simulation) -> tuple[Frame, ...]:
    """Those of `simulation`; the pictures of both are drawn once."""
    return tuple(longer.frames())[:N_HALF]


def told(frames: Iterable[Frame], scene: Scene, plates: tuple[Plate | None, ...]) -> tuple[str, ...]:
    return findings(survey(frames, scene, plates))


def shown_by(frames: tuple[Frame, ...], order: list[int]) -> tuple[Frame, ...]:
    return tuple(replace(frame, images=tuple(frame.images[v] for v in order)) for frame in frames)


def late(frames: tuple[Frame, ...], view: int, by: int) -> tuple[Frame, ...]:
    """The frames as a view shows them that began to record earlier: its images come `by` frames late."""
    pairs = zip(frames[by:], frames, strict=False)
    return tuple(
        replace(now, images=tuple((old if v == view else now).images[v] for v in range(4))) for now, old in pairs
    )


def mirrored(frames: tuple[Frame, ...], plates: tuple[Plate, ...], views: set[int]) -> tuple[list[Frame], list[Plate]]:
    def turned(v: int, image: Array) -> Array:
        return np.ascontiguousarray(image[:, ::-1]) if v in views else image

    shown = [replace(f, images=tuple(turned(v, i) for v, i in enumerate(f.images))) for f in frames]  # type: ignore[arg-type]
    return shown, [Plate(turned(v, plate.picture)) for v, plate in enumerate(plates)]  # type: ignore[arg-type]


def moved(rig: Rig, turn: Array, scale: float = 1.0) -> Rig:
    """The rig in another world: points there are `scale * turn @ x`."""
    cameras = []
    for camera in rig.cameras:
        motion = np.eye(4)
        motion[:3, :3] = camera.camera_from_world[:3, :3] @ turn.T
        motion[:3, 3] = scale * camera.camera_from_world[:3, 3]
        cameras.append(Camera(camera.name, camera.size, camera.matrix, camera.distortion, motion))
    return Rig(tuple(cameras))


def test_a_right_recording_has_no_findings(simulation: Simulation, frames: tuple[Frame, ...]) -> None:
    assert told(frames, simulation.scene, simulation.plates) == ()
    assert told(frames, simulation.scene, (None,) * 4) == ()


@pytest.mark.parametrize("known", [True, False], ids=["plates", "no plates"])
def test_exchanged_videos(known: bool, simulation: Simulation, frames: tuple[Frame, ...]) -> None:
    order = [1, 0, 2, 3]
    plates = tuple(simulation.plates[v] if known else None for v in order)
    (line,) = told(shown_by(frames, order), simulation.scene, plates)
    names = simulation.scene.rig.names
    assert f'"{names[0]}" and "{names[1]}" look exchanged' in line


def test_shadows_and_cables_are_no_wrong_rig(simulation: Simulation, frames: tuple[Frame, ...]) -> None:
    seen = survey(frames, simulation.scene, simulation.plates)
    masks = [[np.array(mask) for mask in row] for row in seen.foregrounds]
    for row in masks:
        for mask in row[:2]:
            mask[-6:, :6] = True
    assert findings(seen) == findings(replace(seen, foregrounds=tuple(map(tuple, masks)))) == ()


@pytest.mark.parametrize("known", [{0, 1}, {2, 3}])
def test_who_moves_before_no_plate_need_not_meet(
    known: set[int], simulation: Simulation, frames: tuple[Frame, ...]
) -> None:
    plates = tuple(plate if v in known else None for v, plate in enumerate(simulation.plates))
    assert told(frames, simulation.scene, plates) == ()


def test_of_what_moves_of_several_persons_nothing_is_told(simulation: Simulation, frames: tuple[Frame, ...]) -> None:
    """DO-Two without plates was told that one of its views does not fit the others."""
    order, (person,) = [1, 0, 2, 3], simulation.scene.persons
    both = Scene((person, replace(person, name="other")), simulation.scene.rig)
    assert told(shown_by(frames, order), both, (None,) * 4) == ()
    assert told(shown_by(frames, order), both, tuple(simulation.plates[v] for v in order))


@pytest.mark.parametrize(
    ("views", "words"), [({2}, 'of "{2}" look mirrored'), ({0, 1, 2, 3}, "all images look mirrored")]
)
def test_mirrored_images(views: set[int], words: str, simulation: Simulation, frames: tuple[Frame, ...]) -> None:
    shown, plates = mirrored(frames, simulation.plates, views)
    lines = told(tuple(shown), simulation.scene, tuple(plates))
    assert any(words.format(*simulation.scene.rig.names) in line for line in lines)


def test_another_rig(simulation: Simulation, frames: tuple[Frame, ...]) -> None:
    """Every camera was turned by some degrees after it was calibrated."""
    rng, cameras = np.random.default_rng(3), []
    for camera in simulation.scene.rig.cameras:
        turned = Camera.looking_at(
            camera.name, camera.size, camera.matrix[0, 0], tuple(camera.centre), rng.normal(0, 1.2, 3)
        )
        cameras.append(turned)
    scene = Scene(simulation.scene.persons, Rig(tuple(cameras)))
    assert any("do not meet in space" in line for line in told(frames, scene, simulation.plates))


@pytest.mark.parametrize(("change", "words"), [(np.logical_not, "cover 9"), (np.zeros_like, "show no person in most")])
def test_masks_that_are_inverted_or_empty(
    change: Callable[[Array], Array], words: str, simulation: Simulation, frames: tuple[Frame, ...]
) -> None:
    seen = survey(frames, simulation.scene, simulation.plates)
    bare = replace(seen, plates=(None,) * 4, masked=(True,) * 4)
    assert findings(bare) == ()
    masks = tuple(tuple(None if mask is None else change(mask) for mask in row) for row in seen.foregrounds)
    assert any(words in line for line in findings(replace(bare, foregrounds=masks)))


def test_a_black_plate(simulation: Simulation, frames: tuple[Frame, ...]) -> None:
    black = Plate(np.zeros_like(simulation.plates[1].picture))
    lines = told(frames[:20], simulation.scene, (simulation.plates[0], black, *simulation.plates[2:]))
    assert any("grey levels all over" in line and simulation.scene.rig.names[1] in line for line in lines)


@pytest.mark.parametrize("by", [LATE, -LATE])
def test_a_view_out_of_step(by: int, longer: Simulation) -> None:
    frames = tuple(longer.frames())
    shown = late(frames, 2, by) if by > 0 else late(frames[::-1], 2, -by)[::-1]
    name = longer.scene.rig.names[2]
    (line,) = told(shown, longer.scene, longer.plates)
    assert f'view "{name}" looks' in line
    proposed = int(line.partition(f"{name} = ")[2].partition(" ")[0])
    # images come late: the frame is found `by` images later than where it is looked for
    assert abs(proposed - by) <= 1


def test_another_stature(simulation: Simulation, frames: tuple[Frame, ...]) -> None:
    person = simulation.scene.persons[0]
    for factor, word in ((0.6, "taller"), (1.7, "smaller")):
        body = replace(person.body, stature_m=factor * person.body.stature_m)
        scene = Scene((replace(person, body=body),), simulation.scene.rig)
        (line,) = told(frames, scene, simulation.plates)
        assert word in line


def test_a_world_that_is_not_upright_or_not_in_metres(simulation: Simulation, frames: tuple[Frame, ...]) -> None:
    rig, persons = simulation.scene.rig, simulation.scene.persons
    y_up = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
    lines = told(frames[:3], Scene(persons, moved(rig, y_up)), simulation.plates)
    assert any("y axis up" in line for line in lines)
    lines = told(frames[:3], Scene(persons, moved(rig, np.eye(3), 1000.0)), simulation.plates)
    assert any("millimetres" in line for line in lines)


def test_more_bodies_than_persons() -> None:
    """Which is all that is said: the middles of foregrounds with two bodies need not meet in space."""
    two = small_simulation("walking_on_the_spot", n_frames=12, persons=2)
    shown = tuple(two.frames())
    assert told(shown, two.scene, two.plates) == ()
    (line,) = told(shown, Scene(two.scene.persons[:1], two.scene.rig), two.plates)
    assert "2 bodies" in line
    assert "1 person is" in line


def test_somebody_in_a_plate(simulation: Simulation, frames: tuple[Frame, ...]) -> None:
    """The plate is an image of the recording, taken where its person has not been again."""
    # where they are last, alone: to draw the frames before takes longer than the look
    alone = replace(simulation.recipe, seconds=1 / 25)
    then = next(replace(simulation, recipe=alone, poses=(simulation.poses[0][-1:],)).frames())
    plates = (Plate(then.images[0]), *simulation.plates[1:])  # type: ignore[arg-type]
    lines = told(frames[:40], simulation.scene, plates)
    assert any(f'plate of view "{simulation.scene.rig.names[0]}" shows something' in line for line in lines)


@pytest.mark.parametrize("use", available("inspection"))
def test_every_inspection_keeps_its_contract(use: str, simulation: Simulation, frames: tuple[Frame, ...]) -> None:
    inspection = find("inspection", use)()
    assert isinstance(inspection, Inspection)
    nothing = tuple(replace(frame, images=(None,) * 4) for frame in frames[:4])
    for seen in (survey((), simulation.scene, simulation.plates), survey(nothing, simulation.scene, (None,) * 4)):
        assert list(inspection.findings(seen)) == []


def test_no_more_frames_are_read_than_are_looked_at(simulation: Simulation, frames: tuple[Frame, ...]) -> None:
    asked = 0

    def endless() -> Iterator[Frame]:
        nonlocal asked
        while True:
            asked += 1
            yield frames[0]

    seen: Survey = survey(endless(), simulation.scene, simulation.plates)
    assert asked == N_FRAMES == len(seen.foregrounds)


@pytest.mark.parametrize("views", [("RIGHT", "BACK", "LEFT"), ("FRONT", "RIGHT", "LEFT")])
def test_three_rendered_views_in_step_are_not_late(
    views: tuple[str, ...], data: Callable[[str], Path], simulation: Simulation
) -> None:
    """The first three were told to be 10 images late."""
    folder = data("room/T-Punch-light")
    rig = folder / "calibration.json"
    sequence = VideoReading(path=str(folder / "{view}.mp4"), rig=rig, views=views, background="none").open()
    lines = told(sequence.frames(), Scene(simulation.scene.persons, sequence.rig), sequence.plates)
    assert not any("offsets" in line for line in lines)


@pytest.mark.parametrize("name", ["D-TwoElbowRot", "N-WalkCircle"])
def test_rendered_recordings_have_no_findings(name: str, data: Callable[[str], Path], simulation: Simulation) -> None:
    folder = data(f"room/{name}")
    reading = VideoReading(
        path=str(folder / "{view}.mp4"),
        rig=folder / "calibration.json",
        background=str(folder / "background" / "{view}.png"),
    )
    sequence = reading.open()
    assert told(sequence.frames(), Scene(simulation.scene.persons, sequence.rig), sequence.plates) == ()


def test_the_real_recording_meets_in_space(data: Callable[[str], Path], simulation: Simulation) -> None:
    """The floor is in the foreground of one of its views."""
    folder = data("balancing")
    reading = VideoReading(
        path=str(folder / "videos" / "{view}.mp4"),
        rig=folder / "calibration_balancing.json",
        background=str(folder / "background" / "{view}.png"),
        downscale=2,
    )
    sequence = reading.open()
    scene = Scene(simulation.scene.persons, sequence.rig)
    assert not any("do not meet" in line for line in told(sequence.frames(), scene, sequence.plates))


def enlarged(camera: Camera, scale: int) -> Camera:
    matrix = np.array(camera.matrix)
    matrix[:2] *= scale
    matrix[:2, 2] += (scale - 1) / 2
    return replace(camera, matrix=matrix, size=(scale * camera.size[0], scale * camera.size[1]))


@pytest.mark.parametrize(("scale", "factor"), [(4, 1), (5, 2)])
def test_images_larger_than_the_model_is_worth(
    scale: int, factor: int, simulation: Simulation, frames: tuple[Frame, ...]
) -> None:
    """The person is 140 px high where she is seen smallest, at 360x288."""
    rig = simulation.scene.rig
    large = Rig(tuple(enlarged(camera, scale) for camera in rig.cameras))
    seen = survey(frames[::2], simulation.scene, simulation.plates)
    masks = tuple(
        tuple(None if mask is None else np.kron(mask, np.ones((scale, scale), dtype=np.bool_)) for mask in row)
        for row in seen.foregrounds
    )
    larger = replace(seen, scene=Scene(seen.scene.persons, large), foregrounds=masks)
    lines = [line for line in findings(larger) if "downscale" in line]
    assert len(lines) == (factor > 1)
    assert all(f"reading.downscale = {factor} " in line for line in lines)


def test_images_that_were_averaged_too_far(simulation: Simulation, frames: tuple[Frame, ...]) -> None:
    """As recorded, small persons are nobody's mistake."""
    rig = Rig(tuple(replace(camera, downscale=2) for camera in simulation.scene.rig.cameras))
    (line,) = told(frames, Scene(simulation.scene.persons, rig), simulation.plates)
    assert re.match(r"reading.downscale = 2 leaves persons 1\d\d px high .*; leave it out, or set it to 1$", line)


@pytest.mark.parametrize("grey", ["images", "plates"])
def test_plates_of_other_colours_than_the_images_are_named(
    simulation: Simulation, frames: tuple[Frame, ...], grey: str
) -> None:
    def greyed(image: Image) -> Image:
        return np.repeat(image.mean(axis=2, keepdims=True), 3, axis=2).astype(np.uint8)

    shown, plates = frames[:3], simulation.plates
    assert other_colours(survey(shown, simulation.scene, plates)) == ""
    if grey == "images":
        shown = tuple(replace(one, images=tuple(map(greyed, one.images))) for one in shown)
    else:
        plates = tuple(replace(one, picture=greyed(one.picture)) for one in plates)
    fault = other_colours(survey(shown, simulation.scene, plates))
    assert fault.startswith(f"the plates of {', '.join(simulation.scene.rig.names)} are")
    assert "take plates with the cameras set as they recorded" in fault
