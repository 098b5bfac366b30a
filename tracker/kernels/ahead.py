"""Ahead-of-time compilation of the kernels; numba keeps the machine code on disk."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any, Literal

import numpy as np

from tracker.kernels.adjustment.bundle import reduce_normal, residuals_of
from tracker.kernels.adjustment.ray_intersection import intersect_rays
from tracker.kernels.body.anchors import Carried, anchor_equations, gaps_of
from tracker.kernels.body.anchors import residuals_of as anchor_residuals
from tracker.kernels.body.keypoints import Detected, Matches, match_keypoints
from tracker.kernels.body.kinematics import chain_transforms, twists_in_world
from tracker.kernels.body.rays import meet_parts
from tracker.kernels.body.self_collision import sum_collisions
from tracker.kernels.compilation import forget_others
from tracker.kernels.contours.chamfer import directed_distances
from tracker.kernels.contours.oriented_matching import match_oriented, normal_equations
from tracker.kernels.contours.scoring import moving_parts, score_poses, trace_still
from tracker.kernels.contours.shares import edge_shares
from tracker.kernels.contours.tracing import trace_contours
from tracker.kernels.images.acceptance import expected_distances, marked
from tracker.kernels.images.appearance import mark_appearance
from tracker.kernels.images.changes import large_regions, mark_changes, median_change
from tracker.kernels.images.distance_images import chamfer_distances
from tracker.kernels.images.edge_segments import trace_segments
from tracker.kernels.images.light import block_ratios, connected_blocks, relight, smooth_surface
from tracker.kernels.images.modes import dominant_modes
from tracker.kernels.images.shadows import MARGIN, without_shadows
from tracker.kernels.images.slopes import strongest_slopes
from tracker.kernels.movements.warping import direction_gaps, warp_sequence
from tracker.kernels.patches.bending import bending_shifts
from tracker.kernels.patches.growth import grow, push_all
from tracker.kernels.patches.keys import cut_keys, key_side, match_keys
from tracker.kernels.patches.matching import N_FOUND, match_patches
from tracker.kernels.pictures.coverage import cover_shares, cover_still, covered_sums
from tracker.kernels.pictures.id_contours import id_contours
from tracker.kernels.pictures.nearest import draw_nearest, project_surfaces
from tracker.kernels.pictures.rasterization import rasterize
from tracker.kernels.pictures.rods import covered_by_rods
from tracker.kernels.pictures.silhouettes import fill_parts
from tracker.kernels.regions.colours import N_COLOURS, Picture, Tables, encode, tabulate_posteriors
from tracker.kernels.regions.equations import shift_equations
from tracker.kernels.regions.learning import learn_lines
from tracker.kernels.regions.lines import Lines, Looks, Rule, Samples
from tracker.kernels.regions.misfits import score_lines
from tracker.kernels.regions.scoring import score_regions
from tracker.kernels.regions.shifts import find_shifts
from tracker.kernels.regions.sides import parts_beside
from tracker.kernels.rows import bundle_camera
from tracker.kernels.skins.filling import fill_mesh
from tracker.kernels.skins.mesh import Mesh
from tracker.kernels.skins.tracing import trace_skins
from tracker.progress import Progress, silent

_F8, _F4, _I8, _B1 = np.float64, np.float32, np.int64, np.bool_
_I4, _I2, _U1 = np.int32, np.int16, np.uint8


Group = Literal["tracking", "matching", "calibration", "recognition"]
"""What kernels are for; a run compiles those that it needs."""

GROUPS: tuple[Group, ...] = "tracking", "matching", "calibration", "recognition"


def _own(dtype: Any, *shape: int) -> Any:
    return np.zeros(shape, dtype)


def _frozen(dtype: Any, *shape: int) -> Any:
    array = np.zeros(shape, dtype)
    array.setflags(write=False)
    return array


def _seen_body() -> tuple[tuple[Any, ...], tuple[Any, ...]]:
    """Shapes, grids, planes, layout and bounds of a body's parts; cameras and image sizes."""
    grids, planes = _frozen(_F4, 1, 17 * 32, 7), _frozen(_F4, 1, 4, 9 * 16)
    return (_frozen(_F8, 1, 7), grids, planes, (9, 16), _frozen(_F8, 3, 1)), (_frozen(_F8, 1, 25), _frozen(_F8, 1, 2))


