// Groups of arguments that several kernels share, checked at the border.
#pragma once
#include "body/anchors.hpp"
#include "body/kinematics.hpp"
#include "border.hpp"

namespace bodytrack::body {

// The parameters of a body, as `BodyModel.packed` has them.
class ChainArguments {
  public:
    ChainArguments(nb::handle rotates, nb::handle axes, nb::handle points, nb::handle parents)
        : rotates_(rotates, "rotates", {ANY}), axes_(axes, "axes", {dof(), 3}), points_(points, "points", {dof(), 3}),
          parents_(parents, "parents", {dof()}) {
        for (Index i = 0; i < dof(); i++) within(&(*parents_)[i], 1, "parents", -1, i);
    }

    Index dof() const { return rotates_.length(0); }
    Chain chain() const { return {*rotates_, *axes_, *points_, *parents_}; }

  private:
    Input<bool, 1> rotates_;
    Input<double, 2> axes_, points_;
    Input<Index, 1> parents_;
};

// A named tuple `tracker.kernels.body.Carried`.
class CarriedArguments {
  public:
    CarriedArguments(const nb::tuple &given, Index n_views, Index n_parts)
        : views_(entry(given, 0, 8, "carried"), "carried.views", {ANY}),
          parts_(entry(given, 1, 8, "carried"), "carried.parts", {size()}),
          places_(entry(given, 2, 8, "carried"), "carried.places", {size(), 3}),
          normals_(entry(given, 3, 8, "carried"), "carried.normals", {size(), 3}),
          rays_(entry(given, 4, 8, "carried"), "carried.rays", {size(), 3}),
          depths_m_(entry(given, 5, 8, "carried"), "carried.depths_m", {size()}),
          pixels_(entry(given, 6, 8, "carried"), "carried.pixels", {size(), 2}),
          variances_(entry(given, 7, 8, "carried"), "carried.variances", {size()}) {
        within((*views_).data, size(), "carried.views", 0, n_views);
        within((*parts_).data, size(), "carried.parts", 0, n_parts);
    }

    Index size() const { return views_.length(0); }
    Carried carried() const {
        return {*views_, *parts_, *places_, *normals_, *rays_, *depths_m_, *pixels_, *variances_};
    }

  private:
    Input<Index, 1> views_, parts_;
    Input<double, 2> places_, normals_, rays_;
    Input<double, 1> depths_m_;
    Input<double, 2> pixels_;
    Input<double, 1> variances_;
};

}  // namespace bodytrack::body
