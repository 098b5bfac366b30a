"""Kernels of skins: triangle meshes that move with the parts of a body."""
