"""What a run has found in its input stays told: when it is resumed, and beside poses that were changed afterwards."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from motions import made_up

from tracker.results.recording.run_json import RunJson
from tracker.results.result import load_result
from tracker.results.smoothed_result import write_smoothed
from tracker.results.smoothing.rts import RauchTungStriebel
from tracker.running.jobs import execute, load_job
from tracker.running.programs import export
from tracker.synthesis.simulation.sequence import Recipe, write_sequence

EXCHANGED = "the videos of FRONT and BACK are exchanged"


def told(folder: Path) -> dict[str, object]:
    return json.loads((folder / "run.json").read_text(encoding="utf-8"))


def test_a_resumed_run_tells_what_it_has_found_before(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen = SimpleNamespace(delays=SimpleNamespace(told=np.ones(4, dtype=np.bool_)))
    monkeypatch.setattr("tracker.running.jobs._messages.survey", lambda *_: seen)
    monkeypatch.setattr("tracker.running.jobs._messages.other_colours", lambda _: "")
    monkeypatch.setattr("tracker.running.jobs.track.found_in", lambda _: (EXCHANGED,))
    late = "view BACK is late"  # told again at every end
    monkeypatch.setattr("tracker.running.jobs._record.Tracks.told", lambda *_: (late,))
    config = write_sequence(Recipe("arm_swing", seconds=0.16, size=(256, 208)), tmp_path / "sequence")
    start = ["initialization.use=given", "initialization.poses=truth_poses.csv", "passes=1"]
    start += ["reading.in_step=off"]
    job = load_job("track", config, [*start, 'recordings=["run_json","journal","report"]'])

    def interrupt(what: str, done: int = 0, total: int = 0, detail: str = "") -> None:
        if what == "tracking" and done == 2:
            raise KeyboardInterrupt

    folder = tmp_path / "out"
    execute(job, folder, progress=interrupt)
    assert told(folder)["findings"] == [EXCHANGED]
    starts = told(folder)["summary"]["starts"]
    assert starts == {"person1": {"frame": 0, "confidence": pytest.approx(0.5, abs=0.5)}}
    for _ in range(2):
        assert execute(job, folder, resume=True).n_frames == 4
        assert told(folder)["findings"] == [EXCHANGED, late]
        assert told(folder)["summary"]["starts"] == starts
        assert EXCHANGED in (folder / "report.html").read_text(encoding="utf-8")


def test_a_changed_result_tells_what_the_raw_one_does(tmp_path: Path) -> None:
    movement = made_up("gavrila22")
    steps = [replace(step, strangers=True, untrusted={1: "dark"}) for step in movement.steps]
    raw = load_result(replace(movement, steps=steps).result(tmp_path / "raw"))
    known = {"findings": [EXCHANGED], "bodies": {"person1": "as modelled"}, "images": {"gain": 2.5}}
    folder = write_smoothed(replace(raw, details={**raw.details, **known}), RauchTungStriebel())
    export(folder, [RunJson()], tmp_path / "exported")
    for found in (told(folder), told(tmp_path / "exported")):
        assert {key: found[key] for key in known} == known
        counts = found["summary"]
        assert counts == {**counts, **{key: raw.details["summary"][key] for key in counts if "frames_with" in key}}
        assert counts["frames_with_strangers"] == len(steps)
    smooth = load_result(folder)
    assert all(replay.strangers and replay.untrusted == {1: "dark"} for replay in smooth.replays)
