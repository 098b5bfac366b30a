#include <nanobind/stl/tuple.h>

#include <algorithm>
#include <cmath>
#include <tuple>

#include "border.hpp"
#include "patches/bending.hpp"
#include "patches/growth.hpp"
#include "patches/keys.hpp"

namespace bodytrack {

namespace patches {

namespace {

using Flat = std::tuple<nb::handle, Index, Index>;
using RuleOf = std::tuple<Index, Index, double, double, double, bool>;
using NoiseOf = std::tuple<double, double, nb::handle>;

// Spline coefficients, width and height of an image.
class ImageArgument {
  public:
    ImageArgument(const Flat &image, const char *name)
        : flat_(std::get<0>(image), name, {ANY}), width_(std::get<1>(image)), height_(std::get<2>(image)) {
        const Index n = flat_.length(0);
        expect(width_ > 0 && height_ > 0 && n % width_ == 0 && n / width_ == height_, name,
               "width times height numbers");
    }

    SplineImage operator*() const { return {(*flat_).data, width_, height_}; }

  private:
    Input<float, 1> flat_;
    Index width_, height_;
};

class NoiseArgument {
  public:
    explicit NoiseArgument(const NoiseOf &noise)
        : residual_gain_(std::get<0>(noise)), gradient_gain_(std::get<1>(noise)),
          taps_(std::get<2>(noise), "noise", {ANY}) {
        expect(0 < taps_.length(0) && taps_.length(0) < 1000, "noise", "1 to 999 taps");
    }

    Noise operator*() const { return {residual_gain_, gradient_gain_, *taps_}; }

  private:
    double residual_gain_, gradient_gain_;
    Input<float, 1> taps_;
};

void check_half(Index half, const char *name) {
    expect(0 < half && half < MOST_REACH, name, "patches of 3 to 127 pixels a side");
}

Rule rule_of(const RuleOf &rule) {
    const auto [half, most, tolerance, farthest, prior, classical] = rule;
    check_half(half, "rule");
    return {half, most, tolerance, farthest, prior, classical};
}

// A patch in an image that is sampled alone, and room for its grey values.
class PatchArgument {
  public:
    PatchArgument(const Flat &image, nb::handle warp, Index half) : image(image, "image"), warp_(warp, "warp", {6}) {
        check_half(half, "half");
        expect(!reaches_out((*warp_).data, half, *this->image), "warp", "a patch inside the image");
        n_ = (2 * half + 1) * (2 * half + 1);
    }

    const double *warp() const { return (*warp_).data; }
    float *room(const Output<float, 1> &values, const char *name) const {
        expect(values.length(0) >= n_, name, "room for all pixels of the patch");
        return (*values).data;
    }

    const ImageArgument image;

