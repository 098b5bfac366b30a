#include <nanobind/stl/pair.h>

#include <utility>

#include "body/arguments.hpp"
#include "body/keypoints.hpp"
#include "body/rays.hpp"
#include "body/self_collision.hpp"
#include "rows.hpp"

namespace bodytrack {

namespace body {

namespace {

void bind_kinematics(nb::module_ &module) {
    module.def(
        "chain_transforms",
        [](nb::handle poses, nb::handle rotates, nb::handle axes, nb::handle points, nb::handle parents,
           nb::handle motions) {
            const ChainArguments c(rotates, axes, points, parents);
            const Input<double, 2> p(poses, "poses", {ANY, c.dof()});
            const Output<double, 4> m(motions, "motions", {p.length(0), c.dof() + 1, 4, 4});
            unlocked([&] { chain_transforms(*p, c.chain(), *m); });
        },
        named("poses"), named("rotates"), named("axes"), named("points"), named("parents"), named("motions"));
    module.def(
        "twists_in_world",
        [](nb::handle motions, nb::handle rotates, nb::handle axes, nb::handle points, nb::handle parents,
           nb::handle twists) {
            const ChainArguments c(rotates, axes, points, parents);
            const Input<double, 4> m(motions, "motions", {ANY, c.dof() + 1, 4, 4});
            const Output<double, 3> t(twists, "twists", {m.length(0), c.dof(), 6});
            unlocked([&] { twists_in_world(*m, c.chain(), *t); });
        },
        named("motions"), named("rotates"), named("axes"), named("points"), named("parents"), named("twists"));
    module.def(
        "sum_collisions",
        [](nb::handle placements, nb::handle shapes, nb::handle pairs, nb::handle sums) {
            const Input<double, 2> s(shapes, "shapes", {ANY, rows::superquadric::N_COLUMNS});
            const Input<double, 4> p(placements, "placements", {ANY, s.length(0), 4, 4});
            const Input<Index, 2> n(pairs, "pairs", {ANY, 2});
            const Output<double, 1> out(sums, "sums", {p.length(0)});
            within((*n).data, (*n).size(), "pairs", 0, s.length(0));
            unlocked([&] { sum_collisions(*p, *s, *n, *out); });
        },
        named("placements"), named("shapes"), named("pairs"), named("sums"));
    module.def(
        "depth",
        [](nb::handle shape, double u, double v, double w) {
            const Input<double, 1> s(shape, "shape", {rows::superquadric::N_COLUMNS});
            return depth((*s).data, u, v, w);
        },
        named("shape"), nb::arg("u"), nb::arg("v"), nb::arg("w"));
}

void bind_keypoints(nb::module_ &module) {
    module.def(
        "match_keypoints",
        [](nb::handle points, nb::handle cameras, const nb::tuple &detected, Index n_limbs, std::pair<double, double> reach,
           const nb::tuple &matches) {
            const Input<double, 3> p(points, "points", {ANY, ANY, 3});
            const Input<double, 2> c(cameras, "cameras", {ANY, rows::camera::N_COLUMNS});
            const Index n_poses = p.length(0), n_points = p.length(1), n_views = c.length(0);
            const Input<double, 3> found(entry(detected, 0, 4, "detected"), "detected.found", {ANY, n_points, 3});
            const Input<Index, 1> first(entry(detected, 1, 4, "detected"), "detected.first", {n_views + 1});
            const Input<Index, 1> other(entry(detected, 2, 4, "detected"), "detected.other", {n_points});
            const Input<Index, 1> limbs(entry(detected, 3, 4, "detected"), "detected.limbs", {n_points});
            const Output<double, 4> gaps(entry(matches, 0, 4, "matches"), "matches.gaps", {n_poses, n_views, n_points, 2});
            const std::array<Index, 3> shape{n_poses, n_views, n_points};
            const Output<double, 3> weights(entry(matches, 1, 4, "matches"), "matches.weights", shape);
            const Output<double, 3> px_per_m(entry(matches, 2, 4, "matches"), "matches.px_per_m", shape);
            const Output<double, 3> losses(entry(matches, 3, 4, "matches"), "matches.losses", shape);
            rising(*first, "detected.first", found.length(0));
            within((*other).data, n_points, "detected.other", 0, n_points);
            within((*limbs).data, n_points, "detected.limbs", -1, n_limbs);
            unlocked([&] {
                match_keypoints(*p, *c, {*found, *first, *other, *limbs}, n_limbs, {reach.first, reach.second},
                                {*gaps, *weights, *px_per_m, *losses});
            });
        },
        named("points"), named("cameras"), nb::arg("detected"), nb::arg("n_limbs"), nb::arg("reach"), nb::arg("matches"));
}

void bind_anchors(nb::module_ &module) {
    module.def(
        "meet_parts",
        [](nb::handle placements, nb::handle shapes, nb::handle centre, nb::handle rays, nb::handle parts,
           nb::handle found) {
            const Input<double, 2> s(shapes, "shapes", {ANY, rows::superquadric::N_COLUMNS});
            const Input<double, 3> p(placements, "placements", {s.length(0), 4, 4});
            const Input<double, 1> c(centre, "centre", {3});
            const Input<Index, 1> of(parts, "parts", {ANY});
            const Input<double, 2> r(rays, "rays", {of.length(0), 3});
            const Output<double, 2> out(found, "found", {of.length(0), rows::met_place::N_COLUMNS});
            within((*of).data, of.length(0), "parts", 0, s.length(0));
            unlocked([&] { meet_parts(*p, *s, (*c).data, *r, *of, *out); });
        },
        named("placements"), named("shapes"), named("centre"), named("rays"), named("parts"), named("found"));
    module.def(
        "gaps_of",
        [](nb::handle placements, nb::handle cameras, const nb::tuple &carried, double most_m, nb::handle gaps) {
            const Input<double, 4> p(placements, "placements", {ANY, ANY, 4, 4});
            const Input<double, 2> c(cameras, "cameras", {ANY, rows::camera::N_COLUMNS});
            const CarriedArguments of(carried, c.length(0), p.length(1));
            const Output<double, 2> out(gaps, "gaps", {p.length(0), of.size()});
            unlocked([&] { gaps_of(*p, *c, of.carried(), most_m, *out); });
        },
        named("placements"), named("cameras"), nb::arg("carried"), nb::arg("most_m"), named("gaps"));
    module.def(
        "residuals_of",
        [](nb::handle placements, nb::handle cameras, const nb::tuple &carried, double slide_m, nb::handle found) {
            const Input<double, 4> p(placements, "placements", {1, ANY, 4, 4});
            const Input<double, 2> c(cameras, "cameras", {ANY, rows::camera::N_COLUMNS});
            const CarriedArguments of(carried, c.length(0), p.length(1));
            const Output<double, 2> out(found, "found", {of.size(), rows::carried_place::N_COLUMNS});
            unlocked([&] { residuals_of((*p)[0], *c, of.carried(), slide_m, *out); });
        },
        named("placements"), named("cameras"), nb::arg("carried"), nb::arg("slide_m"), named("found"));
    module.def(
        "anchor_equations",
        [](nb::handle placements, const nb::tuple &carried, nb::handle found, nb::handle weights, nb::handle ends,
           nb::handle twists, nb::handle moves, nb::handle matrix, nb::handle vector) {
            const Input<double, 4> p(placements, "placements", {1, ANY, 4, 4});
            const CarriedArguments of(carried, std::numeric_limits<Index>::max(), p.length(1));
            const Input<double, 2> f(found, "found", {of.size(), rows::carried_place::N_COLUMNS});
            const Input<double, 1> w(weights, "weights", {of.size()});
            const Input<Index, 1> e(ends, "ends", {p.length(1)});
            const Input<double, 2> t(twists, "twists", {ANY, 6});
            const Index dof = t.length(0);
            const Input<bool, 2> m(moves, "moves", {dof, dof + 1});
            const Output<double, 2> a(matrix, "matrix", {dof, dof});
            const Output<double, 1> v(vector, "vector", {dof});
            within((*e).data, e.length(0), "ends", -2, dof + 1);
            const Sums sums = unlocked([&] { return anchor_equations((*p)[0], of.carried(), *f, *w, {*e, *t, *m}, *a, *v); });
            return std::pair(sums.squares, sums.total);
        },
        named("placements"), nb::arg("carried"), named("found"), named("weights"), named("ends"), named("twists"),
        named("moves"), named("matrix"), named("vector"));
}

}  // namespace

}  // namespace body

void bind_body(nb::module_ &module) {
    body::bind_kinematics(module);
    body::bind_keypoints(module);
    body::bind_anchors(module);
}

}  // namespace bodytrack
