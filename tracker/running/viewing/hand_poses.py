"""Bodies placed by hand over the images of a frame: figure 9 (d) of Gavrila & Davis 1996."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from tracker.bodies.body import BodyModel
from tracker.bodies.limbs import reaching
from tracker.bodies.scene import Scene
from tracker.cameras.frame import Frame
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Image, Integers
from tracker.foundation.errors import ConfigError, ModelError
from tracker.foundation.files import csv_lines, write_whole
from tracker.results.recording.csv_table import in_table_units, parameter_columns
from tracker.results.result import load_result
from tracker.running.jobs import load_job
from tracker.running.viewing.frame_evidence import Window, around, draw_contours
from tracker.running.viewing.images import Pictures, chosen_images, reading_of, single_frame
from tracker.running.viewing.stage import Stage
from tracker.synthesis.cpu import CpuSynthesis
from tracker.tracking.initialization.given import GivenInitialization

_DECIMALS = 5
"""Decimals of a start's angles and positions, as in poses.csv."""

_MOVED_M = 0.01
"""A joint that its limb's parameters move by less per radian cannot be dragged: the pelvis holds a hip."""


def standing(scene: Scene) -> Scene:
    """All persons at rest on the floor, z = 0, side by side in the middle of the cameras' view.

    Bodies that cannot be moved as a whole stay.
    """
    middle, poses = _looked_at(scene.rig), []
    for k, person in enumerate(scene.persons):
        q, shifts = person.body.rest(), _shifts(person.body)
        if len(shifts):
            marks = person.body.landmarks_in_world(q)
            beside = middle + np.array([k - (len(scene.persons) - 1) / 2, 0.0, 0.0])
            place = np.append((marks.min(axis=0) + marks.max(axis=0))[:2] / 2, marks[:, 2].min())
            q[shifts] += beside - place
        poses.append(person.body.clamped(q))
    return scene.with_poses(tuple(poses))


def _looked_at(rig: Rig) -> Array:
    """(3,) the point on the floor below the one that is nearest to all optical axes, metres."""
    centres = np.array([camera.centre for camera in rig.cameras])
    axes = np.array([camera.camera_from_world[2, :3] for camera in rig.cameras])
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    # cameras that look the same way meet nowhere: a little of their own middle keeps the point near them
    normal = across.sum(axis=0) + 1e-3 * np.eye(3)
    point = np.linalg.solve(normal, (across @ centres[..., None]).sum(axis=0)[:, 0] + 1e-3 * centres.mean(axis=0))
    return np.array([point[0], point[1], 0.0])


def handles(body: BodyModel) -> tuple[int, ...]:
    """Numbers of the landmarks that can be dragged: joints of limbs, and one that carries the whole body."""
    q, limbs = body.rest(), [(body.group(limb), body.landmarks_of(limb)) for limb in body.limbs]
    points, ends = body.landmarks_in_world(q), np.array([mark.parameter for mark in body.landmarks], dtype=np.int64)
    moved = np.linalg.norm(body.point_jacobian(q, points, ends), axis=1)
    of_limbs = [int(m) for columns, own in limbs for m in np.flatnonzero(own & (moved[:, columns] > _MOVED_M).any(1))]
    others = np.flatnonzero(~np.any([own for _, own in limbs], axis=0)) if limbs else np.arange(len(points))
    if not len(_shifts(body)) or not len(others):
        return tuple(of_limbs)
    root = body.world_from_parameters(q)[body.root.columns[-1], :3, 3]
    return int(others[np.linalg.norm(points[others] - root, axis=1).argmin()]), *of_limbs


def dragged(body: BodyModel, q: Array, mark: int, place: Array) -> Array:
    """The pose (dof,) after a landmark was dragged to a position (3,): its limb follows, or the whole body.

    Args:
        body: the model.
        q: (dof,) rad and m.
        mark: number of the landmark, one of `handles`.
        place: (3,) metres.
    """
    for limb in body.limbs:
        if body.landmarks_of(limb)[mark]:
            return reaching(body, q.copy(), body.group(limb), np.array([mark]), place[None])
    pose = q.copy()
    pose[_shifts(body)] += place - body.landmarks_in_world(q)[mark]
    return body.clamped(pose)