  private:
    Input<double, 1> warp_;
    Index n_;
};

void bind_splines(nb::module_ &module) {
    module.def(
        "reaches_out",
        [](nb::handle warp, Index half, Index width, Index height) {
            const Input<double, 1> w(warp, "warp", {6});
            return reaches_out((*w).data, half, {nullptr, width, height});
        },
        named("warp"), nb::arg("half"), nb::arg("width"), nb::arg("height"));
    module.def(
        "sample_patch",
        [](Flat image, nb::handle warp, Index half, nb::handle values) {
            const PatchArgument patch(image, warp, half);
            const Output<float, 1> v(values, "values", {ANY});
            sample_patch(*patch.image, patch.warp(), half, patch.room(v, "values"));
        },
        nb::arg("image"), named("warp"), nb::arg("half"), named("values"));
    module.def(
        "sample_gradient",
        [](Flat image, nb::handle warp, Index half, nb::handle values, nb::handle dx_of, nb::handle dy_of) {
            const PatchArgument patch(image, warp, half);
            const Output<float, 1> v(values, "values", {ANY}), x(dx_of, "dx_of", {ANY}), y(dy_of, "dy_of", {ANY});
            sample_gradient(*patch.image, patch.warp(), half, patch.room(v, "values"), patch.room(x, "dx_of"),
                            patch.room(y, "dy_of"));
        },
        nb::arg("image"), named("warp"), nb::arg("half"), named("values"), named("dx_of"), named("dy_of"));
    module.def(
        "sample_whole_pixels",
        [](Flat image, nb::handle warp, Index half, nb::handle values, nb::handle dx_of, nb::handle dy_of) {
            const PatchArgument patch(image, warp, half);
            const Output<float, 1> v(values, "values", {ANY}), x(dx_of, "dx_of", {ANY}), y(dy_of, "dy_of", {ANY});
            const Index column = Index(std::floor(patch.warp()[0])), row = Index(std::floor(patch.warp()[1]));
            const double upright[6] = {double(column), double(row), 1.0, 0.0, 0.0, 1.0};
            expect(std::equal(upright, upright + 6, patch.warp()), "warp", "an upright patch around a whole pixel");
            sample_whole_pixels(*patch.image, column, row, half, patch.room(v, "values"), patch.room(x, "dx_of"),
                                patch.room(y, "dy_of"));
        },
        nb::arg("image"), named("warp"), nb::arg("half"), named("values"), named("dx_of"), named("dy_of"));
}

void bind_matching(nb::module_ &module) {
    module.def(
        "match_patches",
        [](Flat template_image, Flat search, nb::handle at, nb::handle found, nb::handle ended, RuleOf rule,
           NoiseOf noise) {
            const ImageArgument t(template_image, "template"), s(search, "search");
            const Input<double, 2> a(at, "at", {ANY, 2});
            const Output<double, 2> f(found, "found", {a.length(0), found::N_COLUMNS});
            const Output<Index, 1> e(ended, "ended", {a.length(0)});
            const Rule of = rule_of(rule);
            const NoiseArgument n(noise);
            unlocked([&] { match_patches({*t, *s}, *a, *f, *e, of, *n); });
        },
        nb::arg("template"), nb::arg("search"), named("at"), named("found"), named("ended"), nb::arg("rule"),
        nb::arg("noise"));
    module.def(
        "cut_keys",
        [](Flat image, nb::handle centres, Index half, nb::handle keys, nb::handle inside) {
            const ImageArgument i(image, "image");
            const Input<Index, 2> c(centres, "centres", {ANY, 2});
            check_half(half, "half");
            const Output<float, 2> k(keys, "keys", {c.length(0), key_side(half) * key_side(half)});
            const Output<bool, 1> in(inside, "inside", {c.length(0)});
            unlocked([&] { cut_keys(*i, *c, half, *k, *in); });
        },
        nb::arg("image"), named("centres"), nb::arg("half"), named("keys"), named("inside"));
    module.def(
        "match_keys",
        [](nb::handle keys, nb::handle which, Flat search, nb::handle found, nb::handle ended, RuleOf rule,
           NoiseOf noise) {
            const Rule of = rule_of(rule);
            const Input<float, 2> k(keys, "keys", {ANY, key_side(of.half) * key_side(of.half)});
            const Input<Index, 1> w(which, "which", {ANY});
            const ImageArgument s(search, "search");
            const Output<double, 2> f(found, "found", {w.length(0), found::N_COLUMNS});
            const Output<Index, 1> e(ended, "ended", {w.length(0)});
            const NoiseArgument n(noise);
            within((*w).data, w.length(0), "which", 0, k.length(0));
            unlocked([&] { match_keys(*k, *w, *s, *f, *e, of, *n); });
        },
        named("keys"), named("which"), nb::arg("search"), named("found"), named("ended"), nb::arg("rule"),
        nb::arg("noise"));
    module.def(
        "bending_shifts",
        [](nb::handle offsets, nb::handle rows, nb::handle affine, nb::handle known, Index half, nb::handle shifts) {
            const Input<Index, 2> r(rows, "rows", {ANY, ANY});
            const Input<double, 3> o(offsets, "offsets", {r.length(0), r.length(1), 2});
            const Input<double, 3> a(affine, "affine", {r.length(0), 2, 2});
            const Input<bool, 1> k(known, "known", {r.length(0)});
            const Output<double, 2> out(shifts, "shifts", {r.length(0), 2});
            within((*r).data, (*r).size(), "rows", -1, r.length(0));
            unlocked([&] { bending_shifts({*o, *r, *a, *k}, half, *out); });
        },
        named("offsets"), named("rows"), named("affine"), named("known"), nb::arg("half"), named("shifts"));
}

// The heap of attempts and the cells that they lead to.
class GrowthArguments {
  public:
    GrowthArguments(std::tuple<Index, Index, Index> grid, nb::handle found, nb::handle ended, nb::handle seeds,
                    nb::handle keys, nb::handle items, nb::handle count)
        : ended_(ended, "ended", {ANY}), found_(found, "found", {n_cells(), found::N_COLUMNS}),
          seeds_(seeds, "seeds", {n_cells()}), keys_(keys, "keys", {ANY}), items_(items, "items", {keys_.length(0)}),
          count_(count, "count", {1}), grid_{std::get<0>(grid), std::get<1>(grid), std::get<2>(grid)} {
        const auto [n_columns, n_rows, pixels] = grid_;
        expect(n_columns > 0 && n_rows > 0 && n_cells() % n_columns == 0 && n_cells() / n_columns == n_rows &&
                   std::abs(pixels) < 1000000,
               "grid", "columns times rows cells");
        within((*count_).data, 1, "count", 0, keys_.length(0) + 1);
        within((*items_).data, (*count_)[0], "items", 0, 4 * n_cells());
    }

