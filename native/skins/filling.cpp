#include "skins/filling.hpp"

#include <algorithm>
#include <limits>
#include <vector>

#include "pictures/pixels.hpp"
#include "projection.hpp"

namespace bodytrack::skins {

namespace {

// Where a row crosses a triangle: from left to right.
struct Span {
    double left = std::numeric_limits<double>::infinity(), right = -std::numeric_limits<double>::infinity();

    void widen(const Image &a, const Image &b, double row) {
        const double low = std::min(a.v, b.v), high = std::max(a.v, b.v);
        if (!(low <= row && row <= high)) return;
        const double share = high > low ? (row - a.v) / (b.v - a.v) : 0.0, u = a.u + share * (b.u - a.u);
        left = std::min(left, u);
        right = std::max(right, u);
    }
};

}  // namespace

void fill_mesh(Array<const double, 2> points, Array<const Index, 2> faces, const double *camera, Array<bool, 2> mask) {
    const Index height = mask.shape[0], width = mask.shape[1];
    std::vector<Image> seen;
    seen.reserve(points.shape[0]);
    for (Index i = 0; i < points.shape[0]; i++)
        seen.push_back(project_point(camera, points(i, 0), points(i, 1), points(i, 2)));
    for (Index f = 0; f < faces.shape[0]; f++) {
        const Image &p = seen[faces(f, 0)], &q = seen[faces(f, 1)], &r = seen[faces(f, 2)];
        if (!(std::min({p.depth, q.depth, r.depth}) > pictures::NEAREST_M)) continue;
        const Index bottom = pictures::last_pixel(std::max({p.v, q.v, r.v}), height);
        for (Index row = pictures::first_pixel(std::min({p.v, q.v, r.v})); row <= bottom; row++) {
            Span span;
            span.widen(p, q, double(row));
            span.widen(q, r, double(row));
            span.widen(r, p, double(row));
            const Index first = pictures::first_pixel(span.left), last = pictures::last_pixel(span.right, width);
            if (first <= last) std::fill(&mask(row, first), &mask(row, last) + 1, true);
        }
    }
}

}  // namespace bodytrack::skins
