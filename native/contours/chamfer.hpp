// Directed chamfer distances between model contours and scene edges, batched over poses.
#pragma once
#include <vector>

#include "array.hpp"

namespace bodytrack::contours {

// An observation as flat arrays, from `Observation.packed`: chamfer images one after the other and where each view's lies
// (V, 5), px; scene points of all views (S, 5), and where each view's begin (V + 1,).
struct Edges {
    Array<const float, 1> flat;
    Array<const Index, 2> regions;
    Array<const float, 2> points;
    Array<const Index, 1> first;

    bool sees(Index v) const;
};

// Distance at which a point is an outlier, px; whether it is rejected as the paper does, or else clamped.
struct Rule {
    double theta;
    bool reject;
};

// Chamfer image of view v at a position in the whole image, bilinear, px; `outside` beyond its region.
double chamfer_lookup(const Edges &edges, Index v, double x, double y, double outside);

// Normalized directed distance of n points (paper, eq. 2) with outliers clamped or rejected.
double robust_mean(const float *distances, const float *weights, Index n, const Rule &rule);

// What `directed_pair` writes to on its way.
struct Matching {
    Matching(Index n_scene, Index n_samples);

    // positions and shares of a view's scene points; shares and distances of whichever points are in work
    std::vector<float> xs, ys, scene_shares, shares, distances;
};

struct Directed {
    double to_scene, to_model;
};

// Normalized directed chamfer distances of one pose in one view, px. samples (M, 5 or more): pixel, image normal, contour
// length; those of length 0 are not matched, and those where the chamfer image is negative, for something hides them, are
// not measured; the first n_samples are valid.
Directed directed_pair(Array<const float, 2> samples, Index n_samples, const Edges &edges, Index v, const Rule &rule,
                       Matching &work);

// Both directed distances (B, V, 2) of model samples (B, V, M, 5), counts (B, V) of which are valid (paper, eqs. 1 and 2);
// those of missing views are left as they are.
void directed_distances(Array<const float, 4> positions, Array<const Index, 2> counts, const Edges &edges,
                        const Rule &rule, Array<double, 3> distances);

}  // namespace bodytrack::contours