    Index n_cells() const { return ended_.length(0); }
    const Grid &grid() const { return grid_; }
    Cells cells() const { return {*found_, *ended_, *seeds_}; }
    Heap heap() const { return {*keys_, *items_, (*count_)[0]}; }

  private:
    Output<Index, 1> ended_;
    Output<double, 2> found_;
    Input<Index, 1> seeds_;
    Output<double, 1> keys_;
    Output<Index, 1> items_, count_;
    Grid grid_;
};

void bind_growth(nb::module_ &module) {
    module.def(
        "stretch",
        [](nb::handle found) {
            const Input<double, 1> f(found, "found", {ANY});
            expect(f.length(0) >= 6, "found", "a position and an affine matrix");
            return stretch((*f).data);
        },
        named("found"));
    module.def(
        "push_all",
        [](nb::handle keys, nb::handle items, nb::handle count, std::tuple<Index, Index, Index> grid, nb::handle found,
           nb::handle ended, nb::handle seeds) {
            const GrowthArguments of(grid, found, ended, seeds, keys, items, count);
            unlocked([&] { push_all(of.heap(), of.grid(), of.cells()); });
        },
        named("keys"), named("items"), named("count"), nb::arg("grid"), named("found"), named("ended"), named("seeds"));
    module.def(
        "grow",
        [](Flat template_image, Flat search, std::tuple<Index, Index, Index> grid, nb::handle found, nb::handle ended,
           nb::handle seeds, nb::handle tries, nb::handle keys, nb::handle items, nb::handle count, RuleOf usual,
           RuleOf larger, NoiseOf noise, std::tuple<double, double, double, double> limits, Index budget,
           Index most_tries) {
            const ImageArgument t(template_image, "template"), s(search, "search");
            const GrowthArguments of(grid, found, ended, seeds, keys, items, count);
            const Output<Index, 1> tried(tries, "tries", {of.n_cells()});
            const NoiseArgument n(noise);
            const auto [sigma0, deviation, correlation, most] = limits;
            const Judging judging{rule_of(usual), rule_of(larger), *n, {sigma0, deviation, correlation, most}};
            return unlocked([&] {
                return grow({*t, *s}, of.grid(), of.cells(), *tried, of.heap(), judging, budget, most_tries);
            });
        },
        nb::arg("template"), nb::arg("search"), nb::arg("grid"), named("found"), named("ended"), named("seeds"),
        named("tries"), named("keys"), named("items"), named("count"), nb::arg("usual"), nb::arg("larger"),
        nb::arg("noise"), nb::arg("limits"), nb::arg("budget"), nb::arg("most_tries"));
}

}  // namespace

}  // namespace patches

void bind_patches(nb::module_ &module) {
    patches::bind_splines(module);
    patches::bind_matching(module);
    patches::bind_growth(module);
}

}  // namespace bodytrack
