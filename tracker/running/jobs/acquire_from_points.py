"""Acquisition from surface points: a person's model from clouds, silhouettes and trajectories."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import cv2
import numpy as np
import pydantic

from tracker.acquisition.clouds import Cloud, Mark, MeasuredMoment, read_cloud
from tracker.acquisition.pictures import Silhouette, read_silhouette
from tracker.acquisition.posed_points import FromPoints, Moment, PointSettings, acquire_from_points
from tracker.acquisition.result import Panel
from tracker.acquisition.shape_space import ShapeSpace, space_of
from tracker.bodies.body import BodyModel
from tracker.bodies.body.description import read_buildable
from tracker.bodies.scene import Person, Scene
from tracker.bodies.subject import Stature
from tracker.cameras.camera import Camera
from tracker.cameras.rig import Rig
from tracker.evidence.measures.outlines import outline_observation, overlap
from tracker.foundation.arrays import Array, Image, Integers
from tracker.foundation.configuration.components import FilePath, ModelFile, component
from tracker.foundation.errors import ConfigError, ModelError, nearest
from tracker.foundation.progress import Progress
from tracker.foundation.resources import model_path
from tracker.points.following.tables import PointTable, read_trajectories
from tracker.running.jobs import ResultFolder, described
from tracker.running.jobs._acquisition import Acquired, AcquireOutcome
from tracker.synthesis.cpu import CpuSynthesis
from tracker.tracking.initialization.given import GivenInitialization

# Size of the pictures that show the model among the points.
_PICTURE_PX = (480, 640)
_DIRECTIONS_DEG = {"from x": 0.0, "from y": 90.0}


@dataclass(frozen=True)
class OpenedPoints:
    """The fit and its data."""

    space: ShapeSpace
    moments: tuple[Moment, ...]
    pictures: tuple[tuple[Silhouette, ...], ...]
    trajectories: PointTable | None


@component
class PointsJob:
    """Makes a person's model from surface points: `model.toml`, a picture and the figures of the fit."""

    resumable: ClassVar[bool] = False

    name: str = "model"
    """Name of the model, and of the person in `start`."""

    model: ModelFile = pydantic.Field(default_factory=lambda: model_path("human").resolve())
    """The initial body: the name of a bundled model, or a path that ends in .toml."""

    stature_m: Stature
    """Height of the person, metres: points of a part of a body do not show it."""

    moments: tuple[MeasuredMoment, ...] = pydantic.Field(min_length=1, examples=['[{ cloud = "points_000000.ply" }]'])
    """Surface points, in one or more poses."""

    trajectories: FilePath | None = None
    """`trajectories.csv` of `bodytrack follow`, or its result folder. These points stay where they are on their parts
    while the parts move from moment to moment, and so show the joints."""

    start: FilePath | None = None
    """CSV in the layout of poses.csv, or of joint centres, with every moment; None to find the person: that needs
    points of most of the body."""

    acquisition: PointSettings = PointSettings()
    """Settings of the fit."""

    @property
    def model_name(self) -> str:
        """Name of the model."""
        return self.name

    def open(self, earlier: Path | None = None) -> OpenedPoints:
        """Reads points, pictures and trajectories; see `tracker.running.jobs.Job.open`."""
        general = read_buildable(self.model)
        if general.stature_m <= 0:
            raise ModelError(f'model "{general.name}" has no stature_m: it cannot be scaled')
        space = space_of(general.scaled(self.stature_m / general.stature_m), self.acquisition.prior)
        body = space.body(np.zeros(len(space.names)))
        pictures = tuple(self._pictures(one) for one in self.moments)
        moments = []
        for k, (one, own) in enumerate(zip(self.moments, pictures, strict=True)):
            frame, cloud = k if one.frame is None else one.frame, read_cloud(one.cloud, self.acquisition.spacing_m)
            rig = Rig(tuple(picture.camera for picture in own)) if own else Rig(_cameras(cloud))
            q = None
            if self.start is not None:
                alone = Scene((Person(self.name, body, body.rest()),), rig)
                q = GivenInitialization(poses=self.start).poses_of(alone, frame)[0]
            outlines = outline_observation(tuple(picture.mask for picture in own)) if own else None
            moments.append(Moment(cloud, rig, outlines, _marks(body, own), q, frame))
        found = None if self.trajectories is None else read_trajectories(self.trajectories)
        return OpenedPoints(space, tuple(moments), pictures, found)

    def execute(self, opened: OpenedPoints, folder: ResultFolder, progress: Progress) -> AcquireOutcome:
        """Fits the model; see `tracker.running.jobs.Job.execute`."""
        found = acquire_from_points(
            opened.space, opened.moments, self.acquisition, opened.trajectories, self.stature_m, progress
        )
        panels, overlaps = _panels(found, opened)
        followed = f" and {found.n_tracks} trajectories" if found.n_tracks else ""
        acquired = Acquired(
            self.name,
            f"acquired from points of {len(opened.moments)} moment(s){followed}, from {opened.space.description.name}",
            found.fit,
            panels,
            overlaps,
            {},
            explained=found.explained,
        )
        return acquired.written(folder.path, described(self))

    def _pictures(self, moment: MeasuredMoment) -> tuple[Silhouette, ...]:
        found = []
        for picture in moment.silhouettes:
            if picture.rig is None:
                raise ConfigError("[[moments]] silhouettes: a picture without `rig`: its camera is unknown")
            found.append(read_silhouette(picture, f"silhouette {picture.view or ''}".strip(), self.stature_m))
        return tuple(found)


