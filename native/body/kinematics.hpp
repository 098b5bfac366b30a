// Forward kinematics by product of exponentials, batched over poses.
#pragma once
#include "array.hpp"

namespace bodytrack::body {

// The parameters of a body: (dof,) rotation or translation; (dof, 3) unit axes in the reference pose; (dof, 3) points on
// them, metres; (dof,) index of the preceding parameter, -1 for none; parents come first.
struct Chain {
    Array<const bool, 1> rotates;
    Array<const double, 2> axes, points;
    Array<const Index, 1> parents;

    Index dof() const { return rotates.size(); }
    // Place of what carries parameter i, where the unit motion stands last.
    Index before(Index i) const { return parents[i] < 0 ? dof() : parents[i]; }
};

// Motions (B, dof + 1, 4, 4) of the reference pose at the end of every parameter's chain, of poses (B, dof), rad or m;
// the last is the unit motion.
void chain_transforms(Array<const double, 2> poses, const Chain &chain, Array<double, 4> motions);

// Spatial twists (B, dof, 6) at those motions: linear velocity v and angular velocity w of unit speed; a point X moves by
// v + w x X.
void twists_in_world(Array<const double, 4> motions, const Chain &chain, Array<double, 3> twists);

}  // namespace bodytrack::body
