"""One line of the journal: a step as text, exact to the bit."""

from __future__ import annotations

import json
import math
import zlib
from base64 import b85decode, b85encode
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tracker.evidence.measures.account import Account
from tracker.foundation.arrays import Array, Integers, Mask, Numbers16
from tracker.foundation.errors import SequenceError
from tracker.tracking.doubt import Because, Doubt
from tracker.tracking.estimate import Estimate, Status
from tracker.tracking.trajectory import Replay, Step

# Covariances in few bytes, so that they stay covariances: variances, and partial correlations as small numbers.
#
# Rounded correlations can make a matrix that is no correlation matrix. Rounded partial correlations cannot: each may be
# anything between -1 and 1, whatever the others are (Joe 2006; Lewandowski, Kurowicka & Joe 2009, section 2). The
# partial correlations of a parameter and each one before it, given all that come before that one, are kept as Fisher's
# z, the inverse hyperbolic tangent, in steps of 1/64.

_STEP = 1 / 64
"""Steps of z. Measured with 22 and 36 parameters: standard deviations of 2000 random combinations stay right to 2 %,
those of the worst possible combination to 16 %; steps of 1/128 halve that, and 36 parameters then take 2.1 KB a
frame."""

_MOST_STEPS = 320
"""Largest z: a partial correlation of 0.9999."""

_ROUNDS = 4
"""Number of attempts after which correlations that change with each rounding are given up. One is enough for bodies; of
2000 nearly singular matrices 23 were given up."""


@dataclass(frozen=True)
class KeptCovariance:
    """A covariance matrix as it is kept; keeping `covariance_of` it gives the same numbers again."""

    variances: Array
    """(dof,) bfloat16 values, to 0.2 %; NaN where unknown."""

    steps: Integers
    """(dof (dof - 1) / 2,) partial correlations of the lower triangle, row by row; empty if unknown."""

    def packed(self) -> tuple[bytes, bytes]:
        """Variances, 2 bytes each; the steps compressed: the low bytes of all, then all high bytes, mostly 0 or -1."""
        pairs = self.steps.astype("<i2").view(np.uint8).reshape(-1, 2)
        return _halves(self.variances).tobytes(), zlib.compress(np.ascontiguousarray(pairs.T).tobytes(), 9)


def _halves(variances: Array) -> Numbers16:
    """The nearest bfloat16 numbers: the upper halves of float32."""
    with np.errstate(over="ignore", under="ignore", invalid="ignore"):
        bits = np.asarray(variances, dtype="<f4").view("<u4")
    return np.asarray(np.where(np.isfinite(variances), bits + 0x8000, bits) >> 16, dtype=np.uint16)


def _whole(halves: Numbers16) -> Array:
    return (halves.astype("<u4") << 16).view("<f4").astype(np.float64)


def unpacked(variances: bytes, packed: bytes) -> KeptCovariance:
    """The numbers of `KeptCovariance.packed`.

    Raises:
        SequenceError: they are not such numbers, or their count does not match the variances.
    """
    known = _whole(np.frombuffer(variances, dtype="<u2"))
    n = len(known) * (len(known) - 1) // 2
    inflating = zlib.decompressobj()
    try:
        content = inflating.decompress(packed, 2 * n + 1)
    except zlib.error as error:
        raise SequenceError(str(error)) from error
    if len(content) not in (0, 2 * n) or not inflating.eof:
        raise SequenceError(f"{len(content)} bytes of correlations, expected {2 * n}")
    pairs = np.frombuffer(content, dtype=np.uint8).reshape(2, -1)
    steps = np.ascontiguousarray(pairs.T).view("<i2").ravel().astype(np.int64)
    if (np.abs(steps) > _MOST_STEPS).any():
        raise SequenceError("a correlation beyond 1")
    return KeptCovariance(known, steps)


def kept(covariance: Array) -> KeptCovariance:
    """The kept form of a covariance matrix (dof, dof); NaN in it is unknown."""
    found = _rounded(covariance)
    for _ in range(_ROUNDS):
        again = _rounded(covariance_of(found))
        if np.array_equal(again.steps, found.steps):
            return found
        found = again
    return KeptCovariance(found.variances, 0 * found.steps)


def covariance_of(found: KeptCovariance) -> Array:
    """The covariance matrix (dof, dof) of the kept form."""
    n = len(found.variances)
    if not len(found.steps):
        covariance: Array = np.full((n, n), np.nan)
    else:
        partial = np.zeros((n, n))
        partial[np.tril_indices(n, -1)] = np.tanh(_STEP * found.steps)
        # the rest of the length 1 of a row of the Cholesky factor before each column
        left = np.sqrt(np.cumprod(np.column_stack([np.ones(n), 1 - partial[:, :-1] ** 2]), axis=1))
        factor = np.tril(partial * left, -1) + np.diag(np.diag(left))
        sigmas = np.sqrt(found.variances)
        covariance = sigmas[:, None] * (factor @ factor.T) * sigmas
    np.fill_diagonal(covariance, found.variances)
    return covariance


