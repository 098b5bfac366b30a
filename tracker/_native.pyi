"""The extension that native/ is built into: compiled inner loops, without the interpreter's lock.

The files of `tracker.kernels` that call them say what arguments are. Arrays are C-contiguous, of exactly these numbers
and shapes; the others raise TypeError or ValueError with the argument's name.
"""

from tracker.arrays import Array, Array32, Integers, Mask

SOURCES: str
"""Digest of what it was built from, see `tracker.native_sources`."""

# contours/
def chamfer_lookup(flat: Array32, regions: Integers, v: int, x: float, y: float, outside: float) -> float: ...
def robust_mean(distances: Array32, weights: Array32, n: int, theta: float, reject: bool) -> float: ...
def directed_distances(
    positions: Array32,
    counts: Integers,
    flat: Array32,
    regions: Integers,
    scene: Array32,
    first: Integers,
    theta: float,
    reject: bool,
    distances: Array,
) -> None: ...
def edge_shares(
    positions: Array32,
    parts: Integers,
    counts: Integers,
    flat: Array32,
    regions: Integers,
    scene: Array32,
    first: Integers,
    reach: Array32,
    near_px: tuple[float, float],
    sums: Array,
) -> None: ...
def trace_contours(
    placements: Array,
    shapes: Array,
    grids: Array32,
    planes: Array32,
    layout: tuple[int, int],
    bounds: Array,
    cameras: Array,
    sizes: Array,
    spacing: tuple[float, float],
    exact: bool,
    positions: Array32,
    points: Array32,
    parts: Integers,
    between: Mask,
    counts: Integers,
) -> int: ...
def trace_still(
    placements: Array,
    still: Mask,
    shapes: Array,
    grids: Array32,
    planes: Array32,
    layout: tuple[int, int],
    bounds: Array,
    cameras: Array,
    sizes: Array,
    spacing: tuple[float, float],
    samples: Array32,
    counts: Integers,
) -> None: ...
def score_poses(
    placements: Array,
    shapes: Array,
    grids: Array32,
    planes: Array32,
    layout: tuple[int, int],
    bounds: Array,
    cameras: Array,
    sizes: Array,
    spacing: tuple[float, float],
    flat: Array32,
    regions: Integers,
    scene: Array32,
    first: Integers,
    rule: tuple[float, bool],
    moving: Mask,
    samples: Array32,
    counts: Integers,
    distances: Array,
) -> None: ...
def match_oriented(
    positions: Array32, counts: Integers, scene: Array32, first: Integers, gate: tuple[float, float], pairs: Integers
) -> int: ...
def normal_equations(
    pairs: Integers,
    positions: Array32,
    points: Array32,
    parts: Integers,
    ends: Integers,
    scene: Array32,
    cameras: Array,
    twists: Array,
    moves: Mask,
    px_per_observation: float,
    robust_px: float,
    matrix: Array,
    vector: Array,
) -> tuple[float, float]: ...

# movements/
def direction_gaps(queried: Array32, known: Array32, gaps: Array32) -> None: ...
def warp_sequence(
    gaps: Array32, first: Integers, repeats: Mask, slack: Integers, unknown: float, entry: float, found: Integers
) -> float: ...
