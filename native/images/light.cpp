#include "images/light.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

namespace bodytrack::images {

namespace {

constexpr int N_CHANNELS = 3, N_TERMS = 6;

// Added to the diagonal of normal equations: blocks in one row alone determine no surface.
constexpr double REGULAR = 1e-6;

// Logarithm of the median; of an even number the mean of both. The values are used up: half of them are sorted, by
// selection, which branches less than insertion, for which most of the time went.
double log_median(std::vector<float> &values) {
    const std::size_t n = values.size();
    for (std::size_t i = 0; i <= n / 2; i++) {
        float least = values[i];
        for (std::size_t k = i + 1; k < n; k++) {
            const float other = values[k];
            values[k] = std::max(least, other);
            least = std::min(least, other);
        }
        values[i] = least;
    }
    if (n % 2 == 1) return std::log(values[n / 2]);
    return 0.5 * (std::log(values[n / 2 - 1]) + std::log(values[n / 2]));
}

// Median; of an even number the mean of both. NaN is more than any number: the selection must have an order.
double median(std::vector<double> values) {
    const auto less = [](double a, double b) { return a < b || (std::isnan(b) && !std::isnan(a)); };
    const auto middle = values.begin() + std::ptrdiff_t(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end(), less);
    if (values.size() % 2 == 1) return *middle;
    return 0.5 * (*std::max_element(values.begin(), middle, less) + *middle);
}

// The terms of a quadratic surface.
struct Terms {
    double of[N_TERMS];

