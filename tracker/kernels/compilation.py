"""How kernels are compiled, and where their machine code is kept.

numba keeps machine code on disk and compiles anew what was changed itself, but not what calls it: code of two versions
would be mixed. Here the code of a file lies in a folder named after the digest of all sources that it is made of, the
file and whatever of this package it imports. Code of other sources is then never found, wherever it is kept, and
nothing need be deleted for it.
"""

from __future__ import annotations

import ast
import functools
import hashlib
import importlib.abc
import logging
import os
import shutil
import sys
import tempfile
import threading
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, TypeVar, overload

import numba

log = logging.getLogger("tracker")

_PACKAGE = __name__.partition(".")[0]
_FOLDER = f"{_PACKAGE}-kernels"
_DIGITS = 16
"""Of a digest in a folder's name: two versions of a file share one by chance in 1 of 2^64 cases."""

_Kernel = TypeVar("_Kernel", bound=Callable[..., Any])

_settings: Any = numba.config
_deciding = threading.Lock()


@overload
def compiled(function: _Kernel) -> _Kernel: ...
@overload
def compiled(*, fastmath: bool | set[str]) -> Callable[[_Kernel], _Kernel]: ...
def compiled(function: Any = None, *, fastmath: bool | set[str] = False) -> Any:
    """Decorates a kernel: machine code without the interpreter's lock, kept on disk, x / 0 as numpy has it.

    Args:
        function: a plain function of a module; None where options are given.
        fastmath: what may be assumed of floating point numbers, as numba and LLVM name it. Never left to numba, which
            lets a kernel inherit it from whichever caller is compiled first: results would depend on that order.
    """
    if function is None:
        return functools.partial(compiled, fastmath=fastmath)
    options: Any = {"nogil": True, "error_model": "numpy", "fastmath": fastmath}
    folder = _folder_of(function.__module__)
    if folder is None:
        return numba.njit(**options)(function)
    with _deciding:  # numba asks for the folder here, and only here
        before, _settings.CACHE_DIR = _settings.CACHE_DIR, str(folder)
        try:
            return numba.njit(cache=True, **options)(function)
        finally:
            _settings.CACHE_DIR = before


@functools.cache
def _folder_of(module: str) -> Path | None:
    """Where machine code of a module is kept; None if it cannot be."""
    sources, kept = sources_of(module), code_folder()
    if kept is None or not all(sources.values()):
        return None
    digest = hashlib.sha256("\0".join(f"{name}\0{text}" for name, text in sorted(sources.items())).encode())
    return kept / f"{module.rpartition('.')[2]}-{digest.hexdigest()[:_DIGITS]}"


def sources_of(module: str) -> dict[str, str]:
    """The sources that a module is made of: its own, and those of this package that it imports, by whatever way.

    Args:
        module: name of an imported, or just importing, module.

    Returns:
        Texts by module; an empty one if there is no source.
    """
    found: dict[str, str] = {}
    waiting = [module]
    while waiting:
        name = waiting.pop()
        if name not in found:
            found[name] = _source(name)
            waiting += _imported(name)
    return found


@functools.cache
def _source(module: str) -> str:
    loader = getattr(sys.modules[module].__spec__, "loader", None)
    text = (loader.get_source(module) or "") if isinstance(loader, importlib.abc.InspectLoader) else ""
    # the extension tells what it was built from
    built_from = getattr(sys.modules[module], "SOURCES", "")
    return text or (f"# {built_from}" if built_from else "")


@functools.cache
def _imported(module: str) -> tuple[str, ...]:
    """Modules of this package that one imports."""
    names: list[str] = []
    for node in ast.walk(ast.parse(_source(module))):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            names += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
    return tuple(name for name in names if name.partition(".")[0] == _PACKAGE and name in sys.modules)


@functools.cache
def code_folder() -> Path | None:
    """The folder of the machine code: NUMBA_CACHE_DIR if set, else beside the kernels, else the user's; None if none.

    What was tried in vain is logged.
    """
    refused: list[str] = []
    for folder in _candidates():
        if _is_writable(folder):
            if refused:
                log.info("kernels are kept in %s, since %s cannot be written", folder, " and ".join(refused))
            return folder
        refused.append(str(folder))
    log.warning(
        "kernels are compiled anew in every run, since %s cannot be written; set NUMBA_CACHE_DIR to a folder that can",
        " and ".join(refused),
    )
    return None


def _candidates() -> Iterator[Path]:
    if _settings.CACHE_DIR:
        yield Path(_settings.CACHE_DIR) / _FOLDER
    yield Path(__file__).parent / "__pycache__"
    own = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")  # noqa: PTH111  (never fails)
    yield Path(own) / _FOLDER


def _is_writable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def forget_others(modules: Iterable[str]) -> int:
    """Deletes the machine code of all but some imported modules; returns the bytes freed."""
    kept, freed = code_folder(), 0
    if kept is None:
        return 0
    current = {_folder_of(module) for module in modules}
    for folder in kept.glob(f"*-{'[0-9a-f]' * _DIGITS}"):
        if folder not in current:
            freed += sum(file.stat().st_size for file in folder.rglob("*") if file.is_file())
            shutil.rmtree(folder, ignore_errors=True)
    return freed
