"""Configuration files: every mistake is one line that names file, section, key and the nearest valid one."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from tracker.foundation.configuration.tables import build, describe, read_config
from tracker.foundation.errors import ConfigError
from tracker.running.jobs import described, job_from, load_job

CONFIGS = sorted((Path(__file__).parents[1] / "configs").glob("*.toml"))
GOOD = """
persons = [{ name = "anna", model = "gavrila22", stature_m = 1.7 }]
reading = { use = "video", path = "videos/{view}.mp4", rig = "rig.toml" }
"""
CONTOURS = '[evidence]\nuse = "contours"\n'


@pytest.fixture
def written(tmp_path):
    def write(text: str) -> Path:
        path = tmp_path / "run.toml"
        path.write_text(text)
        return path

    return write


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.stem)
def test_the_configurations_load_and_describe_themselves(path, monkeypatch, tmp_path):
    monkeypatch.setenv("BODYTRACK_DATA", str(tmp_path))
    job = load_job("track", path)
    assert job_from("track", described(job), "config.toml", Path("/"), "other") == job


def test_sections_have_defaults_and_paths_start_at_the_file(written, tmp_path):
    run = load_job("track", written(GOOD))
    assert run.name == "run"
    assert run.reading.path == str(tmp_path / "videos/{view}.mp4")
    assert run.reading.rig == tmp_path / "rig.toml"
    assert run.persons[0].body().stature_m == pytest.approx(1.7)


def test_overrides_reach_nested_components(written):
    overrides = [
        "evidence.use=contours",
        "evidence.similarity.outlier_px=15",
        "estimation.first.use=best_first",
        "estimation.first.step_deg=2.5",
    ]
    run = load_job("track", written(GOOD), overrides)
    assert run.evidence.similarity.outlier_px == 15
    assert run.estimation.first.step_deg == 2.5


def test_overrides_reach_entries_of_lists(written):
    run = load_job("track", written(GOOD), ["persons.0.model=human", "persons.0.stature_m=1.6"])
    assert (run.persons[0].model.stem, run.persons[0].stature_m) == ("human", 1.6)
    for override in ("persons.1.model=human", "persons.anna.model=human", "persons.2=3"):
        with pytest.raises(ConfigError, match=r"expected the number of an entry, from 0 on, at most 0"):
            read_config(written(GOOD), [override])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (GOOD + "[evidnce]\n", 'run.toml: unknown section "evidnce"; did you mean "evidence"'),
        (
            GOOD + CONTOURS + "[evidence.similarity]\noutlier = 3\n",
            r'\[evidence\] similarity: unknown key "outlier"; did you mean "outlier',
        ),
        (
            GOOD + CONTOURS + '[evidence.similarity]\nuse = "chamfr"\n',
            r'use = "chamfr": no such component; did you mean "chamfer"',
        ),
        (
            GOOD + CONTOURS + '[evidence.similarity]\noutlier_px = "far"\n',
            r"\[evidence\] similarity: outlier_px = 'far': expected",
        ),
        (
            GOOD + CONTOURS + "[evidence.similarity]\noutlier_px = -1\n",
            r"outlier_px = -1: expected greater than 0",
        ),
        (GOOD + "[estimation]\nfirst = 3\n", r"\[estimation\] first: expected a table like"),
        (GOOD + "[loss]\nlost = 1\n", r'\[loss\]: unknown key "lost"; did you mean "lost_below"'),
        (GOOD.replace("rig =", "rg ="), r'\[reading\]: unknown key "rg"; did you mean "rig"'),
        (
            GOOD.replace(', rig = "rig.toml"', ""),
            r'\[reading\]: the key "rig" is missing, .* rig = "Calib.toml"',
        ),
        (GOOD.replace("gavrila22", "gavrila2"), 'no body model "gavrila2"; did you mean "gavrila22"'),
        (GOOD.replace("stature_m", "statur_m"), 'unknown key "statur_m"; did you mean "stature_m"'),
        (
            GOOD.replace("= 1.7", "= 170"),
            "stature_m = 170: expected less than or equal to 5 .height that the model",
        ),
        (
            GOOD.replace("rig =", "downscale = 0, rig ="),
            r"downscale = 0: expected a whole number from 1 to 16, or 0\.5 \(images are averaged .* enlarges",
        ),
        ("reading = {", "not a TOML file"),
        (GOOD + 'job = "surface"', 'describes the job "surface", but "track" was asked for'),
        (GOOD + 'job = "tarck"', 'no such job; did you mean "track"'),
        (GOOD.replace("persons = [", 'persons = [{ name = "anna" }, '), r"\[persons\]: two persons are called .anna."),
        (GOOD.splitlines()[2], r'the key "persons" is missing, expected e.g. persons = \[\{ name = "anna"'),
        ("persons = []\n" + GOOD.splitlines()[2], "persons = .*at least 1 item"),
        (GOOD.replace("videos/", "${NO_SUCH_FOLDER}/"), "environment variable NO_SUCH_FOLDER is not set"),
    ],
)
def test_mistakes_are_named(written, text, message):
    assert "NO_SUCH_FOLDER" not in os.environ
    with pytest.raises(ConfigError, match=message) as caught:
        load_job("track", written(text))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("override", ["similarity", "=3", "name.first=1"])
def test_malformed_overrides_are_refused(written, override):
    with pytest.raises(ConfigError, match="--set"):
        read_config(written('name = "x"' + GOOD), [override])


def test_a_component_describes_itself_with_all_its_fields():
    component = build("similarity", {"use": "chamfer", "outlier_px": 12.0}, "test", Path())
    table = describe(component)
    assert table == {**table, "use": "chamfer", "outlier_px": 12.0, "outliers": "clamp"}
    assert build("similarity", table, "test", Path()) == component


def test_an_override_is_one_value(tmp_path: Path) -> None:
    (tmp_path / "run.toml").write_text("")
    with pytest.raises(ConfigError, match="expected one value"):
        read_config(tmp_path / "run.toml", ["name=1\nother=2"])