def write_start(path: Path, number: int, scene: Scene) -> None:
    """Writes the poses of all persons as the start of a frame, for `initialization = { use = "given" }`.

    Args:
        path: CSV.
        number: of the frame.
        scene: the persons at their poses.
    """
    columns, rows = parameter_columns(scene.persons), []
    for person in scene.persons:
        own = (parameter.column for parameter in person.body.parameters)
        told = dict(zip(own, in_table_units(person, person.q), strict=True))
        rows.append([number, person.name, *(f"{told[c]:.{_DECIMALS}f}" if c in told else "" for c in columns)])
    write_whole(path, csv_lines([("frame", "person", *columns), *rows]))


def _shifts(body: BodyModel) -> Integers:
    """Columns that move the whole body along x, y and z; empty for a fixed body."""
    none: Integers = np.zeros(0, dtype=np.int64)
    try:
        return none if body.stays else body.root.shifts
    except ModelError:
        return none


def begun_in_result(folder: Path, number: int) -> tuple[Scene, Frame]:
    """The persons as a run found, or assumed, them in a frame, and the images of the frame.

    Args:
        folder: of the result.
        number: of the frame.

    Raises:
        TrackerError: the result has no such frame, or the recording is gone.
    """
    result = load_result(folder)
    replay = next((one for one in result.replays if one.index == number), None)
    if replay is None:
        nearest = min(result.frames.tolist(), key=lambda one: abs(one - number), default=None)
        raise ConfigError(f"{folder}: no frame {number}" + ("" if nearest is None else f", the nearest is {nearest}"))
    _, frame = single_frame(reading_of(result, chosen_images(result)), number)
    return result.scene.with_poses(tuple(estimate.q for estimate in replay.estimates)), frame


def begun_in_run(config: Path, overrides: Sequence[str], number: int) -> tuple[Scene, Frame]:
    """The persons at the configuration's start, else standing before the cameras, and the images.

    Args:
        config: of a run.
        overrides: as for `bodytrack run --set`.
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


# BGR: contours of the person that is placed, and of the others.
_PLACED, _OTHERS = (0, 215, 255), (200, 200, 200)

_WIDTH_PX = 900
"""Widths of the images before the cameras, and of all views together beside the sliders, px."""

_STEP_DEG, _STEP_M = 0.5, 0.005
"""Step of the sliders; typed numbers are as fine."""

_MOST_M = 10.0
"""Range of the position sliders, metres from the first position."""

_HANDLE_M = 0.14
"""Length of the arrows at a joint."""

_AROUND = 1.3
"""Part of a view beside the sliders, over the size of the persons: neighbours are visible."""

_HELD_S = 0.3
"""After this time without movement a joint is released, and goes to where the limb has it."""

_EVERY_S = 0.04
"""Pause between two readings of the visitor's input."""


@dataclass
class _Steered:
    """The visitor's inputs, and the values set last: a difference is the visitor's wish."""

    node: Any
    last: Any


