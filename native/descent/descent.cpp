#include "descent/descent.hpp"

#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

#include "descent/step.hpp"
#include "regions/sides.hpp"

namespace bodytrack::descent {

namespace {

using namespace rows;

// A kind of evidence that leaves half of exact_px over counts this power of two more; `_SHARPNESS` of
// tracker/evidence/together.py.
constexpr double SHARPNESS = 4.0;

// Samples that a view is likely to have room for, of each part; there is more where that is not enough.
constexpr Index PER_PART = 64;

// Numbers that arrays of any shape lie in.
template <class T>
class Room {
  public:
    template <int N>
    Array<T, N> array(const Index (&shape)[N]) {
        Array<T, N> laid;
        std::copy_n(shape, N, laid.shape);
        if (laid.size() > size_) numbers_ = std::make_unique<T[]>(std::size_t(size_ = laid.size()));
        laid.data = numbers_.get();
        return laid;
    }

  private:
    std::unique_ptr<T[]> numbers_;
    Index size_ = 0;
};

// The equations of one kind, and what it counts.
struct Said {
    Said(Index dof, const Counted &counted) : numbers(std::size_t(dof * (dof + 1))), counted(counted), dof(dof) {}

    Array<double, 2> matrix() { return {numbers.data(), {dof, dof}}; }
    Array<double, 1> vector() { return {numbers.data() + dof * dof, {dof}}; }

    // Its weight, raised where it leaves little over.
    double raised() const {
        if (!(sums.squares > 0.0) || !(counted.exact_px > 0.0)) return counted.weight;
        const double rms_px = std::sqrt(sums.squares / sums.total);
        return counted.weight * std::pow(std::max(counted.exact_px / rms_px, 1.0), SHARPNESS);
    }

    std::vector<double> numbers;
    Counted counted;
    Index dof;
    body::Sums sums;
};

// All that one linearization after the other needs.
class Linearizer {
  public:
    Linearizer(const Model &model, const Stage &stage, const Kinds &kinds)
        : model_(model), stage_(stage), kinds_(kinds), n_parts_(stage.parts.size()), n_views_(stage.views.size()),
          room_(PER_PART * n_parts_), ends_(std::size_t(n_parts_), -2), placed_(placements_.array({1, n_parts_, 4, 4})) {
        std::copy_n(stage.placements.data, stage.placements.size(), placed_.data);
        const Index n_own = model.part_parameters.size();
        std::copy_n(model.part_parameters.data, n_own, ends_.begin() + stage.first_part);
        if (kinds.edges) said_.emplace_back(dof(), kinds.edges->counted);
        if (kinds.colours) said_.emplace_back(dof(), kinds.colours->counted);
        if (kinds.places) said_.emplace_back(dof(), kinds.places->counted);
        n_compiled_ = said_.size();
        for (const Counted &counted : kinds.others.counted) said_.emplace_back(dof(), counted);
    }

    Index dof() const { return model_.chain.dof(); }

    // What the kinds say at a pose together: writes J^T W J and J^T W r.
    body::Sums linearize(Array<double, 1> q, double gate_px, Array<double, 2> matrix, Array<double, 1> vector) {
        const body::Motion motion = pose(q);
        draw();
        std::size_t k = 0;
        if (kinds_.edges) compare_edges(*kinds_.edges, motion, gate_px, said_[k++]);
        if (kinds_.colours) compare_colours(*kinds_.colours, motion, gate_px, said_[k++]);
        if (kinds_.places) compare_places(*kinds_.places, motion, gate_px, said_[k++]);
        ask_others(gate_px);
        return sum(matrix, vector);
    }

