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
