"""Viewing: a run in space, in a browser on this machine, while it tracks or when it is finished; needs viser.

Contours along a finished run are pictures, and need nothing.
"""
