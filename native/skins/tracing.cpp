#include "skins/tracing.hpp"

#include <cmath>

#include "projection.hpp"
#include "skins/smooth_contours.hpp"
#include "skins/visibility.hpp"

namespace bodytrack::skins {

namespace {

using namespace rows;

// Where samples are written: one pose and view of `Traced`.
class Found {
  public:
    Found(const contours::Traced &traced, Index b, Index v)
        : positions_(traced.positions[b][v]), points_(traced.points[b][v]), parts_(traced.parts[b][v]),
          between_(traced.between[b][v]) {}

    Index n() const { return n_; }

    // Adds a sample if it is seen.
    void add(const View &view, const double *point, double nu, double nv, Index part, const Spacing &spacing) {
        const Image at = project_point(view.camera, point[0], point[1], point[2]);
        const bool inside = at.depth > 0.0 && -0.5 <= at.u && at.u <= view.width - 0.5 && -0.5 <= at.v &&
                            at.v <= view.height - 0.5;
        if (!inside || n_ == parts_.size()) return;
        const State state = state_of(view, at.u, at.v, nu, nv, at.depth, spacing.contact_m);
        if (state == HIDDEN) return;
        float *position = positions_[n_].data;
        position[sample::U] = float(at.u);
        position[sample::V] = float(at.v);
        position[sample::NU] = float(nu);
        position[sample::NV] = float(nv);
        position[sample::LENGTH] = state == VISIBLE ? float(spacing.step_px) : 0.0f;
        for (int k = 0; k < 3; k++) points_(n_, k) = float(point[k]);
        parts_[n_] = part;
        between_[n_] = state == BETWEEN;
        n_++;
    }

  private:
    Array<float, 2> positions_, points_;
    Array<Index, 1> parts_;
    Array<bool, 1> between_;
    Index n_ = 0;
};

// Contour of each part passed since its last sample, px.
using Over = std::vector<double>;

// Samples where the smooth surface turns away from the camera across one face. On a hollow the farther side faces the
// camera: such a contour is never seen.
void trace_face(const Mesh &mesh, Index f, const Posed &posed, const View &view, const Spacing &spacing, Over &over,
                Found &found) {
    Index p = mesh.faces(f, 0), q = mesh.faces(f, 1), r = mesh.faces(f, 2);
    const float *facing = posed.facing;
    const bool a = facing[p] > 0.0f, b = facing[q] > 0.0f, c = facing[r] > 0.0f;
    if (a == b && b == c) return;
    // p differs from both others
    if (a == c) {
        const Index first = p;
        p = q;
        q = r;
        r = first;
    } else if (a == b) {
        const Index last = r;
        r = q;
        q = p;
        p = last;
    }
    const float *sp = view.seen_at(p), *sq = view.seen_at(q), *sr = view.seen_at(r);
    const bool before = sp[2] > 0.0f && sq[2] > 0.0f && sr[2] > 0.0f;
    if (!before || !turns_away(posed, p, q, r, view.camera)) return;
    const float s = facing[p] / (facing[p] - facing[q]), t = facing[p] / (facing[p] - facing[r]);
    const float u = sp[0] + s * (sq[0] - sp[0]), v = sp[1] + s * (sq[1] - sp[1]);
    const float du = sp[0] + t * (sr[0] - sp[0]) - u, dv = sp[1] + t * (sr[1] - sp[1]) - v;
    const float length = std::sqrt(du * du + dv * dv);
    const Index part = mesh.parts[f];
    double passed = spacing.step_px - over[part];
    over[part] += length;
    if (over[part] < spacing.step_px) return;
    if (covered(view, u + 0.5 * du, v + 0.5 * dv, 1.0 / std::max({sp[2], sq[2], sr[2]}))) {
        over[part] = std::fmod(over[part], spacing.step_px);
        return;
    }
    const Surface one = cross_edge(posed, p, q), other = cross_edge(posed, p, r);
    while (over[part] >= spacing.step_px) {
        over[part] -= spacing.step_px;
        const Surface at = bent(one, other, passed / length);
        passed += spacing.step_px;
        double nu, nv;
        image_normal(view.camera, at, nu, nv);
        found.add(view, at.point, nu, nv, part, spacing);
    }
}

// Samples on an open border of a face seen from outside.
void trace_border(const Mesh &mesh, Index e, const Posed &posed, const View &view, const Spacing &spacing, Over &over,
                  Found &found) {
    const Index p = mesh.borders(e, 0), q = mesh.borders(e, 1), r = mesh.borders(e, 2), f = mesh.borders(e, 3);
    if (!view.front[f]) return;
    const float *sp = view.seen_at(p), *sq = view.seen_at(q), *sr = view.seen_at(r);
    const double du = sq[0] - sp[0], dv = sq[1] - sp[1], length = std::sqrt(du * du + dv * dv);
    const Index part = mesh.parts[f];
    double place = spacing.step_px - over[part];
    over[part] += length;
    if (over[part] < spacing.step_px || length <= 0.0) return;
    double nu = dv / length, nv = -du / length;
    if ((sr[0] - sp[0]) * nu + (sr[1] - sp[1]) * nv > 0.0) {
        nu = -nu;
        nv = -nv;
    }
    while (over[part] >= spacing.step_px) {
        over[part] -= spacing.step_px;
        const double t = place / length;
        place += spacing.step_px;
        double point[3];
        for (int k = 0; k < 3; k++) point[k] = posed.points(p, k) + t * (posed.points(q, k) - posed.points(p, k));
        found.add(view, point, nu, nv, part, spacing);
    }
}

}  // namespace

void trace_skins(Array<const double, 4> placements, Array<const double, 3> part_from_rest, const Mesh &mesh,
                 const contours::Views &views, const Spacing &spacing, const contours::Traced &traced) {
    const Index n_vertices = mesh.points.shape[0], n_parts = part_from_rest.shape[0];
    std::vector<float> moved(12 * n_parts), places(3 * n_vertices), turned(3 * n_vertices);
    const Array<float, 3> motions{moved.data(), {n_parts, 3, 4}};
    const Array<float, 2> points{places.data(), {n_vertices, 3}}, normals{turned.data(), {n_vertices, 3}};
    std::vector<View> seen;
    for (Index v = 0; v < views.size(); v++)
        seen.emplace_back(views.cameras[v].data, views.sizes(v, 0), views.sizes(v, 1), spacing.n_cells, mesh);
    Over over(n_parts);
    for (Index b = 0; b < placements.shape[0]; b++) {
        motions_of(placements[b], part_from_rest, motions);
        pose_mesh(mesh, motions, points, normals);
        for (Index v = 0; v < views.size(); v++) {
            draw_depths(mesh, points, normals, seen[v]);
            const Posed posed{points, normals, seen[v].facing.data()};
            Found found(traced, b, v);
            std::fill(over.begin(), over.end(), 0.5 * spacing.step_px);
            for (Index f = 0; f < mesh.n_traced; f++) trace_face(mesh, f, posed, seen[v], spacing, over, found);
            for (Index e = 0; e < mesh.borders.shape[0]; e++) trace_border(mesh, e, posed, seen[v], spacing, over, found);
            traced.counts(b, v) = found.n();
        }
    }
}

}  // namespace bodytrack::skins
