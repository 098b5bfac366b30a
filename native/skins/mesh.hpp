// Meshes that move with the parts of a scene.
#pragma once
#include <cstdint>

#include "array.hpp"

namespace bodytrack::skins {

// Triangles of what is seen of all persons, as `tracker.kernels.skins.Mesh`.
struct Mesh {
    // (N, 3) vertices in the pose that the surface was measured in, metres; unit normals of the surface there, outwards
    Array<const float, 2> points, normals;
    // (N, K) scene-wide parts that move a vertex, the strongest first; how much each of them does, adding up to 1
    Array<const Index, 2> bones;
    Array<const float, 2> weights;
    // (T, 3) vertex numbers, anticlockwise seen from outside; (T,) scene-wide part that a face belongs to
    Array<const Index, 2> faces;
    Array<const Index, 1> parts;
    // (E, 4) edges of a single face: both ends, the third corner of the face, and the face
    Array<const Index, 2> borders;
    // so many faces, the first ones, have contours; the others only hide what is behind them
    Index n_traced;
};

// Linear blend skinning: x(q) = sum_k w_k M_k(q) x, and the same without translations for normals, which are not of unit
// length where motions differ. motions (P, 3, 4) of each part, from the pose that it was measured in to the one wanted;
// points and normals (N, 3) in the world, metres.
void pose_mesh(const Mesh &mesh, Array<const float, 3> motions, Array<float, 2> points, Array<float, 2> normals);

// Motions (P, 3, 4) of all parts at placements (P, 4, 4) from the pose that their surface was measured in, by
// part_from_rest (P, 4, 4).
void motions_of(Array<const double, 3> placements, Array<const double, 3> part_from_rest, Array<float, 3> motions);

}  // namespace bodytrack::skins
