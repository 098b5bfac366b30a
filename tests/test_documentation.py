"""The site is built without a warning; what its pages show is so: commands, settings, the example, the notebook."""

from __future__ import annotations

import importlib
import re
import shlex
import sys
import tomllib
from collections.abc import Iterator
from importlib.metadata import packages_distributions
from pathlib import Path
from typing import Any

import modules
import nbformat
import pytest
import typer.main
from click.testing import CliRunner
from matplotlib import pyplot as plt

import tracker
from scripts import architecture_picture
from scripts.documentation import configuration_tables, reference_entries
from tracker.bodies.body.description import BodyDescription
from tracker.foundation.configuration.components import available, find, stages
from tracker.foundation.errors import ConfigError
from tracker.results.recording import chosen_recordings
from tracker.running.cli import app
from tracker.running.commands.result import FORMATS
from tracker.running.jobs import execute, job_from, load_job
from tracker.synthesis.simulation.sequence import Recipe, write_sequence
from tracker.tracking.doubt import Because

ROOT = Path(__file__).parents[1]
COMPONENTS = {find(stage, use) for stage in stages() for use in available(stage)}
PAGES = {path.name: path.read_text(encoding="utf-8") for path in sorted((ROOT / "docs").glob("*.md"))}
LAB = {path.name: path.read_text(encoding="utf-8") for path in sorted((ROOT / "docs" / "lab").glob("*.md"))}


