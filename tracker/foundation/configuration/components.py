"""Finds components: a section has the name of a folder, in any room, and `use` names a file in it.

`use = "chamfer"` in [similarity] is tracker/evidence/similarity/chamfer.py.
"""

from __future__ import annotations

import dataclasses
import functools
import importlib
import inspect
import pkgutil
from collections.abc import Callable, Mapping
from contextvars import ContextVar
from pathlib import Path
from types import ModuleType
from typing import Annotated, Any, TypeVar, cast, dataclass_transform

import pydantic
from pydantic.dataclasses import dataclass

from tracker.foundation.errors import ConfigError, nearest
from tracker.foundation.resources import model_path

_Ask = Callable[[str], None]

_ASK: ContextVar[_Ask | None] = ContextVar("ask", default=None)


def ask_before_plugins(ask: _Ask) -> None:
    """Registers a function that is called with `package.module:Class` before its import; it may raise to forbid it."""
    _ASK.set(ask)


def plugin(use: str, contract: Any) -> type[Any]:
    """The class that `package.module:Class` names.

    Args:
        use: its module and name.
        contract: the protocol that it must follow; None for any component.

    Raises:
        ConfigError: it does not exist, is not a component, or not one of that stage.
    """
    module_name, _, class_name = use.partition(":")
    if not all(word.isidentifier() for word in (*module_name.split("."), *class_name.split("."))):
        raise ConfigError(f'use = "{use}": expected an importable "package.module:Class"')
    if (ask := _ASK.get()) is not None:
        ask(use)
    try:
        found: Any = importlib.import_module(module_name)
        for word in class_name.split("."):
            found = getattr(found, word)
    except Exception as error:  # whatever code from outside raises
        raise ConfigError(
            f'use = "{use}": {type(error).__name__}: {error}; expected an importable "package.module:Class"'
        ) from error
    if not (isinstance(found, type) and dataclasses.is_dataclass(found)):
        raise ConfigError(f'use = "{use}": not a component, expected a class made with @component')
    if contract is not None and (fault := _fault(found, contract)):
        raise ConfigError(
            f'use = "{use}": {fault}, which {contract.__module__} ({contract.__name__}) demands of its components'
        )
    return found


def _fault(found: type[Any], contract: Any) -> str:
    """What a class lacks of a protocol."""
    for name, member in vars(contract).items():
        if name.startswith("_") or not (inspect.isfunction(member) or isinstance(member, property)):
            continue
        own = getattr(found, name, None)
        if inspect.isfunction(member):
            if not callable(own):
                return f'no method "{name}", expected one'
            if not _takes(own, len(inspect.signature(member).parameters)):
                return f'the method "{name}" takes {inspect.signature(own)}, expected {inspect.signature(member)}'
        elif own is None and name not in {field.name for field in dataclasses.fields(found)}:
            return f'no field "{name}", expected one'
    return ""


def _takes(method: Any, n_arguments: int) -> bool:
    """Whether a method can be called with so many positional arguments, including itself."""
    try:
        inspect.signature(method).bind(*range(n_arguments))
    except TypeError:
        return False
    except ValueError:  # compiled: it does not tell
        return True
    return True


@dataclasses.dataclass(frozen=True)
class RelativePath:
    """Marks a field whose relative paths start at the configuration file's folder."""

    def resolved(self, text: str, folder: Path) -> str:
        """The absolute path; links to folders are followed, so that it stays right when `latest` moves on."""
        path = folder / text
        return str(path.parent.resolve() / path.name)


@dataclasses.dataclass(frozen=True)
class ModelName(RelativePath):
    """Marks a body model: the name of a bundled one, or a path that ends in .toml."""

    def resolved(self, text: str, folder: Path) -> str:
        """The absolute path.

        Raises:
            ModelError: no bundled model has the name.
        """
        return super().resolved(text, folder) if text.endswith(".toml") else str(model_path(text).resolve())


RECORDED = "median"
"""In place of a path to plates: the recording itself makes them, and a message says where it cannot."""

NO_PLATES = "none"
"""In place of a path to plates: none, not even from the recording."""


@dataclasses.dataclass(frozen=True)
class PlateSource(RelativePath):
    """Marks clean plates: a path with `{view}`, `RECORDED` or `NO_PLATES`."""

    def resolved(self, text: str, folder: Path) -> str:
        """The absolute path, or the word itself."""
        return text if text in (RECORDED, NO_PLATES) else super().resolved(text, folder)


FilePath = Annotated[Path, pydantic.Field(strict=False), RelativePath()]
"""A path; a relative one starts at the configuration file's folder."""

PathPattern = Annotated[str, RelativePath()]
ViewPaths = PathPattern | dict[str, PathPattern]
"""A path with `{view}`, or a table with the path of each view, whose files have other names than the views."""

