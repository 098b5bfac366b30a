"""Common parts of all evidence: a person compared with an observation, correspondences, equations, accounts.

Evidence imports these, never the other way round; tracking uses them as well.
"""
