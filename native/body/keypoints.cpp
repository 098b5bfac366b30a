#include "body/keypoints.hpp"

#include <algorithm>
#include <limits>
#include <vector>

#include "projection.hpp"

namespace bodytrack::body {

namespace {

// What is closer to a camera, behind it or beyond its reach has no image that a keypoint could be of, metres.
constexpr double NEAREST_M = 0.1;

// A point of the body in a view: its pixel, and the distance of half a loss there, px; 0 if it is not before the camera.
struct Seen {
    double u, v, reach;
};

// A keypoint: pixel and confidence.
struct Keypoint {
    const double *at;

    bool was_found() const { return at[2] > 0.0; }
};

// Geman and McClure's loss of a gap, s^2 / (1 + s^2): half of an outlier at the reach, 1 far off. A keypoint that was not
// found, or is of no image, is as bad as an outlier.
double loss_of(const Keypoint &keypoint, const Seen &seen) {
    if (!keypoint.was_found() || !(seen.reach > 0.0)) return 1.0;
    const double u = seen.u - keypoint.at[0], v = seen.v - keypoint.at[1];
    const double square = (u * u + v * v) / (seen.reach * seen.reach);
    return square / (1.0 + square);
}

// One detection beside the points of a pose: losses (L,), and which keypoint (L,) means each point: its own or that of the
// other side.
struct Compared {
    explicit Compared(Index n_points) : losses(n_points), meant(n_points) {}

    double sum() const {
        double total = 0.0;
        for (const double loss : losses) total += loss;
        return total;
    }

    std::vector<double> losses;
    std::vector<Index> meant;
};

void compare(const Detected &detected, Index n, const std::vector<Seen> &seen, double exchange, std::vector<double> &gains,
             Compared &compared) {
    const auto found = detected.found[n];
    const auto keypoint = [&](Index k) { return Keypoint{found[k].data}; };
    const Index n_points = Index(seen.size());
    std::fill(gains.begin(), gains.end(), 0.0);
    for (Index k = 0; k < n_points; k++) {
        const double loss = compared.losses[k] = loss_of(keypoint(k), seen[k]);
        const Index limb = detected.limbs[k];
        if (limb >= 0) gains[limb] += loss - loss_of(keypoint(detected.other[k]), seen[k]) - exchange;
    }
    for (Index k = 0; k < n_points; k++) {
        compared.meant[k] = k;
        const Index limb = detected.limbs[k], other = detected.other[k];
        if (limb < 0 || gains[limb] <= 0.0) continue;
        compared.meant[k] = other;
        compared.losses[k] = loss_of(keypoint(other), seen[k]) + exchange;
    }
}

void write(Array<const double, 2> found, const Compared &compared, const std::vector<Seen> &seen, const Matches &matches,
           Index b, Index v) {
    for (Index k = 0; k < Index(seen.size()); k++) {
        const Keypoint keypoint{found[compared.meant[k]].data};
        const bool there = keypoint.was_found() && seen[k].reach > 0.0;
        matches.weights(b, v, k) = there ? keypoint.at[2] : 0.0;
        matches.gaps(b, v, k, 0) = there ? seen[k].u - keypoint.at[0] : 0.0;
        matches.gaps(b, v, k, 1) = there ? seen[k].v - keypoint.at[1] : 0.0;
        matches.losses(b, v, k) = compared.losses[k];
    }
}

}  // namespace

void match_keypoints(Array<const double, 3> points, Array<const double, 2> cameras, const Detected &detected,
                     Index n_limbs, const Reach &reach, const Matches &matches) {
    const Index n_points = points.shape[1];
    std::vector<Seen> seen(n_points);
    std::vector<double> gains(n_limbs);
    Compared compared(n_points);
    for (Index b = 0; b < points.shape[0]; b++)
        for (Index v = 0; v < cameras.shape[0]; v++) {
            const double *camera = cameras[v].data;
            for (Index k = 0; k < n_points; k++) {
                const Image image = project_point(camera, points(b, k, 0), points(b, k, 1), points(b, k, 2));
                const double size = camera[rows::camera::FX] / std::max(image.depth, NEAREST_M);
                matches.px_per_m(b, v, k) = size;
                seen[k] = {image.u, image.v, image.depth > NEAREST_M ? reach.half_m * size : 0.0};
            }
            double least = std::numeric_limits<double>::infinity();
            for (Index n = detected.first[v]; n < detected.first[v + 1]; n++) {
                compare(detected, n, seen, reach.exchange, gains, compared);
                const double sum = compared.sum();
                if (sum >= least) continue;
                least = sum;
                write(detected.found[n], compared, seen, matches, b, v);
            }
        }
}

}  // namespace bodytrack::body
