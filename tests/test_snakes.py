"""Snakes: contours known exactly, led and alone; the best of all shifts; what is no contour is said."""

from __future__ import annotations

import itertools
from dataclasses import replace

import cv2
import numpy as np
import pytest

from tracker.foundation.errors import ConfigError
from tracker.points.following.led_snakes import (
    FollowedSnake,
    Seen,
    advanced,
    begun,
    evenly,
    inside,
    led_nodes,
    snakes_csv,
)
from tracker.points.following.snakes import Contour, Snake, _best

SIZE, RADII, NOISE_GREY = (220, 160), np.array((34.0, 22.0)), 2.0


def centre(k, speed):
    return np.array((60.0, 70.0)) + k * np.array((speed, 0.15 * speed))


def turn(k):
    c, s = np.cos(0.05 * k), np.sin(0.05 * k)
    return np.array(((c, -s), (s, c)))


def image(k, speed=3.0, noise=NOISE_GREY):
    """A bright ellipse on a darker ground with stripes, drawn eight times as large."""
    large = cv2.resize(
        np.uint8(40 + 12 * (np.arange(SIZE[0]) // 30 % 2))[None], (8 * SIZE[0], 8 * SIZE[1]), None, 0, 0, 0
    )
    # a pixel's centre lies in the middle of its eight by eight
    place = (8 * centre(k, speed) + 3.5).round().astype(int)
    cv2.ellipse(large, place.tolist(), (8 * RADII).astype(int).tolist(), np.degrees(0.05 * k), 0, 360, 150, -1)
    small = cv2.resize(large, SIZE, interpolation=cv2.INTER_AREA)
    return np.uint8(np.clip(small + np.random.default_rng(k).normal(0, noise, small.shape), 0, 255).round())


def off(places, k, speed=3.0):
    """(N,) px outside the true ellipse, to the first order."""
    rest = (places - centre(k, speed)) @ turn(k) / RADII
    radius = np.linalg.norm(rest, axis=1)
    return (radius - 1) * radius / np.linalg.norm(rest / RADII, axis=1)


def surface(k, speed=3.0, n=60):
    """Points of the ellipse, and some of the ground, which rests."""
    rng = np.random.default_rng(5)
    angle, radius = rng.uniform(0, 2 * np.pi, n), np.sqrt(rng.uniform(0, 0.95, n))
    own = np.stack([np.cos(angle), np.sin(angle)], axis=1) * radius[:, None] * RADII
    return np.concatenate([own @ turn(k).T + centre(k, speed), rng.uniform(0, SIZE, (n, 2))])


def clicked(closed=True):
    angle = np.linspace(0, 2 * np.pi if closed else np.pi, 9)[: None if not closed else -1]
    places = centre(0, 0) + np.stack([np.cos(angle), np.sin(angle)], axis=1) * (RADII + 3)
    return Contour(points=tuple(map(tuple, places.tolist())), closed=closed)


def course(speed, led=True, n_frames=10, contour=None):
    nothing = np.zeros((0, 2))
    nodes = [begun(Snake(), contour or clicked(), image(0, speed))]
    for k in range(1, n_frames):
        points = (surface(k - 1, speed), surface(k, speed)) if led else (nothing, nothing)
        nodes.append(advanced(Snake(), nodes[-1], *points, image(k, speed)))
    return nodes


def test_clicks_are_drawn_to_the_contour():
    nodes = begun(Snake(), clicked(), image(0))
    assert nodes.held.all()
    assert np.sqrt(np.mean(off(nodes.places, 0) ** 2)) < 0.35
    gaps = np.linalg.norm(np.diff(nodes.places, axis=0), axis=1)
    assert gaps.max() < 1.5 * Snake().step_px


@pytest.mark.parametrize("closed", [True, False])
def test_a_turning_contour_is_followed(closed):
    nodes = course(3.0, contour=clicked(closed))
    for k, now in enumerate(nodes):
        assert np.median(np.abs(off(now.places, k))) < 0.3
        assert not now.doubtful
    assert (nodes[-1].n_leading > 0).all()


def test_the_part_without_an_edge_is_told_with_its_sigma(monkeypatch):
    # from 60 to 120 degrees the ground is as bright as the ellipse: there is nothing to see of the contour
    whole = image

    def partly(k, speed=3.0, noise=NOISE_GREY):
        bright = whole(k, speed, noise).astype(np.float64)
        rows, columns = np.mgrid[: SIZE[1], : SIZE[0]]
        rest = (np.stack([columns, rows], axis=-1) - centre(k, speed)) @ turn(k) / RADII
        missing = np.abs(np.arctan2(rest[..., 1], rest[..., 0]) - np.pi / 2) < np.pi / 6
        return np.where(missing & (k > 0), 150, bright).astype(np.uint8)

    monkeypatch.setitem(course.__globals__, "image", partly)
    nodes = course(3.0, n_frames=6)[-1]
    error = off(nodes.places, 5)
    rest = (nodes.places - centre(5, 3.0)) @ turn(5) / RADII
    gone = np.abs(np.arctan2(rest[:, 1], rest[:, 0]) - np.pi / 2) < np.pi / 6 - 0.2
    seen = np.abs(np.arctan2(rest[:, 1], rest[:, 0]) - np.pi / 2) > np.pi / 6 + 0.2
    statuses = np.array(nodes.statuses)
    assert gone.sum() >= 4
    assert (statuses[gone] == "led").all()
    assert (statuses[seen] == "followed").mean() > 0.95
    assert nodes.sigma_px[gone].min() > 1.5 * nodes.sigma_px[seen].max()
    assert 0.4 < np.sqrt(np.mean((error / nodes.sigma_px)[seen] ** 2)) < 2
    assert np.abs(error / nodes.sigma_px)[gone].max() < 3


def test_trajectories_lead_where_edges_alone_are_out_of_reach():
    speed = 3.0 * Snake().search_px
    led, alone = course(speed, n_frames=7)[-1], course(speed, led=False, n_frames=7)[-1]
    assert np.median(np.abs(off(led.places, 6, speed))) < 0.3
    assert np.median(np.abs(off(alone.places, 6, speed))) > 5


def test_points_of_another_surface_do_not_lead():
    places = evenly(np.array([[0.0, 0], [40, 0], [40, 30], [0, 30]]), True, 30)
    rng = np.random.default_rng(0)
    inner = rng.uniform((2, 2), (38, 28), (40, 2))
    outer = np.concatenate([rng.uniform((-12, -12), (52, -1), (60, 2)), rng.uniform((-12, 31), (52, 42), (60, 2))])
    shear = np.array(((1.02, 0.03), (-0.01, 0.99)))
    moved = np.concatenate([inner @ shear.T + (5, -2), outer])
    led, n_leading = led_nodes(places, True, (np.concatenate([inner, outer]), moved), 60.0, np.zeros((30, 2)))
    assert (n_leading >= 6).all()
    # an affinity is held towards a shift a little
    np.testing.assert_allclose(led, places @ shear.T + (5, -2), atol=0.25)


def test_a_point_projected_far_outside_is_outside():
    square = np.array([[10.2, 10.0], [60.7, 10.0], [60.7, 60.7], [10.2, 60.7]])
    points = np.array([[30.0, 40.0], [8e5, 40.0], [40.0, 9e5], [-8e5, 30.0], [62.0, 30.0], [9.0, 30.0]])
    np.testing.assert_array_equal(inside(points, square), [True] + [False] * 5)


def test_nodes_that_nothing_leads_go_on_as_they_moved():
    places, motion = np.zeros((5, 2)), np.full((5, 2), 1.5)
    led, n_leading = led_nodes(places, False, (np.zeros((0, 2)), np.zeros((0, 2))), 60.0, motion)
    assert not n_leading.any()
    np.testing.assert_array_equal(led, motion)


def test_shifts_of_an_open_contour_are_the_best_of_all():
    rng, snake = np.random.default_rng(2), Snake(elasticity=0.1)
    strength = rng.uniform(0, 1.2, (5, 5))

    def cost(columns):
        own = [0.25 * ((c - 2) / 2) ** 2 - min(strength[k, c], 1.0) for k, c in enumerate(columns)]
        return sum(own) + 0.1 * sum((a - b) ** 2 for a, b in itertools.pairwise(columns))

    best = min(itertools.product(range(5), repeat=5), key=cost)
    assert _best(snake, strength, closed=False).tolist() == list(best)


def test_a_contour_whose_edges_vanish_is_doubtful_and_then_given_up():
    followed = FollowedSnake("limb", clicked(), 0)
    dark = np.full(SIZE[::-1], 45, dtype=np.uint8)
    for t in range(20):
        followed.look(Snake(), Seen(np.arange(120), surface(0)), t, image(0) if t < 3 else dark)
    assert followed.nodes[3].doubtful
    assert followed.lost_in == 12
    assert followed.warning == "snake limb: given up in frame 12, after 10 frames near hardly an edge"
    rows = list(snakes_csv([followed], ("left",)))
    assert rows[0].startswith("frame,snake,view,node,x_px,y_px,edge_grey_px")
    assert {row.split(",")[-1].strip() for row in rows[1:] if row.startswith("3,")} == {"doubtful"}
    assert max(int(row.split(",")[0]) for row in rows[1:]) == 12


def with_bar(k, x, grey=220):
    """The ellipse turning in its place, and an upright bar that begins at column x."""
    seen = image(k, 0.0)
    seen[:, max(x, 0) : max(x + 12, 0)] = grey
    return seen


def behind_bar(places_of_bar, led):
    """A snake behind a bar whose left edge is at these columns, frame by frame."""
    nodes = [begun(Snake(), clicked(), with_bar(0, places_of_bar[0]))]
    for k, x in enumerate(places_of_bar[1:], start=1):
        points = (surface(k - 1, 0.0), surface(k, 0.0)) if led else (np.zeros((0, 2)), np.zeros((0, 2)))
        nodes.append(advanced(Snake(), nodes[-1], *points, with_bar(k, x)))
    return nodes


def test_a_part_that_something_draws_away_is_told_point_by_point():
    """A bar comes before an end of the contour and stays; nothing leads, and its edge takes nodes along."""
    now = behind_bar([max(150 - 4 * k, 84) for k in range(25)], led=False)[-1]
    gaps, statuses = np.abs(off(now.places, 24, 0.0)), np.array(now.statuses)
    assert (gaps > 2).any(), "it would show nothing"
    assert set(statuses[gaps > 2]) <= {"unsure", "led"}
    assert (statuses == "followed").mean() > 0.7
    assert np.median(gaps[statuses == "followed"]) < 0.3


def test_a_contour_comes_through_behind_what_passes_where_points_lead():
    nodes = behind_bar([150 - 6 * k for k in range(30)], led=True)
    for k, now in enumerate(nodes):
        gaps, followed = np.abs(off(now.places, k, 0.0)), np.array(now.statuses) == "followed"
        assert gaps[followed].max() < 2
        assert gaps.max() < 3
    assert any("led" in now.statuses for now in nodes)
    assert set(nodes[-1].statuses) == {"followed"}


@pytest.mark.parametrize("limb", ["left", "right"])
def test_who_tells_the_limbs_side_of_an_open_contour_has_its_edge_alone(limb):
    """The ground beside an arc changes: nothing is wrong where the ellipse is the limb, and all where the ground is."""
    arc = replace(clicked(closed=False), limb=limb)
    nodes = begun(Snake(), arc, image(0, 0.0, noise=0.0))
    changed = image(0, 0.0, noise=0.0)
    changed[changed < 100] = 110
    now = advanced(Snake(), nodes, np.zeros((0, 2)), np.zeros((0, 2)), changed)
    inner = limb == "right"  # clicked clockwise in the image
    assert (now.held.mean() > 0.9) == inner
    untold = advanced(Snake(), begun(Snake(), clicked(False), image(0, 0.0)), *(np.zeros((0, 2)),) * 2, changed)
    assert "followed" not in untold.statuses


def test_light_that_changes_slowly_takes_no_node_away():
    nodes = begun(Snake(), clicked(), image(0, 0.0))
    for k in range(1, 20):
        brighter = np.uint8(np.clip(image(k, 0.0).astype(float) + 3 * k, 0, 255))
        nodes = advanced(Snake(), nodes, surface(k - 1, 0.0), surface(k, 0.0), brighter)
    assert set(nodes.statuses) == {"followed"}


def test_an_image_that_is_missing_is_leapt_over():
    followed = FollowedSnake("limb", clicked(), 0)
    for t in range(6):
        # points come and go
        own = np.flatnonzero((np.arange(120) + t) % 5)
        followed.look(Snake(), Seen(own, surface(t)[own]), t, None if t in (2, 3) else image(t))
    assert followed.frames == [0, 1, 4, 5]
    assert np.median(np.abs(off(followed.nodes[-1].places, 5))) < 0.3


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (((10, 10), (500, 10), (10, 60)), r"point \[500, 10\] lies outside the image of 220 x 160 px"),
        (((185, 20), (205, 20), (205, 45), (185, 45)), r"of \d+ nodes lie on an edge of 3 grey levels"),
    ],
)
def test_what_is_no_contour_is_said(points, message):
    plain = cv2.GaussianBlur(image(0, noise=0.0), (0, 0), 1.0)
    plain[:, 150:] = 45
    with pytest.raises(ConfigError, match=message):
        begun(Snake(), Contour(points=tuple((float(x), float(y)) for x, y in points)), plain)
