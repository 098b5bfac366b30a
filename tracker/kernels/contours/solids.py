"""Parts of a body, tapered superquadrics, made ready for tests in one pose and view, and where points stand to them.

What a test needs of a part stands in one row of `tracker.kernels.rows.solid`.
"""

from __future__ import annotations

from tracker.arrays import Array, Array32
from tracker.kernels.compilation import compiled
from tracker.kernels.rows import solid


@compiled(fastmath={"contract", "nsz"})
def in_part(solids: Array | Array32, q: int, x: float, y: float, z: float) -> tuple[float, float, float]:
    """A world point in the frame of part q, in units of its half extents."""
    return (
        solids[q, solid.M11] * x + solids[q, solid.M12] * y + solids[q, solid.M13] * z + solids[q, solid.MX],
        solids[q, solid.M21] * x + solids[q, solid.M22] * y + solids[q, solid.M23] * z + solids[q, solid.MY],
        solids[q, solid.M31] * x + solids[q, solid.M32] * y + solids[q, solid.M33] * z + solids[q, solid.MZ],
    )
