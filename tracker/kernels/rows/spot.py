"""Samples of one part's contour while they are tested: rows of one flat array, each `ROW` long."""

from tracker.kernels.rows.workspace import ROW

U, V = 0 * ROW, 1 * ROW
"""Pixel."""

NU, NV = 2 * ROW, 3 * ROW
"""Unit image normal."""

LENGTH = 4 * ROW
"""Contour length that a sample stands for, px."""

X, Y, Z = 5 * ROW, 6 * ROW, 7 * ROW
"""World point, metres."""

NX, NY, NZ = 8 * ROW, 9 * ROW, 10 * ROW
"""World normal."""

STATE = 11 * ROW
"""What other parts do to it: 0 nothing, 1 touch, 2 cover."""

LOCAL_X, LOCAL_Y, LOCAL_Z = 12 * ROW, 13 * ROW, 14 * ROW
"""Position in another part's frame in units of its half extents."""

MEETS = 15 * ROW
"""By how much the viewing ray comes nearer than the other part's bounding ellipsoid, squared; -1 where the pixel is too
far from its axis."""

NEAR = 16 * ROW
"""By how much the sample lies within twice that ellipsoid, squared."""

N_ROWS = 17
