"""Rig layouts: calibrations as files of this and of other programs, read and written by one reader and one writer."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar, Protocol

from tracker.cameras.camera import Camera, told_end
from tracker.cameras.rig import Rig
from tracker.cameras.rig_layouts._plausible import FARTHEST_M as FARTHEST_M
from tracker.cameras.rig_layouts._plausible import (
    check_interior,
    in_metres,
    interior_remarks,
    unit_of,
    unit_remarks,
    with_terms,
)
from tracker.cameras.rig_layouts._sources import other_program, xml_tag
from tracker.foundation.configuration.components import available, find
from tracker.foundation.errors import CalibrationError, ConfigError, nearest, os_fault, shortened
from tracker.foundation.files import write_whole

_NAMED = 4
"""Cameras left out, or files, that are named; of cameras the rest is counted."""

log = logging.getLogger("tracker")


@dataclass(frozen=True)
class Listing:
    """The cameras that a file lists."""

    cameras: tuple[Camera, ...]
    """Cameras with their positions in the unit of the file."""

    left_out: Mapping[str, str] = field(default_factory=dict)
    """Cameras that cannot be used, by name, and why."""

    remarks: tuple[str, ...] = ()
    """Warnings for users of the rig."""

    unit: str = "m"
    """Unit of the cameras' positions: the file's own, else that of the program that writes such files."""

    no_unit: str = ""
    """Why its lengths have no unit, if so: the user must give it."""


class Layout(Protocol):
    """A component that knows one way to write a rig down."""

    endings: ClassVar[tuple[str, ...]]
    """Endings of the file it is written to; none if it is a folder."""

    shape: ClassVar[str]
    """Mark of such a file, for messages."""

    terms: ClassVar[int]
    """Distortion coefficients that it can hold, 4, 5 or 8; lenses with more are fitted before `contents`."""

    def detects(self, path: Path) -> bool:
        """Whether an existing file or folder has this layout; each has one at most."""
        ...

    def read(self, path: Path, size: tuple[int, int] | None) -> Listing:
        """Reads the cameras, lengths in the unit that the listing tells.

        Args:
            path: what `detects` has accepted.
            size: width and height of the images, px, if the layout lacks them.

        Raises:
            CalibrationError: names the camera, what was found and what was expected.
        """
        ...

    def contents(self, rig: Rig) -> dict[str, bytes]:
        """Files to write: content by file name in the folder; for a single file, under the name "".

        Raises:
            CalibrationError: the layout cannot hold this rig.
        """
        ...


@dataclass(frozen=True)
class RigFile:
    """A rig as read, and what to know of its file."""

    rig: Rig
    layout: str
    left_out: Mapping[str, str]
    remarks: tuple[str, ...]
    unit: str = "m"
    """Unit assumed for lengths in the file."""

    def told(self) -> tuple[str, ...]:
        """Warnings for users of the rig, line by line; cameras left out for one reason are named together."""
        return (*_reasons(self.left_out), *self.remarks)


def _reasons(left_out: Mapping[str, str]) -> list[str]:
    lines = []
    for why in dict.fromkeys(left_out.values()):
        names = [name for name, reason in left_out.items() if reason == why]
        more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
        named = ", ".join(f'"{name}"' for name in names[:_NAMED])
        lines.append(f"left out: {named}{more}: {why}")
    return lines


def read_rig(path: Path, size: tuple[int, int] | None = None, units: str | None = None, scale: float = 1.0) -> RigFile:
    """Reads a rig in any layout; path and content decide.

    Args:
        path: a file or a folder; `bodytrack rig convert --help` lists the layouts.
        size: width and height of the images, px, if the layout lacks them (EasyMocap).
        units: of the lengths in the file, `m`, `cm` or `mm`; None for what the file or its program says.
        scale: factor of lengths, for files whose lengths have no unit.

    Raises:
        CalibrationError: it is missing, of no known layout or wrong, or such a rig cannot be; path and camera are
            named.
    """
    use, layout = _detected(path)
    try:
        listing = layout.read(path, size)
        if not listing.cameras and listing.left_out:
            raise CalibrationError(f"no camera can be used; {'; '.join(_reasons(listing.left_out))}")
        stated = units is not None or scale != 1
        if listing.no_unit and not stated:
            raise CalibrationError(
                f"{listing.no_unit}, or tell what its lengths are in metres: `bodytrack rig convert {path} rig.toml "
                "--units m --scale METRES`"
            )
        unit = listing.unit if units is None else unit_of(units)
        cameras = in_metres(listing.cameras, unit, scale)
        far = unit_remarks(cameras, unit, path, stated) if cameras else ()
        rig = Rig(cameras)
        for camera in rig.cameras:
            check_interior(camera)
        remarks = *listing.remarks, *interior_remarks(rig.cameras), *far
    except CalibrationError as error:
        raise CalibrationError(f"{path}: {error}") from error
    except OSError as error:  # of a file that it names
        raise CalibrationError(f"{path}: {os_fault(error)}") from error
    ends = [told for camera in rig.cameras if (told := told_end(camera))]
    return RigFile(rig, use, listing.left_out, (*remarks, *ends), unit)


def _detected(path: Path) -> tuple[str, Layout]:
    """The layout of a file or folder, and its name.

    Raises:
        CalibrationError: it is missing, of another program, or of no known layout.
    """
    layouts = {use: _layout(use) for use in available("rig_layouts")}
    if not path.exists():
        raise CalibrationError(f"{path}: no such file or folder")
    try:
        other = other_program(path)
        use = None if other else next((use for use, layout in layouts.items() if layout.detects(path)), None)
        if use is not None:
            return use, layouts[use]
        files = [p for p in sorted(path.iterdir()) if not other_program(p)] if path.is_dir() else []
        inside = [p.name for p in files if any(layout.detects(p) for layout in layouts.values())]
    except OSError as error:
        raise CalibrationError(f"{path}: {os_fault(error)}") from error
    if other or inside:
        named = f"give the path of the calibration in this folder: {', '.join(inside[:_NAMED])}" if inside else ""
        raise CalibrationError(f"{path}: {'; or '.join(line for line in (other, named) if line)}")
    shapes = "; ".join(layout.shape for layout in layouts.values())
    found = f" (XML of <{shortened(tag)}>)" if (tag := xml_tag(path)) else ""
    raise CalibrationError(f"{path}: not a calibration that is known{found}, expected {shapes}")


def load_rig(path: Path, views: tuple[str, ...] = ()) -> Rig:
    """The rig of a file in any layout; cameras that are left out, and what else is to be known, are logged.

    Args:
        path: as for `read_rig`.
        views: cameras to take, in this order; empty for all.

    Raises:
        CalibrationError: as of `read_rig`, or a view is not in the file or cannot be used.
    """
    found = read_rig(path)
    for name in views:
        if name in found.left_out:
            raise CalibrationError(f'{path}: camera "{name}" {found.left_out[name]}')
    for line in found.remarks if views else found.told():
        log.warning("%s: %s", path, line)
    return found.rig.select(views) if views else found.rig


def save_rig(rig: Rig, path: Path, layout: str | None = None) -> tuple[str, ...]:
    """Writes a rig; every file is replaced as a whole, so that nothing half-written stays.

    Args:
        rig: the cameras.
        path: a file, or a folder for layouts that are one.
        layout: name of the layout; None for the first one that is written to such a file, `.toml` as Anipose does.

    Returns:
        Loss by the layout: lenses with more terms of distortion than it holds are fitted to fewer.

    Raises:
        ConfigError: there is no such layout, or it is not written to such a file.
        CalibrationError: the layout cannot hold this rig.
    """
    chosen = _layout(layout or _layout_of(path))
    if chosen.endings and not path.name.lower().endswith(chosen.endings):
        raise ConfigError(f"{path}: this layout is written to a file that ends in {' or '.join(chosen.endings)}")
    if not chosen.endings and path.is_file():
        raise ConfigError(f"{path}: this layout is a folder, and a file is there: choose another name")
    fitted = [with_terms(camera, chosen.terms) for camera in rig.cameras]
    for name, content in chosen.contents(Rig(tuple(camera for camera, _ in fitted))).items():
        file = path / name if name else path
        file.parent.mkdir(parents=True, exist_ok=True)
        write_whole(file, content)
    return tuple(told for _, told in fitted if told)


def _layout(use: str) -> Layout:
    if ":" not in use and use not in available("rig_layouts"):
        raise ConfigError(f'no layout "{use}"; {nearest(use, available("rig_layouts"))}')
    layout: Layout = find("rig_layouts", use)()
    return layout


def _layout_of(target: Path) -> str:
    names = available("rig_layouts")
    for use in names:
        if _layout(use).endings and target.name.lower().endswith(_layout(use).endings):
            return use
    raise ConfigError(f"{target}: its name does not show the layout; name it: {', '.join(names)}")
