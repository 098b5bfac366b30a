"""Defaults of a model file, derived from the shape of the body, so that a minimal file works as well."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from tracker.bodies.body import BodyModel
from tracker.bodies.body.entries import LandmarkEntry, PartEntry, SegmentEntry
from tracker.bodies.body.sections import Clothes, Joints, Movement, StartMarks, Term
from tracker.bodies.segments import Landmark, Mirror, Root, Segment
from tracker.foundation.arrays import Array
from tracker.foundation.errors import ModelError

# A limb that reaches less far down than this share of the body's height above the floor carries nothing.
_CARRIES = 0.15
# Rotations of a free limb that are worth trying have at least this range; collar bones have less.
_WIDE_DEG = 120.0
# Raised a little, half and fully to the side, and hanging or held forwards: how people stand when a recording begins.
_FIRST_DEG, _SECOND_DEG = (10.0, 45.0, 90.0), (0.0, 50.0)
# T- and A-pose.
_STANCES_DEG = (85.0, 45.0)
# The long axis is sought on the root segment if its landmarks span this share of the body.
_LONG = 0.25
_SAME = 0.006
# Distance, as a share of the body, up to which a part's end is a joint: limbs of the bundled models, round at their
# ends, begin and end 0.01 to 0.042 beyond their joints.
_AT_JOINT = 0.045
_SWAY_DEG, _SWAY_SHARE, _SWAY_S = 20.0, 0.4, 2.0
_GOLDEN = 0.618


def marks(segments: tuple[SegmentEntry, ...], parts: tuple[PartEntry, ...], mirror: Mirror) -> dict[str, LandmarkEntry]:
    """Landmarks: the joints that carry segments, and the ends of parts without a joint.

    Args:
        segments: the tree.
        parts: the shapes on it, one at least.
        mirror: symmetry: an end counts if that of the other side does.
    """
    found = {one.name: LandmarkEntry(segment=one.name, at=one.joint) for one in segments if one.parent != "world"}
    ends = {
        f"{part.name}_{end}": LandmarkEntry(segment=part.segment, at=at)
        for part in parts
        for end, at in (("start", part.start), ("end", part.end))
    }
    near = _AT_JOINT * float(np.ptp([mark.at for mark in ends.values()], axis=0).max())
    joints = [np.array(mark.at) for mark in found.values()]
    free = {
        name for name, mark in ends.items() if all(float(np.linalg.norm(mark.at - joint)) > near for joint in joints)
    }
    paired = {name for name in free if mirror.of(name) in free or mirror.of(name) not in ends}
    return found | {name: mark for name, mark in ends.items() if name in paired}


def bones(
    segments: tuple[SegmentEntry, ...], parts: tuple[PartEntry, ...], known: dict[str, LandmarkEntry]
) -> tuple[tuple[str, str], ...]:
    """Links between `marks`: from joint to joint, from the last joint to the free ends, and along segments with two."""
    pairs = [(one.parent, one.name) for one in segments]
    for part in parts:
        start, end = f"{part.name}_start", f"{part.name}_end"
        pairs += [(start, end)] if start in known and end in known else [(part.segment, start), (part.segment, end)]
    return tuple(pair for pair in pairs if pair[0] in known and pair[1] in known)


def chains(segments: tuple[Segment, ...], names: tuple[str, ...]) -> dict[str, tuple[str, ...]]:
    """Search groups: the parameters between two branchings of the tree, named after their first segment.

    Args:
        segments: the tree.
        names: of all parameters.
    """
    children = [[k for k, other in enumerate(segments) if other.parent == i] for i in range(len(segments))]
    first: list[int] = []
    for k, segment in enumerate(segments):
        above = segment.parent
        joins = above >= 0 and segments[above].parent >= 0 and len(children[above]) == 1
        first.append(first[above] if joins else k)
    groups: dict[str, tuple[str, ...]] = {}
    for k, segment in zip(first, segments, strict=True):
        own = tuple(names[column] for column in segment.parameters)
        if own:
            groups[segments[k].name] = (*groups.get(segments[k].name, ()), *own)
    return groups


def start_marks(body: BodyModel) -> StartMarks:
    """The ends of the long axis, the turn about the vertical, and the free limbs held in a few ways."""
    head, base = _axis_ends(body)
    root = _root(body)
    turn = "" if root is None else body.names[root.turn]
    first, second = _free_limbs(body)
    coarse = {name: values for names, values in ((first, _FIRST_DEG), (second, _SECOND_DEG)) for name in names}
    return StartMarks(
        head=head,
        base=base,
        turn=turn,
        coarse_deg={name: _possible(body, name, values) for name, values in coarse.items()},
        stances_deg=tuple(
            {name: _possible(body, name, (value,))[0] for name in first}
            for value in (_STANCES_DEG if first else (0.0,))
        ),
    )


def _root(body: BodyModel) -> Root | None:
    try:
        return body.root
    except ModelError:
        return None


def _axis_ends(body: BodyModel) -> tuple[str, str]:
    """Landmarks on the midline farthest apart: of the root segment, if these span a good part of the body."""
    marks = [mark for mark in body.landmarks if body.mirror.of(mark.name) == mark.name]
    root = _root(body)
    trunk = [mark for mark in marks if root is not None and mark.parameter == root.columns[-1]]
    found = _farthest(trunk)
    if found is None or _length(*found) < _LONG * float(np.ptp(_surface(body), axis=0).max()):
        found = _farthest(marks)
    if found is None:
        return "", ""
    along = np.abs(found[0].point - found[1].point)
    # Heads are up where the body stands, in front where it lies: x points forwards in every model file.
    axis = 2 if along[2] >= along[:2].max() else 0
    base, head = sorted(found, key=lambda mark: float(mark.point[axis]))
    return head.name, base.name


def _farthest(marks: list[Landmark]) -> tuple[Landmark, Landmark] | None:
    pairs = list(combinations(marks, 2))
    return max(pairs, key=lambda pair: _length(*pair)) if pairs else None


def _length(one: Landmark, other: Landmark) -> float:
    return float(np.linalg.norm(one.point - other.point))


def _surface(body: BodyModel) -> Array:
    """(N, 3) ends of all parts in the reference pose, metres."""
    ends = [part.model_from_part @ [0, 0, sign * part.shape.size[2], 1] for part in body.parts for sign in (-1, 1)]
    return np.array(ends)[:, :3]


def _free_limbs(body: BodyModel) -> tuple[list[str], list[str]]:
    """First and second wide rotation of a pair of limbs that do not carry the body: arms."""
    floor, height = float(_surface(body)[:, 2].min()), float(np.ptp(_surface(body)[:, 2]))
    for group in body.fine_groups:
        other = body.partner_of(group)
        if other is None or other not in body.fine_groups:
            continue
        ends = _surface(body).reshape(-1, 2, 3)[body.parts_of(group)]
        if ends.size and ends[..., 2].min() > floor + _CARRIES * height:
            wide = [name for name in body.groups[group] if _range_deg(body, name) >= _WIDE_DEG][:2]
            pairs = [[name, body.mirror.of(name)] for name in wide]
            return (pairs[0] if pairs else []), (pairs[1] if len(pairs) > 1 else [])
    return [], []


def _range_deg(body: BodyModel, name: str) -> float:
    parameter = body.parameters[body.index(name)]
    return float(np.degrees(np.ptp(parameter.limits))) if parameter.rotates else 0.0


def _possible(body: BodyModel, name: str, values_deg: tuple[float, ...]) -> tuple[float, ...]:
    """The values moved inside the limits, each once."""
    low, high = np.degrees(body.parameters[body.index(name)].limits)
    return tuple(dict.fromkeys(float(np.clip(value, low, high)) for value in values_deg))


def joints(body: BodyModel) -> Joints:
    """All landmarks, and a hinge wherever a segment turns about a single axis between two bones."""
    names = body.landmark_names
    return Joints(reported=names, evaluated=names, hinges=_hinges(body))


def _hinges(body: BodyModel) -> dict[str, tuple[str, str]]:
    found = {}
    near = _SAME * max(body.stature_m, float(np.ptp(_surface(body), axis=0).max()))
    for segment in body.segments:
        if len(segment.parameters) != 1 or not body.rotates[segment.parameters[0]]:
            continue
        joint = [mark for mark in body.landmarks if np.linalg.norm(mark.point - segment.joint) < near]
        for mark in joint:
            linked = [b if a == mark.name else a for a, b in body.links if mark.name in (a, b)]
            moved = {name: body.moves[segment.parameters[0], _mark(body, name).parameter] for name in linked}
            before, behind = ([name for name in linked if moved[name] == way] for way in (False, True))
            if len(before) == len(behind) == 1:
                found[mark.name] = before[0], behind[0]
    return found


def _mark(body: BodyModel, name: str) -> Landmark:
    return body.landmarks[body.landmark_names.index(name)]


def clothes(body: BodyModel) -> Clothes:
    """A garment for every part, the same on both sides."""
    garments: dict[str, tuple[str, ...]] = {}
    names = [part.name for part in body.parts]
    for name in names:
        mate = body.mirror.of(name)
        if mate not in garments:
            garments[name] = (name, mate) if mate in names and mate != name else (name,)
    return Clothes(garments=garments)


def movements(body: BodyModel) -> dict[str, Movement]:
    """A single movement, in which every joint swings a little about its rest, no two in step."""
    root = _root(body)
    still = set() if root is None else set(root.columns.tolist())
    curves: dict[str, tuple[Term, ...]] = {}
    for k, parameter in enumerate(body.parameters):
        low, high = np.degrees(parameter.limits) if parameter.rotates else parameter.limits
        amount = min(_SWAY_SHARE * (high - low) / 2, _SWAY_DEG if parameter.rotates else 0.05)
        if k not in still and np.isfinite(amount):
            middle = float(np.clip(0.0, low + amount, high - amount))
            curves[parameter.name] = Term(at=middle), Term(swing=amount, period_s=_SWAY_S, phase=k * _GOLDEN % 1.0)
    return {"sway": Movement(about="every joint swings a little about its rest", curves=curves)}
