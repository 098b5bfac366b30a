"""Where the part of a view that matters lies in a flat array of all views: one row of regions (V, 5)."""

START = 0
"""Its first pixel in the flat array."""

LEFT, TOP = 1, 2
"""Pixel of the whole image at its upper left corner."""

WIDTH, HEIGHT = 3, 4
"""Size, px; width 0 for a missing view."""

N_COLUMNS = 5
