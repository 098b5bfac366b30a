// How much of a pose's contours lies on edges, and how much of the edges no contour explains.
#pragma once
#include "contours/chamfer.hpp"

namespace bodytrack::contours {

// How close to an edge a sample counts as explained, and how far from all samples an edge as missed, px.
struct Nearness {
    double explained, missed;
};

// Adds up what the contours of one pose and the edges leave of each other. positions (V, M, 5) are contour samples, counts
// (V,) of which are valid, parts (V, M) theirs; those of length 0 explain edges and count as none, as do those where the
// chamfer image is negative, for something hides them. reach (V,): the chamfer image beyond its region. sums (4, V, P), px:
// visible contour; times its distance to the edges; explained; length of edges far from all samples, by the part of the
// nearest.
void edge_shares(Array<const float, 3> positions, Array<const Index, 2> parts, Array<const Index, 1> counts,
                 const Edges &edges, Array<const float, 1> reach, const Nearness &near, Array<double, 3> sums);

}  // namespace bodytrack::contours
