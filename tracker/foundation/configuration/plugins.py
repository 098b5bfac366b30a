"""Components from outside the package: who is asked before their code runs, and whether they keep their contract."""

from __future__ import annotations

import dataclasses
import importlib
import inspect
from collections.abc import Callable
from contextvars import ContextVar
from typing import Any

from tracker.foundation.errors import ConfigError

_Ask = Callable[[str], None]

_ASK: ContextVar[_Ask | None] = ContextVar("ask", default=None)


def ask_before_plugins(ask: _Ask) -> None:
    """Has a function called with `package.module:Class` before that is imported; it may raise to forbid it."""
    _ASK.set(ask)


def plugin(use: str, contract: Any) -> type[Any]:
    """The class that `package.module:Class` names.

    Args:
        use: where it is.
        contract: the protocol that it must follow; None for any component.

    Raises:
        ConfigError: there is none, it is no component, or not one of that stage.
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
            f'use = "{use}": {fault}, as {contract.__module__} ({contract.__name__}) asks of its components'
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
    """Whether a method can be called with so many positional arguments, itself among them."""
    try:
        inspect.signature(method).bind(*range(n_arguments))
    except TypeError:
        return False
    except ValueError:  # compiled: it does not tell
        return True
    return True
