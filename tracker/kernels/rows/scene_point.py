"""An edge point that stands for a stretch of accepted contour: one row of `PackedEdges.points`."""

X, Y = 0, 1
"""Position, px."""

DX, DY = 2, 3
"""Unit image gradient, towards the brighter side."""

WEIGHT = 4
"""Contour length it stands for, px."""

N_COLUMNS = 5
