"""Acquisition: the body model of a person from silhouettes and edges (Gavrila & Davis 1996, section 3).

From pictures in plain stances, from a tracked recording, from a scan, a robot's description or measured points. It
imports `tracking` and all below it; only `running` imports it.
"""
