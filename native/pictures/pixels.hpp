// Pixels between places in a row or a column of them; places may be anywhere, also infinite.
#pragma once
#include <cmath>

#include "array.hpp"

namespace bodytrack::pictures {

// Parts that come closer to the camera than this are not drawn, metres.
constexpr double NEAREST_M = 0.05;

// A place beyond all pictures, px.
constexpr double BEYOND_PX = 1e9;

// The first pixel that does not lie before a place, 0 at least.
inline Index first_pixel(double place) { return place > 0.0 ? Index(std::ceil(std::fmin(place, BEYOND_PX))) : 0; }

// The last pixel that does not lie behind a place, of n; -1 if there is none.
inline Index last_pixel(double place, Index n) {
    if (!(place >= 0.0)) return -1;
    return place >= double(n - 1) ? n - 1 : Index(place);
}

}  // namespace bodytrack::pictures
