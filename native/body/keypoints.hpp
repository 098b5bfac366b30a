// Points of a body in many poses beside 2-D detections of them: which detection, with which sides, and how far.
#pragma once
#include "array.hpp"

namespace bodytrack::body {

// What a detector found in V views, of L keypoints that mean points of a body.
struct Detected {
    // (N, L, 3) pixel and confidence of N detections, those of a view after one another; confidence 0: not found
    Array<const double, 3> found;
    // (V + 1,) first detection of each view, and N
    Array<const Index, 1> first;
    // (L,) keypoint of the other side; itself where there is none
    Array<const Index, 1> other;
    // (L,) number of the limb whose sides are exchanged together; -1 for keypoints without a side
    Array<const Index, 1> limbs;
};

// Room for what is found, of B poses.
struct Matches {
    // (B, V, L, 2) from keypoint to point of the body, px; 0 where the weight is
    Array<double, 4> gaps;
    // (B, V, L) confidences; 0 where there is no keypoint, or the point is not before the camera
    Array<double, 3> weights;
    // (B, V, L) size of a metre at the point of the body
    Array<double, 3> px_per_m;
    // (B, V, L) share of an outlier that a keypoint counts, 0 to 1 and what its exchange costs
    Array<double, 3> losses;
};

// Distance of half a loss, metres; what it costs to exchange a keypoint's side, share of an outlier.
struct Reach {
    double half_m, exchange;
};

// Takes in each view the detection of least loss for each pose, limb by limb with the sides of less loss. points (B, L, 3)
// of the body, metres; cameras (V, 29); n_limbs: limbs with sides.
void match_keypoints(Array<const double, 3> points, Array<const double, 2> cameras, const Detected &detected,
                     Index n_limbs, const Reach &reach, const Matches &matches);

}  // namespace bodytrack::body
