// Misfits of contours: how much of the lines across them lies on the wrong side.
#pragma once
#include "regions/lines.hpp"

namespace bodytrack::regions {

// A line that was read.
struct Judged {
    // how much of it lies on the wrong side of the contour, 0 to 1; -1 where something hides the part
    double wrong;
    // its length, px
    double length_px;
};

// Reads the line of a contour sample; side: part seen at the first of the SPOTS: of all places but one it is the one that
// counts. camera (29,) is that of its view.
Judged judge(const Lines &lines, const double *camera, const Sample &at, Index side);

// Adds a sample of part p, unless it is hidden, and the contour it stands for, to misfits (P, 3) of a view.
void add_misfit(double length, const Judged &judged, Index p, double *misfits);

// How much beside the contours of one pose lies on the wrong side of them. beside (V, M, 2): parts seen at the SPOTS;
// cameras (V, 29). misfits (V, P, 3), added to: contour compared, px; times how much of the line lies on the wrong side,
// px; contour whose lines show the part inside and not outside, px.
void score_lines(const Lines &lines, const Samples &samples, Array<const Index, 3> beside, Array<const double, 2> cameras,
                 Array<double, 3> misfits);

}  // namespace bodytrack::regions
