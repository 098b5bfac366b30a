"""A part of a body, ready for ray tests: one row of `solids` (P, 48), single precision.

What a test needs of a part stands in one row of one array: numba passes an array by its nine words, and slices cost a
reference count, so that several arrays or slices would be most of the time of a test. Single precision is good to
5 micrometres in a room and takes half the time.
"""

M11, M12, M13, MX = 0, 1, 2, 3
"""Motion from the world into the part's frame in units of its half extents, its first row of three."""

M21, M22, M23, MY = 4, 5, 6, 7
M31, M32, M33, MZ = 8, 9, 10, 11

EYE_X, EYE_Y, EYE_Z = 12, 13, 14
"""Camera centre in that frame."""

REACH = 15
"""Largest squared distance of the surface from the origin of that frame."""

K1, K2 = 16, 17
"""Taper."""

AROUND, ALONG, UPWARD = 18, 19, 20
"""Exponents 2 / e2, e2 / e1 and 2 / e1 of the inside-outside function."""

START_U, START_V = 21, 22
"""One end of its axis in the image, px."""

SHARE_U, SHARE_V = 23, 24
"""The axis divided by its squared length, 1 / px."""

AXIS_U, AXIS_V = 25, 26
"""The axis in the image, px."""

WIDTH2 = 27
"""Squared width around the axis, px^2."""

NEAREST = 28
"""Least depth, metres; -1 for a part that is not wholly before the camera, or that ends beyond the lens's reach."""

R11, R12, R13 = 29, 30, 31
"""world_from_part: rotation."""

R21, R22, R23 = 32, 33, 34
R31, R32, R33 = 35, 36, 37

X, Y, Z = 38, 39, 40
"""Position of the part in the world, metres."""

CAMERA_X, CAMERA_Y, CAMERA_Z = 41, 42, 43
"""Camera centre in the part's frame, metres."""

LEAST_U, MOST_U, LEAST_V, MOST_V = 44, 45, 46, 47
"""The box around the part in the image, px."""

N_COLUMNS = 48
