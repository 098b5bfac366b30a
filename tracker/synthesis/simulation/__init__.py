"""Simulation: synthetic recordings of clothed superquadric persons with exact truth; needs no graphics library."""
