"""Kernels of the recognition of movements."""