  private:
    // Puts the person's parts where a pose has them.
    body::Motion pose(Array<double, 1> q) {
        const auto motions = motions_.array({1, dof() + 1, 4, 4});
        const auto twists = twists_.array({1, dof(), 6});
        body::chain_transforms({q.data, {1, dof()}}, model_.chain, motions);
        body::twists_in_world(motions, model_.chain, twists);
        for (Index p = 0; p < model_.part_parameters.size(); p++) {
            const Index end = model_.part_parameters[p];
            const double *moved = motions[0][end < 0 ? dof() : end].data, *part = model_.model_from_parts[p].data;
            double *to = placed_[0][stage_.first_part + p].data;
            for (int r = 0; r < 4; r++)
                for (int c = 0; c < 4; c++) {
                    to[4 * r + c] = 0.0;
                    for (int k = 0; k < 4; k++) to[4 * r + c] += moved[4 * r + k] * part[4 * k + c];
                }
        }
        return {{ends_.data(), {n_parts_}}, twists[0], model_.moves};
    }

    // Traces the contours; what is hidden in a view has none that count.
    void draw() {
        while (trace() == room_) room_ *= 2;
        for (Index v = 0; v < n_views_; v++)
            for (Index m = 0; m < traced_.counts(0, v); m++)
                if (stage_.hidden(v, traced_.parts(0, v, m))) traced_.positions(0, v, m, sample::LENGTH) = 0.0f;
    }

    Index trace() {
        traced_ = {positions_.array({1, n_views_, room_, 5}), points_.array({1, n_views_, room_, 3}),
                   parts_.array({1, n_views_, room_}), between_.array({1, n_views_, room_}),
                   counts_.array({1, n_views_})};
        return contours::trace_contours(placed_, stage_.grids, stage_.parts, stage_.views, stage_.spacing, true, traced_);
    }

    void compare_edges(const Edges &edges, const body::Motion &motion, double gate_px, Said &said) {
        const Index most = n_views_ * room_ + edges.scene.shape[0];
        auto pairs = pairs_.array({most, 4});
        pairs.shape[0] = contours::match_oriented(traced_.positions[0], traced_.counts[0], edges.scene, edges.first,
                                                  {gate_px, edges.cosine}, pairs);
        said.sums = contours::normal_equations({pairs, traced_.positions[0], traced_.points[0], traced_.parts[0],
                                                edges.scene, stage_.views.cameras},
                                               motion, edges.px_per_observation, 0.5 * gate_px, said.matrix(),
                                               said.vector());
    }

    void compare_colours(const Colours &colours, const body::Motion &motion, double gate_px, Said &said) {
        const regions::Samples samples{traced_.positions[0], traced_.points[0], traced_.parts[0], traced_.counts[0]};
        const auto beside = beside_.array({n_views_, room_, 2});
        const auto shifts = shifts_.array({n_views_, room_, 3});
        regions::Lines lines = colours.lines;
        lines.rule.gate_px = gate_px;
        regions::parts_beside(placed_[0], colours.parts, stage_.views.cameras, samples, lines.rule.step_m, beside);
        regions::find_shifts(lines, samples, beside, stage_.views.cameras, shifts);
        said.sums = regions::shift_equations(shifts, samples, motion, stage_.views.cameras, colours.px_per_observation,
                                             said.matrix(), said.vector());
    }

    void compare_places(const Places &places, const body::Motion &motion, double gate_px, Said &said) {
        namespace at = rows::carried_place;
        const Index n = places.carried.size();
        const auto found = found_.array({n, at::N_COLUMNS});
        const auto weights = weights_.array({n});
        body::residuals_of(placed_[0], stage_.views.cameras, places.carried, places.slide_m, found);
        const double reach = std::min(0.5 * gate_px, places.reach_px);
        for (Index i = 0; i < n; i++) {
            const double *row = found[i].data, variance = row[at::VARIANCE];
            const double square = row[at::U] * row[at::U] + row[at::W] * row[at::W];
            const double fallen = 1.0 + square / (reach * reach + 9.0 * variance);
            weights[i] = row[at::FACING] > places.least_facing ? places.shares[i] / (fallen * fallen * variance) : 0.0;
        }
        said.sums = body::anchor_equations(placed_[0], places.carried, found, weights, motion, said.matrix(), said.vector());
    }

