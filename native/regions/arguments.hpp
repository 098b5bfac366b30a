// Groups of arguments that several kernels share, checked at the border.
#pragma once
#include "contours/arguments.hpp"
#include "regions/lines.hpp"

namespace bodytrack::regions {

// A named tuple `tracker.kernels.regions.Picture`.
class PictureArguments {
  public:
    explicit PictureArguments(const nb::tuple &picture)
        : codes_(entry(picture, 0, 2, "picture"), "picture.codes", {ANY}),
          layout_(entry(picture, 1, 2, "picture"), "picture.layout", {ANY, rows::region::N_COLUMNS}) {
        contours::check_regions(*layout_, "picture.layout", codes_.length(0));
    }

    Index n_views() const { return layout_.length(0); }
    Picture picture() const { return {*codes_, *layout_}; }

  private:
    Input<Code, 1> codes_;
    Input<Index, 2> layout_;
};

// A named tuple `Tables`.
template <class Share>
class TablesArguments {
  public:
    TablesArguments(const nb::tuple &tables, Index n_views)
        : inside_(entry(tables, 0, 3, "tables"), "tables.inside", {n_views, ANY, N_COLOURS}),
          outside_(entry(tables, 1, 3, "tables"), "tables.outside", {n_views, inside_.length(1), N_COLOURS}),
          hiders_(entry(tables, 2, 3, "tables"), "tables.hiders", {n_views, N_COLOURS}) {}

    Index n_views() const { return inside_.length(0); }
    Index n_parts() const { return inside_.length(1); }
    Tables<Share> tables() const { return {*inside_, *outside_, *hiders_}; }

  private:
    Argument<Share, 3> inside_, outside_;
    Argument<Share, 2> hiders_;
};

// A named tuple `Looks`.
class LooksArguments {
  public:
    LooksArguments(const nb::tuple &looks, Index n_views)
        : tables_(nb::cast<nb::tuple>(entry(looks, 0, 4, "looks")), n_views),
          posteriors_(entry(looks, 1, 4, "looks"), "looks.posteriors", {n_views, n_parts(), N_COLOURS}),
          known_(entry(looks, 2, 4, "looks"), "looks.known", {n_views, n_parts()}),
          half_extents_(entry(looks, 3, 4, "looks"), "looks.half_extents", {n_parts()}) {}

    Index n_parts() const { return tables_.n_parts(); }
    Looks looks() const { return {tables_.tables(), *posteriors_, *known_, *half_extents_}; }

  private:
    TablesArguments<const float> tables_;
    Input<Byte, 3> posteriors_;
    Input<bool, 2> known_;
    Input<double, 1> half_extents_;
};

inline Rule rule_of(const nb::tuple &rule) {
    const auto number = [&](int i) { return nb::cast<double>(entry(rule, i, 6, "rule")); };
    const Index reach = nb::cast<Index>(entry(rule, 1, 6, "rule"));
    if (reach < 1 || reach > 10000) throw nb::value_error("rule.reach: expected 1 to 10000 steps");
    return {number(0), reach, number(2), number(3), number(4), number(5)};
}

// Colours seen and known, the parts that count, and how lines are read.
class LinesArguments {
  public:
    LinesArguments(const nb::tuple &picture, const nb::tuple &looks, nb::handle wanted, const nb::tuple &rule)
        : picture_(picture), looks_(looks, picture_.n_views()), wanted_(wanted, "wanted", {looks_.n_parts()}),
          rule_(rule_of(rule)) {}

    // A tuple of those four.
    explicit LinesArguments(const nb::tuple &lines)
        : LinesArguments(nb::cast<nb::tuple>(entry(lines, 0, 4, "lines")),
                         nb::cast<nb::tuple>(entry(lines, 1, 4, "lines")), entry(lines, 2, 4, "lines"),
                         nb::cast<nb::tuple>(entry(lines, 3, 4, "lines"))) {}

    Index n_views() const { return picture_.n_views(); }
    Index n_parts() const { return looks_.n_parts(); }
    Lines lines() const { return {picture_.picture(), looks_.looks(), *wanted_, rule_}; }

  private:
    PictureArguments picture_;
    LooksArguments looks_;
    Input<bool, 1> wanted_;
    Rule rule_;
};

}  // namespace bodytrack::regions
