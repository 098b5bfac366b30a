"""Bundle adjustment and ray intersection, for `calibration` and `lsm`."""
