"""Contours of a limb on the moving back: led by trajectories, and looked for where they were."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from rich.table import Table
from scipy.special import ndtri

from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Image, Mask
from tracker.points.following.led_snakes import FollowedSnake, Seen
from tracker.points.following.snakes import Snake
from tracker.points.trajectories import PointFrame
from tracker.running.jobs import load_job

CONFIG = Path(__file__).parents[2] / "configs" / "following" / "contours.toml"

# A node is right that an edge holds no farther from the true outline.
RIGHT_PX = 2.0
# Of the Gaussian that makes a mask a ramp, which tells how far a straight outline is, up to three of these.
_RAMP_PX = 3.0


def add_rows(table: Table, truth: Any, rig: Rig, view: int, images: list[Image], followed: list[PointFrame]) -> None:
    """Rows for the open contours of the configuration, which are outlines against the background.

    Args:
        table: of four columns.
        truth: of the recording.
        rig: its cameras.
        view: index of the view with the contours.
        images: of that view, in all frames.
        followed: the points in the same frames.
    """
    outlines = [_outline(truth, view, frame.index) for frame in followed]
    contours = {name: contour for name, contour in load_job("follow", CONFIG).snakes.items() if not contour.closed}
    for name, contour in contours.items():
        for way, led in (("led by trajectories", True), ("edges alone, from where they were", False)):
            snake = FollowedSnake(name, contour, view)
            for frame, image in zip(followed, images, strict=True):
                if not led and snake.nodes:
                    snake.nodes[-1] = replace(snake.nodes[-1], motion=np.zeros_like(snake.nodes[-1].motion))
                snake.look(Snake(), _seen(frame, rig, view, frame.alive & led), frame.index, image)
            gaps = np.concatenate([outlines[k](nodes.places) for k, nodes in enumerate(snake.nodes)])
            held = np.concatenate([nodes.held for nodes in snake.nodes])
            near = gaps[held]
            n_nodes = len(snake.nodes[0].places) * len(followed)
            doubtful = sum(nodes.doubtful for nodes in snake.nodes) + len(followed) - len(snake.nodes)
            right, wrong = (100 * float(few.sum()) / n_nodes for few in (near <= RIGHT_PX, near > RIGHT_PX))
            note = f"{wrong:.1f} % on a wrong edge; doubtful in {doubtful} frames"
            table.add_row(f"{name}, {way}: nodes on the true outline", f"{right:.1f} %", "", note)
            table.add_row(f"{name}, {way}: median distance of those held", f"{np.median(near):.2f} px", "", "")
            statuses = np.concatenate([nodes.statuses for nodes in snake.nodes])
            sigmas = np.concatenate([nodes.sigma_px for nodes in snake.nodes])
            for status in ("followed", "led"):
                _add_shares(table, f"{name}, {way}", status, (gaps / sigmas)[statuses == status])
            trusted = sigmas[np.isin(statuses, ("followed", "led"))]
            low, middle, high = np.quantile(trusted, (0.05, 0.5, 0.95))
            table.add_row(f"{name}, {way}: sigma_px", f"{middle:.2f} px", "", f"5 to 95 %: {low:.2f} to {high:.2f}")


def _add_shares(table: Table, of: str, status: str, ratios: Array) -> None:
    if len(ratios):
        shares = ", ".join(f"{100 * np.mean(ratios < times):.0f}" for times in (1, 2, 3))
        note = f"{len(ratios)} nodes; normal: 68, 95, 99.7"
        table.add_row(f"{of}: {status} within 1, 2, 3 sigma_px", f"{shares} %", "", note)


def _seen(frame: PointFrame, rig: Rig, view: int, own: Mask) -> Seen:
    positions: Array = frame.positions[own]
    return Seen(frame.ids[own], rig.cameras[view].project(positions) if len(positions) else np.zeros((0, 2)))


def _outline(truth: Any, view: int, index: int) -> Callable[[Array], Array]:
    """Distances of places (N, 2) from the true silhouette's outline, px; far ones are told as 9 px or so."""
    mask = (truth.depth(view, index) > 0).astype(np.float32)
    truth._cache.clear()
    ramp = cv2.GaussianBlur(mask, (0, 0), _RAMP_PX, borderType=cv2.BORDER_REPLICATE)

    def distances(places: Array) -> Array:
        x, y = places.astype(np.float32).T
        levels = cv2.remap(ramp, x[None], y[None], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)[0]
        away: Array = np.abs(_RAMP_PX * ndtri(np.clip(levels.astype(np.float64), 0.001, 0.999)))
        return away

    return distances
