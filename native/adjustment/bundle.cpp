#include "adjustment/bundle.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "adjustment/projecting.hpp"

namespace bodytrack::adjustment {

namespace {

using ObjectMatrix = double[N_OBJECT][N_OBJECT];

// A pivot that loses so many digits belongs to unknowns that are not determined.
constexpr double LEAST_PIVOT = 1e-13;

// Inverse of a symmetric positive definite matrix by Cholesky; zero where it is not definite.
void invert(const ObjectMatrix &matrix, Array<double, 2> inverse) {
    ObjectMatrix lower = {};
    std::fill_n(inverse.data, N_OBJECT * N_OBJECT, 0.0);
    for (int i = 0; i < N_OBJECT; i++)
        for (int j = 0; j <= i; j++) {
            double rest = matrix[i][j];
            for (int k = 0; k < j; k++) rest -= lower[i][k] * lower[j][k];
            if (i > j) lower[i][j] = rest / lower[j][j];
            else if (rest > LEAST_PIVOT * matrix[i][i]) lower[i][i] = std::sqrt(rest);
            else return;
        }
    for (int column = 0; column < N_OBJECT; column++) {
        double solution[N_OBJECT] = {};
        for (int i = column; i < N_OBJECT; i++) {
            double rest = i == column ? 1.0 : 0.0;
            for (int k = column; k < i; k++) rest -= lower[i][k] * solution[k];
            solution[i] = rest / lower[i][i];
        }
        for (int i = N_OBJECT - 1; i >= 0; i--) {
            double rest = solution[i];
            for (int k = i + 1; k < N_OBJECT; k++) rest -= lower[k][i] * inverse(k, column);
            inverse(i, column) = rest / lower[i][i];
        }
    }
}

// The equations of one object as they are summed up: its own, and its couplings with the cameras (V, 6, 17) that have
// seen it (V,).
struct OneObject {
    ObjectMatrix own;
    double *side;
    Array<double, 3> couplings;
    std::vector<bool> seen;
};

// Adds one image coordinate to the cameras' equations and to the object's: its slopes by both.
void add(const double (&by_camera)[N_UNKNOWNS], const double (&by_object)[N_OBJECT], double weight, double error,
         Index view, const Reduced &reduced, OneObject &object) {
    const Index first = view * N_UNKNOWNS;
    for (int i = 0; i < N_UNKNOWNS; i++) {
        const double weighted = weight * by_camera[i];
        reduced.side[first + i] += weighted * error;
        double *row = &reduced.normal(first + i, first);
        for (int j = 0; j <= i; j++) row[j] += weighted * by_camera[j];
    }
    for (int i = 0; i < N_OBJECT; i++) {
        const double weighted = weight * by_object[i];
        object.side[i] += weighted * error;
        double *coupling = &object.couplings(view, i, 0);
        for (int j = 0; j < N_UNKNOWNS; j++) coupling[j] += weighted * by_camera[j];
        for (int j = 0; j < N_OBJECT; j++) object.own[i][j] += weighted * by_object[j];
    }
}

// Sums up the observations [first, end) of an object.
void observe(Array<const double, 2> cameras, const Objects &objects, const Observed &observed, Index first, Index end,
             const Reduced &reduced, OneObject &object) {
    PixelSlopes slopes;
    for (Index n = first; n < end; n++) {
        const Index view = observed.views[n], number = observed.points[n];
        const double weight = observed.weights[n];
        if (weight == 0.0) continue;
        const Pixel pixel = project_with_slopes(cameras[view].data, objects.points[number].data,
                                                observed.velocities[n].data, slopes);
        if (!pixel.before) continue;
        object.seen[std::size_t(view)] = true;
        for (int axis = 0; axis < 2; axis++) {
            double by_object[N_OBJECT] = {};
            for (int k = 0; k < 3; k++)
                for (int j = 0; j < N_OBJECT; j++)
                    by_object[j] += slopes.by_point[axis][k] * objects.slopes(number, k, j);
            const double error = observed.pixels(n, axis) - (axis == 0 ? pixel.u : pixel.v);
            add(slopes.by_camera[axis], by_object, weight, error, view, reduced, object);
        }
    }
}

// Subtracts from the cameras' equations what an object's unknowns take up.
void eliminate(Array<const double, 2> inverse, const OneObject &object, const Reduced &reduced) {
    const Index n_views = Index(object.seen.size());
    for (Index view = 0; view < n_views; view++) {
        if (!object.seen[std::size_t(view)]) continue;
        const Index first = view * N_UNKNOWNS;
        double taken[N_OBJECT][N_UNKNOWNS] = {};
        for (int j = 0; j < N_OBJECT; j++) {
            for (int k = 0; k < N_OBJECT; k++) {
                const double *coupling = &object.couplings(view, k, 0), share = inverse(k, j);
                for (int i = 0; i < N_UNKNOWNS; i++) taken[j][i] += coupling[i] * share;
            }
            for (int i = 0; i < N_UNKNOWNS; i++) reduced.side[first + i] -= taken[j][i] * object.side[j];
        }
        for (Index other = 0; other <= view; other++) {
            if (!object.seen[std::size_t(other)]) continue;
            const double *coupling = object.couplings[other].data;
            for (int i = 0; i < N_UNKNOWNS; i++) {
                double *__restrict row = &reduced.normal(first + i, other * N_UNKNOWNS);
                for (int j = 0; j < N_UNKNOWNS; j++) {
                    double sum = 0.0;
                    for (int k = 0; k < N_OBJECT; k++) sum += taken[k][i] * coupling[k * N_UNKNOWNS + j];
                    row[j] -= sum;
                }
            }
        }
    }
}

// Fills the lower triangle's twin and damps; a share of what elimination left keeps the matrix definite.
void damp(Array<double, 2> normal, double damping) {
    for (Index i = 0; i < normal.shape[0]; i++) {
        normal(i, i) += damping * normal(i, i);
        for (Index j = 0; j < i; j++) normal(j, i) = normal(i, j);
    }
}

}  // namespace

void residuals_of(Array<const double, 2> cameras, Array<const double, 2> points, const Observed &observed,
                  Array<double, 2> residuals) {
    constexpr double NOWHERE = std::numeric_limits<double>::quiet_NaN();
    PixelSlopes slopes;
    for (Index n = 0; n < residuals.shape[0]; n++) {
        const Pixel pixel = project_with_slopes(cameras[observed.views[n]].data, points[observed.points[n]].data,
                                                observed.velocities[n].data, slopes);
        residuals(n, 0) = pixel.before ? observed.pixels(n, 0) - pixel.u : NOWHERE;
        residuals(n, 1) = pixel.before ? observed.pixels(n, 1) - pixel.v : NOWHERE;
    }
}

void reduce_normal(Array<const double, 2> cameras, const Objects &objects, const Observed &observed, double damping,
                   const Reduced &reduced) {
    std::fill_n(reduced.normal.data, reduced.normal.size(), 0.0);
    std::fill_n(reduced.side.data, reduced.side.size(), 0.0);
    std::fill_n(reduced.couplings.data, reduced.couplings.size(), 0.0);
    OneObject object;
    for (Index g = 0; g + 1 < objects.firsts.size(); g++) {
        std::copy_n(objects.priors[g].data, N_OBJECT * N_OBJECT, &object.own[0][0]);
        std::copy_n(objects.prior_sides[g].data, N_OBJECT, reduced.object_sides[g].data);
        object.side = reduced.object_sides[g].data;
        object.couplings = reduced.couplings[g];
        object.seen.assign(std::size_t(cameras.shape[0]), false);
        observe(cameras, objects, observed, objects.firsts[g], objects.firsts[g + 1], reduced, object);
        for (int j = 0; j < N_OBJECT; j++) object.own[j][j] += damping * object.own[j][j];
        invert(object.own, reduced.inverses[g]);
        eliminate(reduced.inverses[g], object, reduced);
    }
    damp(reduced.normal, damping);
}

}  // namespace bodytrack::adjustment
