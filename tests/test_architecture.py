"""The architecture as laws over the syntax tree of every file; each law is also shown code that breaks it."""

from __future__ import annotations

import ast
import builtins
import graphlib
import re
import subprocess
import sys
from collections.abc import Callable

import pytest
from modules import APART, LAYER, ROOT, Module, Modules, imported, modules_of_the_project, ours, packages_above, unit_of

OPTIONAL = (
    {"moderngl", "glcontext", "pyrender", "OpenGL", "rerun", "viser"}
    | {"dask", "distributed"}
    | {"mediapipe", "rtmlib"}
)
"""Libraries that a plain installation lacks: imported by the one component that needs them."""

VAGUE_NAMES = {"utils", "util", "helpers", "helper", "core", "common", "manager", "misc", "base"}

MAX_FILE_LINES, MAX_FUNCTION_LINES, MAX_ROOMS = 400, 60, 12

Function = ast.FunctionDef | ast.AsyncFunctionDef


def upward_imports(modules: Modules) -> list[str]:
    """Imports run one way, from higher rooms to lower ones; rooms of one layer never import one another."""
    homeless = [module.name for module in modules.values() if module.layer is None]
    faults = [f"{name}: no room, expected one of LAYERS" for name in homeless]
    for module in modules.values():
        for target, _ in imported(module, modules):
            if not ours(target) or module.layer is None or unit_of(target) == unit_of(module.name):
                continue
            layer = -1 if target == "tracker" else LAYER.get(unit_of(target))
            if layer is None:
                faults.append(f"{module.name} imports {target}, which has no room")
            elif layer >= module.layer:
                faults.append(f"{module.name} (layer {module.layer}) imports {target} (layer {layer})")
    return faults


def sideways_imports(modules: Modules) -> list[str]:
    """Stages never import one another, and neither do applications, in whichever rooms they lie."""
    return [
        f"{module.name} imports its neighbour {target}"
        for module in modules.values()
        for target, _ in imported(module, modules)
        for names in map(str.split, APART)
        if module.name.startswith("tracker.")
        and (mine := _one_of(names, module.name))
        and (other := _one_of(names, target))
        and mine != other
    ]


def _one_of(names: list[str], module: str) -> str:
    """The innermost folder of a module that is one of some."""
    return next((step for step in reversed(module.split(".")) if step in names), "")


def points_let_in(modules: Modules) -> list[str]:
    """Points know nothing of bodies and poses, and tracking knows them through one evidence alone."""
    faults = []
    for module in modules.values():
        for target, _ in imported(module, modules):
            here, there = unit_of(module.name), unit_of(target)
            if here == "points" and ours(target) and there not in POINTS_MAY_IMPORT:
                faults.append(f"{module.name} imports {target}")
            elif there == "points" and here not in KNOWING_POINTS and module.name not in EVIDENCE_OF_POINTS:
                faults.append(f"{module.name} imports {target}, expected of {EVIDENCE_OF_POINTS[0]} alone")
    return faults


POINTS_MAY_IMPORT = {"", "foundation", "kernels", "cameras", "images", "points"}
KNOWING_POINTS = {"points", "acquisition", "running", "scripts"}
EVIDENCE_OF_POINTS = ("tracker.evidence.points", "tracker.evidence._attachment")


def silent_rooms(modules: Modules) -> list[str]:
    """A room says in a few lines what it is for, and what it may import."""
    faults = []
    for module in modules.values():
        if module.package and module.name.startswith("tracker.") and module.name.count(".") == 1:
            said = ast.get_docstring(module.tree) or ""
            if said.count("\n") < 2 or "import" not in said:
                faults.append(f"{module.name}: expected what it is for and what it imports, in a few lines")
    return faults


def cycles(modules: Modules) -> list[str]:
    """No file and no room imports itself, by whatever way round; a module is imported with the packages it lies in."""
    files: dict[str, set[str]] = {name: set() for name in modules}
    units: dict[str, set[str]] = {}
    for name, module in modules.items():
        for target, _ in imported(module, modules):
            if ours(target) and target != name:
                above = {package for package in packages_above(target) if not f"{name}.".startswith(f"{package}.")}
                files[name] |= {target} | (above & modules.keys())
                if unit_of(target) != unit_of(name):
                    units.setdefault(unit_of(name), set()).add(unit_of(target))
    faults = []
    for graph in (files, units):
        try:
            graphlib.TopologicalSorter(graph).prepare()
        except graphlib.CycleError as error:
            faults.append("import cycle: " + " <- ".join(error.args[1]))
    return faults


