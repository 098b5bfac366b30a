"""What kinds of evidence share: a person compared with what was observed, correspondences, equations, accounts.

Evidence imports these nouns, never the other way round; tracking uses them as well.
"""
