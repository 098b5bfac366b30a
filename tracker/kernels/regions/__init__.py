"""Colours beside contours, for the evidence of regions."""
