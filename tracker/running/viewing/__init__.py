"""Viewing: a run in space, in a browser on this machine, while it tracks or when it is finished; needs viser.

Pictures of contours along a finished run need no browser.
"""
