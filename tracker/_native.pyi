"""The extension that native/ is built into: compiled inner loops, without the interpreter's lock.

The files of `tracker.kernels` that call them say what arguments are. Arrays are of exactly these numbers and shapes;
others raise TypeError or ValueError with the argument's name. Those whose rows lie apart are copied.
"""

import numpy as np
from numpy.typing import NDArray

from tracker.foundation.arrays import Array, Array32, Image, Integers, Mask, Numbers16

Pixels = NDArray[np.int32]
Slopes = NDArray[np.int16]

SOURCES: str
"""Digest of what it was built from, see `tracker.foundation.native_sources`."""

# adjustment/: named tuples of `tracker.kernels.adjustment`
def project_with_slopes(
    camera: Array, point: Array, velocity: Array, by_camera: Array, by_point: Array
) -> tuple[float, float, bool]: ...
def bundle_residuals(cameras: Array, points: Array, observed: tuple[object, ...], residuals: Array) -> None: ...
def reduce_normal(
    cameras: Array,
    objects: tuple[object, ...],
    observed: tuple[object, ...],
    damping: float,
    reduced: tuple[object, ...],
) -> None: ...
def intersect_rays(
    cameras: Array, pixels: Array, variances: Array, points: Array, covariances: Array, residuals: Array
) -> None: ...

# descent/: named tuples of `tracker.kernels.descent`
def descend(
    model: tuple[object, ...],
    stage: tuple[object, ...],
    kinds: tuple[object, ...],
    rule: tuple[object, ...],
    gates: Array,
    q: Array,
    matrix: Array,
    vector: Array,
) -> tuple[float, float, int]: ...

# lens and projection, for tests of the kernels
def undistort(camera: Array, x: float, y: float) -> tuple[float, float]: ...
def project_point(camera: Array, x: float, y: float, z: float) -> tuple[float, float, float]: ...
def project_grid(placement: Array, grid: Array32, camera: Array, pixels: Array) -> float: ...

# body/: named tuples of `tracker.kernels.body`
def chain_transforms(
    poses: Array, rotates: Mask, axes: Array, points: Array, parents: Integers, motions: Array
) -> None: ...
def twists_in_world(
    motions: Array, rotates: Mask, axes: Array, points: Array, parents: Integers, twists: Array
) -> None: ...
def sum_collisions(placements: Array, shapes: Array, pairs: Integers, sums: Array) -> None: ...
def depth(shape: Array, u: float, v: float, w: float) -> float: ...
def match_keypoints(
    points: Array,
    cameras: Array,
    detected: tuple[object, ...],
    n_limbs: int,
    reach: tuple[float, float],
    matches: tuple[object, ...],
) -> None: ...
def meet_parts(placements: Array, shapes: Array, centre: Array, rays: Array, parts: Integers, found: Array) -> None: ...
def gaps_of(placements: Array, cameras: Array, carried: tuple[object, ...], most_m: float, gaps: Array) -> None: ...
def residuals_of(
    placements: Array, cameras: Array, carried: tuple[object, ...], slide_m: float, found: Array
) -> None: ...
def anchor_equations(
    placements: Array,
    carried: tuple[object, ...],
    found: Array,
    weights: Array,
    ends: Integers,
    twists: Array,
    moves: Mask,
    matrix: Array,
    vector: Array,
) -> tuple[float, float]: ...

# contours/
def moving_parts(placements: Array, moving: Mask) -> None: ...
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

