"""Strain: how the surface between followed points is stretched and sheared from one frame to another."""
