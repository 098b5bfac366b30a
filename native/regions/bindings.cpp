#include "regions/arguments.hpp"
#include "regions/learning.hpp"
#include "regions/scoring.hpp"
#include "regions/shifts.hpp"
#include "regions/sides.hpp"

namespace bodytrack {

namespace regions {

namespace {

void check_samples(const Samples &samples, Index n_parts) {
    within(samples.counts.data, samples.counts.size(), "counts", 0, samples.parts.shape[1] + 1);
    contours::within_counted(samples.parts, samples.counts, "parts", n_parts);
}

// Refuses parts seen beside samples that are none of n_parts, nor the background.
void check_beside(Array<const Index, 3> beside, Array<const Index, 1> counts, Index n_parts) {
    for (Index v = 0; v < counts.size(); v++) within(beside[v].data, 2 * counts[v], "beside", BACKGROUND, n_parts);
}

// Contour samples of one pose.
class SampleArguments {
  public:
    SampleArguments(const nb::tuple &samples, Index n_views, Index n_parts)
        : positions_(entry(samples, 0, 4, "samples"), "samples.positions", {n_views, ANY, 5}),
          points_(entry(samples, 1, 4, "samples"), "samples.points", {n_views, room(), 3}),
          parts_(entry(samples, 2, 4, "samples"), "samples.parts", {n_views, room()}),
          counts_(entry(samples, 3, 4, "samples"), "samples.counts", {n_views}) {
        check_samples(this->samples(), n_parts);
    }

    Index room() const { return positions_.length(1); }
    Samples samples() const { return {*positions_, *points_, *parts_, *counts_}; }

  private:
    Input<float, 3> positions_, points_;
    Input<Index, 2> parts_;
    Input<Index, 1> counts_;
};

// The same of many poses.
class PosedArguments {
  public:
    PosedArguments(nb::handle positions, nb::handle points, nb::handle parts, nb::handle counts, Index n_views,
                   Index n_parts)
        : positions_(positions, "positions", {ANY, n_views, ANY, 5}),
          points_(points, "points", {n_poses(), n_views, room(), 3}), parts_(parts, "parts", {n_poses(), n_views, room()}),
          counts_(counts, "counts", {n_poses(), n_views}) {
        for (Index b = 0; b < n_poses(); b++) check_samples((*this)[b], n_parts);
    }

    Index n_poses() const { return positions_.length(0); }
    Index room() const { return positions_.length(2); }
    Samples operator[](Index b) const { return {(*positions_)[b], (*points_)[b], (*parts_)[b], (*counts_)[b]}; }

