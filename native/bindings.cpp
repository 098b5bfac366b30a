// The lens and projection of single points, by which the tests hold all kernels against `Camera`.
#include <nanobind/stl/pair.h>
#include <nanobind/stl/tuple.h>

#include <tuple>
#include <utility>

#include "border.hpp"
#include "projection.hpp"

namespace bodytrack {

void bind_projection(nb::module_ &module) {
    using rows::camera::N_COLUMNS;
    module.def(
        "undistort",
        [](nb::handle camera, double x, double y) {
            const Input<double, 1> c(camera, "camera", {N_COLUMNS});
            double a, b;
            undistort((*c).data, x, y, a, b);
            return std::pair(a, b);
        },
        named("camera"), nb::arg("x"), nb::arg("y"));
    module.def(
        "project_point",
        [](nb::handle camera, double x, double y, double z) {
            const Input<double, 1> c(camera, "camera", {N_COLUMNS});
            const Image image = project_point((*c).data, x, y, z);
            return std::tuple(image.u, image.v, image.depth);
        },
        named("camera"), nb::arg("x"), nb::arg("y"), nb::arg("z"));
    module.def(
        "project_grid",
        [](nb::handle placement, nb::handle grid, nb::handle camera, nb::handle pixels) {
            const Input<double, 2> p(placement, "placement", {4, 4});
            const Input<float, 2> g(grid, "grid", {ANY, ANY});
            const Input<double, 1> c(camera, "camera", {N_COLUMNS});
            const Output<double, 2> out(pixels, "pixels", {3, g.length(0)});
            if (g.length(0) == 0 || g.length(1) < 3) throw nb::value_error("grid: expected at least one point of three");
            return project_grid((*p).data, *g, (*c).data, (*out).data);
        },
        named("placement"), named("grid"), named("camera"), named("pixels"));
}

}  // namespace bodytrack
