#include "patches/growth.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace bodytrack::patches {

namespace {

// Right, down, left, up.
constexpr int N_DIRECTIONS = 4;
constexpr Index RIGHT[N_DIRECTIONS] = {1, 0, -1, 0}, DOWN[N_DIRECTIONS] = {0, 1, 0, -1};

// A full heap takes no more.
void push(const Heap &heap, double key, Index item) {
    Index i = heap.count;
    if (i == heap.keys.size()) return;
    heap.count++;
    for (; i > 0 && heap.keys[(i - 1) / 2] > key; i = (i - 1) / 2) {
        heap.keys[i] = heap.keys[(i - 1) / 2];
        heap.items[i] = heap.items[(i - 1) / 2];
    }
    heap.keys[i] = key;
    heap.items[i] = item;
}

// Takes out the attempt of the least key.
Index pop(const Heap &heap) {
    const Index first = heap.items[0], n = --heap.count, item = heap.items[n];
    const double key = heap.keys[n];
    Index i = 0;
    for (Index child; (child = 2 * i + 1) < n; i = child) {
        if (child + 1 < n && heap.keys[child + 1] < heap.keys[child]) child++;
        if (heap.keys[child] >= key) break;
        heap.keys[i] = heap.keys[child];
        heap.items[i] = heap.items[child];
    }
    heap.keys[i] = key;
    heap.items[i] = item;
    return first;
}

// The cell beside one in a direction; -1 beyond the grid.
Index beside(Index cell, int direction, const Grid &grid) {
    const Index column = cell % grid.n_columns + RIGHT[direction], row = cell / grid.n_columns + DOWN[direction];
    const bool inside = column >= 0 && row >= 0 && column < grid.n_columns && row < grid.n_rows;
    return inside ? row * grid.n_columns + column : -1;
}

// Puts the attempts from a matched cell to its open neighbours on the heap.
void push_neighbours(const Heap &heap, Index cell, const Grid &grid, const Cells &cells) {
    const Index seed = cells.seeds[cell];
    for (int direction = 0; direction < N_DIRECTIONS; direction++) {
        const Index other = beside(cell, direction, grid);
        if (other < 0 || cells.ended[other] == MATCHED || cells.seeds[other] != seed) continue;
        double key = std::max(cells.found(cell, found::VARIANCE_X), cells.found(cell, found::VARIANCE_Y));
        if (seed >= 0) {
            const Index rows = std::abs(other / grid.n_columns - seed / grid.n_columns);
            const Index columns = std::abs(other % grid.n_columns - seed % grid.n_columns);
            key = double(rows * grid.n_columns + columns) + 0.5 * (direction % 2);
        }
        push(heap, key, cell * N_DIRECTIONS + direction);
    }
}

// Whether a match is good enough.
bool accepted(const double *found, const Limits &limits) {
    const double variance = std::max(found[found::VARIANCE_X], found[found::VARIANCE_Y]);
    return found[found::SIGMA0] <= limits.sigma0 && variance <= limits.deviation * limits.deviation &&
           found[found::CORRELATION] >= limits.correlation && stretch(found) <= limits.stretch;
}

struct Step {
    Index x, y;
};

// Matches patches from those of their neighbours.
struct Attempts {
    const Images &images;
    const Judging &judging;
    Workspace work;

    // Matches the patch at a pixel, which is a step from that of the source; the start is the source's patch, carried
    // on by its own affine transformation. Returns how that ended.
    Index operator()(Step pixel, Step step, const double *source, const Rule &rule, double *result) {
        const double at[2] = {double(pixel.x), double(pixel.y)}, dx = double(step.x), dy = double(step.y);
        std::fill_n(result, found::N_COLUMNS, 0.0);
        std::copy_n(source, 6, result);
        result[found::X] += source[found::XX_OF] * dx + source[found::XY_OF] * dy;
        result[found::Y] += source[found::YX_OF] * dx + source[found::YY_OF] * dy;
        const Ended ended = match_patch(images, at, result, rule, judging.noise, work);
        return ended == MATCHED && !accepted(result, judging.limits) ? REJECTED : Index(ended);
    }

    // The same by way of a point half-way, and with the larger patch, where that fails.
    Index repeated(Step pixel, Step step, const double *source, double *result) {
        Index outcome = (*this)(pixel, step, source, judging.usual, result);
        // halves are rounded towards the source, as division goes towards 0
        const Step half{step.x / 2, step.y / 2};
        if (outcome != MATCHED && (half.x != 0 || half.y != 0)) {
            double between[found::N_COLUMNS];
            const Step rest{step.x - half.x, step.y - half.y};
            const Step middle{pixel.x - rest.x, pixel.y - rest.y};
            if ((*this)(middle, half, source, judging.usual, between) == MATCHED)
                outcome = (*this)(pixel, rest, between, judging.usual, result);
        }
        if (outcome != MATCHED && judging.larger.half > judging.usual.half)
            outcome = (*this)(pixel, step, source, judging.larger, result);
        return outcome;
    }
};

}  // namespace

double stretch(const double *found) {
    const double a = found[found::XX_OF], b = found[found::XY_OF], c = found[found::YX_OF], d = found[found::YY_OF];
    const double determinant = a * d - b * c;
    if (!(determinant > 0.0)) return std::numeric_limits<double>::infinity();
    const double squares = a * a + b * b + c * c + d * d;
    const double longest2 =
        0.5 * (squares + std::sqrt(std::max(0.0, squares * squares - 4.0 * determinant * determinant)));
    return std::max(std::sqrt(longest2), std::sqrt(longest2) / determinant);
}

void push_all(const Heap &heap, const Grid &grid, const Cells &cells) {
    for (Index cell = 0; cell < cells.ended.size(); cell++)
        if (cells.ended[cell] == MATCHED) push_neighbours(heap, cell, grid, cells);
}

Index grow(const Images &images, const Grid &grid, const Cells &cells, Array<Index, 1> tries, const Heap &heap,
           const Judging &judging, Index budget, Index most_tries) {
    Attempts attempts{images, judging,
                      Workspace(std::max(judging.usual.half, judging.larger.half), judging.noise.taps.size())};
    double result[found::N_COLUMNS];
    for (Index n = 0; n < budget && heap.count > 0; n++) {
        const Index item = pop(heap), source = item / N_DIRECTIONS;
        const int direction = int(item % N_DIRECTIONS);
        const Index target = beside(source, direction, grid);
        if (target < 0 || cells.ended[target] == MATCHED || cells.ended[source] != MATCHED) continue;
        if (tries[target] >= most_tries) continue;
        tries[target]++;
        const Step pixel{target % grid.n_columns * grid.pixels, target / grid.n_columns * grid.pixels};
        const Step step{RIGHT[direction] * grid.pixels, DOWN[direction] * grid.pixels};
        cells.ended[target] = attempts.repeated(pixel, step, cells.found[source].data, result);
        if (cells.ended[target] != MATCHED) continue;
        std::copy_n(result, found::N_COLUMNS, cells.found[target].data);
        push_neighbours(heap, target, grid, cells);
    }
    return heap.count;
}

}  // namespace bodytrack::patches
