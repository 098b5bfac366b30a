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
