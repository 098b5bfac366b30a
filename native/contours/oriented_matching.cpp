#include "contours/oriented_matching.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "projection.hpp"

namespace bodytrack::contours {

namespace {

using namespace rows;

// More than any squared distance, px^2.
constexpr float FARTHEST = 1e18f;

// Rows are looked at up to this many times the gate away in y, for distances are rounded.
constexpr double A_LITTLE = 1.0001;

// The least number in single precision that is not below one in double precision: comparisons are those with the latter.
float not_below(double number) {
    const float near = float(number);
    return double(near) < number ? std::nextafter(near, std::numeric_limits<float>::infinity()) : near;
}

// The scene points of a view, sorted by y, numbers of one kind one after the other, and what each was found nearest to.
struct Tried {
    std::vector<float> x, y, nx, ny, best, distances;
    std::vector<std::int32_t> nearest;

    Tried(Array<const float, 2> scene, Index first, Index end, float most) {
        for (Index s = first; s < end; s++) {
            const float *row = scene[s].data;
            x.push_back(row[scene_point::X]);
            y.push_back(row[scene_point::Y]);
            nx.push_back(row[scene_point::DX]);
            ny.push_back(row[scene_point::DY]);
        }
        best.assign(x.size(), most);
        distances.resize(x.size());
        nearest.assign(x.size(), -1);
    }

    // Has a contour sample m (pixel, normal) tried by the points whose y is within reach. Returns the point nearest to it, of
    // equal ones the first; -1 if none of agreeing direction is nearer than `most`, a squared distance.
    Index try_sample(const float *drawn, std::int32_t m, float reach, float cosine, float most) {
        const Index low = std::lower_bound(y.begin(), y.end(), drawn[1] - reach) - y.begin();
        const Index high = std::upper_bound(y.begin() + low, y.end(), drawn[1] + reach) - y.begin();
        const float least = compare(drawn, m, cosine, high - low, &x[low], &y[low], &nx[low], &ny[low], &best[low],
                                    &nearest[low], &distances[low]);
        if (!(least < most)) return -1;
        return std::find(distances.begin() + low, distances.begin() + high, least) - distances.begin();
    }

  private:
    // Eight points at a time; the least distance.
    static float compare(const float *drawn, std::int32_t m, float cosine, Index n, const float *__restrict x,
                         const float *__restrict y, const float *__restrict nx, const float *__restrict ny,
                         float *__restrict best, std::int32_t *__restrict nearest, float *__restrict distances) {
        const float u = drawn[0], v = drawn[1], nu = drawn[2], nv = drawn[3];
        float least = FARTHEST;
        for (Index i = 0; i < n; i++) {
            const float dx = x[i] - u, dy = y[i] - v, square = dx * dx + dy * dy;
            const float distance = std::fabs(nu * nx[i] + nv * ny[i]) >= cosine ? square : FARTHEST;
            const bool nearer = distance < best[i];
            best[i] = nearer ? distance : best[i];
            nearest[i] = nearer ? m : nearest[i];
            distances[i] = distance;
            least = std::min(least, distance);
        }
        return least;
    }
};

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

// A sample of the model that is paired: where it is seen and how that changes, and sums of weights and weighted residuals.
struct Pulled {
    Along along;
    const float *place;
    Index end;
    double weight = 0.0, pull = 0.0;
};

}  // namespace

Index match_oriented(Array<const float, 3> positions, Array<const Index, 1> counts, Array<const float, 2> scene,
                     Array<const Index, 1> first, const Gate &gate, Array<Index, 2> pairs) {
    Found found{pairs};
    const float cosine = not_below(gate.cosine), most = not_below(gate.radius * gate.radius);
    const float reach = float(A_LITTLE * gate.radius);
    for (Index v = 0; v < counts.size(); v++) {
        Tried edges(scene, first[v], first[v + 1], most);
        if (edges.x.empty()) continue;
        for (Index m = 0; m < counts[v]; m++) {
            const float *drawn = positions[v][m].data;
            if (!(drawn[sample::LENGTH] > 0.0f)) continue;
            const Index s = edges.try_sample(drawn, std::int32_t(m), reach, cosine, most);
            if (s >= 0) found.add(v, m, first[v] + s, 0);
        }
        for (std::size_t s = 0; s < edges.nearest.size(); s++)
            if (edges.nearest[s] >= 0) found.add(v, edges.nearest[s], first[v] + Index(s), 1);
    }
    return found.n;
}

body::Sums normal_equations(const Paired &paired, const body::Motion &motion, double px_per_observation,
                            double robust_px, Array<double, 2> matrix, Array<double, 1> vector) {
    const Index n_ends = motion.moves.shape[1], n_views = paired.parts.shape[0], room = paired.parts.shape[1];
    // place of each sample among those pulled, and one; most are not
    std::vector<int> places(std::size_t(n_views * room), 0);
    std::vector<Pulled> pulled;
    body::Sums sums;
    for (Index i = 0; i < paired.pairs.shape[0]; i++) {
        const Index *pair = paired.pairs[i].data, view = pair[0], m = pair[1], end = motion.ends[paired.parts(view, m)];
        if (end < -1) continue;
        const float *seen = paired.positions[view][m].data, *edge = paired.scene[pair[2]].data;
        const double nu = seen[sample::NU], nv = seen[sample::NV];
        int &place = places[view * room + m];
        if (place == 0) {
            const float *at = paired.points[view][m].data;
            pulled.push_back({project_along(paired.cameras[view].data, at[0], at[1], at[2], nu, nv), at, end});
            place = int(pulled.size());
        }
        Pulled &of = pulled[place - 1];
        const double length = pair[3] == 0 ? seen[sample::LENGTH] : edge[scene_point::WEIGHT];
        const double residual = (of.along.u - edge[scene_point::X]) * nu + (of.along.v - edge[scene_point::Y]) * nv;
        const double ratio = residual / robust_px, fallen = 1.0 + ratio * ratio;
        const double weight = length / px_per_observation / (fallen * fallen);
        of.weight += weight;
        of.pull += weight * residual;
        sums.squares += weight * residual * residual;
        sums.total += weight;
    }
    std::vector<body::End> ends(n_ends);
    for (const auto &[along, at, end, weight, pull] : pulled)
        if (end >= 0) ends[end].add({at[0], at[1], at[2]}, {along.x, along.y, along.z}, pull, weight);
    body::chain(ends, motion, matrix, vector);
    return sums;
}

}  // namespace bodytrack::contours
