#include <nanobind/stl/pair.h>
#include <nanobind/stl/tuple.h>

#include <tuple>
#include <utility>

#include "border.hpp"
#include "images/acceptance.hpp"
#include "images/appearance.hpp"
#include "images/changes.hpp"
#include "images/checks.hpp"
#include "images/distance_images.hpp"
#include "images/edge_segments.hpp"
#include "images/light.hpp"
#include "images/modes.hpp"
#include "images/profiles.hpp"
#include "images/relighting.hpp"
#include "images/shadows.hpp"
#include "images/slopes.hpp"

namespace bodytrack {

namespace images {

namespace {

constexpr const char *PIXELS = "pixels inside the picture";
constexpr Index MOST_PLACES = 1 << 15;
constexpr const char *EDGES = "an empty border, and no more edge pixels than there is room for";

using Place = std::pair<Index, Index>;
using Three = std::tuple<Index, Index, Index>;

// Refuses a place x, y in a picture from which a part of so many pixels leads beyond it.
void part_of(Place at, const char *name, Index width, Index height, Index whole_width, Index whole_height) {
    const auto [x, y] = at;
    expect(0 <= x && x <= whole_width - width && 0 <= y && y <= whole_height - height, name,
           "a place from which the part lies inside");
}

void bind_light(nb::module_ &module) {
    module.def(
        "block_ratios",
        [](nb::handle now, nb::handle plate, Index size, Index step, nb::handle ratios) {
            const Input<Byte, 3> n(now, "now", {ANY, ANY, 3});
            const Input<Byte, 3> p(plate, "plate", {n.length(0), n.length(1), 3});
            expect(size > 0, "size", "at least 1");
            expect(step > 0, "step", "at least 1");
            const Output<double, 3> out(ratios, "ratios", {n.length(0) / size, n.length(1) / size, 3});
            unlocked([&] { block_ratios(*n, *p, size, step, *out); });
        },
        named("now"), named("plate"), nb::arg("size"), nb::arg("step"), named("ratios"));
    module.def(
        "smooth_surface",
        [](nb::handle ratios, double least, Index n_steps, Index stride, nb::handle surface) {
            const Input<double, 3> r(ratios, "ratios", {ANY, ANY, 3});
            const Output<double, 3> out(surface, "surface", {r.length(0), r.length(1), 3});
            expect(r.length(0) > 0 && r.length(1) > 0, "ratios", "at least one block");
            expect(stride > 0, "stride", "at least 1");
            unlocked([&] { smooth_surface(*r, least, n_steps, stride, *out); });
        },
        named("ratios"), nb::arg("least"), nb::arg("n_steps"), nb::arg("stride"), named("surface"));
    module.def(
        "connected_blocks",
        [](nb::handle departures, double most, nb::handle reached) {
            const Input<double, 3> d(departures, "departures", {ANY, ANY, 3});
            const Output<bool, 2> out(reached, "reached", {d.length(0), d.length(1)});
            unlocked([&] { connected_blocks(*d, most, *out); });
        },
        named("departures"), nb::arg("most"), named("reached"));
    module.def(
        "relight",
        [](nb::handle picture, nb::handle gains, double size, Three geometry, nb::handle lit) {
            const Input<Byte, 3> p(picture, "picture", {ANY, ANY, 3});
            const Input<float, 3> g(gains, "gains", {ANY, ANY, 3});
            const Output<Byte, 3> out(lit, "lit", {p.length(0), p.length(1), 3});
            expect(g.length(0) > 0 && g.length(1) > 0, "gains", "at least one block");
            expect(size > 0.0, "size", "a positive number");
            unlocked([&] {
                const auto [x, y, spacing] = geometry;
                relight(*p, *g, size, {x, y, spacing}, *out);
            });
        },
        named("picture"), named("gains"), nb::arg("size"), nb::arg("geometry"), named("lit"));
}

void bind_plates(nb::module_ &module) {
    module.def(
        "mark_changes",
        [](nb::handle image, nb::handle plate, Place origin, double level, nb::handle moving) {
            const Output<Byte, 2> out(moving, "moving", {ANY, ANY});
            const Input<Byte, 3> i(image, "image", {out.length(0) + 2, out.length(1) + 2, 3});
            const Input<Byte, 3> p(plate, "plate", {ANY, ANY, 3});
            part_of(origin, "origin", out.length(1), out.length(0), p.length(1), p.length(0));
            expect(level >= 0.0, "level", "at least 0");
            unlocked([&] { mark_changes(*i, *p, origin.first, origin.second, level, *out); });
        },
        named("image"), named("plate"), nb::arg("origin"), nb::arg("level"), named("moving"));
    module.def(
        "median_level",
        [](nb::handle picture) {
            const Input<Byte, 2> p(picture, "picture", {ANY, ANY});
            return unlocked([&] { return median_level(*p); });
        },
        named("picture"));
    module.def(
        "large_regions",
        [](nb::handle labels, Index n_labels, double least, nb::handle mask) {
            const Input<std::int32_t, 2> l(labels, "labels", {ANY, ANY});
            const Output<bool, 2> out(mask, "mask", {l.length(0), l.length(1)});
            expect(n_labels > 0, "n_labels", "at least 1");
            expect(labels_below(*l, n_labels), "labels", "numbers from 0 and below n_labels");
            unlocked([&] { large_regions(*l, n_labels, least, *out); });
        },
        named("labels"), nb::arg("n_labels"), nb::arg("least"), named("mask"));
    module.def(
        "without_shadows",
        [](nb::handle now, nb::handle plate, Place origin, nb::handle moving,
           std::tuple<double, double, double, double, double, double> rule, nb::handle mask) {
            const Input<Byte, 2> m(moving, "moving", {ANY, ANY});
            const Index height = m.length(0) + 2 * MARGIN, width = m.length(1) + 2 * MARGIN;
            const Input<Byte, 3> n(now, "now", {height, width, 3});
            const Input<Byte, 3> p(plate, "plate", {ANY, ANY, 3});
            const Output<Byte, 2> out(mask, "mask", {m.length(0), m.length(1)});
            part_of(origin, "origin", width, height, p.length(1), p.length(0));
            const auto [least, least_smooth, most, chroma, texture, outline_px] = rule;
            const ShadowRule of{least, least_smooth, most, chroma, texture, outline_px};
            unlocked([&] { without_shadows(*n, *p, origin.first, origin.second, *m, of, *out); });
        },
        named("now"), named("plate"), nb::arg("origin"), named("moving"), nb::arg("rule"), named("mask"));
    module.def(
        "dominant_modes",
        [](nb::handle pile, Index reach, nb::handle plate, nb::handle counts, nb::handle rivals) {
            const Input<Byte, 4> p(pile, "pile", {ANY, ANY, ANY, 3});
            const Output<Byte, 3> out(plate, "plate", {p.length(1), p.length(2), 3});
            const Output<Byte, 2> c(counts, "counts", {p.length(1), p.length(2)});
            const Output<Byte, 2> r(rivals, "rivals", {p.length(1), p.length(2)});
            expect(0 < p.length(0) && p.length(0) <= MOST_PICTURES, "pile", "1 to 255 pictures");
            expect(0 <= reach && reach <= 255, "reach", "0 to 255 grey levels");
            unlocked([&] { dominant_modes(*p, reach, *out, *c, *r); });
        },
        named("pile"), nb::arg("reach"), named("plate"), named("counts"), named("rivals"));
}

using Split = std::tuple<Index, double, Index>;

SplitRule split_rule(Split rule) {
    const auto [reach, tolerance, shortest] = rule;
    expect(0 <= reach && reach <= 100, "rule", "a tangent over 0 to 100 pixels");
    expect(shortest > 0, "rule", "segments of at least 1 point");
    return {reach, tolerance, shortest};
}

// The slopes of an image of so many pixels, or of any.
class SlopesArguments {
  public:
    SlopesArguments(nb::handle dx, nb::handle dy, Index height = ANY, Index width = ANY)
        : dx_(dx, "dx", {height, width}), dy_(dy, "dy", {dx_.length(0), dx_.length(1)}) {}

