// Where a camera shows a point, and how that changes with camera and point: what a bundle adjustment linearizes.
#pragma once
#include "rows.hpp"

namespace bodytrack::adjustment {

// Of a pixel by the unknowns of the camera, which rows::bundle_unknown names, and by the point; rotations act after the
// camera's own, positions are the centre's.
struct PixelSlopes {
    double by_camera[2][rows::bundle_unknown::N_UNKNOWNS], by_point[2][3];
};

struct Pixel {
    double u = 0.0, v = 0.0;
    // of what lies behind the camera the slopes are 0
    bool before = false;
};

// Image of a point (3), metres, with its derivatives; the twin is `Camera.project`. camera (26) is a state, see
// tracker/kernels/rows/bundle_camera.py; velocity (2) that of the image, px per frame: the time offset shifts along it.
Pixel project_with_slopes(const double *camera, const double *point, const double *velocity, PixelSlopes &slopes);

}  // namespace bodytrack::adjustment
