// Contour samples from pictures of part numbers and depths.
//
// A pixel lies on its part's contour if one of its four neighbours shows the background or something farther away. In a
// round window about it, what shows the part is inside and what lies farther away is outside; whatever is nearer hides both
// and counts for neither. The centres of both sides give the normal, the share of the inside gives the distance of the
// contour from the pixel's centre. `tracker/synthesis/_shaders/edges.glsl` is this file for a graphics card.
#pragma once
#include "array.hpp"

namespace bodytrack::pictures {

// A picture of parts.
struct IdPicture {
    // (h, w) scene-wide part number, -1 for the background; metres, where there is a part
    Array<const Index, 2> ids;
    Array<const float, 2> depths;
    // its first pixel in the image, and the size of the image, px; the image shows nothing but background around it
    Index left, top, image_width, image_height;
};

// Where samples are written, laid out as in `Contours`: (M, 5), (M, 3), (M,) and (M,).
struct IdSamples {
    Array<float, 2> positions, points;
    Array<Index, 1> parts;
    Array<bool, 1> between;
};

// Contour samples, one for each pixel on a part's contour; their number, of which those beyond M are not written. solids
// (P, 17): motion (3x4) from the world into the part's frame in units of its half extents, tapers, exponents 2/e2, e2/e1
// and 2/e1. contact_m: distance at which parts touch, metres.
Index id_contours(const IdPicture &picture, const double *camera, Array<const double, 2> solids, double contact_m,
                  const IdSamples &samples);

}  // namespace bodytrack::pictures
