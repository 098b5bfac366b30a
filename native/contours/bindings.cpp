#include <string>

#include "contours/arguments.hpp"
#include "contours/oriented_matching.hpp"
#include "contours/scoring.hpp"
#include "contours/shares.hpp"

namespace bodytrack {

namespace contours {

void check_regions(Array<const Index, 2> regions, const char *name, Index n) {
    using namespace rows::region;
    for (Index v = 0; v < regions.shape[0]; v++) {
        const Index *at = regions[v].data, room = n - at[START];
        const bool inside = at[START] >= 0 && at[WIDTH] >= 0 && at[HEIGHT] >= 0 && room >= 0 &&
                            (at[WIDTH] == 0 || at[HEIGHT] <= room / at[WIDTH]);
        if (!inside) throw nb::value_error((std::string(name) + ": view " + std::to_string(v) + " has no room").c_str());
    }
}

EdgeArguments::EdgeArguments(nb::handle flat, nb::handle regions, nb::handle scene, nb::handle first, Index n_views)
    : flat_(flat, "flat", {ANY}), regions_(regions, "regions", {n_views, rows::region::N_COLUMNS}),
      scene_(scene, "scene", {ANY, rows::scene_point::N_COLUMNS}), first_(first, "first", {n_views + 1}) {
    rising(*first_, "first", scene_.length(0));
    check_regions(*regions_, "regions", flat_.length(0));
}

void within_counted(Array<const Index, 2> parts, Array<const Index, 1> counts, const char *name, Index n_parts) {
    for (Index v = 0; v < counts.size(); v++) within(parts[v].data, counts[v], name, 0, n_parts);
}

namespace {

void bind_chamfer(nb::module_ &module) {
    module.def(
        "chamfer_lookup",
        [](nb::handle flat, nb::handle regions, Index v, double x, double y, double outside) {
            const Input<Index, 2> r(regions, "regions", {ANY, rows::region::N_COLUMNS});
            const Input<float, 1> f(flat, "flat", {ANY});
            within(&v, 1, "v", 0, r.length(0));
            check_regions(*r, "regions", f.length(0));
            return chamfer_lookup({*f, *r, {}, {}}, v, x, y, outside);
        },
        named("flat"), named("regions"), nb::arg("v"), nb::arg("x"), nb::arg("y"), nb::arg("outside"));
    module.def(
        "robust_mean",
        [](nb::handle distances, nb::handle weights, Index n, double theta, bool reject) {
            const Input<float, 1> d(distances, "distances", {ANY});
            const Input<float, 1> w(weights, "weights", {d.length(0)});
            within(&n, 1, "n", 0, d.length(0) + 1);
            return robust_mean((*d).data, (*w).data, n, {theta, reject});
        },
        named("distances"), named("weights"), nb::arg("n"), nb::arg("theta"), nb::arg("reject"));
    module.def(
        "directed_distances",
        [](nb::handle positions, nb::handle counts, nb::handle flat, nb::handle regions, nb::handle scene,
           nb::handle first, double theta, bool reject, nb::handle distances) {
            const Input<float, 4> p(positions, "positions", {ANY, ANY, ANY, 5});
            const Input<Index, 2> c(counts, "counts", {p.length(0), p.length(1)});
            const EdgeArguments e(flat, regions, scene, first, p.length(1));
            const Output<double, 3> out(distances, "distances", {p.length(0), p.length(1), 2});
            within((*c).data, (*c).size(), "counts", 0, p.length(2) + 1);
            unlocked([&] { directed_distances(*p, *c, e.edges(), {theta, reject}, *out); });
        },
        named("positions"), named("counts"), named("flat"), named("regions"), named("scene"), named("first"),
        nb::arg("theta"), nb::arg("reject"), named("distances"));
    module.def(
        "edge_shares",
        [](nb::handle positions, nb::handle parts, nb::handle counts, nb::handle flat, nb::handle regions,
           nb::handle scene, nb::handle first, nb::handle reach, Pair near_px, nb::handle sums) {
            const Input<float, 3> p(positions, "positions", {ANY, ANY, 5});
            const Input<Index, 2> of(parts, "parts", {p.length(0), p.length(1)});
            const Input<Index, 1> c(counts, "counts", {p.length(0)});
            const EdgeArguments e(flat, regions, scene, first, p.length(0));
            const Input<float, 1> r(reach, "reach", {p.length(0)});
            const Output<double, 3> out(sums, "sums", {4, p.length(0), ANY});
            within((*c).data, (*c).size(), "counts", 0, p.length(1) + 1);
            within_counted(*of, *c, "parts", out.length(2));
            unlocked([&] { edge_shares(*p, *of, *c, e.edges(), *r, {near_px.first, near_px.second}, *out); });
        },
        named("positions"), named("parts"), named("counts"), named("flat"), named("regions"), named("scene"),
        named("first"), named("reach"), nb::arg("near_px"), named("sums"));
}

void bind_tracing(nb::module_ &module) {
    module.def(
        "trace_contours",
        [](nb::handle placements, nb::handle shapes, nb::handle grids, nb::handle planes, std::pair<Index, Index> layout,
           nb::handle bounds, nb::handle cameras, nb::handle sizes, Pair spacing, bool exact, nb::handle positions,
           nb::handle points, nb::handle parts, nb::handle between, nb::handle counts) {
            const BodyArguments body(shapes, grids, planes, layout, bounds);
            const ViewArguments rig(cameras, sizes);
            const Input<double, 4> placed(placements, "placements", {ANY, body.n_parts(), 4, 4});
            const Index n_poses = placed.length(0), n_views = rig.n_views();
            const Output<float, 4> at(positions, "positions", {n_poses, n_views, ANY, 5});
            const Index room = at.length(2);
            const Output<float, 4> of(points, "points", {n_poses, n_views, room, 3});
            const Output<Index, 3> p(parts, "parts", {n_poses, n_views, room});
            const Output<bool, 3> b(between, "between", {n_poses, n_views, room});
            const Output<Index, 2> c(counts, "counts", {n_poses, n_views});
            return unlocked([&] {
                return trace_contours(*placed, body.grids(), body.parts(), rig.views(), {spacing.first, spacing.second},
                                      exact, {*at, *of, *p, *b, *c});
            });
        },
        named("placements"), named("shapes"), named("grids"), named("planes"), nb::arg("layout"), named("bounds"),
        named("cameras"), named("sizes"), nb::arg("spacing"), nb::arg("exact"), named("positions"), named("points"),
        named("parts"), named("between"), named("counts"));
}

void bind_scoring(nb::module_ &module) {
    module.def(
        "moving_parts",
        [](nb::handle placements, nb::handle moving) {
            const Input<double, 4> p(placements, "placements", {ANY, ANY, 4, 4});
            const Output<bool, 1> m(moving, "moving", {p.length(1)});
            unlocked([&] { moving_parts(*p, *m); });
        },
        named("placements"), named("moving"));
    module.def(
        "trace_still",
        [](nb::handle placements, nb::handle still, nb::handle shapes, nb::handle grids, nb::handle planes,
           std::pair<Index, Index> layout, nb::handle bounds, nb::handle cameras, nb::handle sizes, Pair spacing,
           nb::handle samples, nb::handle counts) {
            const BodyArguments body(shapes, grids, planes, layout, bounds);
            const ViewArguments rig(cameras, sizes);
            const Input<double, 4> placed(placements, "placements", {ANY, body.n_parts(), 4, 4});
            const Input<bool, 1> s(still, "still", {body.n_parts()});
            const Output<float, 3> out(samples, "samples", {rig.n_views(), ROW, rows::sample::N_COLUMNS});
            const Output<Index, 1> c(counts, "counts", {rig.n_views()});
            if (placed.length(0) == 0) throw nb::value_error("placements: expected at least one pose");
            unlocked([&] {
                trace_still((*placed)[0], *s, body.grids(), body.parts(), rig.views(), {spacing.first, spacing.second},
                            *out, *c);
            });
        },
        named("placements"), named("still"), named("shapes"), named("grids"), named("planes"), nb::arg("layout"),
        named("bounds"), named("cameras"), named("sizes"), nb::arg("spacing"), named("samples"), named("counts"));
    module.def(
        "score_poses",
        [](nb::handle placements, nb::handle shapes, nb::handle grids, nb::handle planes, std::pair<Index, Index> layout,
           nb::handle bounds, nb::handle cameras, nb::handle sizes, Pair spacing, nb::handle flat, nb::handle regions,
           nb::handle scene, nb::handle first, std::pair<double, bool> rule, nb::handle moving, nb::handle samples,
           nb::handle counts, nb::handle distances) {
            const BodyArguments body(shapes, grids, planes, layout, bounds);
            const ViewArguments rig(cameras, sizes);
            const EdgeArguments e(flat, regions, scene, first, rig.n_views());
            const Input<double, 4> placed(placements, "placements", {ANY, body.n_parts(), 4, 4});
            const Input<bool, 1> m(moving, "moving", {body.n_parts()});
            const Input<float, 3> s(samples, "samples", {rig.n_views(), ROW, rows::sample::N_COLUMNS});
            const Input<Index, 1> c(counts, "counts", {rig.n_views()});
            const Output<double, 3> out(distances, "distances", {placed.length(0), rig.n_views(), 2});
            within((*c).data, (*c).size(), "counts", 0, ROW + 1);
            unlocked([&] {
                score_poses(*placed, body.grids(), body.parts(), rig.views(), {spacing.first, spacing.second}, e.edges(),
                            {rule.first, rule.second}, *m, {*s, *c}, *out);
            });
        },
        named("placements"), named("shapes"), named("grids"), named("planes"), nb::arg("layout"), named("bounds"),
        named("cameras"), named("sizes"), nb::arg("spacing"), named("flat"), named("regions"), named("scene"),
        named("first"), nb::arg("rule"), named("moving"), named("samples"), named("counts"), named("distances"));
}

// Refuses pairs of views, samples, points or parts that are none.
void check_pairs(Array<const Index, 2> pairs, Array<const Index, 2> parts, Index n_scene, Index n_parts) {
    for (Index i = 0; i < pairs.shape[0]; i++) {
        const Index *pair = pairs[i].data;
        within(pair, 1, "pairs (views)", 0, parts.shape[0]);
        within(pair + 1, 1, "pairs (model samples)", 0, parts.shape[1]);
        within(pair + 2, 1, "pairs (scene points)", 0, n_scene);
        within(&parts(pair[0], pair[1]), 1, "parts", 0, n_parts);
    }
}

void bind_oriented_matching(nb::module_ &module) {
    module.def(
        "match_oriented",
        [](nb::handle positions, nb::handle counts, nb::handle scene, nb::handle first, Pair gate, nb::handle pairs) {
            const Input<float, 3> p(positions, "positions", {ANY, ANY, 5});
            const Input<Index, 1> c(counts, "counts", {p.length(0)});
            const Input<float, 2> s(scene, "scene", {ANY, rows::scene_point::N_COLUMNS});
            const Input<Index, 1> f(first, "first", {p.length(0) + 1});
            const Output<Index, 2> out(pairs, "pairs", {ANY, 4});
            within((*c).data, (*c).size(), "counts", 0, p.length(1) + 1);
            rising(*f, "first", s.length(0));
            return unlocked([&] { return match_oriented(*p, *c, *s, *f, {gate.first, gate.second}, *out); });
        },
        named("positions"), named("counts"), named("scene"), named("first"), nb::arg("gate"), named("pairs"));
    module.def(
        "normal_equations",
        [](nb::handle pairs, nb::handle positions, nb::handle points, nb::handle parts, nb::handle ends, nb::handle scene,
           nb::handle cameras, nb::handle twists, nb::handle moves, double px_per_observation, double robust_px,
           nb::handle matrix, nb::handle vector) {
            const Input<Index, 2> p(pairs, "pairs", {ANY, 4});
            const Input<float, 3> at(positions, "positions", {ANY, ANY, 5});
            const Input<float, 3> of(points, "points", {at.length(0), at.length(1), 3});
            const Input<Index, 2> parts_(parts, "parts", {at.length(0), at.length(1)});
            const Input<Index, 1> e(ends, "ends", {ANY});
            const Input<float, 2> s(scene, "scene", {ANY, rows::scene_point::N_COLUMNS});
            const Input<double, 2> c(cameras, "cameras", {at.length(0), rows::camera::N_COLUMNS});
            const Input<double, 2> t(twists, "twists", {ANY, 6});
            const Input<bool, 2> m(moves, "moves", {t.length(0), ANY});
            const Output<double, 2> a(matrix, "matrix", {t.length(0), t.length(0)});
            const Output<double, 1> v(vector, "vector", {t.length(0)});
            within((*e).data, (*e).size(), "ends", -2, m.length(1));
            check_pairs(*p, *parts_, s.length(0), e.length(0));
            const body::Sums sums = unlocked([&] {
                return normal_equations({*p, *at, *of, *parts_, *s, *c}, {*e, *t, *m}, px_per_observation, robust_px, *a,
                                        *v);
            });
            return std::pair(sums.squares, sums.total);
        },
        named("pairs"), named("positions"), named("points"), named("parts"), named("ends"), named("scene"),
        named("cameras"), named("twists"), named("moves"), nb::arg("px_per_observation"), nb::arg("robust_px"),
        named("matrix"), named("vector"));
}

}  // namespace

}  // namespace contours

void bind_contours(nb::module_ &module) {
    contours::bind_chamfer(module);
    contours::bind_tracing(module);
    contours::bind_scoring(module);
    contours::bind_oriented_matching(module);
}

}  // namespace bodytrack
