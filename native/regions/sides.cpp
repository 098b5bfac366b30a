#include "regions/sides.hpp"

#include <memory>

#include "projection.hpp"

namespace bodytrack::regions {

namespace {

using namespace rows;
using contours::Solid;
using contours::Solids;

// Rays are followed to this many times the distance of the contour: through all that may lie behind it.
constexpr double FAR = 3.0;

// How far a contour may be outside of the box around its part, px: lenses bend it.
constexpr double ROUGH_PX = 2.0;

}  // namespace

void parts_near(const Solids &solids, const bool *among, Index p, double fx_px, double step_m, std::vector<Index> &near) {
    near.clear();
    const Solid &own = solids[p];
    const double margin_px = SPOTS[1] * std::max(fx_px * step_m / own.nearest, 1.0) + ROUGH_PX;
    for (Index q = 0; q < Index(solids.size()); q++) {
        const Solid &other = solids[q];
        if (!among[q] || q == p || other.nearest < 0.0f) continue;
        if (other.least_u - margin_px < own.most_u && other.most_u + margin_px > own.least_u &&
            other.least_v - margin_px < own.most_v && other.most_v + margin_px > own.least_v)
            near.push_back(q);
    }
}

Side nearest_beside(const Solids &solids, const std::vector<Index> &near, const Spot &spot, Side side) {
    for (const Index q : near) {
        const Solid &part = solids[q];
        if (contours::beside(part, spot.u, spot.v) > part.width2) continue;
        double a, b, c;
        contours::in_part(part, spot.x, spot.y, spot.z, a, b, c);
        if (!contours::blocks_ray(part, float(a), float(b), float(c))) continue;
        const double da = a - part.eye[0], db = b - part.eye[1], dc = c - part.eye[2];
        const double along = -(part.eye[0] * da + part.eye[1] * db + part.eye[2] * dc) / (da * da + db * db + dc * dc);
        if (along < side.along) side = {q, along};
    }
    return side;
}

// A spot is reached in space: the point on the contour moved across its viewing ray until its image has moved.
void place_spots(const double *camera, const Sample &at, double step_m, int n, Spot *spots) {
    using namespace rows::camera;
    const auto &[x, y, z] = at.point;
    const Along along = project_along(camera, x, y, z, at.nu, at.nv);
    const double step = std::max(pixels_per_metre(camera, at.point) * step_m, 1.0);
    const double cx = camera[CENTRE_X], cy = camera[CENTRE_Y], cz = camera[CENTRE_Z];
    for (int k = 0; k < n; k++) {
        const double far = SPOTS[k] * step;
        const double move = far / (along.x * along.x + along.y * along.y + along.z * along.z);
        spots[k] = {along.u + far * at.nu, along.v + far * at.nv, cx + FAR * (x + move * along.x - cx),
                    cy + FAR * (y + move * along.y - cy), cz + FAR * (z + move * along.z - cz)};
    }
}

void parts_beside(Array<const double, 3> placements, const contours::Parts &parts, Array<const double, 2> cameras,
                  const Samples &samples, double step_m, Array<Index, 3> found) {
    Solids solids(parts.size());
    const auto everything = std::make_unique<bool[]>(parts.size());
    std::fill_n(everything.get(), parts.size(), true);
    std::vector<Index> near;
    Spot spots[2];
    contours::place_solids(placements, parts, solids);
    for (Index v = 0; v < cameras.shape[0]; v++) {
        const double *camera = cameras[v].data;
        contours::view_solids(parts, camera, 0.0, solids);
        Index last = BACKGROUND;
        for (Index m = 0; m < samples.counts[v]; m++) {
            Index *seen = found[v][m].data;
            seen[0] = seen[1] = BACKGROUND;
            const Sample at(samples, v, m);
            if (!(at.length > 0.0)) continue;
            place_spots(camera, at, step_m, 2, spots);
            if (at.p != last) {
                last = at.p;
                parts_near(solids, everything.get(), last, camera[camera::FX], step_m, near);
            }
            for (int k = 0; k < 2; k++) seen[k] = nearest_beside(solids, near, spots[k]).part;
        }
    }
}

}  // namespace bodytrack::regions
