"""Text files of other programs: TRC and XML."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from tracker.foundation.arrays import Array
from tracker.foundation.files import write_whole


def trc_text(title: str, names: Sequence[str], times_s: Array, interval_s: float, points: Array) -> bytes:
    """The content of a TRC file.

    Args:
        title: what its first line calls it.
        names: of the markers.
        times_s: (T,) of the frames.
        interval_s: usual time from one frame to the next.
        points: (T, M, 3) metres; NaN where there is none.
    """
    rate, n_frames = f"{1 / interval_s:.6g}", str(len(points))
    lines = [
        f"PathFileType\t4\t(X/Y/Z)\t{title}",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames",
        "\t".join([rate, rate, n_frames, str(len(names)), "m", rate, "1", n_frames]),
        "Frame#\tTime\t" + "\t\t\t".join(names) + "\t\t",
        "\t\t" + "\t".join(f"{axis}{k}" for k in range(1, len(names) + 1) for axis in "XYZ"),
        "",
    ]
    for k, (time_s, row) in enumerate(zip(times_s, points.reshape(len(points), -1), strict=True), start=1):
        # An empty cell breaks OpenSim.
        cells = ("NaN" if np.isnan(value) else f"{value:.6f}" for value in row)
        lines.append(f"{k}\t{time_s:.6f}\t" + "\t".join(cells))
    return ("\n".join(lines) + "\n").encode()


# Writing of XML files.

Node = ElementTree.Element


def child(parent: Node, tag: str, text: str = "", **attributes: str) -> Node:
    """Adds an element with a text, or none."""
    node = ElementTree.SubElement(parent, tag, attributes)
    node.text = text or None
    return node


def write_xml(path: Path, root: Node) -> None:
    """Writes a file of elements, indented, as a whole."""
    ElementTree.indent(root)
    text = ElementTree.tostring(root, encoding="unicode")
    write_whole(path, f'<?xml version="1.0" encoding="UTF-8" ?>\n{text}\n')
