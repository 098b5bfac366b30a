"""Recognition of movements: other persons than the library's, disturbed performances, long recordings, room videos."""

from __future__ import annotations

import os
import time
from pathlib import Path

import numpy as np
import tomli_w
from rich.console import Console
from rich.table import Table

from benchmarks.motion_files import read_cmu
from benchmarks.performances import (
    DISTURBED,
    Performance,
    everyday_persons,
    other_bodies,
    other_persons,
    performers,
)
from benchmarks.recorded import recorded
from tracker.foundation.arrays import Array32
from tracker.results.evaluation.joints import read_joints
from tracker.results.recognition import JOINTS, RATE_HZ, Course, course, course_of
from tracker.results.recognition.library import Library, load_library
from tracker.results.recognition.matching import Recognized, recognize, timeline
from tracker.results.result import load_result
from tracker.running.jobs import execute, load_job

# What rendered persons of BODYTRACK_DATA/room do; no entry of the library is made of these pictures, and those of
# N-WalkCircle, N-Stride, D-TwoElbowRot and R-Turn move otherwise than any of them.
_ROOM = {
    "N-WalkCircle": "walk",
    "N-Stride": "walk",
    "D-TwoElbowRot": "two_elbow_rotation",
    "R-Turn": "turn",
    "K-Kick": "kick",
    "T-Punch-light": "punch",
    "V-Dance": "dance",
    "P-Floor": "get_up_from_front",
}
_NONE = "nothing known"


def compare(console: Console, tracked: bool, quick: bool) -> None:
    """Prints confusion tables, false alarms, and how far beginnings and ends are off.

    Args:
        console: where tables go.
        tracked: whether the videos of rooms are tracked, too; else their true joints stand for them.
        quick: few performances.
    """
    library = load_library(())
    if "BODYTRACK_DATA" not in os.environ:
        console.print("BODYTRACK_DATA is not set: no movements of other persons to recognize")
        return
    motions = Path(os.environ["BODYTRACK_DATA"]) / "motions" / "cmu"
    asked = [*other_persons(motions), *other_bodies(quick), *everyday_persons(quick)]
    asked += performers(library, 1 if quick else 5)
    begin = time.process_time()
    answers = [(one, _named(one.course, recognize(one.course, library))) for one in asked]
    seconds = time.process_time() - begin
    for group in dict.fromkeys(one.group for one in asked):
        _print_confusion(console, group, [(one.movement, found) for one, found in answers if one.group == group])
    strange = [one.movement == found for one, found in answers if one.group != DISTURBED]
    right = sum(strange), sum(one.movement == found for one, found in answers)
    console.print(
        f"of other persons and bodies {right[0]} of {len(strange)} right ({100 * right[0] / len(strange):.1f} %), "
        f"of all {right[1]} of {len(answers)} ({100 * right[1] / len(answers):.1f} %)",
        highlight=False,
    )
    length = sum(one.course.seconds for one in asked)
    console.print(
        f"{len(library.movements)} movements; {1000 * seconds / length:.1f} ms CPU a second of movement",
        highlight=False,
    )
    _print_false_alarms(console, library, motions)
    _print_ends(console, library, asked, 3 if quick else 20)
    _print_rooms(console, library, tracked, quick)


def _named(asked: Course, found: tuple[Recognized, ...]) -> str:
    """The movement that fills most of a course; nothing, if none fills half of it."""
    shares: dict[str, float] = {}
    for one in found:
        shares[one.movement] = shares.get(one.movement, 0.0) + one.end_s - one.start_s + 1 / RATE_HZ
    best = max(shares, key=lambda name: shares[name], default="")
    return best if best and shares[best] > 0.5 * asked.seconds else _NONE


def _print_confusion(console: Console, group: str, answers: list[tuple[str, str]]) -> None:
    right = sum(asked == found for asked, found in answers)
    title = f"{group}: {right} of {len(answers)} right, {100 * right / len(answers):.1f} %"
    table = Table("movement", "performances", "right", "taken for", title=title, title_justify="left")
    for movement in dict.fromkeys(asked for asked, _ in answers):
        found = [answer for asked, answer in answers if asked == movement]
        others = {name: found.count(name) for name in dict.fromkeys(found) if name != movement}
        told = ", ".join(f"{name} {count}" for name, count in others.items())
        table.add_row(movement, str(len(found)), str(found.count(movement)), told)
    console.print(table)