def _tracking_calls() -> list[tuple[Any, tuple[Any, ...]]]:
    """The kernels of the tracking with arguments of the types used; read-only arrays are types of their own."""
    chain = _frozen(_B1, 1), _frozen(_F8, 1, 3), _frozen(_F8, 1, 3), _frozen(_I8, 1)
    model, rig = _seen_body()
    samples = _own(_F4, 0, 1, 1, 5), _own(_F4, 0, 1, 1, 3), _own(_I8, 0, 1, 1), _own(_B1, 0, 1, 1), _own(_I8, 0, 1)
    images, scene = (_frozen(_F4, 0), _frozen(_I8, 1, 5)), (_frozen(_F4, 0, 5), _frozen(_I8, 2))
    first_pose = _own(_F4, 0, 1, 5), _own(_I8, 0, 1), _own(_I8, 0)
    pairs = _own(_I8, 0, 4), _own(_F4, 1, 1, 5), _own(_F4, 1, 1, 3), _own(_I8, 1, 1), _own(_I8, 1)
    slopes, found = (_own(_I2, 1, 1), _own(_I2, 1, 1)), (_own(_F4, 0, 2), _own(_F4, 0, 2), _own(_I8, 0))
    picture, seen = _own(_U1, 1, 1, 3), _own(_U1, 1 + 2 * MARGIN, 1 + 2 * MARGIN, 3)
    grey, depths = _own(_U1, 1, 1), _own(_F4, 1, 1)
    spots, weighted = _frozen(_F4, 1, 9 * 16, 3), (_frozen(_I8, 1, 3), _frozen(_F4, 0, 2))
    still, asked = (_own(_B1, 0), _own(_F8, 1, 2)), (_own(_F8, 0, 1, 4, 4), *model, *rig, (8.0, 0.02))
    standing = _own(_F4, 1, 0, 13), _own(_I8, 1)
    traced = (_own(_F4, 1, 5), _own(_F4, 1, 3), _own(_I8, 1), _own(_B1, 1))
    detected = Detected(_frozen(_F8, 0, 1, 3), _frozen(_I8, 2), _frozen(_I8, 1), _frozen(_I8, 1))
    matches = Matches(_own(_F8, 0, 1, 1, 2), _own(_F8, 0, 1, 1), _own(_F8, 0, 1, 1), _own(_F8, 0, 1, 1))
    return [
        (chain_transforms, (_own(_F8, 0, 1), *chain)),
        (twists_in_world, (_own(_F8, 0, 2, 4, 4), *chain)),
        (trace_contours, (_own(_F8, 0, 1, 4, 4), *model, *rig, (8.0, 0.02), True, *samples)),
        (moving_parts, (_own(_F8, 1, 1, 4, 4),)),
        (trace_still, (_own(_F8, 1, 1, 4, 4), _own(_B1, 1), *model, *rig, (8.0, 0.02))),
        (score_poses, (*asked, *images, *scene, (40.0, False), _own(_B1, 1), standing)),
        (match_keypoints, (_own(_F8, 0, 1, 3), rig[0], detected, 0, (0.1, 0.1), matches)),
        (sum_collisions, (_own(_F8, 0, 1, 4, 4), model[0], _frozen(_I8, 0, 2))),
        (directed_distances, (samples[0], samples[4], *images, *scene, 40.0, False)),
        (edge_shares, (*first_pose, *images, *scene, _frozen(_F4, 0), (5.0, 10.0), _own(_F8, 4, 2, 1))),
        (strongest_slopes, (_own(_U1, 2, 2, 3), _own(_I2, 2, 2), _own(_I2, 2, 2))),
        (trace_segments, (_own(_U1, 3, 3), slopes, (4, 0.3, 8), grey, found)),
        (expected_distances, (found[0], found[0], _own(_F4, 0, 4), 20.0, 56.0)),
        (marked, (found[0], grey, (0, 0), _own(_B1, 0))),
        (chamfer_distances, (_own(_I4, 0, 2), 40.0, _own(_F4, 1, 1))),
        (median_change, (picture, picture, 4)),
        (mark_changes, (seen, seen, (0, 0), 14.0, grey)),
        (without_shadows, (seen, seen, (0, 0), grey, (0.5, 0.8, 0.9, 8.0, 0.7, 8.0), grey)),
        (block_ratios, (_own(_U1, 1, 1, 3), _own(_U1, 1, 1, 3), 1, 1)),
        (smooth_surface, (_own(_F8, 3, 3, 3), 0.03, 1, 1)),
        (connected_blocks, (_own(_F8, 3, 3, 3), 0.12)),
        (dominant_modes, (_own(_U1, 1, 1, 1, 3), 12, _own(_U1, 1, 1, 3), _own(_U1, 1, 1), _own(_U1, 1, 1))),
        (relight, (_own(_U1, 1, 1, 3), _own(_F4, 1, 1, 3), 1.0, (0, 0, 1), _own(_U1, 1, 1, 3))),
        (relight, (_frozen(_U1, 1, 1, 3), _own(_F4, 1, 1, 3), 1.0, (0, 0, 1), _own(_U1, 1, 1, 3))),
        (large_regions, (_own(_I4, 1, 1), 1, 0.02, _own(_B1, 1, 1))),
        (match_oriented, (_own(_F4, 1, 1, 5), _own(_I8, 1), *scene, (30.0, 0.8), _own(_I8, 0, 4))),
        (normal_equations, (*pairs, scene[0], rig[0], _own(_F8, 1, 6), _frozen(_B1, 1, 2), 16.0, 1.0)),
        (fill_parts, (_own(_F8, 1, 4, 4), _frozen(_F4, 1, 17 * 32, 7), (9, 16), _frozen(_F8, 25), _own(_B1, 1, 1))),
        (cover_still, (_own(_F8, 1, 1, 4, 4), _own(_B1, 1), spots, (9, 16), _own(_F8, 1, 25), *weighted)),
        (covered_sums, (_own(_F8, 0, 1, 4, 4), _own(_B1, 1), spots, (9, 16), _own(_F8, 1, 25), *weighted, still)),
        (cover_shares, (_own(_B1, 1, 1), 1, depths)),
        (cover_shares, (_frozen(_B1, 1, 1), 1, depths)),
        (covered_by_rods, (_own(_F4, 0, 1, 2), _own(_F4, 0, 1, 2), depths, _own(_F4, 1, 2), _own(_F8, 1))),
        (rasterize, (_own(_F8, 0, 2), _own(_F8, 0), _own(_I8, 0, 3), (0, 0), _own(_F4, 1, 1, 4))),
        (id_contours, (_own(_I8, 1, 1), depths, (0, 0, 1, 1), _frozen(_F8, 25), _own(_F8, 1, 17), 0.02, *traced)),
    ]