    // At a block of n_rows by n_columns, whose centres lie between -1 and 1.
    Terms(Index row, Index column, Index n_rows, Index n_columns) {
        const double x = 2.0 * (double(column) + 0.5) / double(n_columns) - 1.0;
        const double y = 2.0 * (double(row) + 0.5) / double(n_rows) - 1.0;
        const double terms[N_TERMS] = {1.0, x, y, x * x, x * y, y * y};
        std::copy_n(terms, N_TERMS, of);
    }
};

using Factors = double[N_TERMS][N_CHANNELS];

double height_of(const Terms &terms, const Factors &factors, int channel) {
    double height = 0.0;
    for (int k = 0; k < N_TERMS; k++) height += terms.of[k] * factors[k][channel];
    return height;
}

// Normal equations of a weighted surface, by Cholesky: the matrix is positive definite.
void solve(double (&normal)[N_TERMS][N_TERMS], Factors &sides) {
    for (int i = 0; i < N_TERMS; i++) {
        for (int j = 0; j <= i; j++) {
            double rest = normal[i][j];
            for (int k = 0; k < j; k++) rest -= normal[i][k] * normal[j][k];
            normal[i][j] = i == j ? std::sqrt(rest) : rest / normal[j][j];
        }
        for (int c = 0; c < N_CHANNELS; c++) {
            for (int k = 0; k < i; k++) sides[i][c] -= normal[i][k] * sides[k][c];
            sides[i][c] /= normal[i][i];
        }
    }
    for (int i = N_TERMS - 1; i >= 0; i--)
        for (int c = 0; c < N_CHANNELS; c++) {
            for (int k = i + 1; k < N_TERMS; k++) sides[i][c] -= normal[k][i] * sides[k][c];
            sides[i][c] /= normal[i][i];
        }
}

// The factors of the surface from weighted blocks: values (N) of three channels.
void fit(const std::vector<Terms> &terms, const std::vector<const double *> &values, const std::vector<double> &weights,
         Factors &factors) {
    double normal[N_TERMS][N_TERMS] = {};
    for (auto &row : factors) std::fill_n(row, N_CHANNELS, 0.0);
    for (std::size_t n = 0; n < terms.size(); n++)
        for (int i = 0; i < N_TERMS; i++) {
            const double weighted = weights[n] * terms[n].of[i];
            for (int j = 0; j <= i; j++) normal[i][j] += weighted * terms[n].of[j];
            for (int c = 0; c < N_CHANNELS; c++) factors[i][c] += weighted * values[n][c];
        }
    for (int i = 0; i < N_TERMS; i++) normal[i][i] += REGULAR;
    solve(normal, factors);
}

// Largest departure of two blocks in a channel.
double departure(const double *one, const double *other) {
    double most = 0.0;
    for (int c = 0; c < N_CHANNELS; c++) most = std::max(most, std::abs(one[c] - other[c]));
    return most;
}

}  // namespace

void block_ratios(Array<const Byte, 3> now, Array<const Byte, 3> plate, Index size, Index step,
                  Array<double, 3> ratios) {
    std::vector<float> values[N_CHANNELS];
    for (Index row = 0; row < ratios.shape[0]; row++)
        for (Index column = 0; column < ratios.shape[1]; column++) {
            for (auto &channel : values) channel.clear();
            for (Index y = row * size; y < (row + 1) * size; y += step)
                for (Index x = column * size; x < (column + 1) * size; x += step)
                    for (int c = 0; c < N_CHANNELS; c++)
                        values[c].push_back(float((now(y, x, c) + DARK) / (plate(y, x, c) + DARK)));
            for (int c = 0; c < N_CHANNELS; c++) ratios(row, column, c) = log_median(values[c]);
        }
}

void smooth_surface(Array<const double, 3> ratios, double least, Index n_steps, Index stride,
                    Array<double, 3> surface) {
    const Index n_rows = ratios.shape[0], n_columns = ratios.shape[1];
    std::vector<Terms> terms;
    std::vector<const double *> values;
    for (Index row = 0; row < n_rows; row += stride)
        for (Index column = 0; column < n_columns; column += stride) {
            terms.emplace_back(row, column, n_rows, n_columns);
            values.push_back(&ratios(row, column, 0));
        }
    std::vector<double> departures(terms.size()), weights(terms.size());
    Factors factors = {};
    for (int c = 0; c < N_CHANNELS; c++) {
        for (std::size_t n = 0; n < values.size(); n++) departures[n] = values[n][c];
        factors[0][c] = median(departures);
    }
    for (Index step = 0; step < n_steps; step++) {
        for (std::size_t n = 0; n < values.size(); n++) {
            double fitted[N_CHANNELS];
            for (int c = 0; c < N_CHANNELS; c++) fitted[c] = height_of(terms[n], factors, c);
            departures[n] = departure(values[n], fitted);
        }
        const double half = std::max(median(departures), least);
        for (std::size_t n = 0; n < values.size(); n++)
            weights[n] = 1.0 / (1.0 + departures[n] / half * (departures[n] / half));
        fit(terms, values, weights, factors);
    }
    for (Index row = 0; row < n_rows; row++)
        for (Index column = 0; column < n_columns; column++) {
            const Terms here(row, column, n_rows, n_columns);
            for (int c = 0; c < N_CHANNELS; c++) surface(row, column, c) = height_of(here, factors, c);
        }
}

void connected_blocks(Array<const double, 3> departures, double most, Array<bool, 2> reached) {
    const Index n_rows = reached.shape[0], n_columns = reached.shape[1];
    constexpr double SURFACE[N_CHANNELS] = {};
    std::vector<Index> queue;
    queue.reserve(std::size_t(reached.size()));
    for (Index block = 0; block < reached.size(); block++) {
        reached.data[block] = departure(departures.data + N_CHANNELS * block, SURFACE) < most;
        if (reached.data[block]) queue.push_back(block);
    }
    for (std::size_t start = 0; start < queue.size(); start++) {
        const Index row = queue[start] / n_columns, column = queue[start] % n_columns;
        const Index neighbours[4][2] = {{row, column + 1}, {row, column - 1}, {row + 1, column}, {row - 1, column}};
        for (const auto &[y, x] : neighbours) {
            if (y < 0 || y >= n_rows || x < 0 || x >= n_columns || reached(y, x)) continue;
            if (!(departure(&departures(y, x, 0), &departures(row, column, 0)) < most)) continue;
            reached(y, x) = true;
            queue.push_back(y * n_columns + x);
        }
    }
}

}  // namespace bodytrack::images
