"""A draft of a run's configuration, made of what lies in a folder of videos or images."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import tomli_w

from tracker.errors import CalibrationError
from tracker.footage import PICTURES, Footage, header, listed, pattern_of, sources, with_view
from tracker.rig import Rig
from tracker.rig_layouts import read_rig

_RIGS = {".toml", ".json", ".txt", ".xml", ".xcp"}
_PLAIN = "images", "frames", "pictures", "raw"
_PLATE_WORDS = "background", "plate", "empty", "bg"
_CALIBRATION_WORDS = "calib", "rig", "camera", "intri"


@dataclass(frozen=True)
class Draft:
    """What was found, and the text made of it."""

    footage: tuple[Footage, ...]
    rig: Path | None
    plates: str
    """Pattern with `{view}`; empty where there are none."""

    remarks: tuple[str, ...]
    """What is missing or does not fit, in one line each."""

    text: str
    """The commented configuration."""


def draft(folder: Path, target: Path, rig: Path | None = None) -> Draft:
    """Finds videos, cameras and plates, and writes down a configuration of them.

    Args:
        folder: of the videos or numbered images, one a view; or of a folder of images for each view.
        target: where the configuration will lie; paths in it start there.
        rig: the calibration; None to look for one in the folder and beside it.

    Raises:
        SequenceError: there are no videos or images, or one cannot be read.
        CalibrationError: the calibration that is given cannot be used, or nothing is called after its cameras.
    """
    there = sources(folder)
    found, faults = ((rig, read_rig(rig).rig), []) if rig is not None else _found_rig(folder, there)
    pattern, views = pattern_of(there, folder, found[1] if found else None)
    if not views and found is not None:
        cameras, files = ", ".join(found[1].names), ", ".join(path.name for path in there[:4])
        raise CalibrationError(
            f"{found[0]}: nothing in {folder} is called after one of its cameras ({cameras}): {files}; rename files "
            "or cameras"
        )
    footage = tuple(header(path, view) for view, path in sorted(views.items()))
    plates, unplated = _found_plates(folder, [one.view for one in footage])
    unused = sorted(set(there) - set(views.values()))
    absent = sorted(set(found[1].names) - set(views)) if found else []
    remarks = (*faults, *_remarks(footage, found, absent, unused, "{frame}" in str(pattern)), *_told(plates, unplated))
    plates = None if unplated else plates
    start = target.resolve().parent
    chosen = found[0] if found else None
    near = {"path": pattern, "rig": chosen, "background": plates}
    told = {key: _relative(path, start) for key, path in near.items() if path is not None}
    chosen_views = [name for name in found[1].names if name in views] if found and absent else []
    text = _text(_name(folder.resolve()), told, chosen_views)
    return Draft(footage, chosen, str(plates or ""), remarks, text)


def _near(folder: Path, words: tuple[str, ...]) -> Iterator[Path]:
    """The folder, the one it lies in, and folders in both that are called after what is looked for."""
    for place in (folder, folder.resolve().parent):
        yield place
        yield from sorted(p for p in listed(place) if p.is_dir() and any(word in p.name.lower() for word in words))


def _found_rig(folder: Path, there: list[Path]) -> tuple[tuple[Path, Rig] | None, list[str]]:
    """The calibration near the recording whose cameras most of its views are called after.

    If there is none, also why those that are called so are none.
    """
    best: tuple[int, Path, Rig] | None = None
    faults: list[str] = []
    for place in _near(folder, _CALIBRATION_WORDS):
        for path in sorted(p for p in listed(place) if p.suffix.lower() in _RIGS):
            try:
                rig = read_rig(path).rig
            except (CalibrationError, OSError, ValueError, KeyError) as error:
                if any(word in path.stem.lower() for word in _CALIBRATION_WORDS):  # else something else
                    faults.append(str(error) if str(path) in str(error) else f"{path}: {error}")
                continue
            n_named = len(pattern_of(there, folder, rig)[1])
            if n_named and (best is None or n_named > best[0]):
                best = n_named, path, rig
    return (None, faults) if best is None else ((best[1], best[2]), [])


def _found_plates(folder: Path, views: list[str]) -> tuple[Path | None, list[str]]:
    """The pattern of pictures, one a view, in a folder called after plates; and views that lack one, fewest of all."""
    best: tuple[Path | None, list[str]] = None, views
    for place in _near(folder, _PLATE_WORDS):
        if not any(word in place.name.lower() for word in _PLATE_WORDS):
            continue
        for path in sorted(p for p in listed(place) if p.suffix.lower() in PICTURES):
            for stem in (stem for view in views for stem in with_view(path.stem, view)):
                pattern = stem + path.suffix
                lacking = [other for other in views if not (place / pattern.replace("{view}", other)).is_file()]
                if len(lacking) < len(best[1]):
                    best = place / pattern, lacking
    return best


def _told(plates: Path | None, lacking: list[str]) -> Iterator[str]:
    if plates is None:
        yield "no plates found: film the empty room for some seconds; else they are made of the recording"
    elif lacking:
        yield (
            f"{plates} has no plate of {', '.join(lacking)}: add what is missing and set `background`, or leave these "
            "views out with `views`; else plates are made of the recording"
        )


def _remarks(
    footage: tuple[Footage, ...],
    found: tuple[Path, Rig] | None,
    absent: list[str],
    unused: list[Path],
    numbered: bool,
) -> Iterator[str]:
    if found is None:
        yield "no calibration found whose cameras the videos are called after: give it by --rig, or as `rig`"
    else:
        sizes = {camera.name: camera.size for camera in found[1].cameras}
        for one in footage:
            if one.size != (size := sizes[one.view]):
                yield f"{one.path.name}: {one.size[0]}x{one.size[1]} px, but calibrated at {size[0]}x{size[1]}"
        if absent:
            yield f"cameras without a recording: {', '.join(absent)}; `views` names those that are used"
    if unused:
        yield f"left out, for their names follow another pattern: {', '.join(path.name for path in unused)}"
    if len({round(one.fps, 2) for one in footage}) > 1:
        yield "the videos have different frame rates: " + ", ".join(f"{one.view} {one.fps:.4g}" for one in footage)
    if len({one.n_frames for one in footage}) > 1:
        yield "the views have different numbers of frames: `offsets` and `stop` make them fit"
    if numbered:
        yield "images do not tell how many there are a second: set `fps`"


def _relative(path: Path, start: Path) -> str:
    return Path(os.path.relpath(path.absolute(), start)).as_posix()


def _name(folder: Path) -> str:
    """Of the run: that of the folder, or of the one above it if it only says what is in it."""
    plain = "video" in folder.name.lower() or folder.name.lower() in _PLAIN
    return folder.parent.name if plain and folder.parent.name else folder.name


def _text(name: str, paths: dict[str, str], views: list[str]) -> str:
    """The configuration; `paths` by their keys, those that are missing become comments; views if not all are used."""
    told = {key: tomli_w.dumps({key: path}).strip() for key, path in paths.items()}
    rig_line = told.get("rig", '# rig = "Calib.toml"                    # missing: the calibration of the cameras')
    images = "{frame}" in paths["path"]
    names = "the camera's name in the calibration"
    use = 'use = "images"' if images else 'use = "video"'
    frame = " and {frame} the number of the image" if images else ""
    rate = "# fps = 25.0              # missing: images do not tell how many there are a second\n" if images else ""
    chosen = f"views = {json.dumps(views, ensure_ascii=False)}\n" if views else ""
    plate_line = told.get("background", '# background = "background/{view}.png"  # clean plates; else of the recording')
    return f"""\
# Written by `bodytrack init`. `bodytrack run THIS --dry-run` checks it; `bodytrack show jobs` lists what else there is.
{tomli_w.dumps({"name": name}).strip()}
# "human" bends its spine, "gavrila22" is rigid and quicker. The stature scales it: measure it, with shoes.
persons = [{{ name = "person1", model = "human", stature_m = 1.75 }}]

[reading]
{use}
{told["path"]}   # {{view}} is {names}{frame}
{rate}{rig_line}
{chosen}{plate_line}
# start = 0                 # first frame: one in which everybody stands apart, arms away from the body
# downscale = 2             # images are averaged until persons are some 300 px high, or enlarged (0.5); 1: as is

# smoothing = "rts" above the first section takes away jitter at the end.

[recordings]
overlay = true              # the model over all views; false saves time
# trc = true                # or c3d, osim, mot, bvh, glb, wide_table, isb_angles; also later: `bodytrack export`
"""
