"""Cameras: lenses, rigs and views; files of rigs (`rig_layouts`), and where cameras stand (`calibration`).

A frame, the images of all cameras at one moment, is here as well. It knows no persons.
It imports `foundation` and `kernels`; every room above may import it.
"""
