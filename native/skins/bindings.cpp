#include <nanobind/stl/tuple.h>

#include <tuple>

#include "contours/arguments.hpp"
#include "skins/depths.hpp"
#include "skins/filling.hpp"
#include "skins/tracing.hpp"

namespace bodytrack {

namespace skins {

namespace {

// A named tuple `tracker.kernels.skins.Mesh`.
class MeshArguments {
  public:
    explicit MeshArguments(const nb::tuple &mesh)
        : points_(entry(mesh, 0, 9, "mesh"), "mesh.points", {ANY, 3}),
          normals_(entry(mesh, 1, 9, "mesh"), "mesh.normals", {n_vertices(), 3}),
          bones_(entry(mesh, 2, 9, "mesh"), "mesh.bones", {n_vertices(), ANY}),
          weights_(entry(mesh, 3, 9, "mesh"), "mesh.weights", {n_vertices(), bones_.length(1)}),
          faces_(entry(mesh, 4, 9, "mesh"), "mesh.faces", {ANY, 3}),
          parts_(entry(mesh, 5, 9, "mesh"), "mesh.parts", {faces_.length(0)}),
          borders_(entry(mesh, 6, 9, "mesh"), "mesh.borders", {ANY, 4}),
          n_traced_(nb::cast<Index>(entry(mesh, 7, 9, "mesh"))), n_parts_(nb::cast<Index>(entry(mesh, 8, 9, "mesh"))) {
        within((*bones_).data, (*bones_).size(), "mesh.bones", 0, n_parts_);
        within((*faces_).data, (*faces_).size(), "mesh.faces", 0, n_vertices());
        within((*parts_).data, (*parts_).size(), "mesh.parts", 0, n_parts_);
        within(&n_traced_, 1, "mesh.n_traced", 0, faces_.length(0) + 1);
        for (Index e = 0; e < borders_.length(0); e++) {
            within((*borders_)[e].data, 3, "mesh.borders", 0, n_vertices());
            within((*borders_)[e].data + 3, 1, "mesh.borders", 0, faces_.length(0));
        }
    }

    Index n_vertices() const { return points_.length(0); }
    Index n_parts() const { return n_parts_; }
    Mesh mesh() const { return {*points_, *normals_, *bones_, *weights_, *faces_, *parts_, *borders_, n_traced_}; }

  private:
    Input<float, 2> points_, normals_;
    Input<Index, 2> bones_;
    Input<float, 2> weights_;
    Input<Index, 2> faces_;
    Input<Index, 1> parts_;
    Input<Index, 2> borders_;
    Index n_traced_, n_parts_;
};

void bind_tracing(nb::module_ &module) {
    module.def(
        "trace_skins",
        [](nb::handle placements, nb::handle part_from_rest, const nb::tuple &mesh, nb::handle cameras, nb::handle sizes,
           std::tuple<double, double, double> spacing, nb::handle positions, nb::handle points, nb::handle parts,
           nb::handle between, nb::handle counts) {
            const MeshArguments m(mesh);
            const contours::ViewArguments rig(cameras, sizes);
            const Input<double, 4> placed(placements, "placements", {ANY, m.n_parts(), 4, 4});
            const Input<double, 3> rest(part_from_rest, "part_from_rest", {m.n_parts(), 4, 4});
            const Index n_poses = placed.length(0), n_views = rig.n_views();
            const Output<float, 4> at(positions, "positions", {n_poses, n_views, ANY, 5});
            const Index room = at.length(2);
            const Output<float, 4> of(points, "points", {n_poses, n_views, room, 3});
            const Output<Index, 3> p(parts, "parts", {n_poses, n_views, room});
            const Output<bool, 3> b(between, "between", {n_poses, n_views, room});
            const Output<Index, 2> c(counts, "counts", {n_poses, n_views});
            const auto [step_px, contact_m, n_cells] = spacing;
            const Spacing cut{step_px, contact_m, n_cells};
            if (!(step_px > 0.0) || !(n_cells >= 1.0 && n_cells <= 1e5))
                throw nb::value_error("spacing: expected a positive step and 1 to 100000 cells");
            unlocked([&] { trace_skins(*placed, *rest, m.mesh(), rig.views(), cut, {*at, *of, *p, *b, *c}); });
        },
        named("placements"), named("part_from_rest"), nb::arg("mesh"), named("cameras"), named("sizes"),
        nb::arg("spacing"), named("positions"), named("points"), named("parts"), named("between"), named("counts"));
    module.def(
        "fill_mesh",
        [](nb::handle points, nb::handle faces, nb::handle camera, nb::handle mask) {
            const Input<double, 2> p(points, "points", {ANY, 3});
            const Input<Index, 2> f(faces, "faces", {ANY, 3});
            const Input<double, 1> c(camera, "camera", {rows::camera::N_COLUMNS});
            const Output<bool, 2> m(mask, "mask", {ANY, ANY});
            within((*f).data, (*f).size(), "faces", 0, p.length(0));
            unlocked([&] { fill_mesh(*p, *f, (*c).data, *m); });
        },
        named("points"), named("faces"), named("camera"), named("mask"));
    module.def(
        "see_vertices",
        [](nb::handle points, nb::handle normals, nb::handle camera, nb::handle seen, nb::handle facing) {
            const Input<float, 2> p(points, "points", {ANY, 3});
            const Input<float, 2> n(normals, "normals", {p.length(0), 3});
            const Input<float, 1> c(camera, "camera", {rows::camera::N_COLUMNS});
            const Output<float, 2> s(seen, "seen", {p.length(0), 3});
            const Output<float, 1> f(facing, "facing", {p.length(0)});
            unlocked([&] { see_vertices((*p).data, (*n).data, p.length(0), (*c).data, (*s).data, (*f).data); });
        },
        named("points"), named("normals"), named("camera"), named("seen"), named("facing"));
}

}  // namespace

}  // namespace skins

void bind_skins(nb::module_ &module) { skins::bind_tracing(module); }

}  // namespace bodytrack
