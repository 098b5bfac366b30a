"""Writing of XML files."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

from tracker.foundation.files import write_whole

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
