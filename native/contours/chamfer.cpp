#include "contours/chamfer.hpp"

#include <algorithm>
#include <cmath>

#include "rows.hpp"

namespace bodytrack::contours {

namespace {

using namespace rows;

// Model samples that a scene point is compared with at a time.
constexpr int FOUR = 4;

// A place so far away that it is nearest to nothing, px.
constexpr float NOWHERE = 1e7f;

// Lowers best[i] to the squared distance of point i to the nearest of four others; eight points at a time.
void nearest_squared(const float *__restrict xs, const float *__restrict ys, Index n, const float (&x)[FOUR],
                     const float (&y)[FOUR], float *__restrict best) {
    const float x0 = x[0], x1 = x[1], x2 = x[2], x3 = x[3], y0 = y[0], y1 = y[1], y2 = y[2], y3 = y[3];
    for (Index i = 0; i < n; i++) {
        const float u = xs[i], v = ys[i];
        const float a = std::min((u - x0) * (u - x0) + (v - y0) * (v - y0), (u - x1) * (u - x1) + (v - y1) * (v - y1));
        const float b = std::min((u - x2) * (u - x2) + (v - y2) * (v - y2), (u - x3) * (u - x3) + (v - y3) * (v - y3));
        best[i] = std::min(best[i], std::min(a, b));
    }
}

}  // namespace

bool Edges::sees(Index v) const { return regions(v, region::WIDTH) > 0; }

double chamfer_lookup(const Edges &edges, Index v, double x, double y, double outside) {
    const Index *at = edges.regions[v].data;
    const Index width = at[region::WIDTH], height = at[region::HEIGHT];
    const double u = x - double(at[region::LEFT]), w = y - double(at[region::TOP]);
    if (!(u >= 0.0 && w >= 0.0 && u <= double(width - 1) && w <= double(height - 1))) return outside;
    const Index column = std::min(Index(u), width - 2), row = std::min(Index(w), height - 2);
    if (column < 0 || row < 0) return outside;
    const double a = u - double(column), b = w - double(row);
    const float *upper = edges.flat.data + at[region::START] + row * width + column, *lower = upper + width;
    return (1.0 - b) * ((1.0 - a) * upper[0] + a * upper[1]) + b * ((1.0 - a) * lower[0] + a * lower[1]);
}

// Rejection follows the paper, section 4.1: points above theta first, then points above mean + 2 sigma of the rest. A set
// of which nothing is left, or an empty one, is at distance theta.
double robust_mean(const float *distances, const float *weights, Index n, const Rule &rule) {
    const double theta = rule.theta;
    double total = 0.0, mean = 0.0;
    for (Index i = 0; i < n; i++) {
        if (rule.reject && distances[i] > theta) continue;
        total += weights[i];
        mean += weights[i] * std::min(double(distances[i]), theta);
    }
    if (total <= 0.0) return theta;
    mean /= total;
    if (!rule.reject) return mean;
    double variance = 0.0;
    for (Index i = 0; i < n; i++)
        if (distances[i] <= theta) variance += weights[i] * (distances[i] - mean) * (distances[i] - mean);
    const double limit = std::min(theta, mean + 2.0 * std::sqrt(variance / total));
    double rest = 0.0, kept = 0.0;
    for (Index i = 0; i < n; i++)
        if (distances[i] <= limit) {
            rest += weights[i];
            kept += weights[i] * double(distances[i]);
        }
    return rest > 0.0 ? kept / rest : theta;
}

Matching::Matching(Index n_scene, Index n_samples)
    : xs(n_scene), ys(n_scene), scene_shares(n_scene), shares(std::max(n_scene, n_samples)),
      distances(std::max(n_scene, n_samples)) {}

Directed directed_pair(Array<const float, 2> samples, Index n_samples, const Edges &edges, Index v, const Rule &rule,
                       Matching &work) {
    const Index start = edges.first[v], n_scene = edges.first[v + 1] - start;
    float *distances = work.distances.data();
    Index n = 0;
    for (Index m = 0; m < n_samples; m++) {
        const float *from = samples[m].data;
        if (!(from[sample::LENGTH] > 0.0f)) continue;
        const double distance = chamfer_lookup(edges, v, from[sample::U], from[sample::V], rule.theta + 1.0);
        if (distance < 0.0) continue;
        distances[n] = float(distance);
        work.shares[n++] = from[sample::LENGTH];
    }
    const double to_scene = robust_mean(distances, work.shares.data(), n, rule);
    const float far = rule.reject ? 1e6f : float(rule.theta + 1.0);
    for (Index i = 0; i < n_scene; i++) {
        const float *point = edges.points[start + i].data;
        work.xs[i] = point[scene_point::X];
        work.ys[i] = point[scene_point::Y];
        work.scene_shares[i] = point[scene_point::WEIGHT];
        distances[i] = far * far;
    }
    float xs[FOUR], ys[FOUR];
    int waiting = 0;
    const auto compare = [&] {
        for (; waiting < FOUR; waiting++) xs[waiting] = ys[waiting] = NOWHERE;
        nearest_squared(work.xs.data(), work.ys.data(), n_scene, xs, ys, distances);
        waiting = 0;
    };
    for (Index m = 0; m < n_samples; m++) {
        const float *from = samples[m].data;
        if (from[sample::LENGTH] <= 0.0f) continue;
        xs[waiting] = from[sample::U];
        ys[waiting++] = from[sample::V];
        if (waiting == FOUR) compare();
    }
    if (waiting > 0) compare();
    for (Index i = 0; i < n_scene; i++) distances[i] = std::sqrt(distances[i]);
    return {to_scene, robust_mean(distances, work.scene_shares.data(), n_scene, rule)};
}

void directed_distances(Array<const float, 4> positions, Array<const Index, 2> counts, const Edges &edges,
                        const Rule &rule, Array<double, 3> distances) {
    Matching work(edges.points.shape[0], positions.shape[2]);
    for (Index b = 0; b < counts.shape[0]; b++)
        for (Index v = 0; v < counts.shape[1]; v++) {
            if (!edges.sees(v)) continue;
            const Directed pair = directed_pair(positions[b][v], counts(b, v), edges, v, rule, work);
            distances(b, v, 0) = pair.to_scene;
            distances(b, v, 1) = pair.to_model;
        }
}

}  // namespace bodytrack::contours
