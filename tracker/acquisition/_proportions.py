"""How lengths of persons of one stature go together: who has long thighs has a short trunk, and hands as feet.

ANSUR II (Gordon et al., 2012 Anthropometric Survey of U.S. Army Personnel, NATICK/TR-15/007, 2014; public data of 4082
men and 1986 women): logarithms of lengths over the stature, correlated over the men and over the women, mean of both.
Upper arm: acromion to radiale; forearm: radiale to stylion; thigh: trochanterion less lateral femoral epicondyle; shin:
that less lateral malleolus; trunk: cervicale less trochanterion; head and neck: stature less cervicale.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tracker.foundation.arrays import Array, frozen

SEGMENTS = ("upper_arm", "forearm", "hand", "thigh", "shin", "foot", "trunk", "head")

CORRELATIONS = frozen(
    [
        [1.00, 0.34, 0.21, 0.18, 0.37, 0.13, -0.26, -0.29],
        [0.34, 1.00, 0.39, 0.28, 0.42, 0.34, -0.38, -0.28],
        [0.21, 0.39, 1.00, 0.08, 0.28, 0.61, -0.20, -0.15],
        [0.18, 0.28, 0.08, 1.00, 0.05, 0.05, -0.74, -0.23],
        [0.37, 0.42, 0.28, 0.05, 1.00, 0.24, -0.50, -0.35],
        [0.13, 0.34, 0.61, 0.05, 0.24, 1.00, -0.17, -0.10],
        [-0.26, -0.38, -0.20, -0.74, -0.50, -0.17, 1.00, -0.05],
        [-0.29, -0.28, -0.15, -0.23, -0.35, -0.10, -0.05, 1.00],
    ]
)
"""Standard deviations are 0.033, 0.043, 0.040, 0.049, 0.039, 0.035, 0.040 and 0.048: `ShapePrior.length`."""

_CALLED = {"chest.height": "trunk", "torso.height": "trunk"}
"""Parameters that lengthen what is measured under another name."""


def correlated(names: Sequence[str], sides: Sequence[str]) -> Array:
    """(S, S) correlations of shape parameters; those that people's proportions do not tell are independent.

    Args:
        names: of the parameters, `left_thigh.length`.
        sides: words that tell sides apart, `left`.
    """
    found, first = np.eye(len(names)), dict[str, int]()
    for k, name in enumerate(names):
        plain = name
        for side in sides:
            plain = plain.removeprefix(f"{side}_")
        segment = _CALLED.get(plain, plain.removesuffix(".length"))
        if segment in SEGMENTS and (plain.endswith(".length") or plain in _CALLED):
            first.setdefault(segment, k)  # of a body whose sides differ the first one: the other is as free as it was
    for one, k in first.items():
        for other, j in first.items():
            found[k, j] = CORRELATIONS[SEGMENTS.index(one), SEGMENTS.index(other)]
    return found