# images/
def marked(points: Array32, picture: Image, origin: tuple[int, int], marks: Mask) -> None: ...
def expected_distances(
    edges: Array32, directions: Array32, samples: Array32, bend_px: float, most_px: float, distances: Array32
) -> None: ...
def mark_appearance(
    image: Image,
    corner: tuple[int, int],
    weights: tuple[int, int, int],
    chroma: Image,
    slopes: tuple[int, int, int],
    grey: bool,
    looks: Image,
) -> None: ...
def count_coloured(image: Image, spacing: int, level: int) -> int: ...
def mark_changes(image: Image, plate: Image, origin: tuple[int, int], level: float, moving: Image) -> None: ...
def median_level(picture: Image) -> float: ...
def large_regions(labels: Pixels, n_labels: int, least: float, mask: Mask) -> None: ...
def without_shadows(
    now: Image,
    plate: Image,
    origin: tuple[int, int],
    moving: Image,
    rule: tuple[float, float, float, float, float, float],
    mask: Image,
) -> None: ...
def dominant_modes(pile: Image, reach: int, plate: Image, counts: Image, rivals: Image) -> None: ...
def chamfer_distances(pixels: Pixels, reach: float, distance: Array32) -> None: ...
def strongest_slopes(image: Image, dx: Slopes, dy: Slopes) -> None: ...
def link_edges(edges: Image, points: Pixels, starts: Pixels) -> int: ...
def split_segments(
    points: Pixels, starts: Pixels, n_chains: int, rule: tuple[int, float, int], segments: Pixels
) -> int: ...
def edge_profile(points: Pixels, dx: Slopes, dy: Slopes, edges: Array32, directions: Array32) -> None: ...
def trace_segments(
    edges: Image,
    dx: Slopes,
    dy: Slopes,
    rule: tuple[int, float, int],
    near: Image,
    positions: Array32,
    directions: Array32,
    segments: Integers,
) -> tuple[int, int]: ...
def block_ratios(now: Image, plate: Image, size: int, step: int, ratios: Array) -> None: ...
def smooth_surface(ratios: Array, least: float, n_steps: int, stride: int, surface: Array) -> None: ...
def connected_blocks(departures: Array, most: float, reached: Mask) -> None: ...
def relight(picture: Image, gains: Array32, size: float, geometry: tuple[int, int, int], lit: Image) -> None: ...

# movements/
def direction_gaps(queried: Array32, known: Array32, weights: Array32, gaps: Array32) -> None: ...
def warp_sequence(
    gaps: Array32, first: Integers, repeats: Mask, slack: Integers, unknown: float, entry: float, found: Integers
) -> float: ...

# patches/
SplineImage = tuple[Array32, int, int]
Rule = tuple[int, int, float, float, float, bool]
Noise = tuple[float, float, Array32]

def reaches_out(warp: Array, half: int, width: int, height: int) -> bool: ...
def sample_patch(image: SplineImage, warp: Array, half: int, values: Array32) -> None: ...
def sample_gradient(
    image: SplineImage, warp: Array, half: int, values: Array32, dx_of: Array32, dy_of: Array32
) -> None: ...
def sample_whole_pixels(
    image: SplineImage, warp: Array, half: int, values: Array32, dx_of: Array32, dy_of: Array32
) -> None: ...
def match_patches(
    template: SplineImage, search: SplineImage, at: Array, found: Array, ended: Integers, rule: Rule, noise: Noise
) -> None: ...
def cut_keys(image: SplineImage, centres: Integers, half: int, keys: Array32, inside: Mask) -> None: ...
def match_keys(
    keys: Array32, which: Integers, search: SplineImage, found: Array, ended: Integers, rule: Rule, noise: Noise
) -> None: ...
def bending_shifts(offsets: Array, rows: Integers, affine: Array, known: Mask, half: int, shifts: Array) -> None: ...
def stretch(found: Array) -> float: ...
def push_all(
    keys: Array,
    items: Integers,
    count: Integers,
    grid: tuple[int, int, int],
    found: Array,
    ended: Integers,
    seeds: Integers,
) -> None: ...
def grow(
    template: SplineImage,
    search: SplineImage,
    grid: tuple[int, int, int],
    found: Array,
    ended: Integers,
    seeds: Integers,
    tries: Integers,
    keys: Array,
    items: Integers,
    count: Integers,
    usual: Rule,
    larger: Rule,
    noise: Noise,
    limits: tuple[float, float, float, float],
    budget: int,
    most_tries: int,
) -> int: ...

