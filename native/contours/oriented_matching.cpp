#include "contours/oriented_matching.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <vector>

#include "projection.hpp"

namespace bodytrack::contours {

namespace {

using namespace rows;

// Width and number of the columns of an image whose last find tells where to look next.
constexpr double COLUMN_PX = 32.0;
constexpr int N_COLUMNS = 64;

// What is farther off than a row that is likely is not looked at; a little more, so that the row itself, or an equal one
// before it, is found as it would be without.
constexpr double A_LITTLE = 1.00001, AND_MORE = 1e-9;

// Rows of x, y, direction x, y and maybe more, sorted by y.
struct Sorted {
    const float *rows;
    int stride;
    Index low, high;

    const float *operator[](Index i) const { return rows + stride * i; }
};

// Last finds in the columns of an image, -1 where none.
struct Likely {
    Index found[N_COLUMNS];

    void clear() { std::fill_n(found, N_COLUMNS, Index(-1)); }
    Index &at(float x) { return found[int(std::min(std::max(x / COLUMN_PX, 0.0), N_COLUMNS - 1.0))]; }
};

// Index of the row nearest to the query (position and direction) whose direction agrees, -1 if there is none. The search
// goes up and down from `start`, the first row that is not above the query, until rows are farther away in y alone than the
// best found.
Index nearest(const Sorted &sorted, Index start, const float *query, const Gate &gate, Index likely) {
    const float x = query[0], y = query[1], nx = query[2], ny = query[3];
    double best = gate.radius * gate.radius;
    Index found = -1;
    const auto agrees = [&](const float *row) { return std::fabs(nx * row[2] + ny * row[3]) >= gate.cosine; };
    if (likely >= 0 && agrees(sorted[likely])) {
        const float dx = sorted[likely][0] - x, dy = sorted[likely][1] - y;
        best = std::min(best, (dx * dx + dy * dy) * A_LITTLE + AND_MORE);
    }
    // whether rows farther on may be nearer
    const auto look = [&](Index i) {
        const float *row = sorted[i], dy = row[1] - y;
        if (dy * dy >= best) return false;
        const float dx = row[0] - x, distance = dx * dx + dy * dy;
        if (distance < best && agrees(row)) {
            best = distance;
            found = i;
        }
        return true;
    };
    for (Index i = start; i < sorted.high && look(i); i++) {}
    for (Index i = start - 1; i >= sorted.low && look(i); i--) {}
    return found;
}

// The matched samples of a view, sorted by y: their first four columns one after the other, and which they are.
void sort_samples(Array<const float, 2> positions, Index n, std::vector<float> &model, std::vector<Index> &samples) {
    samples.clear();
    for (Index m = 0; m < n; m++)
        if (positions(m, sample::LENGTH) > 0.0f) samples.push_back(m);
    std::sort(samples.begin(), samples.end(), [&](Index a, Index b) {
        const float one = positions(a, sample::V), other = positions(b, sample::V);
        return one < other || (one == other && a < b);
    });
    model.clear();
    for (const Index m : samples) model.insert(model.end(), positions[m].data, positions[m].data + 4);
}

// Pairs as they are found, while there is room.
struct Found {
    Array<Index, 2> pairs;
    Index n = 0;

