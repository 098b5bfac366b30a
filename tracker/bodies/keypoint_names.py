"""How keypoints are called by detectors, and by model files."""

from __future__ import annotations


def plain_name(name: str) -> str:
    """A keypoint's name in our spelling: `RShoulder`, `Right Shoulder` and `shoulder_r` are right_shoulder."""
    words = "".join(f" {letter.lower()}" if letter.isupper() else letter for letter in name)
    parts = words.replace("-", " ").replace("_", " ").replace(".", " ").split()
    # a name in capitals is one word
    if name.isupper():
        parts = name.lower().replace("-", " ").replace("_", " ").split()
    sides = [_SIDES[part] for part in parts if part in _SIDES]
    rest = [part for part in parts if part not in _SIDES]
    plain = "_".join([*sides[:1], *rest])
    return _WORDS.get(plain, plain)


_SIDES = {"l": "left", "r": "right", "left": "left", "right": "right"}
_WORDS = {"mid_hip": "pelvis", "hip_center": "pelvis", "hips": "pelvis", "head": "head_top"} | {
    f"{side}_big_toe": f"{side}_toe" for side in ("left", "right")
}
