#include "regions/learning.hpp"

#include <vector>

namespace bodytrack::regions {

namespace {

// Steps inside and outside whose colours are learnt.
constexpr int LEARNT_INSIDE = 12, LEARNT_OUTSIDE = 22;

using Counts = std::vector<Index>;

// Colours counted on both sides of one part in one view, and in all lines of the view that something hides.
struct Counted {
    Counts inside = Counts(N_COLOURS), outside = Counts(N_COLOURS), hidden = Counts(N_COLOURS);
};

// Counts the colours on both sides of one sample, or those inside as the hider's where most of them are.
void count_line(const Lesson &lesson, Index v, Index m, Counted &counted) {
    const Sample at(lesson.samples, v, m);
    const double size = pixels_per_metre(lesson.cameras[v].data, at.point), step = std::max(size * lesson.step_m, 1.0);
    const double deep = DEEPEST * size * lesson.half_extents[at.p];
    const Byte *posteriors = lesson.posteriors[v][at.p].data;
    const auto colour_at = [&](double along) {
        return lesson.picture.at(v, at.x + at.nu * along, at.y + at.nv * along);
    };
    int colours[LEARNT_INSIDE], n_inside = 0, n_hidden = 0;
    for (int k = 1; k <= LEARNT_INSIDE && k * step <= deep; k++) {
        const int colour = colour_at(-k * step);
        if (colour < 0) continue;
        colours[n_inside++] = colour;
        n_hidden += posteriors[colour] == HIDDEN;
    }
    const bool covered = 2 * n_hidden > n_inside;
    for (int i = 0; i < n_inside; i++) {
        if (covered) counted.hidden[colours[i]]++;
        else if (posteriors[colours[i]] != HIDDEN) counted.inside[colours[i]]++;
    }
    if (covered) return;
    for (int k = 2; k <= LEARNT_OUTSIDE; k++) {
        if (lesson.beside(v, m, k < NEAR ? 0 : 1) != BACKGROUND) continue;
        const int colour = colour_at(k * step);
        if (colour >= 0) counted.outside[colour]++;
    }
}

}  // namespace

void learn_lines(const Lesson &lesson, double news, const Tables<float> &tables, Array<bool, 2> changed) {
    const Index n_views = changed.shape[0], n_parts = changed.shape[1];
    std::fill_n(changed.data, changed.size(), false);
    Counted counted;
    for (Index v = 0; v < n_views; v++) {
        std::fill(counted.hidden.begin(), counted.hidden.end(), 0);
        for (Index p = 0; p < n_parts; p++) {
            std::fill(counted.inside.begin(), counted.inside.end(), 0);
            std::fill(counted.outside.begin(), counted.outside.end(), 0);
            bool any = false;
            for (Index m = 0; m < lesson.samples.counts[v]; m++)
                if (lesson.samples.parts(v, m) == p && lesson.useful(v, m)) {
                    count_line(lesson, v, m, counted);
                    any = true;
                }
            if (!any) continue;
            const bool inside = learn_colours(counted.inside.data(), news, tables.inside[v][p].data);
            const bool outside = learn_colours(counted.outside.data(), news, tables.outside[v][p].data);
            changed(v, p) = inside || outside;
        }
        if (learn_colours(counted.hidden.data(), news, tables.hiders[v].data)) std::fill_n(changed[v].data, n_parts, true);
    }
}

void longest_lines(const Samples &samples, Array<const double, 2> cameras, double step_m, Array<double, 1> longest_px) {
    for (Index v = 0; v < longest_px.size(); v++) {
        longest_px[v] = 1.0;
        for (Index m = 0; m < samples.counts[v]; m++) {
            const float *place = samples.points[v][m].data;
            const double point[3] = {place[0], place[1], place[2]};
            const double step_px = std::max(pixels_per_metre(cameras[v].data, point) * step_m, 1.0);
            longest_px[v] = std::max(longest_px[v], LEARNT_OUTSIDE * step_px + 1.0);
        }
    }
}

}  // namespace bodytrack::regions
