#include "pictures/silhouettes.hpp"

#include <algorithm>
#include <cstdint>
#include <utility>

#include "bits.hpp"
#include "pictures/pixels.hpp"
#include "projection.hpp"

namespace bodytrack::pictures {

namespace {

// Columns of a node: place, normal, their product.
constexpr int NODE = 7;

// A part's grid in one view, and what filling it writes to on its way.
struct Drawing {
    int n_rows, n_columns;
    const double *placement, *camera;
    const float *grid;
    // for each point its facing, and its depth less that of the part, metres
    std::vector<double> facing, depths;
    // for each point its pixel
    std::vector<double> us, vs;
    // bit c of number r + 1 is the cell between rings r and r + 1, columns c and c + 1; the first number and the last are 0
    std::vector<Bits> turning;

    int n_points() const { return n_rows * n_columns; }
};

// A vector of the world in the frame of a part.
void into_part(const double *placement, const double *v, double *turned) {
    for (int r = 0; r < 3; r++) turned[r] = placement[r] * v[0] + placement[4 + r] * v[1] + placement[8 + r] * v[2];
}

// Marks the cells of a grid whose corners do not all face the camera, nor all turn away from it: only their sides can be
// outermost, for a line all around which the surface faces the camera lies inside. Returns the least depth of the points,
// metres.
double mark_turning(Drawing &d) {
    using namespace rows::camera;
    const double way[3] = {d.camera[CENTRE_X] - d.placement[3], d.camera[CENTRE_Y] - d.placement[7],
                           d.camera[CENTRE_Z] - d.placement[11]};
    const double axis[3] = {d.camera[R31], d.camera[R32], d.camera[R33]};
    double e[3], a[3];
    into_part(d.placement, way, e);
    into_part(d.placement, axis, a);
    const double away = -(axis[0] * way[0] + axis[1] * way[1] + axis[2] * way[2]);
    for (int i = 0; i < d.n_points(); i++) {
        const float *p = d.grid + NODE * i;
        d.facing[i] = p[3] * e[0] + p[4] * e[1] + p[5] * e[2] - p[6];
        d.depths[i] = p[0] * a[0] + p[1] * a[1] + p[2] * a[2] + away;
    }
    d.turning[0] = d.turning[d.n_rows] = 0;
    Bits before = 0, before_along = 0;
    for (int r = 0; r < d.n_rows; r++) {
        Bits row = 0;
        for (int c = 0; c < d.n_columns; c++) row |= Bits(d.facing[r * d.n_columns + c] > 0.0) << c;
        const Bits along = row ^ rolled(row, d.n_columns);
        if (r > 0) d.turning[r] = along | before_along | (row ^ before);
        before = row;
        before_along = along;
    }
    return *std::min_element(d.depths.begin(), d.depths.end());
}

// Bits of a ring of n, each set where it or the one before it was.
Bits or_before(Bits bits, int n) { return (bits | (bits << 1) | (bits >> (n - 1))) & ((Bits(1) << n) - 1); }

// Projects the corners of the marked cells; false where one of them lies beyond the reach of the lens.
bool project_turning(Drawing &d) {
    const double *m = d.placement;
    for (int r = 0; r < d.n_rows; r++)
        for (Bits left = or_before(d.turning[r] | d.turning[r + 1], d.n_columns); left; left &= left - 1) {
            const int i = r * d.n_columns + lowest_bit(left);
            const double x = d.grid[NODE * i], y = d.grid[NODE * i + 1], z = d.grid[NODE * i + 2];
            const Image image = project_point(d.camera, m[0] * x + m[1] * y + m[2] * z + m[3],
                                              m[4] * x + m[5] * y + m[6] * z + m[7], m[8] * x + m[9] * y + m[10] * z + m[11]);
            if (image.depth <= 0.0) return false;
            d.us[i] = image.u;
            d.vs[i] = image.v;
        }
    return true;
}

// Widens extents by the sides of the marked cells.
void widen_turning(const Drawing &d, Extents &extents) {
    const auto widen = [&](int i, int j) { extents.widen(d.us[i], d.vs[i], d.us[j], d.vs[j]); };
    for (int r = 0; r < d.n_rows; r++) {
        const int start = r * d.n_columns;
        for (Bits left = d.turning[r] | d.turning[r + 1]; left; left &= left - 1) {
            const int c = lowest_bit(left);
            widen(start + c, start + (c + 1 < d.n_columns ? c + 1 : 0));
        }
        for (Bits left = or_before(d.turning[r + 1], d.n_columns); left; left &= left - 1) {
            const int c = lowest_bit(left);
            widen(start + c, start + c + d.n_columns);
        }
    }
}

}  // namespace

void Extents::widen(double u0, double v0, double u1, double v1) {
    if (v1 < v0) {
        std::swap(u0, u1);
        std::swap(v0, v1);
    }
    const Index first = first_pixel(v0), last = last_pixel(v1, height());
    const double slope = v1 > v0 ? (u1 - u0) / (v1 - v0) : 0.0;
    for (Index row = first; row <= last; row++) {
        const double u = u0 + slope * (double(row) - v0);
        left[row] = std::min(left[row], u);
        right[row] = std::max(right[row], u);
    }
}

void fill_parts(Array<const double, 3> placements, Array<const float, 3> grids, int n_rows, int n_columns,
                const double *camera, Array<bool, 2> mask) {
    const Index height = mask.shape[0], width = mask.shape[1];
    const size_t n = size_t(n_rows) * n_columns;
    Drawing drawing{n_rows, n_columns, nullptr, camera, nullptr, std::vector<double>(n), std::vector<double>(n),
                    std::vector<double>(n), std::vector<double>(n), std::vector<Bits>(n_rows + 1)};
    Extents extents(height);
    for (Index p = 0; p < placements.shape[0]; p++) {
        drawing.placement = placements[p].data;
        drawing.grid = grids[p].data;
        if (!(mark_turning(drawing) >= NEAREST_M) || !project_turning(drawing)) continue;
        extents.clear(0, height);
        widen_turning(drawing, extents);
        for (Index row = 0; row < height; row++) {
            if (!(extents.left[row] <= extents.right[row])) continue;
            const Index first = first_pixel(extents.left[row]), last = last_pixel(extents.right[row], width);
            if (first <= last) std::fill(&mask(row, first), &mask(row, last) + 1, true);
        }
    }
}

}  // namespace bodytrack::pictures
