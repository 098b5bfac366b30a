// Visible occluding-contour samples of tapered superquadrics, without rendering a picture.
//
// The pieces of contour of each part are found on its surface grid (`pieces`), cut into samples of equal length, bent by
// the turn of their normals, and tested for visibility (`occlusion`). The cost does not depend on the image size.
#pragma once
#include "contours/occlusion.hpp"
#include "contours/pieces.hpp"

namespace bodytrack::contours {

// Cameras as `Rig.packed` has them (V, 29), and image sizes (V, 2), px.
struct Views {
    Array<const double, 2> cameras, sizes;

    Index size() const { return cameras.shape[0]; }
};

// Longest contour that a sample stands for, px; distance at which parts touch, metres.
struct Spacing {
    double step_px, contact_m;
};

// One view: its camera in single precision, and its image size, px.
struct View {
    View(const Views &views, Index v);

    std::vector<float> lens;
    double width, height;
};

// Contour samples of part p, whatever hides them, written to the spots of the workspace; their number.
int draw_part(const Grids &grids, Index p, const Solid &solid, const View &view, double step_px, Tracing &work);

// Appends to n traced samples (M, 13) those n_spots of part p, in a sphere of that radius, that nothing hides; the number
// of all. Those that find no room are dropped. covering (P,): parts that may hide them.
Index add_visible(Index p, const Solids &solids, const bool *covering, double radius, double contact_m, Tracing &work,
                  int n_spots, Array<float, 2> traced, Index n);

// Visible contour samples of the wanted parts (P,) in one view: pixel, image normal, contour length (0 between parts),
// world point, part, 1 between parts else 0, world normal. Returns their number.
Index trace_view(const Grids &grids, const Parts &parts, const Solids &solids, const View &view, const Spacing &spacing,
                 const bool *wanted, const bool *covering, Tracing &work, Array<float, 2> traced);

// What `trace_contours` writes, laid out as in `Contours`: (B, V, M, 5), (B, V, M, 3), (B, V, M), (B, V, M), (B, V).
struct Traced {
    Array<float, 4> positions, points;
    Array<Index, 3> parts;
    Array<bool, 3> between;
    Array<Index, 2> counts;
};

// Visible contour samples of many poses (B, P, 4, 4) in all views. `exact` places pixels where the points are seen, or
// else where they are traced, as `score_poses` does. Returns the most samples traced in a view; with M there may be more.
Index trace_contours(Array<const double, 4> placements, const Grids &grids, const Parts &parts, const Views &views,
                     const Spacing &spacing, bool exact, const Traced &traced);

}  // namespace bodytrack::contours
