"""Where a contour crosses the edges of a surface grid: rows of one flat array, each `ROW` long."""

from tracker.kernels.rows.workspace import ROW

AX, AY, AZ = 0 * ROW, 1 * ROW, 2 * ROW
"""First end of half a grid edge, in the part's frame, metres."""

NAX, NAY, NAZ = 3 * ROW, 4 * ROW, 5 * ROW
"""Normal of the surface there."""

BX, BY, BZ = 6 * ROW, 7 * ROW, 8 * ROW
"""Second end."""

NBX, NBY, NBZ = 9 * ROW, 10 * ROW, 11 * ROW
"""Normal of the surface there."""

FACING_A, FACING_B = 12 * ROW, 13 * ROW
"""Facing of both ends; they differ in sign."""

X, Y, Z = 14 * ROW, 15 * ROW, 16 * ROW
"""The crossing in the world, metres."""

NX, NY, NZ = 17 * ROW, 18 * ROW, 19 * ROW
"""World normal."""

U, V = 20 * ROW, 21 * ROW
"""Pixel."""

NU, NV = 22 * ROW, 23 * ROW
"""Unit image normal."""

LENGTH = 24 * ROW
"""Length of each piece of contour (not of a crossing), px."""

N_ROWS = 25
