#include "images/edge_segments.hpp"

#include <algorithm>
#include <vector>

#include "images/profiles.hpp"

namespace bodytrack::images {

namespace {

// Whether one of some pixels is where edges matter; that is everywhere if nothing tells where.
bool any_near(Pixels points, Index first, Index end, Array<const Byte, 2> near) {
    if (near.size() == 0) return true;
    for (Index i = first; i < end; i++)
        if (near(points(i, 1), points(i, 0)) != 0) return true;
    return false;
}

// Copies the points [first, end) to those from `to` on, which is not behind them.
void move_points(Pixels points, Index first, Index end, Index to) {
    std::copy(points.data + 2 * first, points.data + 2 * end, points.data + 2 * to);
}

// Moves the chains that have a pixel where edges matter to the front; their number.
Index chains_near(const Chains &chains, Index n_chains, Array<const Byte, 2> near) {
    Index n = 0, n_kept = 0;
    for (Index chain = 0; chain < n_chains; chain++) {
        const Index first = chains.starts[chain], end = chains.starts[chain + 1];
        if (!any_near(chains.points, first, end, near)) continue;
        chains.starts[n_kept++] = std::int32_t(n);
        move_points(chains.points, first, end, n);
        n += end - first;
    }
    chains.starts[n_kept] = std::int32_t(n);
    return n_kept;
}

}  // namespace

TracedCounts trace_segments(Array<Byte, 2> edges, const Slopes &slopes, const SplitRule &rule,
                            Array<const Byte, 2> near, const Traced &found) {
    const Index most = found.positions.shape[0];
    std::vector<std::int32_t> pixels(std::size_t(2 * most)), firsts(std::size_t(most + 1)), of(firsts.size());
    const Chains chains{{pixels.data(), {most, 2}}, {firsts.data(), {most + 1}}};
    const Array<std::int32_t, 1> labels{of.data(), {most}};
    const Index n_chains = chains_near(chains, link_edges(edges, chains), near), n_pixels = chains.starts[n_chains];
    split_segments(chains, n_chains, rule, labels);
    TracedCounts counts{0, 0};
    for (Index i = 0, end; i < n_pixels; i = end) {
        end = i + 1;
        while (end < n_pixels && labels[end] == labels[i]) end++;
        if (labels[i] < 0 || !any_near(chains.points, i, end, near)) continue;
        move_points(chains.points, i, end, counts.points);
        std::fill(found.segments.data + counts.points, found.segments.data + counts.points + end - i, counts.segments);
        counts.points += end - i;
        counts.segments++;
    }
    edge_profile({pixels.data(), {counts.points, 2}}, slopes, found.positions, found.directions);
    return counts;
}

}  // namespace bodytrack::images
