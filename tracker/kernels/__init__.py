"""Compiled (numba) inner loops, each held by the tests against a plain NumPy twin of the same name."""
