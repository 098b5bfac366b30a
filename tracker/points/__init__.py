"""Points: D'Apuzzo's half. Surfaces measured by least squares matching, and points followed on them.

It knows cameras and images, and no bodies. Tracking knows it through one evidence alone, `evidence.points`.
It imports `images`, `cameras`, `kernels` and `foundation`.
"""