    Slopes slopes() const { return {*dx_, *dy_}; }
    Index height() const { return dx_.length(0); }
    Index width() const { return dx_.length(1); }

  private:
    Input<std::int16_t, 2> dx_, dy_;
};

void bind_edges(nb::module_ &module) {
    module.def(
        "strongest_slopes",
        [](nb::handle image, nb::handle dx, nb::handle dy) {
            const Input<Byte, 3> i(image, "image", {ANY, ANY, 3});
            const Output<std::int16_t, 2> x(dx, "dx", {i.length(0), i.length(1)});
            const Output<std::int16_t, 2> y(dy, "dy", {i.length(0), i.length(1)});
            expect(i.length(0) >= 2 && i.length(1) >= 2, "image", "at least 2 rows and columns");
            unlocked([&] { strongest_slopes(*i, *x, *y); });
        },
        named("image"), named("dx"), named("dy"));
    module.def(
        "link_edges",
        [](nb::handle edges, nb::handle points, nb::handle starts) {
            const Output<Byte, 2> e(edges, "edges", {ANY, ANY});
            const Output<std::int32_t, 2> p(points, "points", {ANY, 2});
            const Output<std::int32_t, 1> s(starts, "starts", {p.length(0) + 1});
            expect(framed(*e, p.length(0)), "edges", EDGES);
            return unlocked([&] { return link_edges(*e, {*p, *s}); });
        },
        named("edges"), named("points"), named("starts"));
    module.def(
        "split_segments",
        [](nb::handle points, nb::handle starts, Index n_chains, Split rule, nb::handle segments) {
            const Output<std::int32_t, 2> p(points, "points", {ANY, 2});
            const Output<std::int32_t, 1> s(starts, "starts", {ANY});
            const Output<std::int32_t, 1> out(segments, "segments", {p.length(0)});
            const SplitRule of = split_rule(rule);
            expect(linked({*p, *s}, n_chains), "starts", "places where chains of neighbouring pixels begin");
            return unlocked([&] { return split_segments({*p, *s}, n_chains, of, *out); });
        },
        named("points"), named("starts"), nb::arg("n_chains"), nb::arg("rule"), named("segments"));
    module.def(
        "edge_profile",
        [](nb::handle points, nb::handle dx, nb::handle dy, nb::handle edges, nb::handle directions) {
            const SlopesArguments s(dx, dy);
            const Input<std::int32_t, 2> p(points, "points", {ANY, 2});
            const Output<float, 2> e(edges, "edges", {p.length(0), 2}), d(directions, "directions", {p.length(0), 2});
            expect(pixels_within(*p, s.width(), s.height()), "points", PIXELS);
            unlocked([&] { edge_profile(*p, s.slopes(), *e, *d); });
        },
        named("points"), named("dx"), named("dy"), named("edges"), named("directions"));
    module.def(
        "trace_segments",
        [](nb::handle edges, nb::handle dx, nb::handle dy, Split rule, nb::handle near, nb::handle positions,
           nb::handle directions, nb::handle segments) {
            const Output<Byte, 2> e(edges, "edges", {ANY, ANY});
            const SlopesArguments s(dx, dy, e.length(0) - 2, e.length(1) - 2);
            const Input<Byte, 2> n(near, "near", {ANY, ANY});
            const Output<float, 2> p(positions, "positions", {ANY, 2});
            const Output<float, 2> d(directions, "directions", {p.length(0), 2});
            const Output<Index, 1> of(segments, "segments", {p.length(0)});
            const bool whole = n.length(0) == s.height() && n.length(1) == s.width();
            expect(whole || (*n).size() == 0, "near", "a picture of the edges' size, or none");
            const SplitRule split = split_rule(rule);
            expect(framed(*e, p.length(0)), "edges", EDGES);
            const auto [n_points, n_segments] =
                unlocked([&] { return trace_segments(*e, s.slopes(), split, *n, {*p, *d, *of}); });
            return std::pair(n_points, n_segments);
        },
        named("edges"), named("dx"), named("dy"), nb::arg("rule"), named("near"), named("positions"),
        named("directions"), named("segments"));
}

void bind_pictures(nb::module_ &module) {
    module.def(
        "marked",
        [](nb::handle points, nb::handle picture, Place origin, nb::handle marks) {
            const Input<float, 2> p(points, "points", {ANY, 2});
            const Input<Byte, 2> of(picture, "picture", {ANY, ANY});
            const Output<bool, 1> out(marks, "marks", {p.length(0)});
            unlocked([&] { marked(*p, *of, origin.first, origin.second, *out); });
        },
        named("points"), named("picture"), nb::arg("origin"), named("marks"));
    module.def(
        "expected_distances",
        [](nb::handle edges, nb::handle directions, nb::handle samples, double bend_px, double most_px,
           nb::handle distances) {
            const Input<float, 2> e(edges, "edges", {ANY, 2});
            const Input<float, 2> d(directions, "directions", {e.length(0), 2});
            const Input<float, 2> s(samples, "samples", {ANY, 4});
            const Output<float, 1> out(distances, "distances", {e.length(0)});
            unlocked([&] { expected_distances(*e, *d, *s, bend_px, most_px, *out); });
        },
        named("edges"), named("directions"), named("samples"), nb::arg("bend_px"), nb::arg("most_px"),
        named("distances"));
    module.def(
        "chamfer_distances",
        [](nb::handle pixels, double reach, nb::handle distance) {
            const Output<float, 2> out(distance, "distance", {ANY, ANY});
            const Input<std::int32_t, 2> p(pixels, "pixels", {ANY, 2});
            expect(reach >= 0.0, "reach", "at least 0 px");
            expect(pixels_within(*p, out.length(1), out.length(0)), "pixels", PIXELS);
            unlocked([&] { chamfer_distances(*p, reach, *out); });
        },
        named("pixels"), nb::arg("reach"), named("distance"));
    module.def(
        "mark_appearance",
        [](nb::handle image, Place corner, Three weights, nb::handle chroma, Three slopes, bool grey, nb::handle looks) {
            const Input<Byte, 3> i(image, "image", {ANY, ANY, 3});
            const Input<Byte, 1> of_chroma(chroma, "chroma", {ANY});
            const Output<Byte, 3> out(looks, "looks", {ANY, ANY, 3});
            part_of(corner, "corner", out.length(1), out.length(0), i.length(1), i.length(0));
            const auto [red, blue, added] = weights;
            expect(of_chroma.length(0) <= MOST_PLACES, "chroma", "at most 32768 places");
            for (const Index cr : {0, 255})
                for (const Index cb : {0, 255}) {
                    const Index place = red * cr + blue * cb + added;
                    within(&place, 1, "weights (place of chroma)", 0, of_chroma.length(0));
                }
            const Index steps[] = {std::get<0>(slopes), std::get<1>(slopes), std::get<2>(slopes)};
            within(steps, 3, "slopes", 0, 256);
            const Appearances told{*of_chroma, red, blue, added, {Byte(steps[0]), Byte(steps[1]), Byte(steps[2])}};
            unlocked([&] { mark_appearance(*i, corner.first, corner.second, told, grey, *out); });
        },
        named("image"), nb::arg("corner"), nb::arg("weights"), named("chroma"), nb::arg("slopes"), nb::arg("grey"),
        named("looks"));
    module.def(
        "count_coloured",
        [](nb::handle image, Index spacing, Index level) {
            const Input<Byte, 3> i(image, "image", {ANY, ANY, 3});
            expect(spacing > 0, "spacing", "at least 1 px");
            return unlocked([&] { return count_coloured(*i, spacing, level); });
        },
        named("image"), nb::arg("spacing"), nb::arg("level"));
}

}  // namespace

}  // namespace images

void bind_images(nb::module_ &module) {
    images::bind_light(module);
    images::bind_plates(module);
    images::bind_edges(module);
    images::bind_pictures(module);
}

}  // namespace bodytrack
