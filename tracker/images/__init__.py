"""Images: how they are read, what differs from a clean plate, which edges they show, and a look at them before a run.

It is told what to expect, and finds no poses. It imports `bodies`, `cameras`, `kernels` and `foundation`.
"""
