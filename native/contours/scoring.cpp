#include "contours/scoring.hpp"

#include <algorithm>
#include <array>

#include "rows.hpp"

namespace bodytrack::contours {

namespace {

using namespace rows;

// Samples of a part that are kept for the next pose; parts of more are drawn again.
constexpr int MOST_KEPT = 96;

// What is drawn of a sample, before it is tested.
constexpr int N_DRAWN = 11;
std::array<float *, N_DRAWN> drawn(Spots &s) { return {s.u, s.v, s.nu, s.nv, s.length, s.x, s.y, s.z, s.nx, s.ny, s.nz}; }

bool stands_alike(const double *one, const double *other) { return std::equal(one, one + 12, other); }

// The samples of each part as the pose before had them; -1 of those that have too many.
struct Kept {
    explicit Kept(Index n_parts) : counts(n_parts, -1), samples(size_t(n_parts) * N_DRAWN * MOST_KEPT) {}

    void put(Index p, Spots &spots, int n) {
        float *kept = samples.data() + p * N_DRAWN * MOST_KEPT;
        for (const float *row : drawn(spots)) {
            std::copy_n(row, n, kept);
            kept += MOST_KEPT;
        }
    }

    void take(Index p, Spots &spots, int n) const {
        const float *kept = samples.data() + p * N_DRAWN * MOST_KEPT;
        for (float *row : drawn(spots)) {
            std::copy_n(kept, n, row);
            kept += MOST_KEPT;
        }
    }

    std::vector<int> counts;
    std::vector<float> samples;
};

// What one view is scored with.
struct Search {
    Array<const double, 4> placements;
    const Grids &grids;
    const Parts &parts;
    const Spacing &spacing;
    // (P,) parts that are traced anew for each pose; parts that may cover them
    const bool *wanted, *covering;
};

// As `trace_view` of pose b, but parts that stand as in the pose before are taken from what was kept of it.
Index add_moving(const Search &search, Index b, const Solids &solids, const View &view, Tracing &work, Kept &kept,
                 Array<float, 2> traced) {
    Spots &spots = *work.spots;
    Index n = 0;
    for (Index p = 0; p < search.parts.size(); p++) {
        if (solids[p].nearest < 0.0f || !search.wanted[p]) continue;
        int n_spots = kept.counts[p];
        if (n_spots >= 0 && repeats(search.placements, b, p)) {
            kept.take(p, spots, n_spots);
            std::fill_n(spots.state, n_spots, float(FREE));
        } else {
            n_spots = draw_part(search.grids, p, solids[p], view, search.spacing.step_px, work);
            kept.counts[p] = n_spots <= MOST_KEPT ? n_spots : -1;
            if (n_spots <= MOST_KEPT && repeats(search.placements, b + 1, p)) kept.put(p, spots, n_spots);
        }
        n = add_visible(p, solids, search.covering, search.parts.bounds(0, p), search.spacing.contact_m, work, n_spots,
                        traced, n);
    }
    return n;
}

// Writes the samples of parts that stand still as `cover` wants them, except their state.
void lay_out(Array<const float, 2> still, Index n_still, Spots &s) {
    using namespace sample;
    const int columns[N_DRAWN] = {U, V, NU, NV, LENGTH, X, Y, Z, NX, NY, NZ};
    const auto rows = drawn(s);
    for (Index i = 0; i < n_still; i++)
        for (int k = 0; k < N_DRAWN; k++) rows[k][i] = still(i, columns[k]);
}

// Appends to n traced samples those of the parts that stand still that no moving one covers; the number of all.
Index add_seen(Array<const float, 2> still, Index n_still, const Solids &solids, Array<const bool, 1> moving,
               double contact_m, Spots &spots, Array<float, 2> traced, Index n) {
    for (Index i = 0; i < n_still; i++) spots.state[i] = still(i, sample::BETWEEN);
    for (Index q = 0; q < Index(solids.size()); q++)
        if (moving[q] && solids[q].nearest > 0.0f) cover(solids[q], contact_m, spots, int(n_still));
    for (Index i = 0; i < n_still && n < traced.shape[0]; i++)
        if (spots.state[i] == FREE) std::copy_n(still[i].data, sample::LENGTH + 1, traced[n++].data);
    return n;
}

}  // namespace

void moving_parts(Array<const double, 4> placements, Array<bool, 1> moving) {
    const Index n_poses = placements.shape[0];
    for (Index p = 0; p < moving.size(); p++) {
        moving[p] = n_poses <= 1;
        for (Index b = 1; b < n_poses; b++) moving[p] |= !stands_alike(placements[b][p].data, placements[0][p].data);
    }
}

bool repeats(Array<const double, 4> placements, Index b, Index p) {
    return b > 0 && b < placements.shape[0] && stands_alike(placements[b][p].data, placements[b - 1][p].data);
}

void trace_still(Array<const double, 3> placements, Array<const bool, 1> still, const Grids &grids, const Parts &parts,
                 const Views &views, const Spacing &spacing, Array<float, 3> samples, Array<Index, 1> counts) {
    Solids solids(parts.size());
    Tracing work(grids);
    place_solids(placements, parts, solids);
    for (Index v = 0; v < views.size(); v++) {
        view_solids(parts, views.cameras[v].data, spacing.contact_m, solids);
        counts[v] = trace_view(grids, parts, solids, View(views, v), spacing, still.data, still.data, work, samples[v]);
    }
}

void score_poses(Array<const double, 4> placements, const Grids &grids, const Parts &parts, const Views &views,
                 const Spacing &spacing, const Edges &edges, const Rule &rule, Array<const bool, 1> moving,
                 const Standing &standing, Array<double, 3> distances) {
    const Index n_parts = parts.size(), room = ROW * n_parts;
    const auto everything = std::make_unique<bool[]>(n_parts);
    std::fill_n(everything.get(), n_parts, true);
    // room for all that there can be, not filled: memory that nothing is written to costs nothing
    const std::unique_ptr<float[]> traced_rows(new float[room * sample::N_COLUMNS]);
    const Array<float, 2> traced{traced_rows.get(), {room, sample::N_COLUMNS}};
    const auto still_spots = std::make_unique<Spots>();
    Solids solids(n_parts);
    Tracing tracing(grids);
    Matching matching(edges.points.shape[0], room);
    Kept kept(n_parts);
    for (Index v = 0; v < views.size(); v++) {
        if (!edges.sees(v)) continue;
        const double *camera = views.cameras[v].data;
        const View view(views, v);
        const auto still = standing.samples[v];
        const Index n_still = standing.counts[v];
        lay_out(still, n_still, *still_spots);
        // As many samples as there is room for may be too few: then all parts are traced for every pose.
        const bool stand = n_still < ROW;
        const Search search{placements, grids, parts, spacing, stand ? moving.data : everything.get(), everything.get()};
        for (Index b = 0; b < placements.shape[0]; b++) {
            for (Index p = 0; p < n_parts; p++)
                if (!repeats(placements, b, p)) {
                    place_solid(placements[b][p].data, parts, p, solids[p]);
                    view_solid(parts, p, camera, spacing.contact_m, solids[p]);
                }
            Index n = add_moving(search, b, solids, view, tracing, kept, traced);
            if (stand && n_still > 0)
                n = add_seen(still, n_still, solids, moving, spacing.contact_m, *still_spots, traced, n);
            const Directed pair = directed_pair(traced, n, edges, v, rule, matching);
            distances(b, v, 0) = pair.to_scene;
            distances(b, v, 1) = pair.to_model;
        }
    }
}

}  // namespace bodytrack::contours
