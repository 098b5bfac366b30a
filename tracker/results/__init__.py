"""Results: files of a run, and the work on them: exports, smoothing, evaluation, recognition.

It loads and writes results, and tracks nothing. It imports `tracking` and all rooms below it.
"""
