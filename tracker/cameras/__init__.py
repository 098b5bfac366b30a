"""Cameras: lenses, rigs, the geometry between views; files of rigs (`rig_layouts`), where cameras stand (`calibration`).

A frame, the images of all cameras at one moment, is here as well. It knows no persons.
It imports `foundation` and `kernels`; every room above may import it.
"""
