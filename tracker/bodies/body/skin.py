"""The skin that a model file describes, attached to the body's parts."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tracker.bodies.body import BodyModel
from tracker.bodies.body.sections import SkinSection
from tracker.bodies.skin import Skin
from tracker.bodies.skin_files import columns_of, read_rigging, read_surface, rigging_of_groups
from tracker.foundation.arrays import Array
from tracker.foundation.errors import ModelError, nearest


def skin_of(body: BodyModel, section: SkinSection) -> Skin:
    """The surface of a body, read from its files.

    Raises:
        ModelError: a file is missing or wrong, or names what the body does not have.
    """
    path = Path(section.surface)
    surface = read_surface(path)
    if section.weights:
        rigging = read_rigging(Path(section.weights), len(surface.points))
    else:
        rigging = rigging_of_groups(surface, path)
    if not section.smooth:
        rigging = rigging.rigid()
    names = tuple(part.name for part in body.parts)
    columns = columns_of(rigging, names, tuple(part.segment for part in body.parts))
    weights = np.zeros((len(surface.points), len(names)))
    for k, column in enumerate(columns.tolist()):
        if column >= 0:
            weights[:, column] += rigging.weights[:, k]
    part_from_rest = np.linalg.inv(body.world_from_part(measured_pose(body, section))).astype(np.float64)
    return Skin(section.scale * surface.points, surface.faces, weights, part_from_rest)


def measured_pose(body: BodyModel, section: SkinSection) -> Array:
    """(dof,) the pose that the surface was measured in, rad and m.

    Raises:
        ModelError: a parameter that the body does not have, or a translation.
    """
    q = np.zeros(body.dof)
    for name, degrees in section.pose_deg.items():
        meant = body.mirror.meant(name, body.names)
        if not meant:
            raise ModelError(f'skin.pose_deg: no parameter "{name}"; {nearest(name, body.names)}')
        for own in meant:
            column = body.names.index(own)
            if not body.rotates[column]:
                raise ModelError(f'skin.pose_deg: "{own}" is a translation, expected angles')
            q[column] = np.radians(degrees)
    return q
