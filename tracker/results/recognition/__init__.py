"""Recognition of movements (Gavrila & Davis 1995): joint angles, matched by dynamic time warping with known ones."""
