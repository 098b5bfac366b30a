"""The kernels of what tells more of a pose than contours: colours, and what is followed from image to image."""

from __future__ import annotations

import numpy as np

from tracker.kernels.body.anchors import Carried, anchor_equations, gaps_of
from tracker.kernels.body.anchors import residuals_of as anchor_residuals
from tracker.kernels.body.rays import meet_parts
from tracker.kernels.calls import B1, F4, F8, I2, I8, U1, Call, frozen, own, seen_body
from tracker.kernels.images.appearance import mark_appearance
from tracker.kernels.pictures.nearest import draw_nearest, project_surfaces
from tracker.kernels.regions.colours import N_COLOURS, Picture, Tables, encode, tabulate_posteriors
from tracker.kernels.regions.equations import shift_equations
from tracker.kernels.regions.learning import learn_lines, longest_lines
from tracker.kernels.regions.lines import Lines, Looks, Rule, Samples
from tracker.kernels.regions.misfits import score_lines
from tracker.kernels.regions.scoring import score_regions
from tracker.kernels.regions.shifts import find_shifts
from tracker.kernels.regions.sides import parts_beside
from tracker.kernels.rows import camera


def region_calls() -> list[Call]:
    """As `tracking_calls`, for the evidence of colours."""
    picture = Picture(frozen(np.uint16, 0), np.zeros((1, 5), I8))
    picture.layout.setflags(write=False)
    shares = frozen(F4, 1, 1, N_COLOURS), frozen(F4, 1, 1, N_COLOURS), frozen(F4, 1, N_COLOURS)
    tables, known = Tables(*shares), frozen(B1, 1, 1)
    looks = Looks(tables, frozen(U1, 1, 1, N_COLOURS), known, frozen(F8, 1))
    samples = Samples(own(F4, 1, 1, 5), own(F4, 1, 1, 3), own(I8, 1, 1), own(I8, 1))
    beside, cameras, wanted = own(I8, 1, 1, 2), frozen(F8, 1, camera.N_COLUMNS), own(B1, 1)
    poses = own(F4, 0, 1, 1, 5), own(F4, 0, 1, 1, 3), own(I8, 0, 1, 1), own(I8, 0, 1)
    rule = Rule(0.01, 7, 0.07, 2e-4, 20.0, 3.0)
    lines, (model, rig) = Lines(picture, looks, wanted, rule), seen_body()
    learnt = Tables(own(F4, 1, 1, N_COLOURS), own(F4, 1, 1, N_COLOURS), own(F4, 1, N_COLOURS))
    learning = (
        picture,
        samples,
        beside,
        cameras,
        looks.half_extents,
        own(B1, 1, 1),
        0.01,
        0.15,
        looks.posteriors,
        learnt,
    )
    solids = own(F8, 0, 1, 4, 4), frozen(F8, 1, 7), frozen(F8, 3, 1), cameras
    chains = own(I8, 1), cameras, own(F8, 1, 6), frozen(B1, 1, 2), 16.0
    slopes, looked_up = (own(U1, 1, 1),) * 2, (frozen(U1, 1), frozen(U1, 256), frozen(U1, 16))
    return [
        (encode, (own(U1, 1, 1, 3), own(np.uint16, 1))),
        (mark_appearance, (own(U1, 1, 1, 3), *slopes, (0, 0), (0, 0, 0), looked_up, own(U1, 1, 1, 3))),
        (tabulate_posteriors, (learnt, (2e-4, 4.0), own(B1, 1, 1), own(U1, 1, 1, N_COLOURS))),
        (find_shifts, (picture, looks, samples, beside, cameras, wanted, rule, own(F4, 1, 1, 3))),
        (score_lines, (lines, *poses, own(I8, 0, 1, 1, 2), cameras, own(F8, 0, 1, 1, 3))),
        (score_regions, (own(F8, 0, 1, 4, 4), *model, *rig, (8.0, 0.02), lines)),
        (learn_lines, learning),
        (longest_lines, (samples, cameras, 0.01, own(F8, 1))),
        (parts_beside, (*solids, *poses, 0.01, own(I8, 0, 1, 1, 2))),
        (shift_equations, (own(F4, 1, 1, 3), samples, *chains)),
    ]


def motion_calls() -> list[Call]:
    """As `tracking_calls`, for what is followed from image to image."""
    places = own(F8, 0, 3), own(F8, 0, 3), own(F8, 0, 3), own(F8, 0)
    carried = Carried(own(I8, 0), own(I8, 0), *places, own(F8, 0, 2), own(F8, 0))
    placed, cameras, found = own(F8, 1, 1, 4, 4), frozen(F8, 1, camera.N_COLUMNS), own(F8, 0, 10)
    chains, seen = (own(I8, 1), own(F8, 1, 6), frozen(B1, 1, 2)), own(F8, 1, 3, 4)
    return [
        (gaps_of, (placed, cameras, carried, 0.1, own(F8, 1, 0))),
        (anchor_residuals, (placed, cameras, carried, 0.01, found)),
        (anchor_equations, (placed, carried, found, own(F8, 0), *chains)),
        (meet_parts, (placed[0], frozen(F8, 1, 7), own(F8, 3), own(F8, 0, 3), own(I8, 0), found)),
        (project_surfaces, (placed[0], frozen(F8, 1, 4, 3), own(B1, 1), cameras[0], seen)),
        (draw_nearest, (seen, frozen(I8, 0, 3), (0, 0), own(F4, 1, 1), own(I2, 1, 1))),
    ]
