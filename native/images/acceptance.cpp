#include "images/acceptance.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

namespace bodytrack::images {

namespace {

// Edges that lie side by side in their chain share their candidates among the samples.
constexpr Index BLOCK = 32;

// Expected contour samples, one array a column.
struct Samples {
    std::vector<float> x, y, normal_x, normal_y;

    explicit Samples(Array<const float, 2> rows) {
        for (auto *column : {&x, &y, &normal_x, &normal_y}) column->resize(std::size_t(rows.shape[0]));
        for (Index m = 0; m < rows.shape[0]; m++) {
            const std::size_t k = std::size_t(m);
            x[k] = rows(m, 0);
            y[k] = rows(m, 1);
            normal_x[k] = rows(m, 2);
            normal_y[k] = rows(m, 3);
        }
    }
};

// Edges next to each other, one array a column, and the squared distance of each to the nearest sample so far, px^2.
struct Block {
    float x[BLOCK] = {}, y[BLOCK] = {}, gx[BLOCK] = {}, gy[BLOCK] = {}, best[BLOCK] = {};
};

// Lowers the squared distances of edges to those to one sample. A loop over the samples would look for the least of
// them one by one: this one works in vectors; where it is inlined, g++ makes it part of such a loop.
[[gnu::noinline]] void lower(Block &block, float px, float py, float nx, float ny, float penalty) {
    for (Index i = 0; i < BLOCK; i++) {
        const float dx = block.x[i] - px, dy = block.y[i] - py, sine = block.gx[i] * ny - block.gy[i] * nx;
        const float squared = dx * dx + dy * dy + penalty * sine * sine, before = block.best[i];
        block.best[i] = squared < before ? squared : before;
    }
}

// The samples that are nearer than so much, px^2, to the box of the first n edges of a block, in order; their number.
// near (M,) is scratch, chosen (M,) receives their numbers.
Index near_box(const Block &block, Index n, const Samples &samples, float limit, float *__restrict near,
               Index *__restrict chosen) {
    const auto [left, right] = std::minmax_element(block.x, block.x + n);
    const auto [top, bottom] = std::minmax_element(block.y, block.y + n);
    const float centre_x = 0.5f * (*left + *right), centre_y = 0.5f * (*top + *bottom);
    const float half_x = 0.5f * (*right - *left), half_y = 0.5f * (*bottom - *top);
    const Index n_samples = Index(samples.x.size());
    const float *__restrict xs = samples.x.data(), *__restrict ys = samples.y.data();
    for (Index m = 0; m < n_samples; m++) {
        const float dx = std::max(std::abs(xs[m] - centre_x) - half_x, 0.0f);
        const float dy = std::max(std::abs(ys[m] - centre_y) - half_y, 0.0f);
        near[m] = dx * dx + dy * dy;
    }
    Index n_chosen = 0;
    for (Index m = 0; m < n_samples; m++) {
        chosen[n_chosen] = m;
        n_chosen += near[m] < limit;
    }
    return n_chosen;
}

}  // namespace

void marked(Array<const float, 2> points, Array<const Byte, 2> picture, Index x, Index y, Array<bool, 1> marks) {
    const float left = float(x), top = float(y), right = float(x + picture.shape[1]), bottom = float(y + picture.shape[0]);
    for (Index i = 0; i < points.shape[0]; i++) {
        const float column = std::rint(points(i, 0)), row = std::rint(points(i, 1));
        const bool inside = left <= column && column < right && top <= row && row < bottom;
        marks[i] = inside && picture(Index(row) - y, Index(column) - x) != 0;
    }
}

void expected_distances(Array<const float, 2> edges, Array<const float, 2> directions, Array<const float, 2> samples,
                        double bend_px, double most_px, Array<float, 1> distances) {
    const Index n_edges = edges.shape[0];
    const Samples expected(samples);
    std::vector<float> near(expected.x.size());
    std::vector<Index> chosen(expected.x.size());
    const float farthest = float(most_px * most_px), penalty = float(bend_px * bend_px);
    Block block;
    for (Index first = 0; first < n_edges; first += BLOCK) {
        const Index n = std::min(BLOCK, n_edges - first);
        for (Index i = 0; i < n; i++) {
            block.x[i] = edges(first + i, 0);
            block.y[i] = edges(first + i, 1);
            block.gx[i] = directions(first + i, 0);
            block.gy[i] = directions(first + i, 1);
        }
        std::fill_n(block.best, BLOCK, farthest);
        const Index n_chosen = near_box(block, n, expected, farthest, near.data(), chosen.data());
        for (Index c = 0; c < n_chosen; c++) {
            const std::size_t m = std::size_t(chosen[std::size_t(c)]);
            lower(block, expected.x[m], expected.y[m], expected.normal_x[m], expected.normal_y[m], penalty);
        }
        for (Index i = 0; i < n; i++) distances[first + i] = std::sqrt(block.best[i]);
    }
}

}  // namespace bodytrack::images