PlatePattern = Annotated[str, PlateSource()]
"""A path with placeholders such as `{view}`; a relative one starts at the configuration file's folder."""


@dataclasses.dataclass(frozen=True)
class ReadBy:
    """Marks a field whose value a function makes from the configuration's value."""

    function: Callable[[Any, str, Path], Any]
    """Gets the value, file and section for messages, and the folder where relative paths start."""

    described: Callable[[Any], Any]
    """The inverse: a configuration's value from which the function makes the same value."""


ModelFile = Annotated[Path, pydantic.Field(strict=False), ModelName()]
"""A body model: the name of a bundled one, or a path that ends in .toml."""

_Component = TypeVar("_Component")


@dataclass_transform(frozen_default=True, kw_only_default=True, field_specifiers=(dataclasses.field, pydantic.Field))
def component(cls: type[_Component]) -> type[_Component]:
    """Makes a class a component: a frozen, strictly validated dataclass whose fields are its configuration."""
    settings = pydantic.ConfigDict(
        extra="forbid", strict=True, use_attribute_docstrings=True, arbitrary_types_allowed=True
    )
    made: Any = dataclass(frozen=True, kw_only=True, config=settings)(cls)
    for base in made.__mro__[1:]:  # pydantic reads the docstrings of the class itself only
        for name, field in getattr(base, "__pydantic_fields__", {}).items():
            made.__pydantic_fields__[name].description = made.__pydantic_fields__[name].description or field.description
    return cast("type[_Component]", made)


def standard(stage: str, use: str) -> Any:
    """A field's default: a component with its defaults, loaded when it is needed.

    Args:
        stage: folder of the package.
        use: file name in that folder.
    """
    return pydantic.Field(default_factory=lambda: find(stage, use)())


def stages() -> tuple[str, ...]:
    """The folders of components: those with a contract of the folder's name."""
    return tuple(sorted(name for name in _folders() if contract(name) is not None))


def contract(stage: str) -> Any:
    """The protocol of a stage's components, None for a folder without one."""
    return getattr(importlib.import_module(_folders()[stage]), stage.capitalize(), None)


def stage_of(module: str) -> str:
    """The folder of a module, or the module itself: the stage of its component or contract."""
    folder = module if module in _folders().values() else module.rpartition(".")[0]
    return folder.rpartition(".")[2]


@functools.cache
def _folders() -> Mapping[str, str]:
    """Name -> dotted name of every folder that may be a stage: the rooms, and the folders in them."""
    root = Path(__file__).parents[2]
    found = [*sorted(root.glob("*/*/__init__.py")), *sorted(root.glob("*/__init__.py"))]
    return {path.parent.name: ".".join(path.parent.relative_to(root.parent).parts) for path in found}


def available(stage: str) -> tuple[str, ...]:
    """Names of the components of a stage: its public files."""
    folders = tuple(importlib.import_module(_folders()[stage]).__path__)
    return _public_files(folders, tuple(Path(folder).stat().st_mtime_ns for folder in folders))


@functools.cache
def _public_files(folders: tuple[str, ...], changed_ns: tuple[int, ...]) -> tuple[str, ...]:
    """Public files of folders that were last changed at a time: a rig's layout asks for those of its stage 25 times."""
    found = pkgutil.iter_modules(folders)
    return tuple(sorted(one.name for one in found if not one.ispkg and not one.name.startswith("_")))


def find(stage: str, use: str) -> type[Any]:
    """The component class that a configuration names.

    Args:
        stage: folder of the package, for instance ``similarity``.
        use: file name in that folder, or ``my_lab.module:Class`` outside the package.

    Raises:
        ConfigError: no component has that name, or it does not fit the stage.
    """
    if ":" in use:
        return plugin(use, contract(stage))
    if use not in available(stage):
        raise ConfigError(f'use = "{use}": no such component; {nearest(use, available(stage))}')
    module = _loaded(f"{_folders()[stage]}.{use}")
    classes = [
        value
        for value in vars(module).values()
        if isinstance(value, type) and value.__module__ == module.__name__ and _is_component(value)
    ]
    if len(classes) != 1:
        raise ConfigError(f"{module.__name__} holds {len(classes)} components, expected one")
    return classes[0]


def _loaded(name: str) -> ModuleType:
    """A module of the package.

    Raises:
        ConfigError: it needs a package that a plain installation lacks.
    """
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        lacking = str(error.name).partition(".")[0]
        if lacking in ("tracker", "None"):
            raise
        use = name.rpartition(".")[2]
        raise ConfigError(f'"{use}" needs the Python package {lacking}: pip install {lacking}') from error


def _is_component(cls: type[Any]) -> bool:
    return dataclasses.is_dataclass(cls) and "__pydantic_config__" in vars(cls) and not cls.__name__.startswith("_")
