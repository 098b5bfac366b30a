"""Names of segments, parameters and landmarks as other programs read them."""

from __future__ import annotations

import re

_NOT_IN_A_NAME = re.compile(r"[\s\\*+/{}]")
"""What OpenSim opens no model with, what a BVH reader takes for the end of a name, and the tab of a table."""


def exported_name(name: str) -> str:
    """The name with `_` in place of each such sign: of "left thigh" and "left shin" a BVH reader made two "left"."""
    return _NOT_IN_A_NAME.sub("_", name)