def hidden_imports(modules: Modules) -> list[str]:
    """Imports stand at the top of the file; only the command line may set the environment first."""
    faults = []
    for module in modules.values():
        if module.talks:
            continue
        top = {id(node) for node in module.tree.body}
        faults += [
            f"{module.name}:{node.lineno}: import below the top" for node in module.imports if id(node) not in top
        ]
    return faults


def broken_privacy(modules: Modules) -> list[str]:
    """A file with an underscore is private to its folder, a name with one to its file."""
    faults = []
    for module in modules.values():
        for target, name in imported(module, modules):
            if not ours(target):
                continue
            steps = target.split(".")
            folders = [".".join(steps[:i]) for i, step in enumerate(steps) if _private(step)]
            if any(not f"{module.folder}.".startswith(f"{folder}.") for folder in folders):
                faults.append(f"{module.name} imports {target}, private to {folders[0]}")
            if _private(name):
                faults.append(f"{module.name} imports {name}, private to {target}")
    return faults


def _private(name: str) -> bool:
    return name.startswith("_") and not name.endswith("__")


def oversize(modules: Modules) -> list[str]:
    """Files and functions stay short."""
    faults = []
    for module in modules.values():
        n_lines = module.source.count("\n")
        if n_lines > MAX_FILE_LINES:
            faults.append(f"{module.name}: {n_lines} lines, at most {MAX_FILE_LINES}")
        for node in module.nodes:
            if isinstance(node, Function) and (n_lines := _body_lines(node)) > MAX_FUNCTION_LINES:
                faults.append(f"{module.name}.{node.name}: {n_lines} lines, at most {MAX_FUNCTION_LINES}")
    return faults


def _body_lines(function: Function) -> int:
    body = function.body[1:] if ast.get_docstring(function) else function.body
    return (body[-1].end_lineno or 0) - body[0].lineno + 1 if body else 0


def printing_or_exiting(modules: Modules) -> list[str]:
    """The library raises; only the command line and the scripts print, ask and exit."""
    faults = []
    for module in modules.values():
        if module.talks:
            continue
        for node in module.nodes:
            if isinstance(node, ast.Call) and ast.unparse(node.func) in _TALKING:
                faults.append(f"{module.name}:{node.lineno}: {ast.unparse(node.func)}()")
            if isinstance(node, ast.Raise) and node.exc and "SystemExit" in ast.unparse(node.exc):
                faults.append(f"{module.name}:{node.lineno}: raises SystemExit")
    return faults


_TALKING = {"print", "input", "breakpoint", "exit", "quit", "sys.exit", "os._exit", "os.abort"}


def foreign_errors(modules: Modules) -> list[str]:
    """What a user can cause is a TrackerError: a builtin exception is a traceback on the command line.

    Only pydantic's validators raise ValueError, and a module's `__getattr__` AttributeError: their callers want it.
    """
    faults = []
    for module in modules.values():
        validating = {
            id(node)
            for function in module.nodes
            if isinstance(function, Function)
            and (function.name == "__getattr__" or "validator" in "".join(map(ast.unparse, function.decorator_list)))
            for node in ast.walk(function)
        }
        for node in module.nodes:
            if isinstance(node, ast.Raise) and id(node) not in validating and _builtin_error(node):
                faults.append(
                    f"{module.name}:{node.lineno}: {ast.unparse(node)}, expected one of tracker.foundation.errors"
                )
    return faults


def _builtin_error(node: ast.Raise) -> bool:
    if node.exc is None:
        return False
    name = ast.unparse(node.exc.func if isinstance(node.exc, ast.Call) else node.exc)
    kind = getattr(builtins, name, None)
    return (
        isinstance(kind, type) and issubclass(kind, Exception) and name not in ("NotImplementedError", "StopIteration")
    )


def poor_files(modules: Modules) -> list[str]:
    """Every file says what it is for and annotates lazily; no file is called after nothing in particular."""
    faults = []
    for module in modules.values():
        if not ast.get_docstring(module.tree):
            faults.append(f"{module.name}: no docstring")
        lazy = any(isinstance(node, ast.ImportFrom) and node.module == "__future__" for node in module.tree.body)
        annotates = any(isinstance(node, ast.AnnAssign | Function | ast.ClassDef) for node in module.nodes)
        if annotates and not lazy:
            faults.append(f"{module.name}: no `from __future__ import annotations`")
        if module.name.rpartition(".")[2].strip("_") in VAGUE_NAMES:
            faults.append(f"{module.name}: a name that says nothing")
    return faults


