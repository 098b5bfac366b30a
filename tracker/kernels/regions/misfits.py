"""Misfits of contours: how much of the lines across them lies on the wrong side."""

from __future__ import annotations

from tracker.arrays import Array, Array32, Integers
from tracker.kernels.compilation import compiled
from tracker.kernels.regions.colours import EVEN, HIDDEN, Picture, colour_at
from tracker.kernels.regions.lines import DEEPEST, Lines, Looks, Rule, inside_share, pixels_per_metre
from tracker.kernels.rows import region, sample

_EXPLAINED = 0.45
"""A line with less than this share on the wrong side explains its contour; half tells nothing. Of tracked poses 89 to
92 % of the contour is explained so, of arms anywhere else 26 % (three rendered recordings)."""

_COMPARED = 4
"""Places on either side, two steps apart, that a score looks at."""


@compiled
def _wrong_share(
    picture: Picture,
    looks: Looks,
    place: tuple[int, int, float, float, float, float],
    side: int,
    spacing: tuple[float, float, float],
) -> float:
    """How much of a line lies on the wrong side of the contour, 0 to 1; -1 where something hides the part.

    Args:
        picture, looks: colours seen and known.
        place: view, part, pixel and unit image normal of the contour sample.
        side: part seen at the first of the `SPOTS`: of all places but one it is the one that counts.
        spacing: distance of the places on the line, px; how far it may go into the part, px; `Rule.floor`.
    """
    v, p, x, y, nu, nv = place
    step, deep, floor = spacing
    inside = outside = 0.0
    n_inside = n_hidden = 0
    for k in range(_COMPARED):
        along = 1.5 + 2.0 * k
        if k == 0 or along * step < deep:
            colour = colour_at(picture, v, x - nu * along * step, y - nv * along * step)
            share = inside_share(looks, v, p, side, colour, floor)
            if share == HIDDEN:
                share = float(EVEN)
                n_hidden += 1
            inside += share
            n_inside += 1
        colour = colour_at(picture, v, x + nu * along * step, y + nv * along * step)
        share = inside_share(looks, v, p, side, colour, floor)
        outside += share if share < HIDDEN else float(EVEN)
    if 2 * n_hidden > n_inside:
        return -1.0
    return 0.5 * (1.0 - inside / (254.0 * n_inside) + outside / (254.0 * _COMPARED))


@compiled
def judged(
    picture: Picture,
    looks: Looks,
    rule: Rule,
    cameras: Array,
    place: tuple[int, int, float, float, float, float],
    point: tuple[float, float, float],
    side: int,
) -> tuple[float, float]:
    """Share of the line of a contour sample at a world point that is on the wrong side or -1, and its length, px."""
    size = pixels_per_metre(cameras[place[0]], point[0], point[1], point[2])
    step = max(size * rule.step_m, 1.0)
    spacing = step, DEEPEST * size * looks.half_extents[place[1]], rule.floor
    return _wrong_share(picture, looks, place, side, spacing), 4.0 * _COMPARED * step


@compiled
def add_misfit(length: float, wrong: float, line_px: float, p: int, misfits: Array) -> None:
    """Adds a sample of part p, unless it is hidden, and the contour it stands for, to misfits (P, 3) of a view."""
    if wrong < 0.0:
        return
    misfits[p, 0] += length
    misfits[p, 1] += length * wrong * line_px
    misfits[p, 2] += length if wrong < _EXPLAINED else 0.0


@compiled
def score_lines(
    lines: Lines,
    positions: Array32,
    points: Array32,
    parts: Integers,
    counts: Integers,
    beside: Integers,
    cameras: Array,
    misfits: Array,
) -> None:
    """How much beside the contours of many poses lies on the wrong side of them.

    Args:
        lines: what they are compared with.
        positions, points, parts, counts: of `Contours`, for B poses.
        beside: (B, V, M, 2) parts seen at the `SPOTS`.
        cameras: (V, 29) from `Rig.packed`.
        misfits: (B, V, P, 3) output: contour compared, px; times how much of the line lies on the wrong side, px;
            contour whose lines show the part inside and not outside, px.
    """
    picture, looks, wanted, rule = lines
    for b in range(len(counts)):
        for v in range(counts.shape[1]):
            if picture.layout[v, region.WIDTH] == 0:
                continue
            for m in range(counts[b, v]):
                p, length = parts[b, v, m], float(positions[b, v, m, sample.LENGTH])
                if length <= 0.0 or not wanted[p] or not looks.known[v, p]:
                    continue
                point = float(points[b, v, m, 0]), float(points[b, v, m, 1]), float(points[b, v, m, 2])
                x, y = float(positions[b, v, m, 0]), float(positions[b, v, m, 1])
                place = v, p, x, y, float(positions[b, v, m, 2]), float(positions[b, v, m, 3])
                wrong, line_px = judged(picture, looks, rule, cameras, place, point, beside[b, v, m, 0])
                add_misfit(length, wrong, line_px, p, misfits[b, v])
