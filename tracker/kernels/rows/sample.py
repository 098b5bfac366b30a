"""A visible contour sample: one row of `traced` (M, 13), single precision. The first eight are those of a `spot`."""

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