def stray_optional_imports(modules: Modules) -> list[str]:
    """Optional libraries are imported by components only, which load when a configuration names them."""
    faults, optional = [], {name: _optional(module, modules) for name, module in modules.items()}
    for module in modules.values():
        libraries = optional[module.name]
        component = module.name.count(".") >= 2 and not module.package
        if libraries and not (component and module.layer not in (None, 0)):
            faults.append(f"{module.name} imports {', '.join(sorted(libraries))}")
        for target, _ in imported(module, modules):
            if target in modules and module.folder != modules[target].folder:
                so = sorted(optional[target])
                faults += [f"{module.name} imports {target} and so {library}" for library in so]
    return faults


def _optional(module: Module, modules: Modules) -> set[str]:
    return {target.partition(".")[0] for target, _ in imported(module, modules)} & OPTIONAL


def bare_constants(modules: Modules) -> list[str]:
    """Numbers that a module is built on say what they are or where they come from, in a comment or a docstring.

    A comment above a block of them speaks for all of it.
    """
    faults = []
    for module in modules.values():
        lines, below = module.source.split("\n"), [*module.tree.body[1:], None]
        for node, after in zip(module.tree.body, below, strict=True):
            if isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None and _numeric(node.value):
                above = next((s for s in lines[node.lineno - 2 :: -1] if not _CONSTANT.match(s)), "")
                said = "#" in lines[node.lineno - 1] or (node.lineno > 1 and above.startswith("#"))
                if not said and not _is_text(after):
                    faults.append(f"{module.name}: {lines[node.lineno - 1]}")
    return faults


_CONSTANT = re.compile(r"_?[A-Za-z0-9_, ]+(: [^=]+)? = ")
_RECORDING = re.compile(r"\b(?:[A-Z]{1,2}-(?!Za|Motion)[A-Z]\w+|balancing|two_people)\b")  # not "[A-Za-z]", C-Motion


def recordings_named(modules: Modules) -> list[str]:
    """The package tells reasons and numbers; the recordings that they come from stand in docs/lab."""
    package = [module for module in modules.values() if module.name.startswith("tracker")]
    return [f"{module.name} names {name}" for module in package for name in _RECORDING.findall(module.source)]


def _numeric(value: ast.expr) -> bool:
    """Whether a value has numbers in it that are no index and no part of a comprehension."""
    if isinstance(value, ast.Subscript | ast.ListComp | ast.GeneratorExp | ast.DictComp | ast.SetComp | ast.Lambda):
        return False
    if isinstance(value, ast.Constant):
        return isinstance(value.value, int | float) and not isinstance(value.value, bool)
    return any(_numeric(inner) for inner in ast.iter_child_nodes(value) if isinstance(inner, ast.expr))


def _is_text(node: ast.stmt | None) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)


Law = Callable[[Modules], list[str]]

LAWS: tuple[Law, ...] = (
    upward_imports,
    sideways_imports,
    points_let_in,
    silent_rooms,
    cycles,
    hidden_imports,
    broken_privacy,
    oversize,
    printing_or_exiting,
    foreign_errors,
    poor_files,
    stray_optional_imports,
    bare_constants,
    recordings_named,
)

