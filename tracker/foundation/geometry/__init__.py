"""Pure geometry: rotations, rigid motions, twists, superquadrics."""
