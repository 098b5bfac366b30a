"""The files of the project as syntax trees: their layers, and what they import."""

from __future__ import annotations

import ast
import functools
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import tracker.errors

ROOT = Path(tracker.errors.__file__).resolve().parents[1]

LAYERS = (
    "errors arrays c3d_format freed_memory lengths plugins components config config_files field_types schema resources "
    "files source_files pages progress clock patience keypoint_names geometry imaging kernels "
    "native_sources _native",
    "camera lens fisheye rig world rig_layouts frame shape skin skin_files segments mirror point_trajectories body "
    "limbs scene contours expectation observation keypoints keypoint_layouts skeletons markers marker_layouts account "
    "robots "
    "hidden doubt equations plate plate_changes sight estimate in_view in_space loss start carried subject trajectory "
    "doubts triangulation views shown_size seen_pixels film first_frames",
    "reading detection calibration prediction synthesis analysis recording smoothing",
    "comparison outlines correspondences strangers part_colours lsm following person_track result ball_joints",
    "similarity evidence objective",
    "estimation initialization",
    "tracking",
    "acquisition alignment recognition evaluation simulation inspection",
    "jobs rig_check epipolar_picture exports programs smoothed aligned batching run forecast draft draft_rig "
    "draft_plates draft_keypoints footage viewing detecting detected_pictures",
    "cli commands __main__ scripts",
)
LAYER = {unit: number for number, units in enumerate(LAYERS) for unit in units.split()}

STAGES, APPLICATIONS, COMMAND_LINE = 2, 7, 9
"""Units of the layers STAGES and APPLICATIONS meet only in nouns; the COMMAND_LINE alone prints and exits."""


@dataclass(frozen=True)
class Module:
    """A source file."""

    name: str
    """Dotted, for instance `tracker.similarity.chamfer`."""

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


Modules = dict[str, Module]


def unit_of(name: str) -> str:
    """The noun or the folder that a module belongs to."""
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


def _absolute(node: ast.ImportFrom, module: Module) -> str:
    if not node.level:
        return node.module or ""
    steps = module.folder.split(".")
    above = steps[: len(steps) - node.level + 1]
    return ".".join([*above, node.module] if node.module else above)


def ours(name: str) -> bool:
    """Whether a module is one of the project."""
    return name.partition(".")[0] in ("tracker", "scripts")