def _region_calls() -> list[tuple[Any, tuple[Any, ...]]]:
    """As `_tracking_calls`, for the evidence of colours."""
    picture = Picture(_frozen(np.uint16, 0), np.zeros((1, 5), _I8))
    picture.layout.setflags(write=False)
    shares = _frozen(_F4, 1, 1, N_COLOURS), _frozen(_F4, 1, 1, N_COLOURS), _frozen(_F4, 1, N_COLOURS)
    tables, known = Tables(*shares), _frozen(_B1, 1, 1)
    looks = Looks(tables, _frozen(_U1, 1, 1, N_COLOURS), known, _frozen(_F8, 1))
    samples = Samples(_own(_F4, 1, 1, 5), _own(_F4, 1, 1, 3), _own(_I8, 1, 1), _own(_I8, 1))
    beside, cameras, wanted = _own(_I8, 1, 1, 2), _frozen(_F8, 1, 25), _own(_B1, 1)
    poses = _own(_F4, 0, 1, 1, 5), _own(_F4, 0, 1, 1, 3), _own(_I8, 0, 1, 1), _own(_I8, 0, 1)
    rule = Rule(0.01, 7, 0.07, 2e-4, 20.0, 3.0)
    lines, (model, rig) = Lines(picture, looks, wanted, rule), _seen_body()
    learnt = Tables(_own(_F4, 1, 1, N_COLOURS), _own(_F4, 1, 1, N_COLOURS), _own(_F4, 1, N_COLOURS))
    learning = (
        picture,
        samples,
        beside,
        cameras,
        looks.half_extents,
        _own(_B1, 1, 1),
        0.01,
        0.15,
        looks.posteriors,
        learnt,
    )
    solids = _own(_F8, 0, 1, 4, 4), _frozen(_F8, 1, 7), _frozen(_F8, 3, 1), cameras
    chains = _own(_I8, 1), cameras, _own(_F8, 1, 6), _frozen(_B1, 1, 2), 16.0
    slopes, looked_up = (_own(_U1, 1, 1),) * 2, (_frozen(_U1, 1), _frozen(_U1, 256), _frozen(_U1, 16))
    return [
        (encode, (_own(_U1, 1, 1, 3), _own(np.uint16, 1))),
        (mark_appearance, (_own(_U1, 1, 1, 3), *slopes, (0, 0), (0, 0, 0), looked_up, _own(_U1, 1, 1, 3))),
        (tabulate_posteriors, (learnt, (2e-4, 4.0), _own(_B1, 1, 1), _own(_U1, 1, 1, N_COLOURS))),
        (find_shifts, (picture, looks, samples, beside, cameras, wanted, rule, _own(_F4, 1, 1, 3))),
        (score_lines, (lines, *poses, _own(_I8, 0, 1, 1, 2), cameras, _own(_F8, 0, 1, 1, 3))),
        (score_regions, (_own(_F8, 0, 1, 4, 4), *model, *rig, (8.0, 0.02), lines)),
        (learn_lines, learning),
        (parts_beside, (*solids, *poses, 0.01, _own(_I8, 0, 1, 1, 2))),
        (shift_equations, (_own(_F4, 1, 1, 3), samples, *chains)),
    ]


