#include <nanobind/stl/tuple.h>

#include <algorithm>
#include <stdexcept>
#include <tuple>

#include "body/arguments.hpp"
#include "contours/arguments.hpp"
#include "descent/descent.hpp"
#include "regions/arguments.hpp"

namespace bodytrack {

namespace descent {

namespace {

double number(const nb::tuple &given, int i, int n, const char *name) { return nb::cast<double>(entry(given, i, n, name)); }

nb::tuple inner(const nb::tuple &given, int i, int n, const char *name) {
    return nb::cast<nb::tuple>(entry(given, i, n, name));
}

Counted counted_of(const nb::tuple &given, int n, const char *name) {
    return {number(given, 0, n, name), number(given, 1, n, name)};
}

// A named tuple `tracker.kernels.descent.Model`.
class ModelArguments {
  public:
    explicit ModelArguments(const nb::tuple &given)
        : chain_(given_chain(given, 0), given_chain(given, 1), given_chain(given, 2), given_chain(given, 3)),
          parts_(entry(given, 1, 5, "model"), "model.model_from_parts", {ANY, 4, 4}),
          ends_(entry(given, 2, 5, "model"), "model.part_parameters", {n_parts()}),
          moves_(entry(given, 3, 5, "model"), "model.moves", {dof(), dof() + 1}),
          limits_(entry(given, 4, 5, "model"), "model.limits", {dof(), 2}) {
        within((*ends_).data, n_parts(), "model.part_parameters", -1, dof());
    }

    Index dof() const { return chain_.dof(); }
    Index n_parts() const { return parts_.length(0); }
    Model model() const { return {chain_.chain(), *parts_, *ends_, *moves_, *limits_}; }

  private:
    static nb::handle given_chain(const nb::tuple &given, int i) {
        return entry(inner(given, 0, 5, "model"), i, 4, "model.chain");
    }

    body::ChainArguments chain_;
    Input<double, 3> parts_;
    Input<Index, 1> ends_;
    Input<bool, 2> moves_;
    Input<double, 2> limits_;
};

// A named tuple `Stage`; the person has n_own parts.
class StageArguments {
  public:
    StageArguments(const nb::tuple &given, Index n_own)
        : body_(at(given, 2), at(given, 3), at(given, 4), nb::cast<std::pair<Index, Index>>(at(given, 5)), at(given, 6)),
          rig_(at(given, 7), at(given, 8)), placements_(at(given, 0), "stage.placements", {n_parts(), 4, 4}),
          first_part_(nb::cast<Index>(at(given, 1))), spacing_(nb::cast<contours::Pair>(at(given, 9))),
          hidden_(at(given, 10), "stage.hidden", {n_views(), n_parts()}) {
        within(&first_part_, 1, "stage.first_part", 0, n_parts() - n_own + 1);
    }

    Index n_parts() const { return body_.n_parts(); }
    Index n_views() const { return rig_.n_views(); }
    Stage stage() const {
        return {*placements_, first_part_, body_.grids(), body_.parts(), rig_.views(), {spacing_.first, spacing_.second},
                *hidden_};
    }

  private:
    static nb::handle at(const nb::tuple &given, int i) { return entry(given, i, 11, "stage"); }

    contours::BodyArguments body_;
    contours::ViewArguments rig_;
    Input<double, 3> placements_;
    Index first_part_;
    contours::Pair spacing_;
    Input<bool, 2> hidden_;
};

// Named tuples `Edges`, `Colours` and `Places`.
class EdgesArguments {
  public:
    EdgesArguments(const nb::tuple &given, Index n_views)
        : scene_(at(given, 2), "edges.scene", {ANY, rows::scene_point::N_COLUMNS}),
          first_(at(given, 3), "edges.first", {n_views + 1}), counted_(counted_of(given, 6, "edges")),
          cosine_(number(given, 4, 6, "edges")), px_(number(given, 5, 6, "edges")) {
        rising(*first_, "edges.first", scene_.length(0));
    }

    Edges edges() const { return {counted_, *scene_, *first_, cosine_, px_}; }

  private:
    static nb::handle at(const nb::tuple &given, int i) { return entry(given, i, 6, "edges"); }

    Input<float, 2> scene_;
    Input<Index, 1> first_;
    Counted counted_;
    double cosine_, px_;
};

class ColoursArguments {
  public:
    ColoursArguments(const nb::tuple &given, const StageArguments &stage)
        : lines_(inner(given, 2, 5, "colours")), bounds_(entry(given, 3, 5, "colours"), "colours.bounds", {3, stage.n_parts()}),
          counted_(counted_of(given, 5, "colours")), px_(number(given, 4, 5, "colours")) {
        if (lines_.n_views() != stage.n_views() || lines_.n_parts() != stage.n_parts())
            throw nb::value_error("colours.lines: expected as many views and parts as stage has");
    }

    Colours colours(const contours::Parts &parts) const {
        return {counted_, lines_.lines(), {parts.shapes, *bounds_}, px_};
    }

