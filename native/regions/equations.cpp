// Normal equations of contour shifts.
#include "regions/shifts.hpp"

namespace bodytrack::regions {

body::Sums shift_equations(Array<const float, 3> shifts, const Samples &samples, const body::Motion &motion,
                           Array<const double, 2> cameras, double px_per_observation, Array<double, 2> matrix,
                           Array<double, 1> vector) {
    std::vector<body::End> ends(motion.moves.shape[1]);
    body::Sums sums;
    for (Index v = 0; v < samples.counts.size(); v++)
        for (Index m = 0; m < samples.counts[v]; m++) {
            const Sample at(samples, v, m);
            const Index end = motion.ends[at.p];
            const float *shift = shifts[v][m].data;
            const double weight = at.length / px_per_observation * shift[1] * shift[2];
            if (!(weight > 0.0) || end < 0) continue;
            const auto &[x, y, z] = at.point;
            const Along along = project_along(cameras[v].data, x, y, z, at.nu, at.nv);
            const double residual = -double(shift[0]);
            ends[end].add({x, y, z}, {along.x, along.y, along.z}, weight * residual, weight);
            sums.squares += weight * residual * residual;
            sums.total += weight;
        }
    body::chain(ends, motion, matrix, vector);
    return sums;
}

}  // namespace bodytrack::regions