def blocks(page: str, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", PAGES[page], flags=re.DOTALL)


def test_the_site_is_built(tmp_path, monkeypatch):
    pytest.importorskip("mkdocstrings", reason="pip install mkdocstrings-python, of the extra [docs]")
    monkeypatch.chdir(ROOT)
    monkeypatch.setenv("NO_MKDOCS_2_WARNING", "1")
    mkdocs = importlib.import_module("mkdocs.__main__").cli
    done = CliRunner().invoke(mkdocs, ["build", "--strict", "--site-dir", str(tmp_path / "site")])
    assert done.exit_code == 0, done.output
    pages = {path.stem for path in (tmp_path / "site").glob("*.html")} - {"404"}
    assert pages == {name.removesuffix(".md") for name in PAGES}
    assert "<td><code>search_below</code></td>" in (tmp_path / "site" / "configuration.html").read_text()
    assert 'id="tracker.results.result.load_result"' in (tmp_path / "site" / "reference.html").read_text()
    assert (tmp_path / "site" / "first_steps.ipynb").is_file()
    start = (tmp_path / "site" / "index.html").read_text()
    assert not re.findall(r'<(?:link|script)[^>]*(?:href|src)="https?://', start)  # asks nobody else for anything


def test_every_page_is_in_the_contents():
    nav = (ROOT / "mkdocs.yml").read_text().partition("\nnav:")[2]
    assert set(re.findall(r"(\w+\.md)", nav)) == set(PAGES)


def required(names: list[str]) -> set[str]:
    """Distributions that requirements name, those of extras of the project among them."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    found = set()
    for name in names:
        if extras := re.match(r"bodytrack\[([\w,]+)\]", name):
            found |= required([one for key in extras[1].split(",") for one in project["optional-dependencies"][key]])
        else:
            found.add(re.match(r"[\w.-]+", name)[0].lower().replace("_", "-"))
    return found


def test_the_site_needs_no_extra_but_docs():
    """It imports every component to make the page of every setting."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    there = required([*project["dependencies"], "bodytrack[docs]"]) | {"pydantic-core"}  # pydantic's own
    every = modules.modules_of_the_project()
    package = [module for module in every.values() if module.name.startswith("tracker.")]
    names = {target.partition(".")[0] for module in package for target, _ in modules.imported(module, every)}
    distributions = packages_distributions()
    owners = {name: distributions[name] for name in names - {"tracker"} - set(sys.stdlib_module_names)}
    assert len(owners) > 8
    assert [name for name, who in owners.items() if not {one.lower().replace("_", "-") for one in who} & there] == []


def test_the_reference_has_every_public_name():
    entries = re.findall(r"^::: ([\w.]+)$", reference_entries(), flags=re.MULTILINE)
    public = {name for name in dir(tracker) if getattr(getattr(tracker, name), "__module__", "").startswith("tracker.")}
    assert len(public) >= 5
    assert public <= {entry.rpartition(".")[2] for entry in entries}
    assert len(entries) == len(set(entries))


def test_every_reason_of_a_doubt_is_told():
    rows = re.findall(r"^\| `(\w+)` \| ([^|]+) \|", PAGES["doubt.md"], flags=re.MULTILINE)
    told = {word: phrase for word, phrase in rows if word != "because"}
    assert told == {str(because): because.phrase for because in Because}


def settings_of(cls: Any, where: str = "") -> Iterator[tuple[str, str]]:
    """Section, dotted, and name of every field, with those of the sections in it that are no components."""
    for name, field in cls.__pydantic_fields__.items():
        yield where, name
        kinds = [field.annotation]
        for kind in kinds:
            kinds += getattr(kind, "__args__", ())
            if hasattr(kind, "__pydantic_fields__") and kind not in COMPONENTS:
                yield from settings_of(kind, f"{where}.{name}".strip("."))


def test_every_setting_is_told():
    page = configuration_tables()
    for stage in ("jobs", *stages()):
        for use in available(stage):
            section = re.split(r"\n### ", page.partition(f"## {'Jobs' if stage == 'jobs' else stage}\n")[2])
            (mine,) = [part for part in section if re.match(rf'(`{use}`|{stage}: `use = "{use}"`)\n', part)][:1]
            for where, name in settings_of(find(stage, use)):
                tables = mine.split("\n#### ")
                (table,) = [one for one in tables[1:] if f": {where}\n" in one][:1] if where else tables[:1]
                assert f"\n| `{name}` |" in table, f"{stage} {use} {where} {name}"
    assert not re.search(r"\|  \|$", page, flags=re.MULTILINE)  # no field without a meaning


@pytest.mark.parametrize(
    "line",
    sorted(
        {
            line.partition(" #")[0].strip()
            for name in PAGES
            for block in blocks(name, "sh")
            for line in block.splitlines()
            if line.startswith("bodytrack ") and "*" not in line
        }
    ),
)
def test_commands_parse(line):
    _, name, *arguments = shlex.split(line)
    typer.main.get_command(app).commands[name].make_context(name, arguments)


@pytest.mark.parametrize(
    ("page", "told"),
    [
        ("evidence.md", available("evidence")),
        ("calibration.md", available("calibration")),
        ("formats.md", (*FORMATS, *available("rig_layouts"), *available("smoothing"))),
    ],
)
def test_tables_name_every_component(page, told):
    assert [use for use in told if f"\n| `{use}`" not in PAGES[page]] == []


@pytest.mark.parametrize("page", [*PAGES, *(f"lab/{name}" for name in LAB)])
def test_files_that_are_named_exist(page):
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    named = re.findall(r"`((?:tracker|scripts|configs|models|tests|docs)/[\w./]+)`", text)
    assert [path for path in named if not (ROOT / path).exists() and path != "models/anna.toml"] == []


def test_a_page_of_the_lab_has_a_question_a_setup_and_a_decision():
    assert "lab/" in (ROOT / "mkdocs.yml").read_text().partition("not_in_nav:")[2]  # not in the users' menu
    for name in LAB.keys() - {"index.md"}:
        assert re.match(r"# [^\n]+\?\n\n\*\*Setup\.\*\* .+?\n\n\*\*Decision\.\*\* ", LAB[name], flags=re.S), name
        assert f"]({name})" in LAB["index.md"], name


def test_the_lab_and_the_constants_lead_to_each_other():
    sources = [*(ROOT / "tracker").rglob("*.py"), *(ROOT / "models").glob("*.toml")]
    led = {
        (path.relative_to(ROOT).as_posix(), name)
        for path in sources
        for name in re.findall(r"docs/lab/(\w+\.md)", path.read_text(encoding="utf-8"))
    }
    told = {
        (path, name)
        for name, page in LAB.items()
        for line in re.findall(r"^\*\*Set by it:\*\* (.*)$", page, flags=re.M)
        for path in re.findall(r"`(\w+/[^`]+)`", line)
    }
    assert led == told
    for page in LAB.values():
        for names, path in re.findall(r"`([\w, ]+)` in `([^`]+)`", page.partition("## Measured")[0]):
            assert names in (ROOT / path).read_text(encoding="utf-8"), path


def test_the_picture_of_the_architecture_is_what_the_imports_are(monkeypatch):
    """Which it finds in the files as they are read already, by the law."""
    assert architecture_picture._law().LAYERS == modules.LAYERS
    monkeypatch.setattr(architecture_picture, "_law", lambda: modules)
    told = "python scripts/architecture_picture.py draws it anew"
    assert (ROOT / "docs" / "architecture.svg").read_text(encoding="utf-8") == architecture_picture.drawn(), told


def test_a_way_that_others_tell_is_left_out():
    pairs = {("a", "b"), ("b", "c"), ("a", "c"), ("a", "d")}
    assert architecture_picture.shortest_ways(pairs) == {("a", "b"), ("b", "c"), ("a", "d")}


@pytest.mark.parametrize("page", PAGES)
def test_configurations_can_be_read(page, tmp_path):
    """Each in place of what the smallest configuration of its job says."""
    recording = {"use": "video", "path": "videos/{view}.mp4", "rig": "Calib.toml"}
    for block in blocks(page, "toml"):
        table = tomllib.loads(block)
        if "background" in table:  # a setting alone
            table = {"reading": table}
        if "segments" in table:
            BodyDescription.model_validate(table).build()
        if {"parameters", "keypoints", "segments"} & set(table) or page == "components.md":
            continue  # of a model file, or of a component that its own test builds
        table["reading"] = recording | table.get("reading", {})
        job = "calibrate" if "calibration" in table else "follow" if "snakes" in table else "track"
        if job == "calibrate":
            del table["reading"]["rig"]
        job_from(job, ({"persons": [{"model": "human"}]} if job == "track" else {}) | table, page, tmp_path, "name")


def test_the_component_of_the_page_is_used(tmp_path, monkeypatch):
    """Copied as it stands into a module, it writes its file."""
    (source,) = blocks("components.md", "python")
    (settings,) = (block for block in blocks("components.md", "toml"))
    (tmp_path / "my_lab.py").write_text(source)
    monkeypatch.syspath_prepend(tmp_path)
    config = write_sequence(Recipe("arm_swing", seconds=0.16, size=(360, 288)), tmp_path / "sequence")
    config.write_text(re.sub(r"(?ms)^\[recordings\].*?(?=^\[|\Z)", "", config.read_text()) + "\n" + settings)
    given = ["initialization.use=given", "initialization.poses=truth_poses.csv", "recordings.report=false"]
    given += ["recordings.overlay=false", "recordings.plots=false", "reading.downscale=1", "evidence=contours"]
    execute(load_job("track", config, given), tmp_path / "out")
    head, *lines = (tmp_path / "out" / "heights.csv").read_text().splitlines()
    assert head == "time_s,person,height_m"
    assert [line.split(",")[0] for line in lines] == ["0.0000", "0.0400", "0.0800", "0.1200"]
    heights = [float(line.split(",")[2]) for line in lines]
    assert 0.6 < min(heights) <= max(heights) < 1.6
    assert chosen_recordings({"my_lab:Heights": True}, "", tmp_path)[-1].landmark == "left_wrist"
    with pytest.raises(ConfigError, match='did you mean "landmark"'):
        chosen_recordings({"my_lab:Heights": {"landmrk": "head"}}, "", tmp_path)


def test_the_notebook_runs(tmp_path, monkeypatch, capsys):
    """From its first cell to its last, in this process, whose kernels are loaded; it judges its result itself."""
    notebook = nbformat.read(ROOT / "docs" / "first_steps.ipynb", 4)
    nbformat.validate(notebook)
    cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert not any(cell.outputs for cell in cells), "kept without outputs"
    monkeypatch.chdir(tmp_path)
    plt.switch_backend("agg")
    names, printed = {"__name__": "__main__"}, ""
    for cell in cells:
        exec(compile(cell.source, cell.id, "exec"), names)
        shown, figures = capsys.readouterr().out, plt.get_fignums()
        plt.close("all")
        assert shown or figures, f"cell {cell.id} shows nothing"
        printed += shown
    assert re.search(r"joints \d+\.\d mm, angles", printed)
    assert (tmp_path / "first_steps" / "result" / "report.html").is_file()