  private:
    regions::LinesArguments lines_;
    Input<double, 2> bounds_;
    Counted counted_;
    double px_;
};

class PlacesArguments {
  public:
    PlacesArguments(const nb::tuple &given, const StageArguments &stage)
        : carried_(inner(given, 2, 7, "places"), stage.n_views(), stage.n_parts()),
          shares_(entry(given, 3, 7, "places"), "places.shares", {carried_.size()}),
          counted_(counted_of(given, 7, "places")), slide_m_(number(given, 4, 7, "places")),
          reach_px_(number(given, 5, 7, "places")), least_facing_(number(given, 6, 7, "places")) {}

    Places places() const { return {counted_, carried_.carried(), *shares_, slide_m_, reach_px_, least_facing_}; }

  private:
    body::CarriedArguments carried_;
    Input<double, 1> shares_;
    Counted counted_;
    double slide_m_, reach_px_, least_facing_;
};

// A named tuple `Rule`.
class RuleArguments {
  public:
    RuleArguments(const nb::tuple &given, Index dof)
        : start_(entry(given, 0, 6, "rule"), "rule.start", {dof}), prior_(entry(given, 1, 6, "rule"), "rule.prior", {dof}),
          usual_(entry(given, 2, 6, "rule"), "rule.usual", {dof}),
          spreads_(entry(given, 3, 6, "rule"), "rule.inverse_spreads2", {dof}), rare_px_(number(given, 4, 6, "rule")),
          resting_(entry(given, 5, 6, "rule"), "rule.resting", {dof}) {}

    Rule rule() const { return {*start_, *prior_, *usual_, *spreads_, rare_px_, *resting_}; }

  private:
    Input<double, 1> start_, prior_, usual_, spreads_;
    double rare_px_;
    Input<double, 1> resting_;
};

// Of the tuple of kinds: three that are compiled, the largest silent weight, what each of those counts that are asked, and
// a function of the gate that answers for all of these.
constexpr int N_KINDS = 6;

Others others_of(const nb::tuple &kinds, Index dof) {
    Others others;
    for (const nb::handle one : inner(kinds, 4, N_KINDS, "kinds")) {
        const auto counted = nb::cast<nb::tuple>(one);
        others.counted.push_back(counted_of(counted, 3, "kinds.asked"));
        others.counted.back().apart = nb::cast<bool>(entry(counted, 2, 3, "kinds.asked"));
    }
    const nb::handle ask = entry(kinds, 5, N_KINDS, "kinds");
    others.ask = [ask, dof](double gate_px, const std::vector<Answer> &answers) {
        const nb::gil_scoped_acquire locked;
        const auto given = nb::cast<nb::tuple>(ask(gate_px));
        for (std::size_t k = 0; k < answers.size(); k++) {
            const nb::tuple said = inner(given, int(k), int(answers.size()), "answers");
            const Input<double, 2> matrix(entry(said, 0, 4, "answer"), "answer.matrix", {dof, dof});
            const Input<double, 1> vector(entry(said, 1, 4, "answer"), "answer.vector", {dof});
            std::copy_n((*matrix).data, dof * dof, answers[k].matrix.data);
            std::copy_n((*vector).data, dof, answers[k].vector.data);
            *answers[k].sums = {number(said, 2, 4, "answer"), number(said, 3, 4, "answer")};
        }
    };
    return others;
}

// Takes one of the kinds if it is not None.
template <class Arguments, class... More>
void take(std::optional<Arguments> &arguments, const nb::tuple &kinds, int i, const More &...more) {
    const nb::handle given = entry(kinds, i, N_KINDS, "kinds");
    if (!given.is_none()) arguments.emplace(nb::cast<nb::tuple>(given), more...);
}

}  // namespace

}  // namespace descent

void bind_descent(nb::module_ &module) {
    using namespace descent;
    module.def(
        "descend",
        [](const nb::tuple &model, const nb::tuple &stage, const nb::tuple &kinds, const nb::tuple &rule, nb::handle gates,
           nb::handle q, nb::handle matrix, nb::handle vector) {
            const ModelArguments m(model);
            const StageArguments s(stage, m.n_parts());
            std::optional<EdgesArguments> edges;
            std::optional<ColoursArguments> colours;
            std::optional<PlacesArguments> places;
            take(edges, kinds, 0, s.n_views());
            take(colours, kinds, 1, s);
            take(places, kinds, 2, s);
            const RuleArguments r(rule, m.dof());
            const Input<double, 1> g(gates, "gates", {ANY});
            const Output<double, 1> at(q, "q", {m.dof()});
            const Output<double, 2> a(matrix, "matrix", {m.dof(), m.dof()});
            const Output<double, 1> v(vector, "vector", {m.dof()});
            const Stage in = s.stage();
            Kinds asked;
            asked.most_silent = number(kinds, 3, N_KINDS, "kinds");
            asked.others = others_of(kinds, m.dof());
            if (edges) asked.edges = edges->edges();
            if (colours) asked.colours = colours->colours(in.parts);
            if (places) asked.places = places->places();
            try {
                const Reached reached = unlocked([&] { return descend(m.model(), in, asked, r.rule(), *g, *at, *a, *v); });
                return std::tuple(reached.squares, reached.total, reached.n_steps);
            } catch (const std::domain_error &) {
                return std::tuple(0.0, 0.0, Index(-1));
            }
        },
        nb::arg("model"), nb::arg("stage"), nb::arg("kinds"), nb::arg("rule"), named("gates"), named("q"), named("matrix"),
        named("vector"));
}

}  // namespace bodytrack
