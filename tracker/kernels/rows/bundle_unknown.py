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
