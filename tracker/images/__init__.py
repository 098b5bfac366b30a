"""Images: reading them, differences from a clean plate, edges, and an inspection before a run.

It gets the expected contours, and finds no poses. It imports `bodies`, `cameras`, `kernels` and `foundation`.
"""
