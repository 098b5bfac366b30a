"""Evaluation: a result against exact truth or a reference, in millimetres and degrees."""
