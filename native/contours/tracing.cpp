#include "contours/tracing.hpp"

#include <algorithm>
#include <cmath>

#include "projection.hpp"

namespace bodytrack::contours {

namespace {

using namespace rows;

// Cuts the contour of one part into samples of equal length, those inside the image; their number. A sample between two
// crossings is bent by the turn of their normals, in space and in the image.
int cut(const Crossings &c, const int (*pieces)[2], int n_pieces, const View &view, double step_px, Spots &s) {
    const float low = -0.5f, wide = float(view.width - 0.5), high = float(view.height - 0.5);
    float total = 0.0f;
    for (int k = 0; k < n_pieces; k++) total += c.length[k];
    const float each = total > 0.0f ? float(total / std::min(std::ceil(total / step_px), ROW - 1.0)) : 1.0f;
    float passed = 0.0f, place = 0.5f * each;
    int n = 0;
    for (int k = 0; k < n_pieces; k++) {
        const float length = c.length[k];
        if (place >= passed + length) {
            passed += length;
            continue;
        }
        const int i = pieces[k][0], j = pieces[k][1];
        const float dx = c.x[j] - c.x[i], dy = c.y[j] - c.y[i], dz = c.z[j] - c.z[i];
        const float dnx = c.nx[j] - c.nx[i], dny = c.ny[j] - c.ny[i], dnz = c.nz[j] - c.nz[i];
        const float du = c.u[j] - c.u[i], dv = c.v[j] - c.v[i], dnu = c.nu[j] - c.nu[i], dnv = c.nv[j] - c.nv[i];
        const float turn = dnx * dx + dny * dy + dnz * dz, turn_px = dnu * du + dnv * dv;
        while (place < passed + length && n < ROW) {
            const float t = (place - passed) / length;
            place += each;
            const float bulge = 0.5f * t * (1.0f - t);
            float nu = c.nu[i] + t * dnu, nv = c.nv[i] + t * dnv;
            const float norm = 1.0f / std::sqrt(nu * nu + nv * nv);
            nu *= norm;
            nv *= norm;
            const float u = c.u[i] + t * du + bulge * turn_px * norm * nu;
            const float v = c.v[i] + t * dv + bulge * turn_px * norm * nv;
            if (u < low || v < low || u > wide || v > high) continue;
            const float nx = c.nx[i] + t * dnx, ny = c.ny[i] + t * dny, nz = c.nz[i] + t * dnz, out = bulge * turn;
            s.u[n] = u;
            s.v[n] = v;
            s.nu[n] = nu;
            s.nv[n] = nv;
            s.length[n] = each;
            s.state[n] = FREE;
            s.x[n] = c.x[i] + t * dx + out * nx;
            s.y[n] = c.y[i] + t * dy + out * ny;
            s.z[n] = c.z[i] + t * dz + out * nz;
            s.nx[n] = nx;
            s.ny[n] = ny;
            s.nz[n] = nz;
            n++;
        }
        passed += length;
    }
    return n;
}

// Lays the n traced samples of one view into the outputs, those inside the image; their number.
Index lay_out(Array<const float, 2> samples, Index n, const double *camera, const View &view, bool exact, const Traced &out,
              Index b, Index v) {
    const auto positions = out.positions[b][v], points = out.points[b][v];
    const auto parts = out.parts[b][v];
    const auto between = out.between[b][v];
    Index kept = 0;
    for (Index i = 0; i < n; i++) {
        const float *from = samples[i].data;
        double x = from[sample::U], y = from[sample::V];
        if (exact) {
            const Image seen = project_point(camera, from[sample::X], from[sample::Y], from[sample::Z]);
            if (seen.depth <= 0.0) continue;
            x = seen.u;
            y = seen.v;
        }
        if (x < -0.5 || y < -0.5 || x > view.width - 0.5 || y > view.height - 0.5) continue;
        positions(kept, 0) = float(x);
        positions(kept, 1) = float(y);
        for (int k = 0; k < 3; k++) {
            positions(kept, 2 + k) = from[sample::NU + k];
            points(kept, k) = from[sample::X + k];
        }
        parts[kept] = Index(from[sample::PART]);
        between[kept] = from[sample::BETWEEN] > 0.0f;
        kept++;
    }
    return kept;
}

}  // namespace

View::View(const Views &views, Index v) : width(views.sizes(v, 0)), height(views.sizes(v, 1)) {
    const auto camera = views.cameras[v];
    lens.assign(camera.data, camera.data + camera.size());
}

int draw_part(const Grids &grids, Index p, const Solid &solid, const View &view, double step_px, Tracing &work) {
    const int n_pieces = find_pieces(grids, p, solid, view.lens.data(), work);
    return cut(*work.crossings, work.pieces, n_pieces, view, step_px, *work.spots);
}

Index add_visible(Index p, const Solids &solids, const bool *covering, double radius, double contact_m, Tracing &work,
                  int n_spots, Array<float, 2> traced, Index n) {
    Spots &s = *work.spots;
    neighbours(p, solids, covering, radius, work.listed);
    for (const Index q : work.listed) cover(solids[q], contact_m, s, n_spots);
    for (int i = 0; i < n_spots && n < traced.shape[0]; i++) {
        if (s.state[i] == COVERED) continue;
        float *to = traced[n++].data;
        to[sample::U] = s.u[i];
        to[sample::V] = s.v[i];
        to[sample::NU] = s.nu[i];
        to[sample::NV] = s.nv[i];
        to[sample::LENGTH] = s.state[i] == TOUCHED ? 0.0f : s.length[i];
        to[sample::X] = s.x[i];
        to[sample::Y] = s.y[i];
        to[sample::Z] = s.z[i];
        to[sample::PART] = float(p);
        to[sample::BETWEEN] = s.state[i];
        to[sample::NX] = s.nx[i];
        to[sample::NY] = s.ny[i];
        to[sample::NZ] = s.nz[i];
    }
    return n;
}

Index trace_view(const Grids &grids, const Parts &parts, const Solids &solids, const View &view, const Spacing &spacing,
                 const bool *wanted, const bool *covering, Tracing &work, Array<float, 2> traced) {
    Index n = 0;
    for (Index p = 0; p < parts.size(); p++) {
        if (!(solids[p].nearest >= 0.0f) || !wanted[p]) continue;
        const int n_spots = draw_part(grids, p, solids[p], view, spacing.step_px, work);
        n = add_visible(p, solids, covering, parts.bounds(0, p), spacing.contact_m, work, n_spots, traced, n);
    }
    return n;
}

// Bent in the image and in space, a sample's pixel and point are up to 0.05 px apart: `exact` asks the camera.
Index trace_contours(Array<const double, 4> placements, const Grids &grids, const Parts &parts, const Views &views,
                     const Spacing &spacing, bool exact, const Traced &traced) {
    Solids solids(parts.size());
    Tracing work(grids);
    const Index room = traced.parts.shape[2];
    std::vector<float> rows_(size_t(room) * sample::N_COLUMNS);
    const Array<float, 2> samples{rows_.data(), {room, sample::N_COLUMNS}};
    const auto everything = std::make_unique<bool[]>(parts.size());
    std::fill_n(everything.get(), parts.size(), true);
    std::vector<View> seen;
    for (Index v = 0; v < views.size(); v++) seen.emplace_back(views, v);
    Index most = 0;
    for (Index b = 0; b < placements.shape[0]; b++) {
        place_solids(placements[b], parts, solids);
        for (Index v = 0; v < views.size(); v++) {
            const double *camera = views.cameras[v].data;
            view_solids(parts, camera, spacing.contact_m, solids);
            const Index n =
                trace_view(grids, parts, solids, seen[v], spacing, everything.get(), everything.get(), work, samples);
            most = std::max(most, n);
            traced.counts(b, v) = lay_out(samples, n, camera, seen[v], exact, traced, b, v);
        }
    }
    return most;
}

}  // namespace bodytrack::contours
