"""What is read in the images of the cameras, for `imaging` and `analysis`."""
