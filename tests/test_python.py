"""What programs use: results that are loaded, runs that are iterated, and the page that tells of both."""

from __future__ import annotations

import csv
import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from motions import LOST, N_FRAMES, made_up

import tracker
from tracker.foundation.errors import ConfigError, ModelError
from tracker.foundation.progress import shown, silent
from tracker.results.recording.csv_table import CsvTable
from tracker.results.recording.wide_table import WideTable
from tracker.running import programs
from tracker.running.commands.result import FORMATS
from tracker.running.jobs import execute, load_job
from tracker.synthesis.simulation.sequence import Recipe, write_sequence

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "python.md").read_text()


@pytest.fixture(scope="module")
def recording(tmp_path_factory) -> Path:
    """A folder with `run.toml`, tracked into `results/my_run/latest`."""
    folder = tmp_path_factory.mktemp("python")
    config = write_sequence(Recipe("arm_swing", seconds=0.16, size=(360, 288)), folder / "sequence")
    text = config.read_text() + '\n[initialization]\nuse = "given"\nposes = "truth_poses.csv"\n'
    (folder / "sequence" / "run.toml").write_text(text)
    execute(load_job("track", folder / "sequence" / "run.toml"), folder / "sequence" / "results/my_run/latest")
    return folder / "sequence"


def read(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_the_page_runs(recording, monkeypatch, capsys):
    monkeypatch.chdir(recording)
    blocks = re.findall(r"```python\n(.*?)```", PAGE, flags=re.DOTALL)
    assert len(blocks) == 7
    names = {}
    exec(compile("\n".join(blocks), "docs/python.md", "exec"), names)
    assert names["flexion_deg"].shape == names["speed"].shape == (4,)
    assert names["good"].sum() == 3  # the first frame is bootstrapped
    size = np.array(names["result"].rig.cameras[0].size)
    assert ((names["pixels"] > 0) & (names["pixels"] < size)).all()
    told = capsys.readouterr().out.splitlines()
    assert told[0] == "['frame', 'time_s', 'status', 'torso_x_deg']".replace("_deg", "_m")
    assert [line.split()[0] for line in told[1:4]] == ["0", "1", "2"]
    assert told[4:] == [f"{names['errors'].mean_mm:.0f} mm"]
    assert names["errors"].mean_mm < 30
    assert sorted(path.name for path in Path("results/my_run/latest/smoothed/exports").iterdir()) == [
        "person1.glb",
        "person1.trc",
    ]
    sigma_mm, worst_mm = names["filmed"].expected.joints_mm["left_wrist"]
    assert 0 < sigma_mm <= worst_mm < 100
    assert len(names["again"]) == 3
    assert {"truth_joints.csv", "truth_poses.csv"} <= {path.name for path in names["filmed"].config.parent.iterdir()}


def test_an_iterated_run_finds_what_an_executed_one_wrote(recording):
    """To the last bit, and again when it is iterated again."""
    wanted = tracker.load_result(recording / "results/my_run/latest")
    run = tracker.load_run(recording / "run.toml")
    assert len(run) == 4
    for _ in range(2):
        steps = list(run)
        np.testing.assert_array_equal([step.estimates[0].q for step in steps], wanted.persons[0].poses)
        assert [step.frame.time_s for step in steps] == list(wanted.times_s)
    again = tracker.load_run(recording / "run.toml", ["reading.stop=2"]).execute(recording / "short")
    np.testing.assert_array_equal(again.persons[0].poses, wanted.persons[0].poses[:2])
    assert again.frames.tolist() == [0, 1]


def test_a_result_is_what_its_tables_say(tmp_path):
    movement = made_up("human", "quadruped")
    result = tracker.load_result(movement.result(tmp_path))
    movement.record(CsvTable(), tmp_path)
    poses, sigmas, joints = (read(tmp_path / name) for name in ("poses.csv", "sigmas.csv", "joints.csv"))
    assert (result.name, result.fps, list(result.bodies)) == ("made_up", 25.0, ["person1", "person2"])
    for person in result.persons:
        table = person.columns()
        assert {len(column) for column in table.values()} == {N_FRAMES}
        for rows, infix in ((poses, ""), (sigmas, "_sigma")):
            mine = [row for row in rows if row["person"] == person.name]
            assert [int(row["frame"]) for row in mine] == list(person.frames)
            assert tuple(row["status"] for row in mine) == person.statuses
            for parameter in person.body.parameters:
                found = table[f"{parameter.name}{infix}_{parameter.unit}"]
                wanted = [float(row[parameter.column] or "nan") for row in mine]
                np.testing.assert_allclose(found, wanted, atol=1e-5)
        mine = [row for row in joints if row["person"] == person.name]
        wanted = [[float(row[f"{axis}_m"] or "nan") for axis in "xyz"] for row in mine]
        np.testing.assert_allclose(person.joints.reshape(-1, 3), wanted, atol=1e-5)
        assert [row["joint"] for row in mine[: len(person.joint_names)]] == list(person.joint_names)
        assert [row["status"] for row in mine] == [one for frame in person.joint_statuses for one in frame]
    lost = result.person("person1")
    assert np.isnan(lost.poses[LOST]).all()
    assert np.isnan(lost.joints[LOST]).all()
    assert np.isnan(lost.covariances[LOST]).all()
    assert np.isfinite(np.delete(lost.joints, np.r_[LOST], axis=0)).all()


def test_wrong_names_are_answered_with_the_nearest(tmp_path):
    result = tracker.load_result(made_up("gavrila22").result(tmp_path))
    assert len(repr(result)) + len(repr(result.persons[0])) < 400
    with pytest.raises(ConfigError, match='no person is called "person"; did you mean "person1"'):
        result.person("person")
    with pytest.raises(ConfigError, match='no joint "left_elbo"; did you mean "left_elbow"'):
        result.persons[0].joint("left_elbo")
    with pytest.raises(ModelError, match="did you mean"):
        result.persons[0].parameter("left_arm_extensio")
    with pytest.raises(ConfigError, match="expected the folder of a run"):
        tracker.load_result(tmp_path / "nowhere")
    with pytest.raises(AttributeError, match="load_results"):
        tracker.load_results  # noqa: B018


def test_the_package_shows_its_public_names_and_the_page_tells_since_when():
    """Nothing else: no module, no import of its own."""
    assert set(dir(tracker)) == {*tracker._OFFERED, "__version__"}
    rows = re.findall(r"^\| (.+) \| (\d+\.\d+) \|$", PAGE, flags=re.MULTILINE)
    since = {name: version for names, version in rows for name in re.findall(r"`(\w+)`", names)}
    assert since.keys() == tracker._OFFERED.keys()
    now = tuple(map(int, tracker.__version__.split(".")[:2]))
    assert all(tuple(map(int, version.split("."))) <= now for version in since.values())


def test_a_result_is_smoothed_exported_and_evaluated_by_itself_or_its_folder(tmp_path):
    movement = made_up("gavrila22")
    folder = movement.result(tmp_path / "result")
    movement.record(CsvTable(), folder)
    result = tracker.load_result(folder)
    smooth = tracker.smooth(result, "butterworth", cutoff_hz=8.0)
    assert smooth.folder == folder / "smoothed"
    assert smooth.details["smoothing"]["cutoff_hz"] == 8
    with pytest.raises(ConfigError, match="or replace it with --overwrite"):
        tracker.smooth(str(folder))
    assert tracker.smooth(folder, overwrite=True).details["smoothing"]["use"] == "rts"
    for to in ("trc,wide_table", ["trc", WideTable()], {"trc": {"y_up": False}, "wide_table": {}}):
        files = tracker.export(smooth, to, overwrite=True)
        assert [path.name for path in files] == ["person1.trc", "person1_wide.csv"]
        assert {path.parent for path in files} == {folder / "smoothed" / "exports"}
    assert tracker.export(folder, {"trc": {"y_up": True}}, tmp_path / "up") == (tmp_path / "up" / "person1.trc",)
    assert tracker.evaluate(result, folder).persons[0].mean_mm == pytest.approx(0)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda folder: tracker.smooth(folder, "butterwort"), 'did you mean "butterworth"'),
        (lambda folder: tracker.smooth(folder, cutoff=8.0), 'smooth: unknown key "cutoff"'),
        (lambda folder: tracker.export(folder, "trk"), 'no format "trk" to export to; did you mean "trc"'),
        (lambda folder: tracker.export(folder, "overlay"), 'no format "overlay"'),
        (lambda folder: tracker.export(folder, []), "expected one or more of bvh"),
        (lambda folder: tracker.export(folder, {"trc": {"y_upp": True}}), 'did you mean "y_up"'),
        (lambda folder: tracker.evaluate(folder, folder / "nowhere"), "no such truth file"),
        (lambda folder: tracker.simulate(second=1), 'unknown argument "second"; did you mean "seconds"'),
        (lambda folder: tracker.simulate(movement="hop"), 'no movement "hop"'),
    ],
)
def test_a_wrong_argument_is_one_line_and_leaves_nothing(call, words, tmp_path, monkeypatch):
    movement = made_up("gavrila22")
    folder = movement.result(tmp_path / "result")
    movement.record(CsvTable(), folder)
    monkeypatch.chdir(tmp_path)
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(tracker.TrackerError, match=re.escape(words)):
        call(folder)
    assert sorted(tmp_path.rglob("*")) == before


