"""Where a ray meets a part, in the part's frame, as one row of numbers."""

X, NORMAL_X, RAY_X = 0, 3, 6
"""First of three: the place, metres; the unit normal there; the unit direction of the ray."""

N_SURFACE = 9
"""Columns of those three."""

FACING = 9
"""Cosine between the normal and the way back along the ray; 0 where they do not meet."""

N_COLUMNS = 10