class Placing:
    """Persons of whom one is posed by sliders, numbers or joints that are dragged; contours follow in all views.

    The browser's threads only leave values in the nodes; the thread that calls `draw` does all the work.
    """

    def __init__(self, server: Any, scene: Scene, frame: Frame, path: Path) -> None:
        """Shows the persons at their first poses.

        Args:
            server: of viser.
            scene: the persons at their first poses, and the cameras of the images.
            frame: the images.
            path: of the file that `save` writes.
        """
        self._server, self.scene, self._begin, self._frame, self._path = server, scene, scene, frame, path
        self._stage, self._pictures = Stage(server, scene), Pictures(scene.rig, 1, _WIDTH_PX)
        self._saving, self._resetting = threading.Event(), threading.Event()
        self.saved = 0
        """Number of starts written."""

        gui, names = server.gui, tuple(person.name for person in scene.persons)
        self._told = gui.add_markdown("")
        self._overlay = gui.add_image(np.zeros((8, 8, 3), np.uint8), label=f"frame {frame.index}", format="jpeg")
        self._who = gui.add_dropdown("person", names, visible=len(names) > 1)
        self._who.value = names[0]
        for label, wanted in (("save the start", self._saving), ("as at the beginning", self._resetting)):
            gui.add_button(label).on_click(lambda _, wanted=wanted: wanted.set())
        self._sliders = [self._with_sliders(k) for k in range(len(names))]
        self._handles = [self._with_handles(k) for k in range(len(names))]
        self._held: tuple[int, float] | None = None
        self._shown: tuple[int, bytes, int | None] | None = None
        self._note = ""

    def draw(self) -> None:
        """Carries out the visitor's input, and shows it."""
        k = [person.name for person in self.scene.persons].index(self._who.value)
        q = self._wanted(k)
        if self._resetting.is_set():
            self._resetting.clear()
            q = self._begin.persons[k].q
        self.scene = self.scene.with_pose(k, q)
        if self._saving.is_set():
            self._saving.clear()
            write_start(self._path, self._frame.index, self.scene)
            self.saved += 1
            self._note, self._shown = f"written: `{self._path}`", None
        held = self._held[0] if self._held and time.monotonic() - self._held[1] < _HELD_S else None
        if self._shown != (k, q.tobytes(), held):
            with self._server.atomic():
                self._show(k, held)
            self._shown = k, q.tobytes(), held

    def serve(self, seconds: float = float("inf")) -> None:
        """Draws for this time, seconds."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.draw()
            time.sleep(_EVERY_S)

    def _wanted(self, k: int) -> Array:
        """The pose (dof,) of a person after the visitor's input."""
        body, q = self.scene.persons[k].body, self.scene.persons[k].q.copy()
        for column, slider in self._sliders[k].items():
            if slider.node.value != slider.last:
                slider.last = slider.node.value
                q[column] = np.radians(slider.last) if body.rotates[column] else slider.last
        q = body.clamped(q)
        for mark, handle in self._handles[k].items():
            place = np.asarray(handle.node.position, dtype=np.float64)
            if not np.array_equal(place, handle.last):
                handle.last, self._held = place, (mark, time.monotonic())
                q = dragged(body, q, mark, place)
        return q

    def _show(self, k: int, held: int | None) -> None:
        """Draws bodies, contours, sliders and joints at the poses; a dragged joint stays in place."""
        for n, person in enumerate(self.scene.persons):
            marks = person.body.landmarks_in_world(person.q)
            for column, slider in self._sliders[n].items():
                value = np.degrees(person.q[column]) if person.body.rotates[column] else person.q[column]
                node, step = slider.node, slider.node.step
                node.value = slider.last = float(np.clip(step * round(value / step), node.min, node.max))
                node.visible = n == k
            for mark, handle in self._handles[n].items():
                handle.node.visible = n == k
                if (n, mark) != (k, held):
                    handle.node.position, handle.last = marks[mark], marks[mark]
        self._stage.pose([person.q for person in self.scene.persons])
        drawn, windows = self._drawn(k)
        self._pictures.add(replace(self._frame, images=drawn))
        self._stage.show_images(self._pictures.of(self._frame.index) or (None,) * len(drawn))
        self._overlay.image = _side_by_side(drawn, windows)[..., ::-1]
        self._told.content = self._text(k)

    def _drawn(self, k: int) -> tuple[tuple[Image | None, ...], tuple[Window, ...]]:
        """The images with the contours, and the rectangles around the persons."""
        images, windows, contours = [], [], CpuSynthesis().contours(self.scene)
        first, n_parts = self.scene.first_part(k), len(self.scene.persons[k].body.parts)
        for v, image in enumerate(self._frame.images):
            view = contours.of(v)
            own = (view.parts >= first) & (view.parts < first + n_parts)
            picture = None if image is None else image.copy()
            if picture is not None:
                for chosen, shade in ((~own, _OTHERS), (own, _PLACED)):
                    draw_contours(picture, view.chosen(chosen), (0, 0), 1.0, shade)
            images.append(picture)
            size = self.scene.rig.cameras[v].size
            windows.append(_like_the_view(around(view.pixels, size), size))
        return tuple(images), tuple(windows)

    def _text(self, k: int) -> str:
        lines = [
            f"**{self.scene.persons[k].name}, frame {self._frame.index}**",
            "Move the sliders, type numbers, or drag the arrows at a joint. A click on a camera looks through it.",
        ]
        return "\n\n".join([*lines, *([self._note] if self._note else [])])

    def _with_sliders(self, k: int) -> dict[int, _Steered]:
        """A slider for each parameter, in a folder for each group; the first one carries the body, and is open."""
        person, gui = self.scene.persons[k], self._server.gui
        sliders: dict[int, _Steered] = {}
        body, carrying = person.body, person.body.carrying.tolist()
        groups = {"body": carrying} | {g: body.group(g).tolist() for g in body.fine_groups}
        groups["others"] = list(range(body.dof))
        for group, columns in groups.items():
            title = group.replace("_", " ") if len(self.scene.persons) == 1 else f"{person.name}: {group}"
            new = [column for column in columns if column not in sliders]
            if new:
                with gui.add_folder(title, expand_by_default=not sliders):
                    sliders.update({column: self._slider(k, column) for column in new})
        return sliders

    def _slider(self, k: int, column: int) -> _Steered:
        person = self.scene.persons[k]
        rotates, value = bool(person.body.rotates[column]), person.q[column]
        # a turn about the vertical may go on for ever, and so may a place; one way round, and 10 m, are enough
        reach = np.pi if rotates else _MOST_M
        low, high = np.clip(person.body.limits[column], value - reach, value + reach)
        unit, step = (np.degrees(1.0), _STEP_DEG) if rotates else (1.0, _STEP_M)
        ends = [round(step * n, 3) for n in (np.floor(unit * low / step), np.ceil(unit * high / step))]
        name = person.body.parameters[column].column
        node = self._server.gui.add_slider(name, *map(float, ends), step, float(np.clip(unit * value, *ends)))
        return _Steered(node, node.value)

    def _with_handles(self, k: int) -> dict[int, _Steered]:
        """Arrows at the joints that can be dragged."""
        person, found = self.scene.persons[k], {}
        marks = person.body.landmarks_in_world(person.q)
        for mark in handles(person.body):
            node = self._server.scene.add_transform_controls(
                f"/handles/{person.name}/{person.body.landmark_names[mark]}",
                scale=_HANDLE_M,
                disable_rotations=True,
                disable_sliders=True,
                depth_test=False,
                position=marks[mark],
            )
            found[mark] = _Steered(node, marks[mark])
        return found


