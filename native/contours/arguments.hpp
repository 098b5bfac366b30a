// Groups of arguments that several kernels share, checked at the border.
#pragma once
#include <nanobind/stl/pair.h>

#include <utility>

#include "border.hpp"
#include "contours/chamfer.hpp"
#include "contours/tracing.hpp"
#include "rows.hpp"

namespace bodytrack::contours {

using Pair = std::pair<double, double>;

// Parts of bodies and their surface grids.
class BodyArguments {
  public:
    BodyArguments(nb::handle shapes, nb::handle grids, nb::handle planes, std::pair<Index, Index> layout, nb::handle bounds)
        : shapes_(shapes, "shapes", {ANY, rows::superquadric::N_COLUMNS}),
          grids_(grids, "grids", {shapes_.length(0), nodes(layout), 7}),
          planes_(planes, "planes", {shapes_.length(0), 4, layout.first * layout.second}),
          bounds_(bounds, "bounds", {3, shapes_.length(0)}), layout_(layout) {}

    Index n_parts() const { return shapes_.length(0); }
    Parts parts() const { return {*shapes_, *bounds_}; }
    Grids grids() const { return {*grids_, *planes_, int(layout_.first), int(layout_.second)}; }

  private:
    static Index nodes(std::pair<Index, Index> layout) {
        const auto [n_rows, n_columns] = layout;
        if (n_rows < 2 || n_rows > ROW || n_columns < 3 || n_columns > MOST_COLUMNS)
            throw nb::value_error("layout: expected at least 2 rows and 3 to 62 columns");
        return (2 * n_rows - 1) * 2 * n_columns;
    }

    Input<double, 2> shapes_;
    Input<float, 3> grids_, planes_;
    Input<double, 2> bounds_;
    std::pair<Index, Index> layout_;
};

// Cameras and image sizes.
class ViewArguments {
  public:
    ViewArguments(nb::handle cameras, nb::handle sizes)
        : cameras_(cameras, "cameras", {ANY, rows::camera::N_COLUMNS}), sizes_(sizes, "sizes", {cameras_.length(0), 2}) {}

    Index n_views() const { return cameras_.length(0); }
    Views views() const { return {*cameras_, *sizes_}; }

  private:
    Input<double, 2> cameras_, sizes_;
};

// The edges of all views: chamfer images and scene points.
class EdgeArguments {
  public:
    EdgeArguments(nb::handle flat, nb::handle regions, nb::handle scene, nb::handle first, Index n_views);

    Edges edges() const { return {*flat_, *regions_, *scene_, *first_}; }

  private:
    Input<float, 1> flat_;
    Input<Index, 2> regions_;
    Input<float, 2> scene_;
    Input<Index, 1> first_;
};

// Refuses regions (V, 5) that do not lie in a flat array of n numbers.
void check_regions(Array<const Index, 2> regions, const char *name, Index n);

// Refuses parts (V, M), counts (V,) of which are valid, that are none of n_parts.
void within_counted(Array<const Index, 2> parts, Array<const Index, 1> counts, const char *name, Index n_parts);

}  // namespace bodytrack::contours
