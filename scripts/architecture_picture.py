"""Draws `docs/architecture.svg`: the rooms of tracker/, one above the other, and which of them import which."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape

ROOT = Path(__file__).resolve().parents[1]
PICTURE = ROOT / "docs" / "architecture.svg"

_FREE = 2
"""So many of the lowest layers everybody may use: no line leads there."""

# Sizes of the picture, px.
_WIDTH, _ROW, _BOX, _HIGH = 900, 78, 430, 46

_STYLE = (
    "text{font:bold 15px sans-serif;fill:#223}.inside{font:11px sans-serif;fill:#556}.box{fill:#e8eef4;stroke:#567}"
    ".way{fill:none;stroke:#89a;stroke-width:1.3}"
)


def main() -> None:
    """Writes the picture."""
    PICTURE.write_text(drawn(), encoding="utf-8")


def drawn() -> str:
    """The picture, SVG."""
    law = _law()
    rows = [row for units in law.LAYERS if (row := [unit for unit in units.split() if unit in _rooms()])]
    free = {name for row in rows[:_FREE] for name in row}
    ways = shortest_ways(pair for pair in imports_of_rooms(law) if pair[1] not in free)
    places = {name: place for n, row in enumerate(reversed(rows)) for name, place in _placed(row, n)}
    height = _ROW * len(rows)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH} {height}" role="img">',
        "<title>The rooms of tracker/; lines lead down to what a room imports</title>",
        '<marker id="to" viewBox="0 0 8 8" refX="8" refY="4" markerWidth="7" markerHeight="7" orient="auto">',
        '<path d="M0 0L8 4L0 8z" fill="#89a"/></marker>',
        f'<style>{_STYLE}</style><rect width="{_WIDTH}" height="{height}" fill="#fff"/>',
    ]
    parts += [_way(places[low], places[high]) for high, low in sorted(ways)]
    parts += [_box(name, *place) for name, place in sorted(places.items())]
    return "\n".join([*parts, "</svg>", ""])


def imports_of_rooms(law: Any) -> set[tuple[str, str]]:
    """Pairs of rooms, the first of which imports from the second."""
    modules, rooms = law.modules_of_the_project(), _rooms()
    pairs = {
        (law.unit_of(module.name), law.unit_of(target))
        for module in modules.values()
        if module.name.startswith("tracker.")
        for target, _ in law.imported(module, modules)
        if target.startswith("tracker.")
    }
    return {(high, low) for high, low in pairs if high != low and {high, low} <= rooms}


def shortest_ways(pairs: Iterable[tuple[str, str]]) -> set[tuple[str, str]]:
    """Those pairs that no way through a third room tells as well."""
    below: dict[str, set[str]] = {}
    for high, low in pairs:
        below.setdefault(high, set()).add(low)

    def reached(name: str) -> set[str]:
        return set().union(*({low} | reached(low) for low in below.get(name, ())))

    return {
        (high, low)
        for high, lows in below.items()
        for low in lows
        if not any(low in reached(other) for other in lows - {low})
    }


def _law() -> Any:
    """The module of the tests that says which layer a room belongs to."""
    spec = importlib.util.spec_from_file_location("layers_of_the_law", ROOT / "tests" / "modules.py")
    if spec is None or spec.loader is None:
        raise SystemExit("no tests/modules.py: draw in a checkout of the project")
    law = importlib.util.module_from_spec(spec)
    # dataclasses look their module up
    importlib.import_module("sys").modules[spec.name] = law
    spec.loader.exec_module(law)
    return law


def _rooms() -> set[str]:
    return {path.parent.name for path in (ROOT / "tracker").glob("*/__init__.py")}


def _inside(room: str) -> list[str]:
    """The folders in a room."""
    return sorted(path.parent.name for path in (ROOT / "tracker" / room).glob("*/__init__.py"))


def _placed(row: list[str], n: int) -> Iterator[tuple[str, tuple[float, float]]]:
    """Middles of boxes."""
    step = _WIDTH / len(row)
    return ((name, (step * (k + 0.5), n * _ROW + _ROW / 2)) for k, name in enumerate(row))


def _way(low: tuple[float, float], high: tuple[float, float]) -> str:
    """A line from the lower side of a box down to another one, or from side to side within a row."""
    (x, y), (to_x, to_y) = high, low
    if y == to_y:
        side = _BOX / 2 if to_x > x else -_BOX / 2
        return f'<path class="way" marker-end="url(#to)" d="M{x + side:.0f} {y:.0f}L{to_x - side:.0f} {to_y:.0f}"/>'
    y, to_y = y + _HIGH / 2, to_y - _HIGH / 2
    bend = (to_y - y) / 2
    curve = f"M{x:.0f} {y:.0f}C{x:.0f} {y + bend:.0f} {to_x:.0f} {to_y - bend:.0f} {to_x:.0f} {to_y:.0f}"
    return f'<path class="way" marker-end="url(#to)" d="{curve}"/>'


def _box(name: str, x: float, y: float) -> str:
    """A room, with the folders in it below its name."""
    box = f'<rect class="box" x="{x - _BOX / 2:.0f}" y="{y - _HIGH / 2:.0f}" width="{_BOX}" height="{_HIGH}" rx="4"/>'
    inside = escape(", ".join(_inside(name)))
    lines = f'<text x="{x:.0f}" y="{y - 3:.0f}" text-anchor="middle">{escape(name)}</text>'
    return f'{box}{lines}<text class="inside" x="{x:.0f}" y="{y + 14:.0f}" text-anchor="middle">{inside}</text>'


if __name__ == "__main__":
    main()