    void add(Index view, Index m, Index s, Index way) {
        if (n == pairs.shape[0]) return;
        Index *pair = pairs[n++].data;
        pair[0] = view;
        pair[1] = m;
        pair[2] = s;
        pair[3] = way;
    }
};

// For each last parameter, the parameters that move what hangs on it.
std::vector<std::vector<Index>> chains_of(Array<const bool, 2> moves) {
    std::vector<std::vector<Index>> chains(moves.shape[1]);
    for (Index j = 0; j < moves.shape[1]; j++)
        for (Index d = 0; d < moves.shape[0]; d++)
            if (moves(d, j)) chains[j].push_back(d);
    return chains;
}

}  // namespace

Index match_oriented(Array<const float, 3> positions, Array<const Index, 1> counts, Array<const float, 2> scene,
                     Array<const Index, 1> first, const Gate &gate, Array<Index, 2> pairs) {
    Found found{pairs};
    std::vector<float> model;
    std::vector<Index> samples;
    Likely likely;
    for (Index v = 0; v < counts.size(); v++) {
        sort_samples(positions[v], counts[v], model, samples);
        const Index n_model = Index(samples.size());
        const Sorted edges{scene.data, int(scene.shape[1]), first[v], first[v + 1]};
        const Sorted drawn{model.data(), 4, 0, n_model};
        likely.clear();
        Index start = edges.low;
        for (Index i = 0; i < n_model; i++) {
            const float *query = drawn[i];
            while (start < edges.high && edges[start][1] < query[1]) start++;
            Index &last = likely.at(query[0]);
            const Index s = nearest(edges, start, query, gate, last);
            if (s < 0) continue;
            last = s;
            found.add(v, samples[i], s, 0);
        }
        likely.clear();
        start = 0;
        for (Index s = edges.low; s < edges.high; s++) {
            const float *query = edges[s];
            while (start < n_model && drawn[start][1] < query[1]) start++;
            Index &last = likely.at(query[0]);
            const Index i = nearest(drawn, start, query, gate, last);
            if (i < 0) continue;
            last = i;
            found.add(v, samples[i], s, 1);
        }
    }
    return found.n;
}

Sums normal_equations(const Paired &paired, const Motion &motion, double px_per_observation, double robust_px,
                      Array<double, 2> matrix, Array<double, 1> vector) {
    const Index dof = motion.twists.shape[0], n_ends = motion.moves.shape[1];
    std::fill_n(matrix.data, matrix.size(), 0.0);
    std::fill_n(vector.data, vector.size(), 0.0);
    const auto chains = chains_of(motion.moves);
    std::vector<double> row(dof);
    Sums sums{0.0, 0.0};
    for (Index i = 0; i < paired.pairs.shape[0]; i++) {
        const Index *pair = paired.pairs[i].data, view = pair[0], m = pair[1];
        Index end = motion.ends[paired.parts(view, m)];
        if (end < -1) continue;
        if (end < 0) end += n_ends;
        const float *place = paired.points[view][m].data, *seen = paired.positions[view][m].data;
        const float *edge = paired.scene[pair[2]].data;
        const double x = place[0], y = place[1], z = place[2], nu = seen[sample::NU], nv = seen[sample::NV];
        const double length = pair[3] == 0 ? seen[sample::LENGTH] : edge[scene_point::WEIGHT];
        const Along along = project_along(paired.cameras[view].data, x, y, z, nu, nv);
        const double residual = (along.u - edge[scene_point::X]) * nu + (along.v - edge[scene_point::Y]) * nv;
        const double ratio = residual / robust_px, fallen = 1.0 + ratio * ratio;
        const double weight = length / px_per_observation / (fallen * fallen);
        const auto &chain = chains[end];
        const Index n = Index(chain.size());
        for (Index k = 0; k < n; k++) {
            const double *t = motion.twists[chain[k]].data;
            row[k] = along.x * (t[0] + t[4] * z - t[5] * y) + along.y * (t[1] + t[5] * x - t[3] * z) +
                     along.z * (t[2] + t[3] * y - t[4] * x);
        }
        for (Index k = 0; k < n; k++) {
            const double weighted = weight * row[k];
            vector[chain[k]] += weighted * residual;
            double *line = matrix[chain[k]].data;
            for (Index j = 0; j <= k; j++) line[chain[j]] += weighted * row[j];
        }
        sums.squares += weight * residual * residual;
        sums.total += weight;
    }
    for (Index a = 0; a < dof; a++)
        for (Index c = 0; c < a; c++) matrix(c, a) = matrix(a, c);
    return sums;
}

}  // namespace bodytrack::contours
