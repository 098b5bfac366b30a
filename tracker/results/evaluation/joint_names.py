"""Which joints of a result are compared, and what a reference calls them: the body's model file says so."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pydantic

from tracker.bodies.body.description import load_body
from tracker.bodies.body.sections import Joints
from tracker.bodies.segments import Mirror
from tracker.foundation.arrays import Array
from tracker.foundation.errors import SequenceError, shortened
from tracker.foundation.resources import model_path
from tracker.foundation.source_files import json_of, one_line


@dataclass(frozen=True)
class JointNames:
    """The joints of one body that are compared."""

    joints: Joints
    mirror: Mirror

    def ours(self, name: str) -> str:
        """Our name of a joint that a reference calls `l_elbow`, `RKnee` or `Head`; the same name if it is none."""
        for own, others in self.joints.aliases.items():
            if name in others:
                return own
        for side in self.mirror.sides:
            known = set(self.joints.evaluated)
            if name[:2].lower() == f"{side[0].lower()}_" and (own := f"{side}_{name[2:].lower()}") in known:
                return own
            if name[:1] == side[0].upper() and name[1:2].isupper() and (own := f"{side}_{name[1:].lower()}") in known:
                return own
        return name

    def of(self, found: dict[str, Array]) -> dict[str, Array]:
        """Points (3,) of one frame by our names, with those midway between two others where they lack.

        Raises:
            SequenceError: two names mean the same joint.
        """
        named: dict[str, Array] = {}
        for name, point in found.items():
            if named.setdefault(own := self.ours(name), point) is not point:
                both = ", ".join(shortened(other) for other in found if self.ours(other) == own)
                raise SequenceError(f"{both} all mean the joint {own}, expected one of them: leave the others out")
        for name, (one, other) in self.joints.middles.items():
            if name not in named and one in named and other in named:
                named[name] = (named[one] + named[other]) / 2
        return named


def names_of(result: Path) -> dict[str, JointNames]:
    """Person -> the joints to compare, from the run.json of a result folder.

    Persons whom it does not tell about have a person's joints, those of gavrila22: tables of other programs are
    compared as well.

    Raises:
        SequenceError: run.json is damaged.
    """
    body = load_body(model_path("gavrila22"))
    names = defaultdict(lambda: JointNames(body.joints, body.mirror))
    path = result / "run.json"
    if path.is_file():
        try:
            entries: list[dict[str, Any]] = json_of(path, SequenceError).get("persons", [])
            for entry in (entry for entry in entries if "joints" in entry):
                one, other = entry["sides"]
                names[entry["name"]] = JointNames(Joints.model_validate(entry["joints"]), Mirror((one, other)))
        except (ValueError, KeyError, AttributeError, TypeError, pydantic.ValidationError) as error:
            raise SequenceError(f"{path}: damaged, expected what a run writes there: {one_line(error)}") from error
    return names