# pictures/
def fill_parts(placements: Array, grids: Array32, layout: tuple[int, int], camera: Array, mask: Mask) -> None: ...
def cover_still(
    placements: Array,
    still: Mask,
    grids: Array32,
    layout: tuple[int, int],
    cameras: Array,
    regions: Integers,
    pictures: Array32,
    covered: Mask,
    sums: Array,
) -> None: ...
def covered_sums(
    placements: Array,
    moving: Mask,
    grids: Array32,
    layout: tuple[int, int],
    cameras: Array,
    regions: Integers,
    pictures: Array32,
    covered: Mask,
    base: Array,
    sums: Array,
) -> None: ...
def cover_shares(mask: Mask, factor: int, shares: Array32) -> None: ...
def covered_by_rods(starts: Array32, ways: Array32, reach_px: Array32, pixels: Array32, shares: Array) -> None: ...
def rasterize(pixels: Array, depths: Array, triangles: Integers, origin: tuple[int, int], buffers: Array32) -> None: ...
def project_surfaces(placements: Array, surfaces: Array, wanted: Mask, camera: Array, seen: Array) -> None: ...
def draw_nearest(
    seen: Array, triangles: Integers, corner: tuple[int, int], depths: Array32, parts: NDArray[np.int16]
) -> None: ...
def id_contours(
    ids: Integers,
    depths: Array32,
    frame: tuple[int, int, int, int],
    camera: Array,
    solids: Array,
    contact_m: float,
    positions: Array32,
    points: Array32,
    parts: Integers,
    between: Mask,
) -> int: ...

# regions/: named tuples of `tracker.kernels.regions`
def encode(picture: Image, codes: Numbers16) -> None: ...
def learn_colours(counts: Integers, news: float, table: Array32) -> bool: ...
def tabulate_posteriors(
    tables: tuple[object, ...], rule: tuple[float, float], wanted: Mask, posteriors: Image
) -> None: ...
def find_shifts(
    picture: tuple[object, ...],
    looks: tuple[object, ...],
    samples: tuple[object, ...],
    beside: Integers,
    cameras: Array,
    wanted: Mask,
    rule: tuple[object, ...],
    shifts: Array32,
) -> None: ...
def shift_equations(
    shifts: Array32,
    samples: tuple[object, ...],
    ends: Integers,
    cameras: Array,
    twists: Array,
    moves: Mask,
    px_per_observation: float,
    matrix: Array,
    vector: Array,
) -> tuple[float, float]: ...
def score_lines(
    lines: tuple[object, ...],
    positions: Array32,
    points: Array32,
    parts: Integers,
    counts: Integers,
    beside: Integers,
    cameras: Array,
    misfits: Array,
) -> None: ...
def parts_beside(
    placements: Array,
    shapes: Array,
    bounds: Array,
    cameras: Array,
    positions: Array32,
    points: Array32,
    parts: Integers,
    counts: Integers,
    step_m: float,
    found: Integers,
) -> None: ...
def score_regions(
    placements: Array,
    shapes: Array,
    grids: Array32,
    planes: Array32,
    layout: tuple[int, int],
    bounds: Array,
    cameras: Array,
    sizes: Array,
    spacing: tuple[float, float],
    lines: tuple[object, ...],
    misfits: Array,
) -> None: ...
def learn_lines(
    picture: tuple[object, ...],
    samples: tuple[object, ...],
    beside: Integers,
    cameras: Array,
    half_extents: Array,
    useful: Mask,
    step_m: float,
    news: float,
    posteriors: Image,
    tables: tuple[object, ...],
    changed: Mask,
) -> None: ...
def longest_lines(samples: tuple[object, ...], cameras: Array, step_m: float, longest_px: Array) -> None: ...

# skins/
def trace_skins(
    placements: Array,
    part_from_rest: Array,
    mesh: tuple[object, ...],
    cameras: Array,
    sizes: Array,
    spacing: tuple[float, float, float],
    positions: Array32,
    points: Array32,
    parts: Integers,
    between: Mask,
    counts: Integers,
) -> None: ...
def fill_mesh(points: Array, faces: Integers, camera: Array, mask: Mask) -> None: ...
def see_vertices(points: Array32, normals: Array32, camera: Array32, seen: Array32, facing: Array32) -> None: ...
