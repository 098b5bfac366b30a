"""Draws `docs/architecture.svg`: the folders of tracker/, layer above layer, and which of them import which."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape

ROOT = Path(__file__).resolve().parents[1]
PICTURE = ROOT / "docs" / "architecture.svg"

LAYERS = (
    "basics", "nouns", "stages", "points, surfaces", "comparing", "one pose", "all frames", "applications", "a run",
    "terminal",
)  # fmt: skip
"""What the layers of tests/modules.py are called, the lowest one first."""

_FREE = 2
"""So many of the lowest layers everybody may use: no line leads there."""

# Sizes of the picture, px.
_WIDTH, _LEFT, _ROW, _BOX, _HIGH = 1180, 130, 84, 116, 30

_STYLE = (
    "text{font:14px sans-serif;fill:#223}.layer{font-style:italic;fill:#667}.box{fill:#e8eef4;stroke:#567}"
    ".way{fill:none;stroke:#89a;stroke-width:1.3}.row{fill:#fafbfc}"
)


def main() -> None:
    """Writes the picture."""
    PICTURE.write_text(drawn(), encoding="utf-8")


def drawn() -> str:
    """The picture, SVG."""
    law = _law()
    rows = [sorted({unit for unit in units.split() if unit in _folders()}) for units in law.LAYERS]
    free = {name for row in rows[:_FREE] for name in row}
    ways = shortest_ways(pair for pair in imports_of_folders(law) if pair[1] not in free)
    _sort(rows, ways)
    places = {name: place for n, row in enumerate(reversed(rows)) for name, place in _placed(row, n)}
    height = _ROW * len(rows)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH} {height}" role="img">',
        "<title>Folders of tracker/ in ten layers; lines lead down to what a folder imports</title>",
        '<marker id="to" viewBox="0 0 8 8" refX="8" refY="4" markerWidth="7" markerHeight="7" orient="auto">',
        '<path d="M0 0L8 4L0 8z" fill="#89a"/></marker>',
        f'<style>{_STYLE}</style><rect width="{_WIDTH}" height="{height}" fill="#fff"/>',
    ]
    for n, title in enumerate(reversed(LAYERS)):
        if n % 2:
            parts.append(f'<rect class="row" y="{n * _ROW}" width="{_WIDTH}" height="{_ROW}"/>')
        parts.append(f'<text class="layer" x="10" y="{n * _ROW + _ROW // 2 + 5}">{escape(title)}</text>')
    parts += [_way(places[low], places[high]) for high, low in sorted(ways)]
    parts += [_box(name, *place) for name, place in sorted(places.items())]
    return "\n".join([*parts, "</svg>", ""])


def imports_of_folders(law: Any) -> set[tuple[str, str]]:
    """Pairs of folders, the first of which imports from the second."""
    modules, folders = law.modules_of_the_project(), _folders()
    pairs = {
        (law.unit_of(module.name), law.unit_of(target))
        for module in modules.values()
        if module.name.startswith("tracker.")
        for target, _ in law.imported(module, modules)
        if target.startswith("tracker.")
    }
    return {(high, low) for high, low in pairs if high != low and {high, low} <= folders}


def shortest_ways(pairs: Iterable[tuple[str, str]]) -> set[tuple[str, str]]:
    """Those pairs that no way through a third folder tells as well."""
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
    """The module of the tests that says which layer a folder belongs to."""
    spec = importlib.util.spec_from_file_location("layers_of_the_law", ROOT / "tests" / "modules.py")
    if spec is None or spec.loader is None:
        raise SystemExit("no tests/modules.py: draw in a checkout of the project")
    law = importlib.util.module_from_spec(spec)
    # dataclasses look their module up
    importlib.import_module("sys").modules[spec.name] = law
    spec.loader.exec_module(law)
    return law


def _folders() -> set[str]:
    return {path.parent.name for path in (ROOT / "tracker").glob("*/__init__.py")}


def _sort(rows: list[list[str]], ways: set[tuple[str, str]]) -> None:
    """Sorts each row, from the lowest one up, by where in the rows below lies what its folders import."""
    at: dict[str, float] = {}
    for row in rows:
        lows = {name: [at[low] for high, low in sorted(ways) if high == name and low in at] for name in row}
        row.sort(key=lambda name: sum(lows[name]) / len(lows[name]) if lows[name] else 0.5)
        at |= {name: (k + 0.5) / len(row) for k, name in enumerate(row)}


def _placed(row: list[str], n: int) -> Iterator[tuple[str, tuple[float, float]]]:
    """Middles of boxes."""
    step = (_WIDTH - _LEFT) / len(row)
    return ((name, (_LEFT + step * (k + 0.5), n * _ROW + _ROW / 2)) for k, name in enumerate(row))


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
    box = f'<rect class="box" x="{x - _BOX / 2:.0f}" y="{y - _HIGH / 2:.0f}" width="{_BOX}" height="{_HIGH}" rx="4"/>'
    return f'{box}<text x="{x:.0f}" y="{y + 5:.0f}" text-anchor="middle">{escape(name)}</text>'


if __name__ == "__main__":
    main()
