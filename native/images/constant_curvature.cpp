#include "images/constant_curvature.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

namespace bodytrack::images {

namespace {

constexpr double PI = 3.14159265358979323846;

// Pieces of a chain that wait to be looked at; a chain is halved less often.
constexpr int MOST_WAITING = 64;

// Angles of all vectors of up to 2 reach px in x and y, which lead from one point of a chain to another.
class Angles {
  public:
    explicit Angles(Index reach) : middle_(2 * reach), size_(4 * reach + 1), table_(std::size_t(size_ * size_)) {
        for (Index y = 0; y < size_; y++)
            for (Index x = 0; x < size_; x++)
                table_[std::size_t(y * size_ + x)] = std::atan2(double(y - middle_), double(x - middle_));
    }

    double operator()(Index dx, Index dy) const { return table_[std::size_t((dy + middle_) * size_ + dx + middle_)]; }

  private:
    Index middle_, size_;
    std::vector<double> table_;
};

// Unwrapped tangent angle at each point of a chain, over `reach` pixels to both sides.
void tangent_angles(Pixels points, Index first, Index end, Index reach, const Angles &angle_of, float *angles) {
    double turn = 0.0, before = 0.0;
    for (Index i = first; i < end; i++) {
        const Index a = std::max(first, i - reach), b = std::min(end - 1, i + reach);
        const double angle = angle_of(points(b, 0) - points(a, 0), points(b, 1) - points(a, 1));
        if (i > first) {
            const double step = angle + turn - before;
            if (step > PI) turn -= 2.0 * PI;
            else if (step < -PI) turn += 2.0 * PI;
        }
        before = angle + turn;
        angles[i] = float(before);
    }
}

// The point of [low, end) whose angle departs most from the straight line between its ends.
struct Departure {
    double most = 0.0;
    Index where = -1;

    Departure(const float *angles, Index low, Index end) {
        const double slope = double(angles[end - 1] - angles[low]) / double(std::max(end - 1 - low, Index(1)));
        for (Index i = low + 1; i < end - 1; i++) {
            const double departure = std::abs(double(angles[i] - angles[low]) - slope * double(i - low));
            if (departure > most) {
                most = departure;
                where = i;
            }
        }
    }
};

}  // namespace

// Along an arc of constant curvature the tangent angle grows linearly with arc length: each chain's angle is
// approximated by straight pieces (Ramer-Douglas-Peucker), one piece a segment.
Index split_segments(const Chains &chains, Index n_chains, const SplitRule &rule, Array<std::int32_t, 1> segments) {
    const Angles angle_of(rule.reach);
    std::vector<float> angles(std::size_t(chains.points.shape[0]));
    struct {
        Index low, end;
    } waiting[MOST_WAITING];
    Index n_segments = 0;
    for (Index chain = 0; chain < n_chains; chain++) {
        const Index first = chains.starts[chain], end = chains.starts[chain + 1];
        if (end - first < rule.shortest) {
            std::fill(segments.data + first, segments.data + end, -1);
            continue;
        }
        tangent_angles(chains.points, first, end, rule.reach, angle_of, angles.data());
        int depth = 0;
        waiting[depth++] = {first, end};
        while (depth > 0) {
            const auto [low, high] = waiting[--depth];
            const Departure departure(angles.data(), low, high);
            if (departure.most > rule.tolerance && high - low >= 2 * rule.shortest && depth < MOST_WAITING - 2) {
                const Index where = std::min(std::max(departure.where, low + rule.shortest), high - rule.shortest);
                waiting[depth++] = {where, high};
                waiting[depth++] = {low, where};
                continue;
            }
            std::fill(segments.data + low, segments.data + high, std::int32_t(n_segments));
            n_segments++;
        }
    }
    return n_segments;
}

}  // namespace bodytrack::images
