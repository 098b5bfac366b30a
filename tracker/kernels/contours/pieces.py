"""Where a surface grid turns away from a camera: crossings of the grid's edges, joined to pieces of contour.

A point of a surface with outward normal n lies on the occluding contour of a camera at c where n . (c - p) = 0.
The contour crosses the grid's edges where that product changes sign; the crossings of a cell are joined to a piece
of contour (marching squares) and the pieces to chains. A row of signs is the bits of one integer, so that rows and
cells without a crossing cost next to nothing. Every edge has a point in its middle; between the nearer two the
surface is bent by the turn of its normals: a 9 x 16 grid is good to a fraction of a pixel.
"""

from __future__ import annotations

MOST_COLUMNS = 62
"""Columns of a grid that fit into one integer."""

MOST_ROWS = 400
"""Rows of a grid whose contour has room: it crosses each row and each column twice, and two rows more must fit."""
