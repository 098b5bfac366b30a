"""Results: what a run leaves on disk, and all that is made of it: exports, smoothing, evaluation, recognition.

It loads and writes results, and tracks nothing. It imports `tracking` and all below it.
"""
