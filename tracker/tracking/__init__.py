"""Tracking: poses of all persons from frame to frame; `sequence` is the loop, `cycle_turn` one frame of it.

`initialization` finds the first poses, `prediction` guesses the next, `estimation` refines; they leave `estimate`,
`trajectory` and `doubt`. It imports `evidence`, `synthesis` and all rooms below, and knows nothing of files and
commands.
"""