VIOLATIONS: tuple[tuple[Law, dict[str, str]], ...] = (
    (upward_imports, {"tracker.cameras.frame": "from tracker.tracking.sequence import track"}),
    (upward_imports, {"tracker.foundation.axes": "from tracker import cameras", "tracker.cameras": ""}),
    (upward_imports, {"tracker.cameras.rig": "def f():\n    import tracker.tracking.objective"}),
    (upward_imports, {"tracker.cameras.rig": "if TYPE_CHECKING:\n    from tracker.running.jobs import Job"}),
    (upward_imports, {"tracker.cameras.rig": "from ..running.jobs import Job"}),
    (upward_imports, {"tracker.points.surfaces": "import tracker.synthesis"}),
    (upward_imports, {"tracker.running.jobs": "from scripts.benchmark import main"}),
    (upward_imports, {"tracker.novelty": ""}),
    (upward_imports, {"tracker.running.jobs": "import tracker.novelty"}),
    (sideways_imports, {"tracker.images.analysis.overlap": "from tracker.images.reading import Reading"}),
    (
        sideways_imports,
        {"tracker.results.evaluation": "from tracker.synthesis import simulation", "tracker.synthesis.simulation": ""},
    ),
    (points_let_in, {"tracker.points.surfaces.growth": "from tracker.bodies.body import BodyModel"}),
    (points_let_in, {"tracker.evidence.contours": "from tracker.points.following.tables import Names"}),
    (points_let_in, {"tracker.tracking.windows": "import tracker.points.trajectories"}),
    (silent_rooms, {"tracker.synthesis": chr(34) * 3 + "Synthesis." + chr(34) * 3}),
    (
        cycles,
        {"tracker.cameras.rig": "import tracker.cameras.frame", "tracker.cameras.frame": "import tracker.cameras.rig"},
    ),
    (cycles, {"tracker.foundation.a": "import tracker.kernels.b", "tracker.kernels.b": "import tracker.foundation.c"}),
    (
        cycles,
        {"tracker.synthesis": "import tracker.images.a", "tracker.images.a": "import tracker.synthesis.b"}
        | {"tracker.synthesis.b": ""},
    ),
    (hidden_imports, {"tracker.cameras.rig": "def f():\n    import numpy"}),
    (broken_privacy, {"tracker.running.jobs": "from tracker.images.reading._footage import ImageStream"}),
    (broken_privacy, {"tracker.running.jobs": "from tracker.images.reading.video import _header"}),
    (oversize, {"tracker.cameras.rig": "x = 1\n" * 401}),
    (oversize, {"tracker.cameras.rig": "def f():\n" + "    x = 1\n" * 61}),
    (printing_or_exiting, {"tracker.running.jobs": "print('done')"}),
    (printing_or_exiting, {"tracker.running.jobs": "import sys\nsys.exit(1)"}),
    (printing_or_exiting, {"tracker.running.jobs": "raise SystemExit(2)"}),
    (foreign_errors, {"tracker.running.jobs": "raise ValueError('no')"}),
    (poor_files, {"tracker.running.jobs": "from __future__ import annotations"}),
    (poor_files, {"tracker.running.jobs": '"""Runs."""\ndef f() -> int: ...'}),
    (poor_files, {"tracker.images.operations._helpers": '"""Helps."""'}),
    (stray_optional_imports, {"tracker.synthesis": "import moderngl"}),
    (
        stray_optional_imports,
        {"tracker.synthesis.egl": "import moderngl", "tracker.running.jobs": "import tracker.synthesis.egl"},
    ),
    (bare_constants, {"tracker.cameras.rig": "_NEAR_M = 0.3"}),
    (bare_constants, {"tracker.cameras.rig": "x = 1\n# Of something else.\nimport numpy\n\n_SIZE = np.array([1, 2])"}),
    (recordings_named, {"tracker.cameras.rig": "# 31 mm instead of 70 on V-Dance."}),
    (recordings_named, {"tracker.cameras.rig": "# Of balancing, frame 10."}),
)


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.__name__)
def test_the_project_keeps_the_law(law: Law) -> None:
    assert law(modules_of_the_project()) == []


@pytest.mark.parametrize(("law", "sources"), VIOLATIONS, ids=lambda value: getattr(value, "__name__", None))
def test_the_law_notices_a_violation(law: Law, sources: dict[str, str]) -> None:
    modules = {name: Module(name, source, name == "tracker.synthesis") for name, source in sources.items()}
    assert law(modules)


def test_the_whole_package_is_looked_at() -> None:
    modules = modules_of_the_project()
    assert {
        "tracker",
        "tracker.tracking",
        "tracker.kernels.contours",
        "tracker.evidence.similarity.chamfer",
    } <= set(modules)
    assert modules["tracker.evidence.similarity"].package
    assert not modules["tracker.cameras.rig"].package


def test_there_are_few_rooms() -> None:
    """What stands beside them is the package itself, and what is compiled."""
    entries = {path.stem.partition(".")[0] for path in (ROOT / "tracker").iterdir() if not path.name.startswith(".")}
    rooms = entries - {"__init__", "__main__", "__pycache__", "_native", "_models", "py"}
    assert len(rooms) <= MAX_ROOMS, sorted(rooms)


def test_importing_the_package_loads_no_library() -> None:
    script = "import sys; before = set(sys.modules); import tracker; print(*sorted(set(sys.modules) - before))"
    loaded = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=True)
    units = {name.partition(".")[0] for name in loaded.stdout.split()}
    assert units <= {"tracker", "__future__", "importlib", "warnings"}
