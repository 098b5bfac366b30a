"""The benchmarks run, in a form too small to measure anything, and print their columns."""

from __future__ import annotations

import csv
import importlib
import json
import os
import pickle
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import asdict, replace
from functools import partial
from itertools import islice
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from rich.console import Console
from typer.testing import CliRunner

from tracker.synthesis.simulation.sequence import Recipe, write_sequence
from tracker.tracking.estimation.best_first import BestFirstEstimation
from tracker.tracking.estimation.twist_icp import TwistIcpEstimation
from tracker.tracking.initialization.pca import PcaInitialization

ROOT = Path(__file__).parents[1]


def benchmark(*arguments: str, **variables: str) -> str:
    """What the script prints, in a process of its own."""
    command = [sys.executable, "scripts/benchmark.py", *arguments, "--quick"]
    environment = {**os.environ, **variables}
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=False, env=environment)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture
def benchmark_here(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., str]]:
    """What the script prints, run in this process, which has imported what it needs: three seconds otherwise."""
    monkeypatch.syspath_prepend(ROOT / "scripts")
    app, n_threads = importlib.import_module("benchmark").app, cv2.getNumThreads()
    # the tests that follow are not to wait for others
    monkeypatch.setattr(os, "nice", lambda by: by)

    def run(*arguments: str) -> str:
        done = CliRunner().invoke(app, [*arguments, "--quick"])
        assert done.exit_code == 0, done.output
        return done.output

    yield run
    cv2.setNumThreads(n_threads)


class Here:
    """A pool of processes whose work is done in this one; what they would be sent is pickled all the same."""

    def __init__(self, *_: object) -> None:
        pass

    def __enter__(self) -> Here:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def submit(self, work: Callable[..., object], *arguments: object) -> SimpleNamespace:
        there, sent = pickle.loads(pickle.dumps((work, arguments)))
        return SimpleNamespace(result=lambda: pickle.loads(pickle.dumps(there(*sent))))


