#include "patches/equations.hpp"

#include <cmath>

namespace bodytrack::patches {

namespace {

// Sums run in so many lanes.
constexpr int LANES = 16;

// Sum of n terms, in lanes.
template <class Term>
inline float sum(Index n, Term term) {
    float lanes[LANES] = {};
    Index i = 0;
    for (; i + LANES <= n; i += LANES)
        for (int k = 0; k < LANES; k++) lanes[k] += term(i + k);
    float total = 0.0f;
    for (; i < n; i++) total += term(i);
    for (const float lane : lanes) total += lane;
    return total;
}

}  // namespace

Workspace::Workspace(Index half, Index n_taps) : normal{}, factor{} {
    const std::size_t side = std::size_t(2 * half + 1), n = side * side, padded = side - 1 + std::size_t(n_taps);
    for (auto &column : design) column.resize(n);
    for (auto *patch : {&fixed, &grey, &residual}) patch->resize(n);
    for (auto *wide : {&influences[0], &influences[1], &passed}) wide->resize(padded * (padded + std::size_t(n_taps)));
}

float dot(const float *a, const float *b, Index n) {
    return sum(n, [=](Index i) { return a[i] * b[i]; });
}

Moments moments(const float *values, Index n) {
    const float mean = sum(n, [=](Index i) { return values[i]; }) / float(n);
    const float squares = sum(n, [=](Index i) { return (values[i] - mean) * (values[i] - mean); });
    return {mean, std::sqrt(squares / float(n))};
}

bool factorize(const Matrix &matrix, Matrix &factor) {
    const double least = 1e-6 * matrix[6][6];
    for (int i = 0; i < N_PARAMETERS; i++)
        for (int j = 0; j <= i; j++) {
            double rest = matrix[i][j];
            for (int k = 0; k < j; k++) rest -= factor[i][k] * factor[j][k];
            if (i > j) factor[i][j] = rest / factor[j][j];
            else if (rest > 1e-5 * matrix[i][i] && rest > least) factor[i][i] = std::sqrt(rest);
            else return false;
        }
    return true;
}

void solve(const Matrix &factor, Vector &right) {
    for (int i = 0; i < N_PARAMETERS; i++) {
        for (int k = 0; k < i; k++) right[i] -= factor[i][k] * right[k];
        right[i] /= factor[i][i];
    }
    for (int i = N_PARAMETERS - 1; i >= 0; i--) {
        for (int k = i + 1; k < N_PARAMETERS; k++) right[i] -= factor[k][i] * right[k];
        right[i] /= factor[i][i];
    }
}

void complete_design(Workspace &work, const float *grey, Moments of, double gain, Index half) {
    const Index size = 2 * half + 1;
    const float scale = float(1.0 / double(half)), slope = 1.0f / of.deviation, factor = float(gain);
    float *__restrict column[N_PARAMETERS];
    for (int k = 0; k < N_PARAMETERS; k++) column[k] = work.design[k].data();
    for (Index j = 0; j < size; j++) {
        const float v = float(j - half) * scale;
        for (Index i = 0; i < size; i++) {
            const Index k = j * size + i;
            const float u = float(std::int32_t(i - half)) * scale;
            const float along = column[0][k] * factor, down = column[3][k] * factor;
            column[0][k] = along;
            column[1][k] = along * u;
            column[2][k] = along * v;
            column[3][k] = down;
            column[4][k] = down * u;
            column[5][k] = down * v;
            column[6][k] = 1.0f;
            column[7][k] = (grey[k] - of.mean) * slope;
        }
    }
}

void fill_normal(Workspace &work, Index n, double prior) {
    for (int i = 0; i < N_PARAMETERS; i++)
        for (int j = 0; j <= i; j++)
            work.normal[i][j] = work.normal[j][i] = dot(work.design[i].data(), work.design[j].data(), n);
    for (const int k : AFFINE) work.normal[k][k] += prior;
}

void fill_residuals(Workspace &work, double brightness, double contrast, Index n) {
    const float shift = float(brightness), scale = float(contrast);
    const float *__restrict grey = work.grey.data(), *__restrict fixed = work.fixed.data();
    float *__restrict residual = work.residual.data();
    for (Index i = 0; i < n; i++) residual[i] = shift + scale * grey[i] - fixed[i];
}

}  // namespace bodytrack::patches
