"""Bodies placed by hand over the images of a frame: figure 9 (d) of Gavrila & Davis 1996."""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from tracker.bodies.scene import Scene
from tracker.cameras.frame import Frame
from tracker.foundation.arrays import Array, Image
from tracker.running.viewing.frame_evidence import Window, around, draw_contours
from tracker.running.viewing.hand_poses import dragged, handles, write_start
from tracker.running.viewing.pictures import Pictures
from tracker.running.viewing.stage import Stage
from tracker.synthesis.cpu import CpuSynthesis

# BGR: contours of the person that is placed, and of the others.
_PLACED, _OTHERS = (0, 215, 255), (200, 200, 200)

_WIDTH_PX = 900
"""Of the images before the cameras, and of all views together beside the sliders, px."""

_STEP_DEG, _STEP_M = 0.5, 0.005
"""Of the sliders; what is typed beside them is as fine."""

_MOST_M = 10.0
"""Of the sliders of places, metres from where a person begins."""

_HANDLE_M = 0.14
"""Length of the arrows at a joint."""

_AROUND = 1.3
"""What is shown beside the sliders, over the size of the persons: who is placed beside somebody sees him."""

_HELD_S = 0.3
"""After so long without a move a joint is not dragged any more, and goes to where the limb has it."""

_EVERY_S = 0.04
"""Between two looks at what the visitor has done."""


@dataclass
class _Steered:
    """What a visitor moves, and what we have put there last: what differs is the visitor's wish."""

    node: Any
    last: Any


class Placing:
    """Persons, one of whom is posed by sliders, numbers or joints that are dragged; contours follow in all views.

    The browser's threads only leave values in the nodes; all is done by the thread that calls `draw`.
    """

    def __init__(self, server: Any, scene: Scene, frame: Frame, path: Path) -> None:
        """Shows the persons where they begin.

        Args:
            server: of viser.
            scene: the persons where they begin, and the cameras of the images.
            frame: the images.
            path: where `save` writes.
        """
        self._server, self.scene, self._begin, self._frame, self._path = server, scene, scene, frame, path
        self._stage, self._pictures = Stage(server, scene), Pictures(scene.rig, 1, _WIDTH_PX)
        self._saving, self._resetting = threading.Event(), threading.Event()
        self.saved = 0
        """How often a start was written."""

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
        """Does what the visitor has asked for since, and shows it."""
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
        """Draws what is wanted for so long, seconds."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.draw()
            time.sleep(_EVERY_S)

    def _wanted(self, k: int) -> Array:
        """The pose (dof,) that the visitor has made of a person's."""
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
        """Bodies, contours, sliders and joints as the poses are; a joint that is held stays where it was dragged."""
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
        """The images with the contours, and where in them the persons are."""
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
        """A slider for each parameter, in a folder for each group; what carries the body first, and open."""
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
    """A larger window with the view's own proportions, inside it."""
    share = min(1.0, _AROUND * max(window.width / size[0], window.height / size[1]))
    width, height = max(8, int(share * size[0])), max(8, int(share * size[1]))
    left = min(max(window.left + (window.width - width) // 2, 0), size[0] - width)
    top = min(max(window.top + (window.height - height) // 2, 0), size[1] - height)
    return Window(left, top, width, height)


def _side_by_side(images: tuple[Image | None, ...], windows: tuple[Window, ...]) -> Image:
    """What all views show in their windows, in two columns; a missing one is black."""
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
