// Where viewing rays first meet the surface of a part that is known to be seen there.
#pragma once
#include "array.hpp"

namespace bodytrack::body {

// The first crossing of each ray (N, 3), a unit vector in the world from the centre (3), with one part (N,); placements
// (P, 4, 4), shapes (P, 7). found (N, 10): rows of `rows::met_place`, 0 where they do not meet.
void meet_parts(Array<const double, 3> placements, Array<const double, 2> shapes, const double *centre,
                Array<const double, 2> rays, Array<const Index, 1> parts, Array<double, 2> found);

}  // namespace bodytrack::body
