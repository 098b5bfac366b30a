#include "regions/misfits.hpp"

namespace bodytrack::regions {

namespace {

// A line with less than this share on the wrong side explains its contour; half tells nothing. Of tracked poses 89 to 92 %
// of the contour is explained so, of arms anywhere else 26 % (three rendered recordings).
constexpr double EXPLAINED = 0.45;

// Places on either side, two steps apart, that a score looks at.
constexpr int COMPARED = 4;

// How much of a line lies on the wrong side. step: distance of the places, px; deep: how far it may go into the part, px.
double wrong_share(const Lines &lines, const Sample &at, Index side, double step, double deep) {
    const auto share_at = [&](double along) {
        const int colour = lines.picture.at(at.v, at.x + at.nu * along, at.y + at.nv * along);
        return inside_share(lines.looks, at.v, at.p, side, colour, lines.rule.floor);
    };
    double inside = 0.0, outside = 0.0;
    int n_inside = 0, n_hidden = 0;
    for (int k = 0; k < COMPARED; k++) {
        const double along = 1.5 + 2.0 * k;
        if (k == 0 || along * step < deep) {
            double share = share_at(-along * step);
            if (share == HIDDEN) {
                share = EVEN;
                n_hidden++;
            }
            inside += share;
            n_inside++;
        }
        const double share = share_at(along * step);
        outside += share < HIDDEN ? share : double(EVEN);
    }
    if (2 * n_hidden > n_inside) return -1.0;
    return 0.5 * (1.0 - inside / (254.0 * n_inside) + outside / (254.0 * COMPARED));
}

}  // namespace

Judged judge(const Lines &lines, const double *camera, const Sample &at, Index side) {
    const double size = pixels_per_metre(camera, at.point), step = std::max(size * lines.rule.step_m, 1.0);
    return {wrong_share(lines, at, side, step, DEEPEST * size * lines.looks.half_extents[at.p]), 4.0 * COMPARED * step};
}

void add_misfit(double length, const Judged &judged, Index p, double *misfits) {
    if (judged.wrong < 0.0) return;
    double *of_part = misfits + 3 * p;
    of_part[0] += length;
    of_part[1] += length * judged.wrong * judged.length_px;
    if (judged.wrong < EXPLAINED) of_part[2] += length;
}

void score_lines(const Lines &lines, const Samples &samples, Array<const Index, 3> beside, Array<const double, 2> cameras,
                 Array<double, 3> misfits) {
    for (Index v = 0; v < samples.counts.size(); v++) {
        if (!lines.picture.sees(v)) continue;
        for (Index m = 0; m < samples.counts[v]; m++) {
            const Sample at(samples, v, m);
            if (!(at.length > 0.0) || !lines.wanted[at.p] || !lines.looks.known(v, at.p)) continue;
            add_misfit(at.length, judge(lines, cameras[v].data, at, beside(v, m, 0)), at.p, misfits[v].data);
        }
    }
}

}  // namespace bodytrack::regions
