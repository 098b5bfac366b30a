"""The recordings in BODYTRACK_DATA that have a truth, described by their folders or the project's configurations."""

from __future__ import annotations

import csv
import json
import tomllib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from tracker.foundation.configuration.tables import Table

CONFIGS = Path(__file__).parents[2] / "configs"
_TRUTHS = ("truth_joints.csv", "gt_joints.csv", "joints3d*.csv", "reference/joints3d*.csv")
_RIGS = ("rig.toml", "calibration.json")
_VIDEOS, _PLATES = (".mp4", ".avi", ".mov"), (".png", ".jpg")


@dataclass(frozen=True)
class Recorded:
    """A recording with a truth."""

    name: str
    truth: Path
    reading: Table
    """The section [reading], without plates."""

    plates: Table
    """What it needs more to have plates; empty where there are none."""

    statures_m: dict[str, float]
    """Person -> height."""

    truth_names: dict[str, str]
    """Person -> name in the truth, where it is known."""

    n_frames: int
    """Frames up to the last one that the truth knows."""

    keypoints: str = ""
    """Path of 2-D detections with `{view}`; empty where there are none."""

    def videos(self) -> list[Path]:
        """The views' files, in the order of their names."""
        pattern = Path(str(self.reading["path"]))
        return sorted(pattern.parent.glob(pattern.name.replace("{view}", "*")))

    def with_keypoints(self) -> tuple[str, ...]:
        """Settings by which detections are evidence beside the default and what a person is found by."""
        told = f'{{use="keypoints",path="{self.keypoints}"}}'
        beside = f'evidence={{use="together",of=["auto",{told}],ranking=[1,1],refining=[1,1]}}'
        return beside, f"initialization={told}"

    def starts(self, n_starts: int) -> list[int]:
        """Frames to start at: 0 and others a tenth of the recording apart, so that most of it is tracked."""
        return sorted({round(0.1 * k * self.n_frames) for k in range(n_starts)})


def recorded(root: Path) -> tuple[list[Recorded], list[str]]:
    """All recordings with a truth below a folder, and what was left out and why."""
    found: list[Recorded] = []
    left_out: list[str] = []
    seen: set[Path] = set()
    for folder in sorted(path for path in (root, *root.glob("*"), *root.glob("*/*")) if path.is_dir()):
        truth = _truth(folder)
        if truth is None or truth in seen:
            continue
        seen.add(truth)
        one = _from_folder(folder, truth) or _from_config(folder, root, truth)
        if one is None:
            left_out.append(f"{folder}: a truth, but neither meta.json with statures nor a configuration in {CONFIGS}")
        else:
            found.append(one)
    return found, left_out


def _truth(folder: Path) -> Path | None:
    """The table of joints in every frame; of several the one of the plainest name."""
    tables = [path for pattern in _TRUTHS for path in folder.glob(pattern) if "frame" in _first_line(path)]
    return min(tables, key=lambda path: (len(path.name), path.name), default=None)


def _first_line(path: Path) -> list[str]:
    with path.open(encoding="utf-8") as file:
        return file.readline().strip().split(",")


def _n_frames(truth: Path) -> int:
    with truth.open(newline="", encoding="utf-8") as file:
        return 1 + max(int(float(row["frame"])) for row in csv.DictReader(file))


def _from_folder(folder: Path, truth: Path) -> Recorded | None:
    """A recording whose folder holds videos, rig and `meta.json`."""
    rig = next((folder / name for name in _RIGS if (folder / name).is_file()), None)
    videos = sorted(path for path in folder.iterdir() if path.suffix in _VIDEOS)
    meta = folder / "meta.json"
    if rig is None or not videos or not meta.is_file():
        return None
    told = json.loads(meta.read_text(encoding="utf-8"))
    people = [one for one in told.get("people", [told]) if "height_m" in one]
    if not people:
        return None
    names = [str(one.get("subject", f"person{k + 1}")) for k, one in enumerate(people)]
    return Recorded(
        name=folder.name,
        truth=truth,
        reading={"use": "video", "path": str(folder / f"{{view}}{videos[0].suffix}"), "rig": str(rig)},
        plates=_plates(folder / "background", [path.stem for path in videos]),
        statures_m={name: float(one["height_m"]) for name, one in zip(names, people, strict=True)},
        truth_names={name: str(one["id"]) for name, one in zip(names, people, strict=True) if "id" in one},
        n_frames=_n_frames(truth),
        keypoints=_keypoints(folder),
    )


def _plates(folder: Path, views: Iterable[str]) -> Table:
    for suffix in _PLATES:
        if all((folder / f"{view}{suffix}").is_file() for view in views):
            return {"background": str(folder / f"{{view}}{suffix}")}
    return {}


def _keypoints(folder: Path) -> str:
    """Folders of detections, a view each."""
    return str(folder / "keypoints" / "{view}_json") if any(folder.glob("keypoints/*_json")) else ""


def _from_config(folder: Path, root: Path, truth: Path) -> Recorded | None:
    """A recording whose persons are told by the first configuration that reads videos of its folder."""
    start = f"${{BODYTRACK_DATA}}/{folder.relative_to(root).as_posix()}/"
    for path in sorted(CONFIGS.glob("*.toml")):
        table = tomllib.loads(path.read_text(encoding="utf-8"))
        persons = table.get("persons", [])
        if table["reading"]["path"].startswith(start) and all("stature_m" in one for one in persons):
            keys = ("background", "align_background")
            return Recorded(
                name=folder.name,
                truth=truth,
                reading={key: value for key, value in table["reading"].items() if key not in keys},
                plates={key: value for key, value in table["reading"].items() if key in keys},
                statures_m={str(one["name"]): float(one["stature_m"]) for one in persons},
                truth_names={},
                n_frames=_n_frames(truth),
                keypoints=_keypoints(folder),
            )
    return None