    void ask_others(double gate_px) {
        std::vector<Answer> answers;
        for (std::size_t k = n_compiled_; k < said_.size(); k++)
            answers.push_back({said_[k].matrix(), said_[k].vector(), &said_[k].sums});
        if (!answers.empty()) kinds_.others.ask(gate_px, answers);
    }

    // The sum of what was said, times the weights; the largest weight stays what it is.
    body::Sums sum(Array<double, 2> matrix, Array<double, 1> vector) const {
        double most = kinds_.most_silent, most_raised = most;
        for (const Said &said : said_) {
            if (said.counted.apart) continue;
            most = std::max(most, said.counted.weight);
            most_raised = std::max(most_raised, said.raised());
        }
        std::fill_n(matrix.data, matrix.size(), 0.0);
        std::fill_n(vector.data, vector.size(), 0.0);
        body::Sums sums;
        for (const Said &said : said_) {
            const double weight = said.counted.apart ? said.counted.weight : said.raised() * most / most_raised;
            const double *numbers = said.numbers.data();
            for (Index i = 0; i < matrix.size(); i++) matrix.data[i] += weight * numbers[i];
            for (Index i = 0; i < dof(); i++) vector[i] += weight * numbers[matrix.size() + i];
            sums.squares += weight * said.sums.squares;
            sums.total += weight * said.sums.total;
        }
        return sums;
    }

    const Model &model_;
    const Stage &stage_;
    const Kinds &kinds_;
    Index n_parts_, n_views_, room_;
    std::vector<Index> ends_;
    // those that are compiled, then the others
    std::vector<Said> said_;
    std::size_t n_compiled_ = 0;
    Room<double> placements_, motions_, twists_, found_, weights_;
    Room<float> positions_, points_, shifts_;
    Room<Index> parts_, counts_, pairs_, beside_;
    Room<bool> between_;
    Array<double, 4> placed_;
    contours::Traced traced_;
};

}  // namespace

Reached descend(const Model &model, const Stage &stage, const Kinds &kinds, const Rule &rule, Array<const double, 1> gates,
                Array<double, 1> q, Array<double, 2> matrix, Array<double, 1> vector) {
    Linearizer linearizer(model, stage, kinds);
    const Index dof = linearizer.dof(), n_gates = gates.size();
    std::vector<double> held(std::size_t(dof * dof)), pull(dof), before(dof);
    Reached reached;
    std::fill_n(matrix.data, matrix.size(), 0.0);
    std::fill_n(vector.data, vector.size(), 0.0);
    for (Index g = 0; g < n_gates;) {
        const body::Sums sums = linearizer.linearize(q, gates[g++], matrix, vector);
        reached = {sums.squares, sums.total, reached.n_steps + 1};
        // so many px more of root mean square are twice that times it in squares
        const double usual_px2 = 2.0 * rule.rare_px * std::sqrt(sums.squares * sums.total);
        for (Index i = 0; i < dof; i++) {
            const double weight = usual_px2 * rule.inverse_spreads2[i];
            matrix(i, i) += weight;
            vector[i] += weight * (q[i] - rule.usual[i]);
            pull[i] = vector[i] + rule.prior[i] * (q[i] - rule.start[i]);
            before[i] = q[i];
        }
        std::copy_n(matrix.data, matrix.size(), held.begin());
        for (Index i = 0; i < dof; i++) held[i * dof + i] += rule.prior[i];
        limited_step(q, held, pull, model.limits);
        bool rests = true;
        for (Index i = 0; i < dof; i++) rests &= std::abs(q[i] - before[i]) < rule.resting[i];
        // at rest with a wide gate: only the narrow one can still move it
        if (rests) g = std::max(g, n_gates - 1);
    }
    return reached;
}

}  // namespace bodytrack::descent
