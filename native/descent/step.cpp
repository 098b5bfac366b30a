#include "descent/step.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace bodytrack::descent {

namespace {

// What is moved by less did not hit a limit.
constexpr double A_LITTLE = 1e-12;

constexpr int N_TIMES = 3;

// Solves A x = b for the chosen parameters of a matrix (dof, dof), by Cholesky; right (n,) receives x.
void solve(const std::vector<double> &matrix, Index dof, const std::vector<Index> &chosen, std::vector<double> &right) {
    const Index n = Index(chosen.size());
    std::vector<double> factor(std::size_t(n * n));
    for (Index i = 0; i < n; i++)
        for (Index j = 0; j <= i; j++) {
            double rest = matrix[chosen[i] * dof + chosen[j]];
            for (Index k = 0; k < j; k++) rest -= factor[i * n + k] * factor[j * n + k];
            if (i == j && !(rest > 0.0)) throw std::domain_error("the equations of a pose are not positive definite");
            factor[i * n + j] = i == j ? std::sqrt(rest) : rest / factor[j * n + j];
        }
    for (Index i = 0; i < n; i++) {
        for (Index k = 0; k < i; k++) right[i] -= factor[i * n + k] * right[k];
        right[i] /= factor[i * n + i];
    }
    for (Index i = n - 1; i >= 0; i--) {
        for (Index k = i + 1; k < n; k++) right[i] -= factor[k * n + i] * right[k];
        right[i] /= factor[i * n + i];
        if (!std::isfinite(right[i])) throw std::domain_error("the equations of a pose are not finite");
    }
}

}  // namespace

void limited_step(Array<double, 1> q, const std::vector<double> &matrix, const std::vector<double> &vector,
                  Array<const double, 2> limits) {
    const Index dof = q.size();
    std::vector<Index> free, left, held;
    std::vector<double> moved(q.data, q.data + dof), right;
    for (Index i = 0; i < dof; i++) free.push_back(i);
    for (int time = 0; time <= N_TIMES; time++) {
        right.clear();
        for (const Index i : free) {
            double pull = -vector[i];
            for (const Index k : held) pull -= matrix[i * dof + k] * (moved[k] - q[k]);
            right.push_back(pull);
        }
        solve(matrix, dof, free, right);
        left.clear();
        const std::size_t n_held = held.size();
        for (std::size_t n = 0; n < free.size(); n++) {
            const Index i = free[n];
            const double target = q[i] + right[n];
            moved[i] = std::min(std::max(target, limits(i, 0)), limits(i, 1));
            (std::abs(moved[i] - target) <= A_LITTLE ? left : held).push_back(i);
        }
        free.swap(left);
        if (held.size() == n_held || free.empty()) break;
    }
    std::copy(moved.begin(), moved.end(), q.data);
}

}  // namespace bodytrack::descent