def _motion_calls() -> list[tuple[Any, tuple[Any, ...]]]:
    """As `_tracking_calls`, for what is followed from image to image."""
    places = _own(_F8, 0, 3), _own(_F8, 0, 3), _own(_F8, 0, 3), _own(_F8, 0)
    carried = Carried(_own(_I8, 0), _own(_I8, 0), *places, _own(_F8, 0, 2), _own(_F8, 0))
    placed, cameras, found = _own(_F8, 1, 1, 4, 4), _frozen(_F8, 1, 25), _own(_F8, 0, 10)
    chains, seen = (_own(_I8, 1), _own(_F8, 1, 6), _frozen(_B1, 1, 2)), _own(_F8, 1, 3, 4)
    return [
        (gaps_of, (placed, cameras, carried, 0.1, _own(_F8, 1, 0))),
        (anchor_residuals, (placed, cameras, carried, 0.01, found)),
        (anchor_equations, (placed, carried, found, _own(_F8, 0), *chains)),
        (meet_parts, (placed[0], _frozen(_F8, 1, 7), _own(_F8, 3), _own(_F8, 0, 3), _own(_I8, 0), found)),
        (project_surfaces, (placed[0], _frozen(_F8, 1, 4, 3), _own(_B1, 1), cameras[0], seen)),
        (draw_nearest, (seen, _frozen(_I8, 0, 3), (0, 0), _own(_F4, 1, 1), _own(_I2, 1, 1))),
    ]


def _skin_calls() -> list[tuple[Any, tuple[Any, ...]]]:
    """As `_tracking_calls`, for bodies whose own surface is known."""
    vertices = _frozen(_F4, 0, 3), _frozen(_F4, 0, 3), _frozen(_I8, 0, 1), _frozen(_F4, 0, 1)
    mesh = Mesh(*vertices, _frozen(_I8, 0, 3), _frozen(_I8, 0), _frozen(_I8, 0, 4), 0, 1)
    samples = _own(_F4, 0, 1, 1, 5), _own(_F4, 0, 1, 1, 3), _own(_I8, 0, 1, 1), _own(_B1, 0, 1, 1), _own(_I8, 0, 1)
    rig = _frozen(_F8, 1, 25), _frozen(_F8, 1, 2)
    return [
        (trace_skins, (_own(_F8, 0, 1, 4, 4), _frozen(_F8, 1, 4, 4), mesh, *rig, (8.0, 0.02, 240.0), *samples)),
        (fill_mesh, (_own(_F8, 0, 3), _frozen(_I8, 0, 3), rig[0][0], _own(_B1, 1, 1))),
    ]


