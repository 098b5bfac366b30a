"""Limbs that something hides from a view: a board, a table, somebody who passes. Other views show where they are."""

from __future__ import annotations

import math

import numpy as np

from tracker.bodies.body import BodyModel
from tracker.cameras.rig import Rig
from tracker.evidence.measures.account import Account
from tracker.foundation.arrays import Array, Mask

_LEAST_PX, _LEAST_KNOWN_PX = 40.0, 10.0
"""Contour that a view should show of a limb to have a say in where it is: half of a forearm's at 720 px. Less where
something is known to hide it: colours learn nothing there and then have no say."""

# See docs/lab/hidden_limbs.md.
_SHOWN, _NOT_SHOWN, _STILL = 0.2, 0.45, 0.3
"""Share of a limb's contour that a view leaves over at most if it shows the limb, and at least if it does not; between
the two once something is known to hide it. Of R-UpperBody's left arm the view with a board before it leaves over 0.45
to 0.96 in 80 frames, the other three 0 to 0.3. Of 4221 limbs put 150 mm and more off (exchanged, scattered and refined,
or the body turned round; V-Dance, K-Kick, R-Turn, T-Punch-light) 91.0 % are in doubt; 90.1 if each was so hidden, 88.0
with 0.3 in place of 0.2."""

_MOST = 0.1
"""Share of the person's contour from which on so much is left over that it is the pose that is wrong. Without such a
bound 89.8 % of those limbs would be in doubt."""

_APART = math.sin(math.radians(20.0))
"""Of the angle between rays, the sine from which on they meet in a place: not in views that face each other."""

LONG_FRAMES = 4
"""Frames for which a view has not shown a limb before something is taken to hide it there. From the first frame on, an
arm that was wrong from T-Punch-light's frame 16 on was no longer in doubt in two of four frames."""


def not_shown_by(body: BodyModel, rig: Rig, places: Array, account: Account, hidden: Mask | None = None) -> Mask | None:
    """Parts (V, P) of limbs that a view does not show while others do; None for none.

    A limb that two views show from different sides is where it is taken to be. Where a third one does not show it for
    long, something is before it there. For a frame or two the images of a limb in a wrong place may look so.

    Args:
        body: the model.
        rig: the cameras.
        places: (P, 3) where the parts are, metres.
        account: of the pose, with what each view has.
        hidden: (V, P) parts that something hid a frame before; None for none.
    """
    if account.by_view_px is None:
        return None
    members = np.array([body.parts_of(group) for group in body.fine_groups], dtype=np.float64)
    visible, explained, missed = account.by_view_px @ members.T
    known = np.zeros(visible.shape, dtype=np.bool_) if hidden is None else hidden @ members.T > 0
    told = visible >= np.where(known, _LEAST_KNOWN_PX, _LEAST_PX)
    left_over = np.where(told, (visible - explained + missed) / np.maximum(visible, 1.0), np.nan)
    shown = left_over <= np.where(known.any(axis=0), _STILL, _SHOWN)
    not_shown = left_over > np.where(known, _STILL, _NOT_SHOWN)
    found = np.zeros(account.by_view_px.shape[1:], dtype=np.bool_)
    for k in np.flatnonzero(not_shown.any(axis=0) & (shown.sum(axis=0) > np.maximum(not_shown.sum(axis=0), 1))):
        place = places[members[k] > 0].mean(axis=0)
        if _meet(place - np.array([rig.cameras[v].centre for v in np.flatnonzero(shown[:, k])])):
            found |= not_shown[:, k, None] & (members[k] > 0)
    much = account.by_view_px[0][found].sum() > _MOST * account.by_view_px[0].sum()
    return found if found.any() and not much else None


def hidden_limbs(body: BodyModel, account: Account) -> list[tuple[int, str]]:
    """Number of the view, and limb, of all that an account has as hidden."""
    if account.hidden is None:
        return []
    groups = [(group, body.parts_of(group)) for group in body.fine_groups]
    return [(v, group) for v, parts in enumerate(account.hidden) for group, own in groups if parts[own].any()]


def _meet(rays: Array) -> bool:
    """Whether two of some rays (N, 3) come from sides so different that they tell a place."""
    directions = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    sines = np.linalg.norm(np.cross(directions[:, None], directions[None]), axis=2)
    return bool(sines.max() >= _APART)