def _like_the_view(window: Window, size: tuple[int, int]) -> Window:
    """A larger rectangle with the view's own proportions, inside it."""
    share = min(1.0, _AROUND * max(window.width / size[0], window.height / size[1]))
    width, height = max(8, int(share * size[0])), max(8, int(share * size[1]))
    left = min(max(window.left + (window.width - width) // 2, 0), size[0] - width)
    top = min(max(window.top + (window.height - height) // 2, 0), size[1] - height)
    return Window(left, top, width, height)


def _side_by_side(images: tuple[Image | None, ...], windows: tuple[Window, ...]) -> Image:
    """The rectangles of all views, in two columns; a missing view is black."""
    width = _WIDTH_PX // 2
    height = max(round(width * window.height / window.width) for window in windows)
    cells = [np.zeros((height, width, 3), np.uint8) for _ in range(len(images) + len(images) % 2)]
    for cell, image, (x, y, w, h) in zip(cells, images, windows, strict=False):
        if image is not None:
            scale = min(width / w, height / h)
            size = min(width, round(scale * w)), min(height, round(scale * h))
            small = cv2.resize(image[y : y + h, x : x + w], size, interpolation=cv2.INTER_AREA)
            cell[: size[1], : size[0]] = small
    rows = [np.hstack(cells[n : n + 2]) for n in range(0, len(cells), 2)]
    picture: Image = np.vstack(rows)
    return picture