def _matching_calls() -> list[tuple[Any, tuple[Any, ...]]]:
    """As `_tracking_calls`, for least squares matching."""
    image = _frozen(_F4, 1), 1, 1
    rule, noise = (2, 1, 0.01, 1.0, 0.0, False), (1.0, 1.0, _frozen(_F4, 1))
    heap, state = (_own(_F8, 4), _own(_I8, 4), _own(_I8, 1)), (_own(_F8, 1, N_FOUND), _own(_I8, 1), _own(_I8, 1))
    meeting = _own(_F8, 1, 0, 2), _own(_F8, 1, 0, 3), _own(_F8, 0, 3), _own(_F8, 0, 3, 3), _own(_F8, 0)
    growing = (
        (image, image),
        (1, 1, 1),
        (*state, _own(_I8, 1)),
        heap,
        (rule, rule),
        (noise, (1.0, 1.0, 0.5, 2.0)),
        (1, 1),
    )
    return [
        (match_patches, (image, image, _own(_F8, 0, 2), _own(_F8, 0, N_FOUND), _own(_I8, 0), rule, noise)),
        (push_all, (heap, (1, 1, 1), *state)),
        (grow, growing),
        (key_side, (2,)),
        (cut_keys, (image, _own(_I8, 0, 2), 2, _own(_F4, 0, 81), _own(_B1, 0))),
        (match_keys, (_own(_F4, 0, 81), _own(_I8, 0), image, _own(_F8, 0, N_FOUND), _own(_I8, 0), rule, noise)),
        (bending_shifts, (_own(_F8, 0, 1, 2), _own(_I8, 0, 1), _own(_F8, 0, 2, 2), _own(_B1, 0), 2)),
        (intersect_rays, (_frozen(_F8, 1, 25), *meeting)),
    ]


def _calibration_calls() -> list[tuple[Any, tuple[Any, ...]]]:
    """As `_tracking_calls`, for the bundle adjustment."""
    images_of = _own(_I8, 0), _own(_I8, 0), _own(_F8, 0, 2), _own(_F8, 0, 2), _own(_F8, 0)
    bars = _own(_F8, 0, 3), _own(_F8, 0, 3, 6), _own(_I8, 1), _own(_F8, 0, 6, 6), _own(_F8, 0, 6)
    reduced = _own(_F8, 17, 17), _own(_F8, 17), _own(_F8, 0, 6, 6), _own(_F8, 0, 6), _own(_F8, 0, 1, 6, 17)
    return [
        (residuals_of, (_own(_F8, 1, bundle_camera.N_COLUMNS), bars[0], images_of, images_of[2])),
        (reduce_normal, (_own(_F8, 1, bundle_camera.N_COLUMNS), bars, images_of, 0.0, reduced)),
    ]


def _recognition_calls() -> list[tuple[Any, tuple[Any, ...]]]:
    """As `_tracking_calls`, for movements."""
    known = _frozen(_I8, 1), _frozen(_B1, 0), _frozen(_I8, 0)
    return [
        (direction_gaps, (_frozen(_F4, 0, 1, 3), _frozen(_F4, 0, 1, 3), _own(_F4, 0, 0))),
        (warp_sequence, (_own(_F4, 0, 0), *known, 1.0, 1.0, _own(_I8, 1, 2))),
    ]


_CALLS = {
    "tracking": lambda: [*_tracking_calls(), *_region_calls(), *_motion_calls(), *_skin_calls()],
    "matching": _matching_calls,
    "calibration": _calibration_calls,
    "recognition": _recognition_calls,
}


def all_cached(group: Group = "tracking") -> bool:
    """Whether machine code of every kernel of a group lies on disk."""
    return all(
        any(Path(kernel.stats.cache_path).glob(f"{kernel.__module__.rpartition('.')[2]}.{kernel.__name__}-*.nbi"))
        for kernel, _ in _CALLS[group]()
    )


def warm_up(progress: Progress = silent, group: Group = "tracking") -> None:
    """Compiles or loads every kernel of a group, by calls on empty data of the types the package uses.

    Args:
        progress: told the kernel in work.
        group: what the kernels are for.
    """
    calls = _CALLS[group]()
    for k, (kernel, arguments) in enumerate(calls):
        progress("compiling kernels once", k, len(calls), kernel.__name__.replace("_", " "))
        kernel(*arguments)
    progress("compiling kernels once", len(calls), len(calls))


def forget_outdated() -> int:
    """Deletes machine code made of other sources than those of today; returns the bytes freed."""
    return forget_others(name for name in sys.modules if name.startswith(f"{__package__}."))
