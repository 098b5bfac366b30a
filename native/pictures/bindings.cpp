#include <nanobind/stl/pair.h>
#include <nanobind/stl/tuple.h>

#include <tuple>
#include <utility>

#include "border.hpp"
#include "pictures/coverage.hpp"
#include "pictures/id_contours.hpp"
#include "pictures/nearest.hpp"
#include "pictures/rods.hpp"
#include "pictures/silhouettes.hpp"
#include "rows.hpp"

namespace bodytrack {

namespace pictures {

namespace {

using Layout = std::pair<Index, Index>;

// Points of a grid; rings of at least three, and few enough for the bits of an integer.
Index n_points(const Layout &layout) {
    if (layout.first < 1 || layout.first > 100000 || layout.second < 3 || layout.second > 62)
        throw nb::value_error("layout: expected at least 1 row and 3 to 62 columns");
    return layout.first * layout.second;
}

// Surface points of parts.
class RingArguments {
  public:
    RingArguments(nb::handle grids, const Layout &layout, Index n_parts)
        : points_(grids, "grids", {n_parts, n_points(layout), 3}), layout_(layout) {}

    Rings rings() const { return {*points_, int(layout_.first), int(layout_.second)}; }

  private:
    Input<float, 3> points_;
    Layout layout_;
};

// Weighted pictures of all views.
class WeightedArguments {
  public:
    WeightedArguments(nb::handle cameras, nb::handle regions, nb::handle pictures)
        : cameras_(cameras, "cameras", {ANY, rows::camera::N_COLUMNS}), regions_(regions, "regions", {n_views(), 3}),
          pictures_(pictures, "pictures", {ANY, 2}) {
        for (Index v = 0; v < n_views(); v++) {
            const Index *at = (*regions_)[v].data, room = n_pixels() - at[0];
            if (at[0] < 0 || at[1] < 0 || at[2] < 0 || room < 0 || (at[1] > 0 && at[2] > room / at[1]))
                throw nb::value_error(("regions: view " + std::to_string(v) + " does not lie in pictures").c_str());
        }
    }

    Index n_views() const { return cameras_.length(0); }
    Index n_pixels() const { return pictures_.length(0); }
    Weighted weighted() const { return {*cameras_, *regions_, *pictures_}; }

