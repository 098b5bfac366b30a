"""Bodies: segments in a tree, their shapes, skins and keypoints; persons in a scene, and the contours they should show.

It knows cameras, and no images. It imports `cameras`, `kernels` and `foundation`; every room above may import it.
"""
