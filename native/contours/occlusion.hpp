// Which parts cover or touch a contour sample: ray tests against tapered superquadrics.
//
// Parts near one another in the image are told by their axes (`neighbours`); only those are tested.
#pragma once
#include "contours/solids.hpp"
#include "contours/workspace.hpp"

namespace bodytrack::contours {

// Squared distance of a pixel from the axis of a part, px^2.
double beside(const Solid &part, double u, double v);

// Those of some parts (covering: (P,)) that may cover or touch part p, which lies in a sphere of that radius.
void neighbours(Index p, const Solids &solids, const bool *covering, double radius, std::vector<Index> &listed);

// Whether a part covers a point seen from a camera; x, y, z is the point in the part's frame divided by a1, a2, a3.
bool blocks_ray(const Solid &part, float x, float y, float z);

// Marks those of n contour samples of another part that a part covers, or touches (distance contact_m) on their outer
// side.
void cover(const Solid &part, double contact_m, Spots &spots, int n);

}  // namespace bodytrack::contours
