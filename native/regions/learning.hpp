// Colours learnt along the lines across contours: on both sides of them, and of what hides them.
#pragma once
#include "regions/lines.hpp"

namespace bodytrack::regions {

// What colours are learnt from: contour samples of one pose, those that are useful (V, M), and the parts seen at the SPOTS
// (V, M, 2): a part's pixels are not the background.
struct Lesson {
    const Picture &picture;
    const Samples &samples;
    Array<const bool, 2> useful;
    Array<const Index, 3> beside;
    Array<const double, 2> cameras;
    // (P,) metres, see `Looks`
    Array<const double, 1> half_extents;
    // (V, P, 4096) of the frame before: a line that shows a hider inside teaches how that looks
    Array<const Byte, 3> posteriors;
    double step_m;
};

// Learns the colours on both sides of contours, and those of what hides them; news: weight of what is seen now. Marks the
// tables (V, P) that changed.
void learn_lines(const Lesson &lesson, double news, const Tables<float> &tables, Array<bool, 2> changed);

// How far from a view's contour colours are learnt (V,), px, with the pixel that the last step is rounded to.
void longest_lines(const Samples &samples, Array<const double, 2> cameras, double step_m, Array<double, 1> longest_px);

}  // namespace bodytrack::regions
