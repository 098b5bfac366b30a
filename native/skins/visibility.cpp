#include "skins/visibility.hpp"

#include <algorithm>
#include <cmath>

namespace bodytrack::skins {

namespace {

// So many cells outside of a contour is looked what is there: nearer, the cell may still show the surface itself.
constexpr double BESIDE = 1.5;

// What is beside a contour and so much nearer to the camera hides it; at the contour itself a surface may bulge that much
// towards the camera within a cell (limbs 3 cm, a trunk 5 cm).
constexpr double HIDDEN_M = 0.03, COVERED_M = 0.05;

// The cell of a place along an axis, the first or the last one if it lies beyond; as numpy rounds.
Index cell(double place, Index n) { return Index(std::nearbyint(std::min(std::max(place, 0.0), double(n - 1)))); }

// Inverse depth of what is seen at a pixel, 0 for nothing.
double nearest(const View &view, double u, double v) {
    return view.depths[cell(v / view.cell_px, view.rows) * view.columns + cell(u / view.cell_px, view.columns)];
}

}  // namespace

bool covered(const View &view, double u, double v, double depth) { return nearest(view, u, v) * (depth - COVERED_M) > 1.0; }

State state_of(const View &view, double u, double v, double nu, double nv, double depth, double contact_m) {
    if (covered(view, u, v, depth)) return HIDDEN;
    const double away = BESIDE * view.cell_px, behind = nearest(view, u + away * nu, v + away * nv);
    if (behind * (depth - HIDDEN_M) > 1.0) return HIDDEN;
    return behind * (depth + contact_m) > 1.0 ? BETWEEN : VISIBLE;
}

}  // namespace bodytrack::skins
