"""Body models as TOML files."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pydantic
import tomli_w

from tracker.bodies.body import BodyModel
from tracker.bodies.body.description import BodyDescription
from tracker.bodies.body.sections import SkinSection
from tracker.foundation.errors import ModelError
from tracker.foundation.files import write_whole
from tracker.foundation.source_files import toml_of


def read_description(path: Path) -> BodyDescription:
    """Reads the content of a model file, with landmarks derived from the shape if it has none.

    Raises:
        ModelError: the file is missing or wrong; the message names the entry.
    """
    try:
        found = BodyDescription.model_validate(toml_of(path, ModelError, "the body model")).with_marks()
    except pydantic.ValidationError as error:
        raise ModelError(f"{path}: {_first_fault(error)} (see models/gavrila22.toml)") from error
    return found if found.skin is None else found.model_copy(update={"skin": found.skin.beside(path.parent)})


def read_buildable(path: Path) -> BodyDescription:
    """Reads the content of a model file of which a body can be made, whatever its skin is.

    Raises:
        ModelError: the file is missing or wrong; the message names the entry.
    """
    description = read_description(path)
    try:
        description.model_copy(update={"skin": None}).build()
    except ModelError as error:
        raise ModelError(f"{path}: {error}") from error
    return description


def _first_fault(error: pydantic.ValidationError) -> str:
    first = error.errors()[0]
    where = ".".join(str(step) for step in first["loc"])
    reason = first["msg"].removeprefix("Value error, ")
    return f"{where}: {reason}" if where else reason


def save_description(description: BodyDescription, path: Path, decimals: int | None = 5) -> None:
    """Writes a model file; replaced as a whole, so that nothing half-written stays.

    Args:
        description: the body.
        path: file to write; its folder is made.
        decimals: digits after the point, 5 for a hundredth of a millimetre; None for all, so that it loads again to
            the same bits.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    if description.skin is not None:
        description = description.model_copy(update={"skin": _with_files_beside(description.skin, path)})
    content = description.model_dump(mode="json", exclude_none=True, exclude_unset=True)
    content = content if decimals is None else _rounded(content, decimals)
    write_whole(path, _INNER_ARRAY.sub(_on_one_line, tomli_w.dumps(content)))


def _with_files_beside(skin: SkinSection, model: Path) -> SkinSection:
    """The section with its files copied beside a model file: models are kept and moved with their skins.

    Raises:
        ModelError: a file cannot be read.
    """
    names = {}
    for key, source in skin.files().items():
        names[key] = f"{model.stem}_skin{Path(source).suffix}"
        try:
            content = Path(source).read_bytes()
        except OSError as error:
            raise ModelError(f"{source}: cannot read the skin: {error.strerror or error}") from error
        write_whole(model.parent / names[key], content)
    return skin.model_copy(update=names)


# An array without arrays in it, as tomli_w writes it: an entry a line.
_INNER_ARRAY = re.compile(r"\[\n([^\[\]{}]*?),?\n *\]")


def _on_one_line(array: re.Match[str]) -> str:
    # line by line: names may have blanks in them
    return f"[{' '.join(filter(None, map(str.strip, array[1].splitlines())))}]"


def _rounded(value: Any, decimals: int) -> Any:
    """Numbers to so many digits after the point, in tables and lists."""
    if isinstance(value, float):
        return round(value, decimals)
    if isinstance(value, dict):
        return {key: _rounded(entry, decimals) for key, entry in value.items()}
    if isinstance(value, list):
        return [_rounded(entry, decimals) for entry in value]
    return value


def load_body(path: Path, scale: float = 1.0) -> BodyModel:
    """Reads a body model.

    Args:
        path: a model TOML (see models/gavrila22.toml for a commented one).
        scale: every length is multiplied by it.

    Raises:
        ModelError: the file is missing or wrong; the message names the entry.
    """
    description = read_description(path)
    try:
        return description.scaled(scale).build()
    except ModelError as error:
        raise ModelError(f"{path}: {error}") from error
