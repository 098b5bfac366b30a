#include <nanobind/stl/tuple.h>

#include <algorithm>
#include <tuple>

#include "adjustment/bundle.hpp"
#include "adjustment/projecting.hpp"
#include "adjustment/ray_intersection.hpp"
#include "border.hpp"

namespace bodytrack {

namespace adjustment {

namespace {

using Five = std::tuple<nb::handle, nb::handle, nb::handle, nb::handle, nb::handle>;

// Observations of points by cameras; see `tracker.kernels.adjustment.Observed`.
class ObservedArguments {
  public:
    ObservedArguments(const Five &observed, Index n_views, Index n_points)
        : views_(std::get<0>(observed), "views", {ANY}), points_(std::get<1>(observed), "numbers", {n()}),
          pixels_(std::get<2>(observed), "pixels", {n(), 2}),
          velocities_(std::get<3>(observed), "velocities", {n(), 2}),
          weights_(std::get<4>(observed), "weights", {n()}) {
        within((*views_).data, n(), "views", 0, n_views);
        within((*points_).data, n(), "numbers", 0, n_points);
    }

    Index n() const { return views_.length(0); }
    Observed observed() const { return {*views_, *points_, *pixels_, *velocities_, *weights_}; }

  private:
    Input<Index, 1> views_, points_;
    Input<double, 2> pixels_, velocities_;
    Input<double, 1> weights_;
};

}  // namespace

}  // namespace adjustment

void bind_adjustment(nb::module_ &module) {
    using namespace adjustment;
    module.def(
        "project_with_slopes",
        [](nb::handle camera, nb::handle point, nb::handle velocity, nb::handle by_camera, nb::handle by_point) {
            const Input<double, 1> c(camera, "camera", {rows::bundle_camera::N_COLUMNS}), p(point, "point", {3});
            const Input<double, 1> v(velocity, "velocity", {2});
            const Output<double, 2> of_camera(by_camera, "by_camera", {2, N_UNKNOWNS});
            const Output<double, 2> of_point(by_point, "by_point", {2, 3});
            PixelSlopes slopes;
            const Pixel pixel = project_with_slopes((*c).data, (*p).data, (*v).data, slopes);
            std::copy_n(&slopes.by_camera[0][0], 2 * N_UNKNOWNS, (*of_camera).data);
            std::copy_n(&slopes.by_point[0][0], 6, (*of_point).data);
            return std::tuple(pixel.u, pixel.v, pixel.before);
        },
        named("camera"), named("point"), named("velocity"), named("by_camera"), named("by_point"));
    module.def(
        "bundle_residuals",
        [](nb::handle cameras, nb::handle points, Five observed, nb::handle residuals) {
            const Input<double, 2> c(cameras, "cameras", {ANY, rows::bundle_camera::N_COLUMNS});
            const Input<double, 2> p(points, "points", {ANY, 3});
            const ObservedArguments of(observed, c.length(0), p.length(0));
            const Output<double, 2> out(residuals, "residuals", {of.n(), 2});
            unlocked([&] { residuals_of(*c, *p, of.observed(), *out); });
        },
        named("cameras"), named("points"), nb::arg("observed"), named("residuals"));
    module.def(
        "reduce_normal",
        [](nb::handle cameras, Five objects, Five observed, double damping, Five reduced) {
            const auto [points, slopes, firsts, priors, prior_sides] = objects;
            const auto [normal, side, inverses, object_sides, couplings] = reduced;
            const Input<double, 2> c(cameras, "cameras", {ANY, rows::bundle_camera::N_COLUMNS});
            const Input<double, 2> p(points, "points", {ANY, 3});
            const Input<double, 3> s(slopes, "slopes", {p.length(0), 3, N_OBJECT});
            const Input<double, 3> pr(priors, "priors", {ANY, N_OBJECT, N_OBJECT});
            const Index n_objects = pr.length(0), n = c.length(0) * N_UNKNOWNS;
            const Input<double, 2> ps(prior_sides, "prior_sides", {n_objects, N_OBJECT});
            const Input<Index, 1> f(firsts, "firsts", {n_objects + 1});
            const ObservedArguments of(observed, c.length(0), p.length(0));
            rising(*f, "firsts", of.n());
            const Output<double, 2> a(normal, "normal", {n, n});
            const Output<double, 2> os(object_sides, "object_sides", {n_objects, N_OBJECT});
            const Output<double, 1> b(side, "side", {n});
            const Output<double, 3> i(inverses, "inverses", {n_objects, N_OBJECT, N_OBJECT});
            const Output<double, 4> co(couplings, "couplings", {n_objects, c.length(0), N_OBJECT, N_UNKNOWNS});
            unlocked([&] {
                reduce_normal(*c, {*p, *s, *f, *pr, *ps}, of.observed(), damping, {*a, *b, *i, *os, *co});
            });
        },
        named("cameras"), nb::arg("objects"), nb::arg("observed"), nb::arg("damping"), nb::arg("reduced"));
    module.def(
        "intersect_rays",
        [](nb::handle cameras, nb::handle pixels, nb::handle variances, nb::handle points, nb::handle covariances,
           nb::handle residuals) {
            const Output<double, 2> p(points, "points", {ANY, 3});
            const Input<double, 2> c(cameras, "cameras", {ANY, rows::camera::N_COLUMNS});
            const Input<double, 3> px(pixels, "pixels", {c.length(0), p.length(0), 2});
            const Input<double, 3> v(variances, "variances", {c.length(0), p.length(0), 3});
            const Output<double, 3> co(covariances, "covariances", {p.length(0), 3, 3});
            const Output<double, 1> r(residuals, "residuals", {p.length(0)});
            unlocked([&] { intersect_rays({*c, *px, *v}, *p, *co, *r); });
        },
        named("cameras"), named("pixels"), named("variances"), named("points"), named("covariances"),
        named("residuals"));
}

}  // namespace bodytrack