def test_a_command_and_the_package_know_the_same_formats():
    assert programs.FORMATS == FORMATS


class Cell:
    """What IPython shows below a cell: the pictures that replace each other."""

    def __init__(self) -> None:
        self.drawn: list[dict[str, str]] = []

    def display(self, content, raw, display_id):
        assert (raw, display_id) == (True, True)
        self.drawn.append(content)
        return SimpleNamespace(update=lambda content, raw: self.drawn.append(content))


@pytest.fixture
def cell(monkeypatch) -> Cell:
    """A notebook's cell."""
    shown = Cell()
    shell = SimpleNamespace(kernel=object())
    monkeypatch.setitem(sys.modules, "IPython", SimpleNamespace(get_ipython=lambda: shell))
    monkeypatch.setitem(sys.modules, "IPython.display", SimpleNamespace(display=shown.display))
    return shown


def test_a_notebook_shows_how_far_a_run_is(cell, recording, tmp_path):
    tracker.load_run(recording / "run.toml", ["reading.stop=2"]).execute(tmp_path / "out")
    last = cell.drawn[-1]["text/plain"].splitlines()
    assert [line for line in last if re.search(r"\b2 of 2\b", line)], last
    assert '<progress value="2" max="2"></progress>' in cell.drawn[-1]["text/html"]


