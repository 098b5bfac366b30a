"""Keypoints as a faultless detector would find them, and with its usual faults."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from tracker.bodies.keypoint_layouts.orders import LAYOUTS
from tracker.bodies.keypoints import meant
from tracker.bodies.scene import Scene
from tracker.foundation.arrays import Array

NAMES = LAYOUTS["coco_17"]


def detected(scene: Scene, noise_px: float = 0.0, seed: int = 0, names: tuple[str, ...] = NAMES) -> list[Array]:
    """(K, N, 3) a view: keypoints of every person, NaN where the body has no such point."""
    rng = np.random.default_rng(seed)
    views = []
    for camera in scene.rig.cameras:
        persons = []
        for person in scene.persons:
            known = meant(names, person.body)
            found = np.full((len(names), 3), np.nan)
            found[known.rows, :2] = camera.project(person.body.points_in_world(person.q, known.points, known.ends))
            found[known.rows, :2] += noise_px * rng.normal(size=(len(known.rows), 2))
            found[known.rows, 2] = 0.9
            persons.append(found)
        views.append(np.array(persons))
    return views


def exchanged(found: Array, words: tuple[str, ...], names: tuple[str, ...] = NAMES) -> Array:
    """Keypoints (..., K, 3) with left and right exchanged where a name holds one of the words."""
    other = {"left": "right", "right": "left"}
    order = [
        names.index("_".join(other.get(part, part) for part in name.split("_")))
        if set(words) & set(name.split("_"))
        else k
        for k, name in enumerate(names)
    ]
    return found[..., order, :]


def written(views: list[Array], rig_names: tuple[str, ...], folder: Path, frame: int = 0) -> str:
    """Writes what was found as OpenPose does; the pattern of the folders."""
    for name, persons in zip(rig_names, views, strict=True):
        (folder / f"{name}_json").mkdir(parents=True, exist_ok=True)
        people = [{"pose_keypoints_2d": np.nan_to_num(person).ravel().tolist()} for person in persons]
        path = folder / f"{name}_json" / f"{name}_{frame:06d}.json"
        path.write_text(json.dumps({"people": people}), encoding="utf-8")
    return str(folder / "{view}_json")