  private:
    Input<float, 4> positions_, points_;
    Input<Index, 3> parts_;
    Input<Index, 2> counts_;
};

void bind_colours(nb::module_ &module) {
    module.def(
        "encode",
        [](nb::handle picture, nb::handle codes) {
            const Input<Byte, 3> p(picture, "picture", {ANY, ANY, 3});
            const Index n = p.length(0) * p.length(1);
            const Output<Code, 1> c(codes, "codes", {n});
            unlocked([&] { encode((*p).data, n, (*c).data); });
        },
        named("picture"), named("codes"));
    module.def(
        "learn_colours",
        [](nb::handle counts, double news, nb::handle table) {
            const Input<Index, 1> c(counts, "counts", {N_COLOURS});
            const Output<float, 1> t(table, "table", {N_COLOURS});
            return learn_colours((*c).data, news, (*t).data);
        },
        named("counts"), nb::arg("news"), named("table"));
    module.def(
        "tabulate_posteriors",
        [](const nb::tuple &tables, contours::Pair rule, nb::handle wanted, nb::handle posteriors) {
            const Input<bool, 2> w(wanted, "wanted", {ANY, ANY});
            const TablesArguments<const float> t(tables, w.length(0));
            const Output<Byte, 3> p(posteriors, "posteriors", {w.length(0), w.length(1), N_COLOURS});
            if (t.n_parts() != w.length(1)) throw nb::value_error("tables: expected as many parts as wanted has");
            unlocked([&] { tabulate_posteriors(t.tables(), rule.first, rule.second, *w, *p); });
        },
        nb::arg("tables"), nb::arg("rule"), named("wanted"), named("posteriors"));
}

void bind_lines(nb::module_ &module) {
    module.def(
        "find_shifts",
        [](const nb::tuple &picture, const nb::tuple &looks, const nb::tuple &samples, nb::handle beside,
           nb::handle cameras, nb::handle wanted, const nb::tuple &rule, nb::handle shifts) {
            const LinesArguments l(picture, looks, wanted, rule);
            const SampleArguments s(samples, l.n_views(), l.n_parts());
            const Input<Index, 3> b(beside, "beside", {l.n_views(), s.room(), 2});
            const Input<double, 2> c(cameras, "cameras", {l.n_views(), rows::camera::N_COLUMNS});
            const Output<float, 3> out(shifts, "shifts", {l.n_views(), s.room(), 3});
            check_beside(*b, s.samples().counts, l.n_parts());
            unlocked([&] { find_shifts(l.lines(), s.samples(), *b, *c, *out); });
        },
        nb::arg("picture"), nb::arg("looks"), nb::arg("samples"), named("beside"), named("cameras"), named("wanted"),
        nb::arg("rule"), named("shifts"));
    module.def(
        "shift_equations",
        [](nb::handle shifts, const nb::tuple &samples, nb::handle ends, nb::handle cameras, nb::handle twists,
           nb::handle moves, double px_per_observation, nb::handle matrix, nb::handle vector) {
            const Input<Index, 1> e(ends, "ends", {ANY});
            const Input<double, 2> c(cameras, "cameras", {ANY, rows::camera::N_COLUMNS});
            const SampleArguments s(samples, c.length(0), e.length(0));
            const Input<float, 3> moved(shifts, "shifts", {c.length(0), s.room(), 3});
            const Input<double, 2> t(twists, "twists", {ANY, 6});
            const Index dof = t.length(0);
            const Input<bool, 2> m(moves, "moves", {dof, dof + 1});
            const Output<double, 2> a(matrix, "matrix", {dof, dof});
            const Output<double, 1> v(vector, "vector", {dof});
            within((*e).data, e.length(0), "ends", -2, dof + 1);
            const body::Sums sums = unlocked(
                [&] { return shift_equations(*moved, s.samples(), {*e, *t, *m}, *c, px_per_observation, *a, *v); });
            return std::pair(sums.squares, sums.total);
        },
        named("shifts"), nb::arg("samples"), named("ends"), named("cameras"), named("twists"), named("moves"),
        nb::arg("px_per_observation"), named("matrix"), named("vector"));
    module.def(
        "score_lines",
        [](const nb::tuple &lines, nb::handle positions, nb::handle points, nb::handle parts, nb::handle counts,
           nb::handle beside, nb::handle cameras, nb::handle misfits) {
            const LinesArguments l(lines);
            const PosedArguments s(positions, points, parts, counts, l.n_views(), l.n_parts());
            const Input<Index, 4> of(beside, "beside", {s.n_poses(), l.n_views(), s.room(), 2});
            const Input<double, 2> c(cameras, "cameras", {l.n_views(), rows::camera::N_COLUMNS});
            const Output<double, 4> out(misfits, "misfits", {s.n_poses(), l.n_views(), l.n_parts(), 3});
            for (Index b = 0; b < s.n_poses(); b++) check_beside((*of)[b], s[b].counts, l.n_parts());
            unlocked([&] {
                for (Index b = 0; b < s.n_poses(); b++) score_lines(l.lines(), s[b], (*of)[b], *c, (*out)[b]);
            });
        },
        nb::arg("lines"), named("positions"), named("points"), named("parts"), named("counts"), named("beside"),
        named("cameras"), named("misfits"));
}

void bind_poses(nb::module_ &module) {
    module.def(
        "parts_beside",
        [](nb::handle placements, nb::handle shapes, nb::handle bounds, nb::handle cameras, nb::handle positions,
           nb::handle points, nb::handle parts, nb::handle counts, double step_m, nb::handle found) {
            const Input<double, 2> form(shapes, "shapes", {ANY, rows::superquadric::N_COLUMNS});
            const Index n_parts = form.length(0);
            const Input<double, 2> limits(bounds, "bounds", {3, n_parts});
            const Input<double, 2> c(cameras, "cameras", {ANY, rows::camera::N_COLUMNS});
            const PosedArguments s(positions, points, parts, counts, c.length(0), n_parts);
            const Input<double, 4> placed(placements, "placements", {s.n_poses(), n_parts, 4, 4});
            const Output<Index, 4> out(found, "found", {s.n_poses(), c.length(0), s.room(), 2});
            unlocked([&] {
                for (Index b = 0; b < s.n_poses(); b++)
                    parts_beside((*placed)[b], {*form, *limits}, *c, s[b], step_m, (*out)[b]);
            });
        },
        named("placements"), named("shapes"), named("bounds"), named("cameras"), named("positions"), named("points"),
        named("parts"), named("counts"), nb::arg("step_m"), named("found"));
    module.def(
        "score_regions",
        [](nb::handle placements, nb::handle shapes, nb::handle grids, nb::handle planes, std::pair<Index, Index> layout,
           nb::handle bounds, nb::handle cameras, nb::handle sizes, contours::Pair spacing, const nb::tuple &lines,
           nb::handle misfits) {
            const contours::BodyArguments body(shapes, grids, planes, layout, bounds);
            const contours::ViewArguments rig(cameras, sizes);
            const LinesArguments l(lines);
            if (l.n_views() != rig.n_views() || l.n_parts() != body.n_parts())
                throw nb::value_error("lines: expected as many views as cameras has, and parts as shapes has");
            const Input<double, 4> placed(placements, "placements", {ANY, body.n_parts(), 4, 4});
            const Output<double, 4> out(misfits, "misfits", {placed.length(0), l.n_views(), l.n_parts(), 3});
            unlocked([&] {
                score_regions(*placed, body.grids(), body.parts(), rig.views(), {spacing.first, spacing.second}, l.lines(),
                              *out);
            });
        },
        named("placements"), named("shapes"), named("grids"), named("planes"), nb::arg("layout"), named("bounds"),
        named("cameras"), named("sizes"), nb::arg("spacing"), nb::arg("lines"), named("misfits"));
}

void bind_learning(nb::module_ &module) {
    module.def(
        "learn_lines",
        [](const nb::tuple &picture, const nb::tuple &samples, nb::handle beside, nb::handle cameras,
           nb::handle half_extents, nb::handle useful, double step_m, double news, nb::handle posteriors,
           const nb::tuple &tables, nb::handle changed) {
            const PictureArguments p(picture);
            const TablesArguments<float> t(tables, p.n_views());
            const Index n_views = p.n_views(), n_parts = t.n_parts();
            const SampleArguments s(samples, n_views, n_parts);
            const Input<Index, 3> b(beside, "beside", {n_views, s.room(), 2});
            const Input<double, 2> c(cameras, "cameras", {n_views, rows::camera::N_COLUMNS});
            const Input<double, 1> h(half_extents, "half_extents", {n_parts});
            const Input<bool, 2> u(useful, "useful", {n_views, s.room()});
            const Input<Byte, 3> q(posteriors, "posteriors", {n_views, n_parts, N_COLOURS});
            const Output<bool, 2> out(changed, "changed", {n_views, n_parts});
            const Picture seen = p.picture();
            const Samples drawn = s.samples();
            unlocked([&] { learn_lines({seen, drawn, *u, *b, *c, *h, *q, step_m}, news, t.tables(), *out); });
        },
        nb::arg("picture"), nb::arg("samples"), named("beside"), named("cameras"), named("half_extents"), named("useful"),
        nb::arg("step_m"), nb::arg("news"), named("posteriors"), nb::arg("tables"), named("changed"));
    module.def(
        "longest_lines",
        [](const nb::tuple &samples, nb::handle cameras, double step_m, nb::handle longest_px) {
            const Input<double, 2> c(cameras, "cameras", {ANY, rows::camera::N_COLUMNS});
            const SampleArguments s(samples, c.length(0), std::numeric_limits<Index>::max());
            const Output<double, 1> out(longest_px, "longest_px", {c.length(0)});
            unlocked([&] { longest_lines(s.samples(), *c, step_m, *out); });
        },
        nb::arg("samples"), named("cameras"), nb::arg("step_m"), named("longest_px"));
}

}  // namespace

}  // namespace regions

void bind_regions(nb::module_ &module) {
    regions::bind_colours(module);
    regions::bind_lines(module);
    regions::bind_poses(module);
    regions::bind_learning(module);
}

}  // namespace bodytrack