def _rounded(covariance: Array) -> KeptCovariance:
    """The nearest numbers; parameters that are certain or unknown have no correlations."""
    with np.errstate(over="ignore", under="ignore", invalid="ignore"):
        variances = _whole(_halves(np.diag(covariance)))
        scale = np.sqrt(np.where(np.diag(covariance) > 0, np.diag(covariance), 0.0))
        correlations = covariance / np.where(scale > 0, scale, np.inf)[:, None] / np.where(scale > 0, scale, np.inf)
    np.fill_diagonal(correlations, 1.0)
    if not (np.isfinite(correlations).all() and np.isfinite(variances).all() and (variances >= 0).all()):
        return KeptCovariance(variances, np.zeros(0, dtype=np.int64))
    factor = _factored(correlations)
    left = np.maximum(1 - np.cumsum(factor**2, axis=1) + factor**2, 1e-12)
    rows = np.tril_indices(len(factor), -1)
    most = np.tanh(_STEP * _MOST_STEPS)
    partial = np.clip(factor[rows] / np.sqrt(left[rows]), -most, most)
    return KeptCovariance(variances, np.round(np.arctanh(partial) / _STEP).astype(np.int64))


def _factored(correlations: Array) -> Array:
    """Cholesky factor of a correlation matrix; if rounding errors spoilt it, of one beside it."""
    shrunk = 0.0
    while shrunk < 1:
        try:
            beside = (1 - shrunk) * correlations + shrunk * np.eye(len(correlations))
            return np.asarray(np.linalg.cholesky(beside), dtype=np.float64)
        except np.linalg.LinAlgError:
            shrunk = max(1e-9, 10 * shrunk)
    return np.eye(len(correlations))


_LISTS = "per_view_px", "per_part_px", "visible_px", "explained_px", "missed_px"
_MASKS = "not_shown", "hidden"

_LARGEST = 2**20
"""Largest number of bytes of an account: thousands of parts."""


def as_kept(step: Step) -> Step:
    """The step with covariances as the journal keeps them, so that a resumed run goes on with the same numbers."""
    return replace(step, estimates=tuple(_as_kept(estimate) for estimate in step.estimates))


def line_of(step: Step) -> str:
    """The line of a frame, with its end."""
    return json.dumps(_line(step), separators=(",", ":")) + "\n"


def replay_of(line: bytes) -> Replay:
    """The step in a line.

    Raises:
        SequenceError, ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError: not such a line.
    """
    entry = json.loads(line)
    overlap, time_s = entry["overlap"], float(entry["time_s"])
    if not math.isfinite(time_s):
        raise SequenceError("a time that is not finite")
    return Replay(
        index=int(entry["frame"]),
        time_s=time_s,
        estimates=tuple(_estimate(values) for values in entry["estimates"]),
        seconds={str(stage): float(value) for stage, value in entry["seconds"].items()},
        overlap=None if overlap is None else _unpacked(overlap),
        untrusted={int(v): str(fault) for v, fault in entry["untrusted"].items()},
        strangers=bool(entry.get("strangers", False)),
        start_confidence=_confidences(entry.get("start_confidence", [])),
        unfaced=bool(entry.get("unfaced", False)),
        as_tracked=_poses(entry.get("as_tracked", []), entry["estimates"]),
    )


def _line(step: Step) -> dict[str, Any]:
    return {
        "frame": step.frame.index,
        "time_s": step.frame.time_s,
        "seconds": {stage: round(value, 5) for stage, value in step.seconds.items()},
        "overlap": None if step.overlap is None else _packed(step.overlap),
        "untrusted": {str(v): fault for v, fault in step.untrusted.items()},
        **({"strangers": True} if step.strangers else {}),
        **({"start_confidence": list(step.start_confidence)} if step.start_confidence else {}),
        **({"unfaced": True} if step.may_face_the_other_way else {}),
        "estimates": [_to_json(estimate) for estimate in step.estimates],
        **({"as_tracked": [_packed(q) for q in step.as_tracked]} if step.as_tracked else {}),
    }


def _poses(values: list[Any], estimates: list[Any]) -> tuple[Array, ...]:
    """Poses of each of the estimates; empty if there are none."""
    poses = tuple(map(_unpacked, values))
    fit = [len(q) == len(_unpacked(one["q"])) for q, one in zip(poses, estimates, strict=False)]
    if poses and (len(poses) != len(estimates) or not all(fit) or not all(np.isfinite(q).all() for q in poses)):
        raise SequenceError("poses as tracked that are not those of the estimates")
    return poses


def _confidences(values: list[Any]) -> tuple[float, ...]:
    told = tuple(float(value) for value in values)
    if not all(0 <= value <= 1 for value in told):
        raise SequenceError("a confidence that is not between 0 and 1")
    return told


