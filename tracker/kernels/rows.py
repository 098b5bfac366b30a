"""Names of the columns of packed rows, a class for each kind of row."""

from __future__ import annotations


class BundleCameraRow:
    """A camera that an adjustment changes: one row of states (V, 26)."""

    R11, R12, R13 = 0, 1, 2
    """Rotation from the world into the camera."""

    R21, R22, R23 = 3, 4, 5
    R31, R32, R33 = 6, 7, 8

    X, Y, Z = 9, 10, 11
    """Centre in the world, metres."""

    C, CX, CY = 12, 13, 14
    """Camera constant and principal point, px."""

    AFFINITY, SHEAR = 15, 16

    K1, K2, P1, P2, K3 = 17, 18, 19, 20, 21
    K4, K5, K6 = 22, 23, 24
    """Distortion, in OpenCV's order; its denominator no adjustment changes."""

    DELAY = 25
    """Time offset, frames."""

    N_COLUMNS = 26

    ROTATION, CENTRE, INTERIOR, DISTORTION = slice(R11, X), slice(X, C), slice(C, K1), slice(K1, DELAY)


class BundleUnknowns:
    """Unknowns of a camera in an adjustment, in the order of its normal equations."""

    TURN_X, TURN_Y, TURN_Z = 0, 1, 2
    """Rotation about the camera's own axes, after its own, rad."""

    X, Y, Z = 3, 4, 5
    """Centre in the world, metres."""

    C, CX, CY = 6, 7, 8
    """Camera constant and principal point, px."""

    AFFINITY, SHEAR = 9, 10

    K1, K2, P1, P2, K3 = 11, 12, 13, 14, 15
    """Distortion, in OpenCV's order."""

    DELAY = 16
    """Time offset, frames."""

    N_UNKNOWNS = 17

    TURN, CENTRE = slice(TURN_X, X), slice(X, C)


class CameraRow:
    """A camera as one row of numbers, as `Rig.packed` has them."""

    R11, R12, R13, TX = 0, 1, 2, 3
    """camera_from_world, its first row of three: rotation and translation, metres."""

    R21, R22, R23, TY = 4, 5, 6, 7
    R31, R32, R33, TZ = 8, 9, 10, 11

    CENTRE_X, CENTRE_Y, CENTRE_Z = 12, 13, 14
    """The camera's place in the world, metres."""

    FX, FY, CX, CY = 15, 16, 17, 18
    """Focal lengths and principal point, px."""

    K1, K2, P1, P2, K3 = 19, 20, 21, 22, 23
    """Distortion, in OpenCV's order; goes on below."""

    SHEAR = 24
    """Shift of u by the height in the plane of the pinhole, px."""

    K4, K5, K6 = 25, 26, 27
    """Denominator of the radial distortion."""

    REACH2 = 28
    """Squared distance from the axis, in the plane z = 1, beyond which the lens images nothing; inf without an end."""

    N_COLUMNS = 29


class CarriedPlaceRow:
    """Where a pose carries a place on a part, beside where an image shows it, as one row of numbers."""

    U, W = 0, 1
    """Residual, px."""

    VARIANCE = 2
    """Of the residual, mean of both axes, px^2."""

    FACING = 3
    """Cosine between the surface's normal and the way to the camera; -1 of what lies behind it."""

    U_X, U_Y, U_Z = 4, 5, 6
    """Derivatives of the first residual by the place in the world, px per metre."""

    W_X, W_Y, W_Z = 7, 8, 9

    N_COLUMNS = 10


class MetPlaceRow:
    """Where a ray meets a part, in the part's frame, as one row of numbers."""

    X, NORMAL_X, RAY_X = 0, 3, 6
    """First of three: the place, metres; the unit normal there; the unit direction of the ray."""

    N_SURFACE = 9
    """Columns of those three."""

    FACING = 9
    """Cosine between the normal and the way back along the ray; 0 where they do not meet."""

    N_COLUMNS = 10


class RegionRow:
    """Where the part of a view that matters lies in a flat array of all views: one row of regions (V, 5)."""

    START = 0
    """Its first pixel in the flat array."""

    LEFT, TOP = 1, 2
    """Pixel of the whole image at its upper left corner."""

    WIDTH, HEIGHT = 3, 4
    """Size, px; width 0 for a missing view."""

    N_COLUMNS = 5


class SampleRow:
    """A visible contour sample: one row of `traced` (M, 13), single precision; the first eight are a `spot`."""

    U, V = 0, 1
    """Pixel."""

    NU, NV = 2, 3
    """Unit image normal."""

    LENGTH = 4
    """Contour length it stands for, px; 0 between parts."""

    X, Y, Z = 5, 6, 7
    """World point, metres."""

    PART = 8

    BETWEEN = 9
    """1 where the part touches another, else 0."""

    NX, NY, NZ = 10, 11, 12
    """World normal."""

    N_COLUMNS = 13


class ScenePointRow:
    """An edge point that stands for a stretch of accepted contour: one row of `PackedEdges.points`."""

    X, Y = 0, 1
    """Position, px."""

    DX, DY = 2, 3
    """Unit image gradient, towards the brighter side."""

    WEIGHT = 4
    """Contour length it stands for, px."""

    N_COLUMNS = 5


class SuperquadricRow:
    """A tapered superquadric as one row of numbers, as `Superquadric.packed` has them."""

    A1, A2, A3 = 0, 1, 2
    """Half extents along its axes, metres."""

    E1, E2 = 3, 4
    """Exponents along the axis and around it."""

    K1, K2 = 5, 6
    """Taper of the first and the second axis along the third."""

    N_COLUMNS = 7


WORKSPACE_ROW = 33 * 32
"""Crossings or samples of one part that a workspace has room for, as native/contours/workspace.hpp has it."""
