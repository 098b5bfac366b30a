"""Least squares matching of image patches, for `lsm`."""
