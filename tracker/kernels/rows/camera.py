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
"""Squared distance from the axis, in the plane z = 1, beyond which the lens images nothing; inf if it has no end."""

N_COLUMNS = 29