def _print_false_alarms(console: Console, library: Library, folder: Path) -> None:
    """What is claimed of a dance and a martial artist that the library does not have."""
    for name in ("131_04-dance", "135_06-martialArts"):
        motion = read_cmu(folder / f"{name}.amc")
        asked = course(motion.times_s, motion.joints)
        found = ", ".join(f"{one.movement} {one.start_s:.1f}-{one.end_s:.1f} s" for one in recognize(asked, library))
        console.print(f"{name}, {asked.seconds:.0f} s: {found or _NONE}", highlight=False)


def _print_ends(console: Console, library: Library, asked: list[Performance], n: int) -> None:
    """Beginnings and ends in recordings of four movements, each turned into the next one within a third of a second."""
    rng = np.random.default_rng(1)
    errors, missed, added = [], 0, 0
    for _ in range(n):
        chosen = [asked[k] for k in rng.permutation(len(asked))[:4]]
        joined, ends = _chained([one.course for one in chosen])
        found = recognize(joined, library)
        right = set()
        for one, (start, end) in zip(chosen, ends, strict=True):
            best = max(found, key=lambda it: min(it.end_s, end) - max(it.start_s, start), default=None)
            if best is None or best.movement != one.movement or min(best.end_s, end) - max(best.start_s, start) <= 0:
                missed += 1
                continue
            right.add(best)
            errors += [abs(best.start_s - start), abs(best.end_s - end)]
        added += len(set(found) - right)
    middle, most = np.percentile(errors, [50, 90])
    console.print(
        f"{n} recordings of four movements each: {4 * n - missed} of {4 * n} found, {added} more told; beginnings and "
        f"ends off by {middle:.2f} s in the middle, 90 % within {most:.2f} s",
        highlight=False,
    )


def _chained(courses: list[Course]) -> tuple[Course, list[tuple[float, float]]]:
    pieces: list[Array32] = []
    ends: list[tuple[float, float]] = []
    length = 0
    for k, one in enumerate(courses):
        if k:
            share = np.linspace(0, 1, round(RATE_HZ / 3), endpoint=False)[1:, None, None]
            seam = (1 - share) * pieces[-1][-1] + share * one.directions[0]
            pieces.append(seam / np.linalg.norm(seam, axis=-1, keepdims=True))
            length += len(seam)
        pieces.append(one.directions)
        ends.append((length / RATE_HZ, (length + len(one.directions) - 1) / RATE_HZ))
        length += len(one.directions)
    directions = np.concatenate(pieces).astype(np.float32)
    return Course(0.0, directions, np.ones(length, dtype=np.bool_)), ends


def _print_rooms(console: Console, library: Library, tracked: bool, quick: bool) -> None:
    rooms = Path(os.environ["BODYTRACK_DATA"]) / "room"
    what = "tracked with `human` scaled" if tracked else "true joints"
    table = Table(
        "recording",
        "movement",
        "recognized",
        "next best",
        title=f"rendered persons in rooms, {what}",
        title_justify="left",
    )
    for name, movement in list(_ROOM.items())[: 1 if quick else None]:
        asked = _tracked(rooms / name) if tracked else _true(rooms / name)
        found = recognize(asked, library)
        told = [
            f"{one.what} {one.start_s:.1f}-{one.end_s:.1f} s"
            + (f" ({one.recognized.angle_deg:.0f} deg, misfit {one.recognized.misfit:.2f})" if one.recognized else "")
            for one in timeline(asked, found)
        ]
        seconds = [f"{one.second} {one.second_deg:.1f}" if one.second else "none" for one in found]
        table.add_row(name, movement, "\n".join(told), "\n".join(seconds))
    console.print(table)


def _true(folder: Path) -> Course:
    frames = next(iter(read_joints(folder / "gt_joints.csv").persons.values()))
    names = [joint.replace("left_", "l_").replace("right_", "r_") for joint in JOINTS]
    joints = np.array([[frames[t][name] for name in names] for t in sorted(frames)])
    return course(np.array(sorted(frames)) / 25.0, joints)


def _tracked(folder: Path) -> Course:
    """Tracks a recording, or takes the result of an earlier call."""
    output = (Path("results") / "recognition" / folder.name).resolve()
    if not (output / "run.json").is_file():
        config = output.parent / f"{folder.name}.toml"
        output.parent.mkdir(parents=True, exist_ok=True)
        one = next(one for one in recorded(folder.parent)[0] if one.name == folder.name)
        persons = [{"name": name, "model": "human", "stature_m": stature} for name, stature in one.statures_m.items()]
        chosen = {"overlay": False, "plots": False, "report": False}
        table = {"name": folder.name, "persons": persons, "reading": one.reading | one.plates, "recordings": chosen}
        config.write_text(tomli_w.dumps(table), encoding="utf-8")
        execute(load_job("track", config), output)
    track = load_result(output).persons[0]
    return course_of(track.body, track.times_s, track.poses)