def _marks(body: BodyModel, pictures: tuple[Silhouette, ...]) -> tuple[Mark, ...]:
    marks = []
    for v, picture in enumerate(pictures):
        for name, pixel in picture.clicks.items():
            if name not in body.landmark_names:
                raise ModelError(f'{picture.name}: clicks: no landmark "{name}"; {nearest(name, body.landmark_names)}')
            marks.append(Mark(body.landmark_names.index(name), v, pixel))
    return tuple(marks)


def _panels(found: FromPoints, opened: OpenedPoints) -> tuple[list[Panel], dict[str, float]]:
    """The first moment's points from two directions, with the model, and all silhouettes with their overlap."""
    body, first, overlaps = found.fit.body, opened.moments[0].cloud, {}
    panels = [
        Panel(f"points {camera.name}", _drawn(camera, first), None, camera, found.fit.pose(0))
        for camera in _cameras(first)
    ]
    for k, pictures in enumerate(opened.pictures):
        for picture in pictures:
            scene = Scene((Person("subject", body, found.fit.pose(k)),), Rig((picture.camera,)))
            share = overlap(CpuSynthesis().silhouettes(scene)[0], picture.mask)
            name = f"{picture.camera.name} {k + 1}" if len(opened.pictures) > 1 else picture.camera.name
            overlaps[name] = share
            title = f"{name}: IoU {share:.3f}"
            panels.append(Panel(title, picture.image, picture.mask, picture.camera, found.fit.pose(k)))
    return panels, overlaps


def _cameras(cloud: Cloud) -> tuple[Camera, ...]:
    """Cameras that see all points."""
    middle = (cloud.points.min(axis=0) + cloud.points.max(axis=0)) / 2
    size_m = float(np.ptp(cloud.points, axis=0).max())
    found = []
    for name, degrees in _DIRECTIONS_DEG.items():
        angle, distance = np.radians(degrees), 5.0 * size_m
        x, y, z = middle + distance * np.array([np.cos(angle), np.sin(angle), 0.0])
        found.append(Camera.looking_at(name, _PICTURE_PX, 0.7 * min(_PICTURE_PX) * 5.0, (x, y, z), middle))
    return tuple(found)


def _drawn(camera: Camera, cloud: Cloud) -> Image:
    """The points on grey; nearer points are darker."""
    picture: Image = np.full((*_PICTURE_PX[::-1], 3), 120, dtype=np.uint8)
    depths = camera.in_camera(cloud.points)[:, 2]
    shades: Integers = np.interp(depths, [depths.min(), depths.max()], [20, 110]).astype(np.int64)
    pixels: Array = np.rint(camera.project(cloud.points))
    for k in np.argsort(-depths):
        shade = int(shades[k])
        cv2.circle(picture, (int(pixels[k, 0]), int(pixels[k, 1])), 2, (shade, 60, shade), -1)
    return picture
