"""The files of the project as syntax trees: their layers, and what they import."""

from __future__ import annotations

import ast
import functools
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import tracker

ROOT = Path(tracker.__file__).resolve().parents[1]

LAYERS = (
    "foundation _native",
    "kernels",
    "cameras",
    "bodies",
    "images",
    "points synthesis",
    "evidence",
    "tracking",
    "acquisition results",
    "running",
    "__main__",
    "scripts",
)
"""The rooms, one above the other: imports run down alone, and rooms of one layer know nothing of each other."""

LAYER = {unit: number for number, units in enumerate(LAYERS) for unit in units.split()}

APART = (
    "reading detection calibration prediction synthesis analysis recording smoothing",
    "acquisition alignment recognition evaluation simulation inspection",
)
"""Folders, in whichever rooms, that meet in nouns alone: no stage imports another, and neither does an application."""

COMMAND_LINE = ("tracker.running.cli", "tracker.running.commands", "tracker.__main__", "scripts")
"""Where alone is printed and exited."""


@dataclass(frozen=True)
class Module:
    """A source file."""

    name: str
    """Dotted, for instance `tracker.evidence.similarity.chamfer`."""

    source: str
    package: bool = False

    @functools.cached_property
    def tree(self) -> ast.Module:
        """Its syntax tree."""
        return ast.parse(self.source)

    @functools.cached_property
    def nodes(self) -> tuple[ast.AST, ...]:
        """All nodes of it, which many laws look through."""
        return tuple(ast.walk(self.tree))

    @functools.cached_property
    def imports(self) -> tuple[ast.Import | ast.ImportFrom, ...]:
        """Those that import something."""
        return tuple(node for node in self.nodes if isinstance(node, ast.Import | ast.ImportFrom))

    @property
    def folder(self) -> str:
        """The package it lies in; a package lies in itself."""
        return self.name if self.package else self.name.rpartition(".")[0]

    @property
    def layer(self) -> int | None:
        """Its layer; None if it has none yet."""
        return 0 if self.name == "tracker" else LAYER.get(unit_of(self.name))

    @property
    def talks(self) -> bool:
        """Whether it belongs to the command line."""
        return any(f"{self.name}.".startswith(f"{place}.") for place in COMMAND_LINE)


Modules = dict[str, Module]


def unit_of(name: str) -> str:
    """The room that a module belongs to."""
    first, _, rest = name.partition(".")
    return rest.partition(".")[0] if first == "tracker" else first


@functools.cache
def modules_of_the_project() -> Modules:
    """Every Python file of the package and of scripts/."""
    found = {}
    for path in sorted([*(ROOT / "tracker").rglob("*.py"), *(ROOT / "scripts").rglob("*.py")]):
        steps = path.relative_to(ROOT).with_suffix("").parts
        package = steps[-1] == "__init__"
        name = ".".join(steps[:-1] if package else steps)
        found[name] = Module(name, path.read_text(encoding="utf-8"), package)
    return found


def imported(module: Module, modules: Modules) -> Iterator[tuple[str, str]]:
    """Modules that one imports anywhere, type checking and functions included, each with the name taken from it."""
    for node in module.imports:
        if isinstance(node, ast.Import):
            yield from ((alias.name, "") for alias in node.names)
        else:
            source = _absolute(node, module)
            for alias in node.names:
                inner = f"{source}.{alias.name}"
                yield (inner, "") if inner in modules else (source, alias.name)


def packages_above(name: str) -> Iterator[str]:
    """Packages that are imported before a module of them is; the whole package is no room."""
    steps = name.split(".")
    yield from (".".join(steps[:n]) for n in range(2, len(steps)))


def _absolute(node: ast.ImportFrom, module: Module) -> str:
    if not node.level:
        return node.module or ""
    steps = module.folder.split(".")
    above = steps[: len(steps) - node.level + 1]
    return ".".join([*above, node.module] if node.module else above)


def ours(name: str) -> bool:
    """Whether a module is one of the project."""
    return name.partition(".")[0] in ("tracker", "scripts")
