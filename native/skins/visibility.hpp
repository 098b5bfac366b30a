// Whether a contour of a mesh is seen, judged by a coarse depth picture of its view.
//
// A surface must not hide its own contour: what is in a contour's place may be nearer than what is beside it, by as much as
// a surface bulges within a cell of the picture.
#pragma once
#include "skins/depths.hpp"

namespace bodytrack::skins {

// What a sample is: seen, seen with another surface behind that it touches, or hidden.
enum State { VISIBLE, BETWEEN, HIDDEN };

// Whether something at a pixel is well before a depth, metres.
bool covered(const View &view, double u, double v, double depth);

// Whether a contour is seen: judged by what is in its place u, v, and by what is seen beside it. nu, nv: unit image normal,
// outwards; depth: of the contour, metres; contact_m: distance at which surfaces touch, metres.
State state_of(const View &view, double u, double v, double nu, double nv, double depth, double contact_m);

}  // namespace bodytrack::skins