def _to_json(estimate: Estimate) -> dict[str, Any]:
    variances, correlations = kept(estimate.covariance).packed()
    return {
        "q": _packed(estimate.q),
        "variances": b85encode(variances).decode(),
        "correlations": b85encode(correlations).decode(),
        "distance_px": estimate.account.distance_px,
        "views": len(estimate.account.per_view_px),
        "account": _deflated(np.concatenate([getattr(estimate.account, name) for name in _LISTS])),
        **{name: places for name in _MASKS if (places := _places(getattr(estimate.account, name)))},
        "penalty_px": estimate.penalty_px,
        "evaluations": estimate.evaluations,
        "search_s": estimate.search_s,
        **({"vain": dict(estimate.vain)} if estimate.vain else {}),
        "status": str(estimate.status),
        "doubts": [doubt.as_row() for doubt in estimate.doubts],
        **({} if estimate.joint_sigmas_m is None else {"joint_sigmas_m": _packed(estimate.joint_sigmas_m, "<f4")}),
    }


def _estimate(values: dict[str, Any]) -> Estimate:
    q = _unpacked(values["q"])
    if not np.isfinite(q).all():
        raise SequenceError("a pose that is not finite")
    covariance = unpacked(b85decode(values["variances"]), b85decode(values["correlations"]))
    if len(covariance.variances) != len(q):
        raise SequenceError(f"{len(covariance.variances)} variances of {len(q)} parameters")
    per_view_px, per_part_px, visible_px, explained_px, missed_px = _inflated(values["account"], int(values["views"]))
    not_shown, hidden = (_mask(values.get(name, []), (len(per_view_px), len(per_part_px))) for name in _MASKS)
    return Estimate(
        q=q,
        covariance=covariance_of(covariance),
        account=Account(
            float(values["distance_px"]),
            per_view_px,
            per_part_px,
            visible_px,
            explained_px,
            missed_px,
            not_shown=not_shown,
            hidden=hidden,
        ),
        penalty_px=float(values["penalty_px"]),
        evaluations=int(values["evaluations"]),
        search_s=float(values["search_s"]),
        vain={str(group): float(share) for group, share in values.get("vain", {}).items()},
        status=Status(values["status"]),
        doubts=_untold(values) if "doubts" not in values else tuple(map(Doubt.of_row, values["doubts"])),
        joint_sigmas_m=_sigmas(values.get("joint_sigmas_m")),
    )


def _untold(values: dict[str, Any]) -> tuple[Doubt, ...]:
    """Doubts of an old line, which has no reasons."""
    vague = {str(limb) for limb in values.get("vague", ())}
    whole = [Doubt("", Because.UNTOLD)] if values["doubtful"] or values["status"] == Status.LOST else []
    limbs = [str(limb) for limb in values["ambiguous"]]
    return (*whole, *(Doubt(limb, Because.HARDLY_SEEN if limb in vague else Because.UNTOLD) for limb in limbs))


def _sigmas(text: str | None) -> Array | None:
    """Standard deviations of joints; None if there are none.

    Raises:
        SequenceError: they cannot be standard deviations.
    """
    sigmas_m = None if text is None else _unpacked(text, "<f4")
    if sigmas_m is not None and not (np.isfinite(sigmas_m).all() and (sigmas_m >= 0).all()):
        raise SequenceError("sigmas of joints that are negative or not finite")
    return sigmas_m


def _as_kept(estimate: Estimate) -> Estimate:
    sigmas_m = estimate.joint_sigmas_m
    short = None if sigmas_m is None else sigmas_m.astype(np.float32).astype(np.float64)
    return replace(estimate, covariance=covariance_of(kept(estimate.covariance)), joint_sigmas_m=short)


def _places(mask: Mask | None) -> list[list[int]]:
    """View and part of all entries that are true."""
    return [] if mask is None else np.argwhere(mask).tolist()


def _mask(places: list[list[int]], shape: tuple[int, int]) -> Mask | None:
    """A mask (V, P) that is true in some places; None without a place.

    Raises:
        SequenceError: a place is outside of it.
    """
    if not places:
        return None
    mask, rows = np.zeros(shape, dtype=np.bool_), np.array(places, dtype=np.int64).reshape(-1, 2)
    if (rows < 0).any() or (rows >= shape).any():
        raise SequenceError(f"a part hidden from a view that is none of {shape[1]} parts or {shape[0]} views")
    mask[tuple(rows.T)] = True
    return mask


def _packed(values: Array, kind: str = "<f8") -> str:
    return b85encode(np.asarray(values, dtype=kind).tobytes()).decode()


def _unpacked(text: str, kind: str = "<f8") -> Array:
    return np.frombuffer(b85decode(text), dtype=kind).astype(np.float64)


def _deflated(values: Array) -> str:
    """Packed numbers, compressed: most visible contours are explained, and most parts miss nothing."""
    return b85encode(zlib.compress(np.asarray(values, dtype="<f8").tobytes(), 9)).decode()


def _inflated(text: str, n_views: int) -> list[Array]:
    """The lists of an account.

    Raises:
        SequenceError: it is not such a text, or longer than any account.
    """
    inflating = zlib.decompressobj()
    try:
        content = inflating.decompress(b85decode(text), _LARGEST)
    except zlib.error as error:
        raise SequenceError(str(error)) from error
    if inflating.unconsumed_tail or not inflating.eof:
        raise SequenceError("an account that is too long or torn")
    values = np.frombuffer(content, dtype="<f8").astype(np.float64)
    return [values[:n_views], *values[n_views:].reshape(len(_LISTS) - 1, -1)]
