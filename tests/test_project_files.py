"""What a project has beside its code: links lead somewhere, files that are named exist, versions agree."""

from __future__ import annotations

import re
import shlex
import tomllib
from pathlib import Path

import pytest
import yaml
from markdown.extensions.toc import slugify

import tracker

ROOT = Path(__file__).parents[1]
PAGES = [*sorted(ROOT.glob("*.md")), *sorted((ROOT / "docs").rglob("*.md"))]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def prose(page: Path) -> str:
    return re.sub(r"```.*?```|`[^`\n]*`", lambda code: re.sub(r"[\[\]()#]", "", code[0]), page.read_text(), flags=re.S)


def anchors(page: Path) -> set[str]:
    """What a link may say after `#`: headings as MkDocs and GitHub name them."""
    headings = re.findall(r"^#+ (.*)$", re.sub(r"```.*?```", "", page.read_text(), flags=re.S), flags=re.M)
    return {slugify(re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading), "-") for heading in headings}


def dead_links(page: Path) -> list[str]:
    """Links of a page that lead to no file, to no heading, or from the site's pages out of the site."""
    dead = []
    for link in re.findall(r"\]\((?!https?://|mailto:)([^)\s]+)\)", prose(page)):
        name, _, anchor = link.partition("#")
        target = page.parent / name if name else page
        site = next((folder for folder in page.parents if folder.name == "docs"), None)
        leaves = site is not None and site not in target.resolve().parents
        if leaves or not target.exists() or (anchor and anchor not in anchors(target)):
            dead.append(link)
    return dead


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page):
    assert dead_links(page) == []


def test_dead_links_are_found(tmp_path):
    (tmp_path / "docs").mkdir()
    (tmp_path / "README.md").write_text("# Top\n")
    page = tmp_path / "docs" / "page.md"
    page.write_text("# A `b` c\n[1](#a-b-c) [2](page.md#a-b-c) [3](none.md) [4](#no) [5](../README.md) `[6](x.md)`\n")
    assert dead_links(page) == ["none.md", "#no", "../README.md"]
    (tmp_path / "docs" / "lab").mkdir()
    page = tmp_path / "docs" / "lab" / "question.md"
    page.write_text("# Q\n[1](../page.md#a-b-c) [2](../../README.md) [3](../none.md)\n")
    assert dead_links(page) == ["../../README.md", "../none.md"]


@pytest.mark.parametrize("page", ["CONTRIBUTING.md", "CHANGELOG.md"])
def test_files_that_are_named_exist(page):
    text = (ROOT / page).read_text()
    named = re.findall(r"`((?:tracker|scripts|configs|models|tests|docs)/[\w./]+)`", text)
    assert [path for path in named if not (ROOT / path).exists()] == []


def test_versions_agree():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert PROJECT["version"] == tracker.__version__ == str(citation["version"])
    assert re.findall(r"^## ([\w.]+)", (ROOT / "CHANGELOG.md").read_text(), flags=re.M)[0] == PROJECT["version"]
    assert citation["license"] == PROJECT["license"].split(" AND ")
    assert [author["name"] for author in citation["authors"]] == [author["name"] for author in PROJECT["authors"]]


def test_the_container_runs_bodytrack():
    """No engine builds it here: what it copies and installs exists, and the pages show its own command."""
    lines = [line for line in (ROOT / "Dockerfile").read_text().splitlines() if not line.startswith("#")]
    python = next(re.fullmatch(r"FROM python:(3\.\d+)-slim", line)[1] for line in lines if line.startswith("FROM"))
    assert f"Programming Language :: Python :: {python}" in PROJECT["classifiers"]
    assert 'ENTRYPOINT ["bodytrack"]' in lines
    assert "bodytrack" in PROJECT["scripts"]
    extras = re.findall(r"/src\[(\w+)\]", "\n".join(lines))
    assert set(extras) <= set(PROJECT["optional-dependencies"])
    assert shlex.split(next(line for line in lines if line.startswith("WORKDIR")))[1] == "/data"
    assert '-v "$PWD:/data"' in (ROOT / "docs" / "computers.md").read_text()
