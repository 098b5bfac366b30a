#include "patches/bending.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

namespace bodytrack::patches {

namespace {

// tracker/kernels/patches.py says what these are.
constexpr double LEAST_NEIGHBOURS = 6.0, LARGEST_PX = 0.5, NO_SPREAD_PX2 = 1.0, NO_SHIFT_PX2 = 1e-12;

struct Shift {
    double x = 0.0, y = 0.0;
    // whether neighbours tell of it
    bool usable = false;

    double square() const { return x * x + y * y; }
};

// The plane through the differences dA of one affine term to those of the neighbours, at offsets o: sums of dA and of o
// dA.
struct Plane {
    double mean = 0.0, along = 0.0, down = 0.0;
};

// By Taylor's theorem the shift is (s_xx + s_yy) m / 2 with m the mean square of a pixel's offset along an axis; the
// second derivatives are the slopes of the affine terms over the neighbours.
Shift raw_shift(const Followed &followed, Index own, Index half) {
    double count = 1.0, mean_x = 0.0, mean_y = 0.0, xx = NO_SPREAD_PX2, yy = NO_SPREAD_PX2, xy = 0.0;
    Plane planes[4];
    const double *affine = followed.affine[own].data;
    for (Index k = 0; k < followed.rows.shape[1]; k++) {
        const double x = followed.offsets(own, k, 0), y = followed.offsets(own, k, 1);
        const Index row = followed.rows(own, k);
        if (row < 0 || !followed.known[row] || !std::isfinite(x)) continue;
        count += 1.0;
        mean_x += x;
        mean_y += y;
        xx += x * x;
        yy += y * y;
        xy += x * y;
        for (int t = 0; t < 4; t++) {
            const double difference = followed.affine[row].data[t] - affine[t];
            planes[t].mean += difference;
            planes[t].along += x * difference;
            planes[t].down += y * difference;
        }
    }
    if (count <= LEAST_NEIGHBOURS) return {};
    mean_x /= count;
    mean_y /= count;
    xx -= count * mean_x * mean_x;
    yy -= count * mean_y * mean_y;
    xy -= count * mean_x * mean_y;
    const double determinant = xx * yy - xy * xy, m = double(half * (half + 1)) / 6.0;
    const auto along = [&](const Plane &plane) { return plane.along - mean_x * plane.mean; };
    const auto down = [&](const Plane &plane) { return plane.down - mean_y * plane.mean; };
    // s_xx from the first term of a row of the affine matrix, s_yy from the second
    const auto shift = [&](const Plane &first, const Plane &second) {
        return m * ((yy * along(first) - xy * down(first)) / determinant +
                    (xx * down(second) - xy * along(second)) / determinant);
    };
    const Shift found{shift(planes[0], planes[1]), shift(planes[2], planes[3]), true};
    return std::max(std::abs(found.x), std::abs(found.y)) <= LARGEST_PX ? found : Shift{};
}

}  // namespace

// Each shift is multiplied by the Wiener weight |mean s|^2 / mean |s|^2 over the point and its neighbours.
void bending_shifts(const Followed &followed, Index half, Array<double, 2> shifts) {
    const Index n_points = shifts.shape[0];
    std::vector<Shift> raw(static_cast<std::size_t>(n_points));
    for (Index n = 0; n < n_points; n++)
        if (followed.known[n]) raw[std::size_t(n)] = raw_shift(followed, n, half);
    for (Index n = 0; n < n_points; n++) {
        const Shift own = raw[std::size_t(n)];
        Shift sum = own;
        double square = own.square(), count = 1.0;
        for (Index k = 0; k < followed.rows.shape[1]; k++) {
            const Index row = followed.rows(n, k);
            if (row < 0 || !raw[std::size_t(row)].usable) continue;
            const Shift other = raw[std::size_t(row)];
            sum.x += other.x;
            sum.y += other.y;
            count += 1.0;
            square += other.square();
        }
        const double weight = sum.square() / (count * std::max(square, NO_SHIFT_PX2));
        shifts(n, 0) = weight * own.x;
        shifts(n, 1) = weight * own.y;
    }
}

}  // namespace bodytrack::patches
