// Parts of a body that run through each other.
#pragma once
#include "array.hpp"

namespace bodytrack::body {

// How deep a point lies inside a part (7,): 0 at its surface, 1 on its axis, along the line between them across it.
// u, v, w: position in the part's frame divided by a1, a2, a3; inside.
double depth(const double *shape, double u, double v, double w);

// Points on the axes of parts that lie inside other parts, five to a part, by how deep they lie: surfaces that touch count
// for nothing, and what is deep inside another part for one a point. placements (B, P, 4, 4), shapes (P, 7); pairs (N, 2)
// of parts that must not run through each other. sums (B,) receives the sums over the points.
void sum_collisions(Array<const double, 4> placements, Array<const double, 2> shapes, Array<const Index, 2> pairs,
                    Array<double, 1> sums);

}  // namespace bodytrack::body