  private:
    Input<double, 2> cameras_;
    Input<Index, 2> regions_;
    Input<float, 2> pictures_;
};

void bind_coverage(nb::module_ &module) {
    module.def(
        "fill_parts",
        [](nb::handle placements, nb::handle grids, Layout layout, nb::handle camera, nb::handle mask) {
            const Layout nodes{2 * layout.first - 1, 2 * layout.second};
            const Input<double, 3> p(placements, "placements", {ANY, 4, 4});
            const Input<float, 3> g(grids, "grids", {p.length(0), n_points(nodes), 7});
            const Input<double, 1> c(camera, "camera", {rows::camera::N_COLUMNS});
            const Output<bool, 2> m(mask, "mask", {ANY, ANY});
            unlocked([&] { fill_parts(*p, *g, int(nodes.first), int(nodes.second), (*c).data, *m); });
        },
        named("placements"), named("grids"), nb::arg("layout"), named("camera"), named("mask"));
    module.def(
        "cover_still",
        [](nb::handle placements, nb::handle still, nb::handle grids, Layout layout, nb::handle cameras,
           nb::handle regions, nb::handle pictures, nb::handle covered, nb::handle sums) {
            const Input<bool, 1> s(still, "still", {ANY});
            const Input<double, 4> p(placements, "placements", {ANY, s.length(0), 4, 4});
            const RingArguments r(grids, layout, s.length(0));
            const WeightedArguments w(cameras, regions, pictures);
            const Output<bool, 1> c(covered, "covered", {w.n_pixels()});
            const Output<double, 2> out(sums, "sums", {w.n_views(), 2});
            if (p.length(0) == 0) throw nb::value_error("placements: expected at least one pose");
            unlocked([&] { cover_still((*p)[0], *s, r.rings(), w.weighted(), *c, *out); });
        },
        named("placements"), named("still"), named("grids"), nb::arg("layout"), named("cameras"), named("regions"),
        named("pictures"), named("covered"), named("sums"));
    module.def(
        "covered_sums",
        [](nb::handle placements, nb::handle moving, nb::handle grids, Layout layout, nb::handle cameras,
           nb::handle regions, nb::handle pictures, nb::handle covered, nb::handle base, nb::handle sums) {
            const Input<bool, 1> m(moving, "moving", {ANY});
            const Input<double, 4> p(placements, "placements", {ANY, m.length(0), 4, 4});
            const RingArguments r(grids, layout, m.length(0));
            const WeightedArguments w(cameras, regions, pictures);
            const Input<bool, 1> c(covered, "covered", {w.n_pixels()});
            const Input<double, 2> b(base, "base", {w.n_views(), 2});
            const Output<double, 3> out(sums, "sums", {p.length(0), w.n_views(), 2});
            unlocked([&] { covered_sums(*p, *m, r.rings(), w.weighted(), *c, *b, *out); });
        },
        named("placements"), named("moving"), named("grids"), nb::arg("layout"), named("cameras"), named("regions"),
        named("pictures"), named("covered"), named("base"), named("sums"));
    module.def(
        "cover_shares",
        [](nb::handle mask, Index factor, nb::handle shares) {
            const Input<bool, 2> m(mask, "mask", {ANY, ANY});
            const Output<float, 2> s(shares, "shares", {ANY, ANY});
            if (factor < 1 || factor > 255 || s.length(0) > m.length(0) / factor || s.length(1) > m.length(1) / factor)
                throw nb::value_error("factor: expected 1 to 255, and shares no larger than mask by it");
            unlocked([&] { cover_shares(*m, factor, *s); });
        },
        named("mask"), nb::arg("factor"), named("shares"));
    module.def(
        "covered_by_rods",
        [](nb::handle starts, nb::handle ways, nb::handle reach_px, nb::handle pixels, nb::handle shares) {
            const Input<float, 3> s(starts, "starts", {ANY, ANY, 2});
            const Input<float, 3> w(ways, "ways", {s.length(0), s.length(1), 2});
            const Input<float, 2> r(reach_px, "reach_px", {s.length(0), s.length(1)});
            const Input<float, 2> p(pixels, "pixels", {ANY, 2});
            const Output<double, 1> out(shares, "shares", {s.length(0)});
            unlocked([&] { covered_by_rods(*s, *w, *r, *p, *out); });
        },
        named("starts"), named("ways"), named("reach_px"), named("pixels"), named("shares"));
}

void bind_drawing(nb::module_ &module) {
    module.def(
        "rasterize",
        [](nb::handle pixels, nb::handle depths, nb::handle triangles, std::pair<Index, Index> origin,
           nb::handle buffers) {
            const Input<double, 2> p(pixels, "pixels", {ANY, 2});
            const Input<double, 1> d(depths, "depths", {p.length(0)});
            const Input<Index, 2> t(triangles, "triangles", {ANY, 3});
            const Output<float, 3> b(buffers, "buffers", {ANY, ANY, 4});
            within((*t).data, (*t).size(), "triangles", 0, p.length(0));
            unlocked([&] { rasterize(*p, *d, *t, {origin.first, origin.second}, *b); });
        },
        named("pixels"), named("depths"), named("triangles"), nb::arg("origin"), named("buffers"));
    module.def(
        "project_surfaces",
        [](nb::handle placements, nb::handle surfaces, nb::handle wanted, nb::handle camera, nb::handle seen) {
            const Input<bool, 1> w(wanted, "wanted", {ANY});
            const Input<double, 3> p(placements, "placements", {w.length(0), 4, 4});
            const Input<double, 3> s(surfaces, "surfaces", {w.length(0), ANY, 3});
            const Input<double, 1> c(camera, "camera", {rows::camera::N_COLUMNS});
            const Output<double, 3> out(seen, "seen", {w.length(0), 3, s.length(1)});
            if (s.length(1) == 0) throw nb::value_error("surfaces: expected at least one point");
            unlocked([&] { project_surfaces(*p, *s, *w, (*c).data, *out); });
        },
        named("placements"), named("surfaces"), named("wanted"), named("camera"), named("seen"));
    module.def(
        "draw_nearest",
        [](nb::handle seen, nb::handle triangles, std::pair<Index, Index> corner, nb::handle depths, nb::handle parts) {
            const Input<double, 3> s(seen, "seen", {ANY, 3, ANY});
            const Input<Index, 2> t(triangles, "triangles", {ANY, 3});
            const Output<float, 2> d(depths, "depths", {ANY, ANY});
            const Output<std::int16_t, 2> p(parts, "parts", {d.length(0), d.length(1)});
            within((*t).data, (*t).size(), "triangles", 0, s.length(2));
            unlocked([&] { draw_nearest(*s, *t, {corner.first, corner.second}, *d, *p); });
        },
        named("seen"), named("triangles"), nb::arg("corner"), named("depths"), named("parts"));
    module.def(
        "id_contours",
        [](nb::handle ids, nb::handle depths, std::tuple<Index, Index, Index, Index> frame, nb::handle camera,
           nb::handle solids, double contact_m, nb::handle positions, nb::handle points, nb::handle parts,
           nb::handle between) {
            const Input<Index, 2> i(ids, "ids", {ANY, ANY});
            const Input<float, 2> d(depths, "depths", {i.length(0), i.length(1)});
            const Input<double, 1> c(camera, "camera", {rows::camera::N_COLUMNS});
            const Input<double, 2> s(solids, "solids", {ANY, 17});
            const Output<Index, 1> p(parts, "parts", {ANY});
            const Output<float, 2> at(positions, "positions", {p.length(0), 5});
            const Output<float, 2> of(points, "points", {p.length(0), 3});
            const Output<bool, 1> b(between, "between", {p.length(0)});
            const auto [left, top, width, height] = frame;
            const IdPicture picture{*i, *d, left, top, width, height};
            return unlocked([&] { return id_contours(picture, (*c).data, *s, contact_m, {*at, *of, *p, *b}); });
        },
        named("ids"), named("depths"), nb::arg("frame"), named("camera"), named("solids"), nb::arg("contact_m"),
        named("positions"), named("points"), named("parts"), named("between"));
}

}  // namespace

}  // namespace pictures

void bind_pictures(nb::module_ &module) {
    pictures::bind_coverage(module);
    pictures::bind_drawing(module);
}

}  // namespace bodytrack
