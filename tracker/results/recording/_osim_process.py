"""Runs OpenSim's scaling and inverse kinematics as a separate program, with its own log, folder and crashes.

Its arguments are the set-up files of both. If there is no movement in the end, OpenSim's log says why.
"""

from __future__ import annotations

import importlib
import sys

opensim = importlib.import_module("opensim")
opensim.Logger.setLevelString("error")
if opensim.ScaleTool(sys.argv[1]).run():
    opensim.InverseKinematicsTool(sys.argv[2]).run()
