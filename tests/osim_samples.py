"""A model file of OpenSim to test with: none is in the package."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from motions import MODELS, performed

from tracker.bodies.body.description import read_description
from tracker.results.recording.osim import Osim

OF_LIMBS = (
    *(("thigh", "femur"), ("shin", "tibia"), ("foot", "talus"), ("shoulder", "scapulaPhantom")),
    *(("upper_arm", "humerus"), ("forearm", "ulna"), ("hand", "hand")),
    *(("leg_extension", "knee_angle"), ("leg_elevation", "hip_flexion"), ("arm_extension", "elbow_flex")),
)
"""What we call bodies and coordinates, and what Rajagopal's model does."""

THEIRS = {f"{side}_{ours}": f"{theirs}_{side[0]}" for side in ("left", "right") for ours, theirs in OF_LIMBS}
THEIRS["chest"] = "torso"


def osim_like_rajagopals(folder: Path) -> Path:
    """A model whose bodies and coordinates are called as Rajagopal's, with our joints, taller, unable to turn round."""
    tall = read_description(MODELS / "human.toml").scaled(1.1).build()
    (made,) = performed(tall, np.zeros((1, tall.dof))).record(Osim(), folder)
    root = ElementTree.parse(made).getroot()
    for element in root.iter():
        if "name" in element.attrib:
            element.set("name", THEIRS.get(element.get("name"), element.get("name")))
        path, slash, name = (element.text or "").rpartition("/")
        element.text = f"{path}{slash}{THEIRS.get(name, name)}" or None
        if element.tag == "clamped":
            element.text = "true"
    for markers in root.iter("MarkerSet"):
        markers.find("objects").clear()
    path = folder / "own.osim"
    ElementTree.ElementTree(root).write(path)
    return path
