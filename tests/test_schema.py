"""JSON schemas for editors: they accept the files that are there, refuse what cannot be, and are named in drafts."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import jsonschema
import pytest
import tomli_w
from small_jobs import JOBS, smallest
from typer.testing import CliRunner

from tracker.foundation.configuration.components import available, find
from tracker.foundation.configuration.tables import describe
from tracker.results.recording import DEFAULTS
from tracker.running.cli import app
from tracker.running.commands.configuration import FILES, _schema
from tracker.running.jobs import described, job_from

ROOT = Path(__file__).parents[1]

KINDS = {
    "configs/*.toml": "run",
    "configs/acquisition/balancing*.toml": "acquire",
    "configs/acquisition/silhouettes.toml": "acquire_from_pictures",
    "configs/acquisition/points.toml": "acquire_from_points",
    "configs/acquisition/scan*.toml": "acquire_from_scan",
    "configs/calibration/*.toml": "calibrate",
    "configs/following/*.toml": "follow",
    "configs/markers/*.toml": "markers",
    "configs/surfaces/*.toml": "surface",
    "models/*.toml": "model",
    "models/movements/*/movement.toml": "movement",
}
"""Files -> what they are; configs/rigs holds calibrations, which have no schema."""

_CHECKS: dict[str, jsonschema.Draft7Validator] = {}


def check(kind: str) -> jsonschema.Draft7Validator:
    if kind not in _CHECKS:
        schema = json.loads(json.dumps(_schema(kind)))
        jsonschema.Draft7Validator.check_schema(schema)
        _CHECKS[kind] = jsonschema.Draft7Validator(schema)
    return _CHECKS[kind]


def faults(kind: str, table: dict) -> list[str]:
    return [f"{list(one.absolute_path)}: {one.message}" for one in check(kind).iter_errors(table)]


def run(**sections) -> dict:
    return {"persons": [{}], "reading": {"use": "video", "path": "{view}.mp4", "rig": "a.toml"}, **sections}


def test_every_file_there_is_accepted():
    found = {path: kind for pattern, kind in KINDS.items() for path in ROOT.glob(pattern)}
    there = {*ROOT.glob("configs/**/*.toml"), *ROOT.glob("models/**/*.toml")} - {*ROOT.glob("configs/rigs/*")}
    assert found.keys() == there
    told = {path.name: faults(kind, tomllib.loads(path.read_text())) for path, kind in found.items()}
    assert {name: those for name, those in told.items() if those} == {}


@pytest.mark.parametrize("use", JOBS)
def test_the_smallest_and_the_resolved_configuration_are_accepted(use, tmp_path):
    table = smallest(use)
    assert faults(use, table) == []
    resolved = described(job_from(use, table, "it", tmp_path, use))
    assert faults(use, tomllib.loads(tomli_w.dumps(resolved))) == []


@pytest.mark.parametrize("stage", ["evidence", "estimation", "initialization", "prediction", "synthesis", "smoothing"])
def test_every_component_is_accepted_by_name_and_with_all_its_fields(stage):
    for use in available(stage):
        assert faults("run", run(**{stage: use})) == []
        if all(not field.is_required() for field in find(stage, use).__pydantic_fields__.values()):
            table = tomllib.loads(tomli_w.dumps(describe(find(stage, use)())))
            assert faults("run", run(**{stage: table})) == []
            assert faults("run", run(**{stage: {**table, "nonsense": 1}})) != []


@pytest.mark.parametrize(
    "sections",
    [
        {"recordings": {"overlay": False, "trc": {"y_up": True}, "my_lab:Table": {"rows": 2}}},
        {"recordings": [*DEFAULTS, {"use": "trc", "y_up": True}]},
        {"estimation": {"rounds": 3}},  # of the usual one
        {"estimation": {"first": {"range_deg": 20}}},  # of that one's usual one
        {"evidence": "my_lab:Mine"},
        {"evidence": {"use": "my_lab:Mine", "anything": 1}},
        {"persons": [{"model": "human", "stature_m": 2}, {"model": "mine/anna.toml"}]},
        {"job": "track"},
    ],
)
def test_what_the_loader_takes_is_accepted(sections):
    assert faults("run", run(**sections)) == []


@pytest.mark.parametrize(
    ("sections", "told"),
    [
        ({"estimation": {"use": "hybrid", "roundss": 3}}, "['estimation']: Additional properties are not allowed"),
        ({"estimation": {"round": 3}}, "['estimation']: Additional properties are not allowed"),
        ({"estimations": {}}, "[]: Additional properties are not allowed ('estimations' was unexpected)"),
        ({"evidence": "contour"}, "['evidence']: 'contour' does not match '^(auto|contours|"),
        ({"evidence": {"use": "contour"}}, "['evidence', 'use']: 'contour' does not match"),
        ({"evidence": 3}, "['evidence']: 3 is not of type 'object'"),
        ({"passes": 3}, "['passes']: 3 is greater than the maximum of 2"),
        ({"passes": "two"}, "['passes']: 'two' is not of type 'integer'"),
        ({"persons": []}, "['persons']"),
        ({"persons": [{"model": "humann"}]}, "['persons', 0, 'model']: 'humann' does not match '^(gavrila22|human|"),
        ({"persons": [{"stature_m": "measure"}]}, "['persons', 0, 'stature_m']: 'measure' is not of type 'number'"),
        ({"persons": [{"statur_m": 1.7}]}, "['persons', 0]: Additional properties"),
        ({"reading": {"path": "a"}}, "['reading']: 'use' is a required property"),
        ({"recordings": {"overlai": True}}, "['recordings']"),
        ({"recordings": {"trc": {"y_upp": True}}}, "['recordings', 'trc']: Additional properties"),
        ({"recordings": ["overlai"]}, "['recordings', 0]: 'overlai' does not match"),
        ({"job": "calibrate"}, "['job']: 'track' was expected"),
    ],
)
def test_what_cannot_be_is_refused_where_it_stands(sections, told):
    found = faults("run", run(**sections))
    assert len(found) == 1, found
    assert found[0].startswith(told)


def test_a_section_that_is_missing_is_told():
    assert faults("run", {"persons": [{}]}) == ["[]: 'reading' is a required property"]


def test_editors_are_offered_names_and_meanings():
    """`anyOf`, `properties` and `description` are what they look at; a null, which TOML lacks, is nowhere."""
    schema = _schema("run")
    offered = schema["properties"]["estimation"]
    assert offered["anyOf"][0]["enum"] == list(available("estimation"))
    assert {"$ref": "#/definitions/estimation.hybrid"} in offered["anyOf"]
    assert offered["description"] == find("jobs", "track").__pydantic_fields__["estimation"].description
    fields = schema["definitions"]["estimation.hybrid"]["properties"]
    assert fields["use"] == {"const": "hybrid"}
    assert fields["rounds"]["description"]
    assert '"null"' not in json.dumps(schema)


@pytest.mark.parametrize("arguments", [[], ["run"], ["track"], *([kind] for kind in FILES)])
def test_the_command_prints_it(arguments):
    done = CliRunner().invoke(app, ["show", *arguments, "--schema"])
    assert done.exit_code == 0, done.output
    assert json.loads(done.stdout) == json.loads(json.dumps(_schema(*arguments or ["run"])))


def test_what_has_no_schema_is_answered_with_the_nearest():
    told = str(CliRunner().invoke(app, ["show", "modell", "--schema"]).exception)
    assert told.startswith('no schema of "modell"; did you mean "model"')
