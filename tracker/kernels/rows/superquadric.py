"""A tapered superquadric as one row of numbers, as `Superquadric.packed` has them."""

A1, A2, A3 = 0, 1, 2
"""Half extents along its axes, metres."""

E1, E2 = 3, 4
"""Exponents along the axis and around it."""

K1, K2 = 5, 6
"""Taper of the first and the second axis along the third."""

N_COLUMNS = 7