def smaller(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Makes benchmarks do less of the same than their --quick does."""
    # a start is not asked for limbs elsewhere, which takes longer than the rest of it
    monkeypatch.setattr("tracker.tracking.cycle_turn.in_likeliest_places", lambda objective, estimate, *_: estimate)
    if name == "tracking":
        tracking = importlib.import_module("benchmarks.tracking")
        refined = {"estimation": TwistIcpEstimation()}
        usual, floor = tracking.default_cycle, tracking._floor
        monkeypatch.setattr(tracking, "default_cycle", lambda *asked: replace(usual(*asked), **refined))
        monkeypatch.setattr(tracking, "_floor", lambda *asked: floor(*asked, repeats=1))
    if name == "whole_runs":
        runs = importlib.import_module("benchmarks.whole_runs")
        monkeypatch.setattr(runs, "_simulated", lambda folder, n_frames, made=runs._simulated: made(folder, 2))
    if name == "recognition":
        recognition = importlib.import_module("benchmarks.recognition")
        chained = recognition._print_ends
        first = {"performers": (0, 40, 5), "other_persons": (2,), "other_bodies": (2,), "everyday_persons": (4,)}
        for asked_of, which in first.items():
            every = getattr(recognition, asked_of)
            some = partial(lambda every, which, *asked: islice(every(*asked), *which), every, which)
            monkeypatch.setattr(recognition, asked_of, some)
        monkeypatch.setattr(recognition, "_print_ends", lambda *asked: chained(*asked[:-1], 1))
    if name == "poses":
        poses = importlib.import_module("benchmarks.poses")
        monkeypatch.setattr(poses, "_situation", lambda size, n_poses, made=poses._situation: made((160, 120), 2))
    if name == "starts":
        starts = importlib.import_module("benchmarks.starts")
        coarse = BestFirstEstimation(range_deg=20.0, step_deg=20.0, range_m=0.1, step_m=0.1, halvings=0, patience=1)
        start = PcaInitialization(hypotheses=1, finalists=2, turn_step_deg=90.0, coarse_deg={}, fine=coarse)
        monkeypatch.setattr(starts, "PcaInitialization", lambda **_: start)
        monkeypatch.setattr(starts, "HybridEstimation", lambda **_: TwistIcpEstimation())
        monkeypatch.setattr(starts, "_N_POSES", 4)
    if name == "sizes":
        sizes = importlib.import_module("benchmarks.sizes")
        monkeypatch.setattr(sizes, "ProcessPoolExecutor", Here)
        monkeypatch.setattr(sizes, "_RENDERED", 2)


@pytest.mark.parametrize(
    ("arguments", "words", "n_rows"),
    [
        (("poses",), ("1 thread", "to rasterizing", "to pyrender", "2 threads", "cpu"), 2),
        (("skins",), ("rasterizing it", "contours of it, smooth", "contours of its superquadrics", "CPU ms a pose"), 5),
        (("tracking",), ("decode alone", "observation", "other", "floor", "ratio", "frames/s", "hinge RMS deg"), 4),
        (("refinements",), ("step by step ms", "compiled ms", "to step by step", "poses apart"), 2),
        (("whole_runs",), ("opening", "body, fit", "writing", "floor", "times", "peak GiB"), 1),
        (("starts",), ("a loop", "threads", "wall s", "same pose", "yes", "still parts once", "rasterized"), 2),
        (("robustness", "--only", "missing"), ("lost", "longest loss", "joints 95 % mm", "verdict", "tracked"), 1),
        (("robustness", "--only", "start 5"), ("< 20 mm in 10 frames", "flagged lost", "silently wrong"), 1),
        (("lsm",), ("inverse-compositional", "findTransformECC", "RMS px", "real error over predicted sigma"), 30),
        (("segmentation",), ("to grabCut", "IoU", "threshold dynamics", "the paper's way"), 6),
        (("sizes",), ("views", "persons", "ms/frame", "last/first quarter", "+MiB", "lost"), 2),
        (("sigma",), ("rendered RMS ratio", "noise robust", "torso_x", "all arm angles", "aim 0.7 to 1.5"), 27),
        (("calibration",), ("three in line", "four around", "3 of 3", "hold-out bar RMS mm", "error / sigma"), 4),
    ],
)
def test_benchmarks_print_their_columns(
    arguments: tuple[str, ...],
    words: tuple[str, ...],
    n_rows: int,
    benchmark_here: Callable[..., str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """In this process; as a script they run below."""
    smaller(arguments[0], monkeypatch)
    printed = benchmark_here(*arguments)
    for word in words:
        assert word in printed
    assert len(re.findall("^│", printed, re.MULTILINE)) >= n_rows
    if arguments[0] == "starts":
        assert "NO" not in printed  # the same pose, whichever way it is made
    if arguments[0] in ("poses", "refinements", "skins", "tracking", "starts", "lsm", "segmentation"):
        # Every speed stands beside its reference.
        assert re.search(r" \d[\d.]*x ", printed)


def test_recognition_prints_its_columns(
    data: Callable[[str], Path], benchmark_here: Callable[..., str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("BODYTRACK_DATA", str(data("motions").parent))
    smaller("recognition", monkeypatch)
    printed = benchmark_here("recognition")
    for word in ("nobody of whom is in", "walk", "taken for", "true joints"):
        assert word in printed
    assert len(re.findall("^│", printed, re.MULTILINE)) >= 10


def test_following_prints_its_columns(
    data: Callable[[str], Path], benchmark_here: Callable[..., str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("BODYTRACK_DATA", str(data("closerange").parent))
    printed = benchmark_here("follow", "--only", "shirt")
    for word in ("key patches", "error / sigma", "the paper", "Lucas-Kanade's median error / ours", ">= 3"):
        assert word in printed
    assert len(re.findall("^│", printed, re.MULTILINE)) >= 8


def test_a_robot_is_tracked_in_both_ways(benchmark_here: Callable[..., str], tmp_path: Path) -> None:
    bar = '<visual><origin xyz="0 0 0.2"/><geometry><box size="{0} {0} 0.4"/></geometry></visual>'
    links = [f'<link name="{name}">{bar.format(width)}</link>' for name, width in (("post", 0.12), ("arm", 0.08))]
    joint = (
        '<joint name="lift" type="revolute"><parent link="post"/><child link="arm"/><origin xyz="0 0 0.4"/>'
        '<axis xyz="1 0 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
    )
    file = tmp_path / "crane.urdf"
    file.write_text(f'<robot name="crane">{"".join(links)}{joint}</robot>')
    rows = [line.split("│") for line in benchmark_here("robots", str(file)).splitlines() if line.startswith("│")]
    ways = {(row[2].strip(), row[3].strip()): row for row in rows}
    assert len(ways) == 2 * 3
    assert float(ways["25", "ours"][6]) < 2 > float(ways["25", "as M3T"][6])


def test_settings_for_skin_measure_five_times_as_many_points(
    data: Callable[[str], Path], benchmark_here: Callable[..., str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("BODYTRACK_DATA", str(data("closerange").parent))
    rows = [line.split("│") for line in benchmark_here("surface", "--only", "skin").splitlines() if "skin.toml" in line]
    (_, frame, _, _, times, _, median, *_), *others = rows
    assert not others
    assert frame.strip() == "0"
    assert float(times) >= 5
    assert float(median) <= 0.5


@pytest.mark.parametrize("name", ["recognition", "follow"])
def test_what_benchmarks_lack_is_said(
    name: str, benchmark_here: Callable[..., str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("BODYTRACK_DATA", raising=False)
    assert "BODYTRACK_DATA is not set" in benchmark_here(name)


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of recordings: one that describes itself, one that does not say who is seen."""
    root = tmp_path_factory.mktemp("recordings")
    write_sequence(
        Recipe("arm_swing", seconds=0.24, size=(360, 288)), root / "room" / "swing", lambda what, done, total: None
    )
    meta = {"people": [{"id": "person1", "subject": "anna", "height_m": 1.8}]}
    (root / "room" / "swing" / "meta.json").write_text(json.dumps(meta), encoding="utf-8")
    poses = (root / "room" / "swing" / "truth_poses.csv").read_text()
    (root / "start.csv").write_text(poses.replace("person1", "anna"))
    (root / "nobody").mkdir()
    (root / "nobody" / "gt_joints.csv").write_text("frame,joint,x,y,z\n0,neck,0,0,1.5\n", encoding="utf-8")
    return root


def test_recordings_are_found_run_once_and_scored(
    recordings: Path, tmp_path: Path, benchmark_here: Callable[..., str], monkeypatch: pytest.MonkeyPatch
) -> None:
    given = "passes=1", "persons.0.shape=model", "reading.downscale=1", "evidence=contours"
    start = "initialization.use=given", f"initialization.poses={recordings / 'start.csv'}"
    settings = [word for setting in (*given, *start) for word in ("--set", setting)]
    arguments = "recordings", "--models", "gavrila22", "--starts", "2", *settings, "--output", str(tmp_path)
    printed = benchmark(*arguments, BODYTRACK_DATA=str(recordings))
    assert "nobody: a truth, but neither meta.json" in printed
    for word in ("joints mm", "offsets removed", "swing", "gavrila22", "0 1", "false flags", "CPU ms a frame"):
        assert word in printed
    with (tmp_path / "scores.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(row["person"], row["start"], row["failed"]) for row in rows] == [("anna", "0", ""), ("anna", "1", "")]
    assert "how often starts are right" in printed
    for row in rows:
        assert float(row["start_mm"]) <= float(row["start_farthest_mm"]) < 150
        assert 0 <= float(row["confidence"]) <= 1
        # the model is the simulation's own
        assert 0 < float(row["removed_mm"]) <= float(row["mean_mm"]) < 60
        assert float(row["cpu_s"]) > 0.01
    assert (tmp_path / "scores.png").stat().st_size > 1000
    before = (tmp_path / "scores.csv").read_text()
    monkeypatch.setenv("BODYTRACK_DATA", str(recordings))
    assert "2 of 2: swing" in benchmark_here(*arguments)
    assert (tmp_path / "scores.csv").read_text() == before


def test_scores_of_several_runs_are_one_picture(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A column for each kind of evidence; a cell tells the worst start, and whether anything was off in silence."""
    monkeypatch.syspath_prepend(ROOT / "scripts")
    scores = importlib.import_module("benchmarks.scores")
    pictures = importlib.import_module("benchmarks.scores_picture")
    drawn: list[tuple[int, int, str, str]] = []
    monkeypatch.setattr(pictures, "_draw_cell", lambda _, x, y, group: drawn.append((x, y, *pictures.worst_of(group))))
    row = scores.Score("swing", "anna", "human", False, True, "", 0, 9, "c0de", "c0mm1t", n_frames=9)
    rows = [
        replace(row, mean_mm=99, removed_mm=99, code="old"),
        replace(row, mean_mm=20, removed_mm=9, limb_off=3, limb_off_flagged=2),
        replace(row, start=1, mean_mm=19, removed_mm=11, lost=2),
        replace(row, person="", plates=False, failed="nobody was found"),
        replace(row, acquired=True, mean_mm=18, removed_mm=7, false_flags=4),
        replace(row, settings="passes=1", mean_mm=17, removed_mm=6),
    ]
    pictures.draw(rows, tmp_path / "scores.png")
    assert sorted(drawn) == [
        (0, 0, "20 (11)  x2", "3 of 18 off, 2 flagged; 2 lost"),
        (1, 0, "17 (6)", "none of 9 off"),
        (2, 0, "18 (7)", "none of 9 off; 4 false"),
        (3, 0, "failed", ""),
    ]
    app = importlib.import_module("benchmark").app
    done = CliRunner().invoke(app, ["scores", str(tmp_path), "--picture", str(tmp_path / "none.png")])
    assert done.exit_code == 2
    assert "no scores to draw" in done.output
    assert not (tmp_path / "none.png").exists()


def test_starts_are_counted_by_how_sure_they_were(monkeypatch: pytest.MonkeyPatch) -> None:
    """Wrong on average or by a joint alone; neither what is unknown nor runs made again count twice."""
    monkeypatch.syspath_prepend(ROOT / "scripts")
    scores, starts = (importlib.import_module(f"benchmarks.{name}") for name in ("scores", "start_scores"))
    row = scores.Score("swing", "anna", "human", False, True, "", 0, 9, "c0de", "c0mm1t", n_frames=9)
    found = [(0.3, 120, 400), (0.49, 20, 40), (0.5, 20, 40), (0.9, 40, 160), (0.91, 20, 40), (1.0, 20, 151)]
    rows = [replace(row, start=9, lost=9)]  # lost in the frame that it was found in: nothing to compare
    for k, (sure, mean_mm, farthest_mm) in enumerate(found):
        rows.append(replace(row, start=k, confidence=sure, start_mm=mean_mm, start_farthest_mm=farthest_mm))
    rows.insert(0, replace(rows[1], code="old", start_mm=500))
    console = Console(width=120, record=True)
    starts.print_starts(console, rows)
    cells = [re.split(r"\s*│\s*", line)[1:-1] for line in console.export_text().splitlines() if line.startswith("│")]
    assert cells == [
        ["< 0.5", "2", "1", "1", "50", ">= 50"],
        ["0.5 to 0.9", "2", "0", "1", "50", ""],
        ["> 0.9", "2", "0", "1", "50", "<= 2"],
    ]
    starts.print_starts(console, [row])
    assert console.export_text() == ""


def test_scores_of_an_earlier_version_are_kept(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.syspath_prepend(ROOT / "scripts")
    scores = importlib.import_module("benchmarks.scores")
    row = scores.Score("swing", "anna", "human", False, True, "", 0, 9, "c0de", "c0mm1t", n_frames=9)
    before, after = replace(row, mean_mm=20.0, confidence=0.9), replace(row, start=1, start_mm=19.0)
    table = tmp_path / "scores.csv"
    assert scores.read_scores(table) == []
    columns = [name for name in asdict(row) if not name.startswith("start_")]
    with table.open("w", newline="") as file:
        writer = csv.DictWriter(file, columns, extrasaction="ignore")
        writer.writeheader()
        writer.writerow(asdict(before))
    scores.add_scores(table, [after])
    scores.add_scores(table, [after])
    # by their words, for what is unknown equals nothing
    assert list(map(str, scores.read_scores(table))) == list(map(str, [before, after, after]))


def test_a_start_that_lost_the_person_throughout_is_not_left_out(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.syspath_prepend(ROOT / "scripts")
    scores, pictures, tables = (
        importlib.import_module(f"benchmarks.{name}") for name in ("scores", "scores_picture", "recordings")
    )
    row = scores.Score("swing", "anna", "human", False, True, "", 0, 9, "c0de", "c0mm1t", n_frames=9)
    found = replace(row, start=1, mean_mm=19, removed_mm=11, turned_mm=10, under_100=1.0)
    gone = replace(row, lost=9, under_100=0.0)
    for group in ([gone, found], [found, gone]):
        assert tables._cells(group, tables._ERRORS)[:5] == ["19 / lost", "11 / lost", "10 / lost", "50 / 0", "-"]
        assert pictures.worst_of(group) == ("lost  x2", "none of 9 off; 9 lost")
        pictures.draw(group, tmp_path / "scores.png")
    assert tables._cells([gone], tables._ERRORS)[0] == "lost"
    assert pictures.worst_of([gone]) == ("lost", "9 lost")


def test_a_verdict_tells_of_a_limb_that_stays_off(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(ROOT / "scripts")
    verdict = importlib.import_module("benchmarks.robustness").verdict
    none = np.zeros(20, bool)
    for n_lost, n_off, words in (
        (0, 0, "tracked"),
        (0, 6, "[yellow]tracked, a limb off in 6 frames[/]"),
        (3, 0, "recovered in 3 frames"),
        (3, 6, "[yellow]recovered in 3 frames, a limb off in 6 others[/]"),
    ):
        errors = np.zeros((20, 5))
        errors[10 : 10 + n_off, 0] = 200.0
        assert verdict(SimpleNamespace(lost=np.arange(20) < n_lost, wrong=none, joints_mm=errors)) == words


def test_what_fails_is_a_row_that_says_so(
    recordings: Path, tmp_path: Path, benchmark_here: Callable[..., str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("BODYTRACK_DATA", str(recordings))
    arguments = "recordings", "--models", "gavrila22", "--starts", "1", "--output", str(tmp_path)
    printed = benchmark_here(*arguments, "--set", "estimation.stepp=3")
    assert re.search("swing.* failed ", printed)
    assert 'unknown key "stepp"' in printed


def test_a_scanned_recording_is_run_as_its_configuration_says(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """With the scan's model, made once, and the start given; every way changes what is to be compared alone."""
    monkeypatch.syspath_prepend(ROOT / "scripts")
    ways = importlib.import_module("benchmarks.ways")
    asked: list[list[str]] = []

    def run(arguments: list[str], folder: Path) -> str:
        asked.append(arguments)
        Path(arguments[-1]).write_text("a model")
        return ""

    recording, code = SimpleNamespace(name="R-UpperBody"), SimpleNamespace(run=run)
    for n_frames in (30, 4):
        table = ways._described(recording, n_frames, code, tmp_path)
        assert (table["reading"]["start"], table["reading"]["stop"], table["passes"]) == (0, n_frames, 1)
        assert Path(table["persons"][0]["model"]).read_text() == "a model"
        assert Path(table["initialization"]["poses"]).is_file()
        assert [one["use"] for one in table["evidence"]["of"]] == ["contours", "regions", "departures", "motion"]
    assert [Path(arguments[1]).is_file() for arguments in asked] == [True]
    failing = SimpleNamespace(run=lambda arguments, folder: "no such scan")
    assert ways._described(recording, 4, failing, tmp_path / "other") == "no model: no such scan"
    assert set(ways.RECORDINGS) == {"D-TwoElbowRot", "R-UpperBody", "R-Turn", "balancing"}