def test_a_cell_keeps_warnings_and_the_last_steps(cell):
    bar = shown()
    bar("input: two videos <are> exchanged")
    for k in range(1000):
        bar("tracking", k + 1, 1000, f"{k} frames/s")
    bar("compiling")
    assert cell.drawn[-1]["text/plain"].splitlines() == [
        "input: two videos <are> exchanged",
        "tracking: 1000 of 1000 999 frames/s",
        "compiling",
    ]
    assert cell.drawn[-1]["text/html"].startswith("input: two videos &lt;are&gt; exchanged<br><progress ")
    assert len(cell.drawn) < 100, "a browser is not asked a thousand times"
    for k in range(20):
        bar(f"step {k}", 1, 1)
    assert len(cell.drawn[-1]["text/plain"].splitlines()) == 9


@pytest.mark.parametrize("shell", [None, SimpleNamespace()])
def test_elsewhere_nobody_is_told(shell, monkeypatch):
    """In a script, and in IPython in a terminal."""
    monkeypatch.setitem(sys.modules, "IPython", SimpleNamespace(get_ipython=lambda: shell))
    assert shown() is silent
    monkeypatch.delitem(sys.modules, "IPython")
    assert shown() is silent


def test_what_the_package_offers_has_types():
    """Each name of `__init__.pyi` is there, and nothing else is offered."""
    typed = set(re.findall(r" as (\w+)", (ROOT / "tracker" / "__init__.pyi").read_text()))
    assert typed == set(tracker._OFFERED)
    assert all(hasattr(tracker, name) and name in dir(tracker) for name in typed)
    script = "import sys, tracker; tracker.load_result; print('tracker.running.jobs' in sys.modules)"
    told = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, cwd=ROOT)
    assert told.stdout.strip() == "False"  # reading a result needs no cameras, evidence or estimators
