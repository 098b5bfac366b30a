#include "regions/scoring.hpp"

#include <memory>

#include "contours/scoring.hpp"
#include "regions/sides.hpp"

namespace bodytrack::regions {

namespace {

using namespace rows;
using contours::ROW;
using contours::Solids;

// Masks of parts.
using Mask = std::unique_ptr<bool[]>;

template <class Condition>
Mask parts_where(Index n_parts, Condition condition) {
    Mask mask = std::make_unique<bool[]>(n_parts);
    for (Index p = 0; p < n_parts; p++) mask[p] = condition(p);
    return mask;
}

// The lines of the parts that stand still, at most ROW, as long as nothing that moves is near.
struct Kept {
    Kept() : rows(size_t(ROW) * sample::N_COLUMNS), spots(ROW), sides(ROW), judged(ROW) {}

    // (ROW, 13) from `trace_view`
    Array<float, 2> samples() { return {rows.data(), {ROW, sample::N_COLUMNS}}; }

    std::vector<float> rows;
    std::vector<Spot> spots;
    std::vector<Side> sides;
    std::vector<Judged> judged;
    Index n = 0;
};

// One view that is scored.
struct Scored {
    const Lines &lines;
    const double *camera;
    Index v;
    Solids &solids;

    double step_m() const { return lines.rule.step_m; }
};

// The parts near the one that is in work, listed anew when it changes.
class Near {
  public:
    Near(const Scored &view, const bool *among) : view_(view), among_(among) {}

    const std::vector<Index> &of(Index p) {
        if (p != last_) parts_near(view_.solids, among_, last_ = p, view_.camera[camera::FX], view_.step_m(), listed_);
        return listed_;
    }

  private:
    const Scored &view_;
    const bool *among_;
    Index last_ = BACKGROUND;
    std::vector<Index> listed_;
};

// Reads the lines of the parts that stand still, among themselves.
void read_still(const Scored &view, const bool *still, Kept &kept) {
    Near near(view, still);
    for (Index i = 0; i < kept.n; i++) {
        const Sample at(view.v, kept.samples()[i].data);
        if (!(at.length > 0.0)) continue;
        place_spots(view.camera, at, view.step_m(), 1, &kept.spots[i]);
        kept.sides[i] = nearest_beside(view.solids, near.of(at.p), kept.spots[i]);
        kept.judged[i] = judge(view.lines, view.camera, at, kept.sides[i].part);
    }
}

// Writes samples as `cover` wants them.
void lay_out(Array<const float, 2> samples, Index n, contours::Spots &s) {
    using namespace sample;
    const int columns[] = {U, V, NU, NV, LENGTH, X, Y, Z, NX, NY, NZ, BETWEEN};
    float *const rows[] = {s.u, s.v, s.nu, s.nv, s.length, s.x, s.y, s.z, s.nx, s.ny, s.nz, s.state};
    for (Index i = 0; i < n; i++)
        for (int k = 0; k < 12; k++) rows[k][i] = samples(i, columns[k]);
}

// Adds the lines of the parts that stand still; those that something that moves lies beside are read anew.
void add_still(const Scored &view, const bool *moving, double contact_m, Kept &kept, contours::Spots &spots,
               double *misfits) {
    lay_out(kept.samples(), kept.n, spots);
    for (Index q = 0; q < Index(view.solids.size()); q++)
        if (moving[q] && view.solids[q].nearest > 0.0f) contours::cover(view.solids[q], contact_m, spots, int(kept.n));
    Near near(view, moving);
    for (Index i = 0; i < kept.n; i++) {
        const Sample at(view.v, kept.samples()[i].data);
        if (spots.state[i] != contours::FREE || !(at.length > 0.0)) continue;
        const Side side = nearest_beside(view.solids, near.of(at.p), kept.spots[i], kept.sides[i]);
        const bool same = side.part == kept.sides[i].part;
        add_misfit(at.length, same ? kept.judged[i] : judge(view.lines, view.camera, at, side.part), at.p, misfits);
    }
}

// Adds the lines of n traced samples.
void add_traced(const Scored &view, Array<const float, 2> traced, Index n, const bool *everything, double *misfits) {
    Near near(view, everything);
    for (Index i = 0; i < n; i++) {
        const Sample at(view.v, traced[i].data);
        if (!(at.length > 0.0)) continue;
        Spot spot;
        place_spots(view.camera, at, view.step_m(), 1, &spot);
        const Side side = nearest_beside(view.solids, near.of(at.p), spot);
        add_misfit(at.length, judge(view.lines, view.camera, at, side.part), at.p, misfits);
    }
}

}  // namespace

void score_regions(Array<const double, 4> placements, const contours::Grids &grids, const contours::Parts &parts,
                   const contours::Views &views, const contours::Spacing &spacing, const Lines &lines,
                   Array<double, 4> misfits) {
    const Index n_poses = placements.shape[0], n_parts = parts.size(), room = ROW * n_parts;
    if (n_poses == 0) return;
    const Mask moving = parts_where(n_parts, [](Index) { return false; });
    contours::moving_parts(placements, {moving.get(), {n_parts}});
    const Mask still = parts_where(n_parts, [&](Index p) { return !moving[p]; });
    const Mask everything = parts_where(n_parts, [](Index) { return true; });
    const bool any_still = std::any_of(still.get(), still.get() + n_parts, [](bool one) { return one; });
    Solids solids(n_parts);
    // room for all that there can be, not filled: memory that nothing is written to costs nothing
    const std::unique_ptr<float[]> rows_(new float[room * sample::N_COLUMNS]);
    const Array<float, 2> traced{rows_.get(), {room, sample::N_COLUMNS}};
    const auto spots = std::make_unique<contours::Spots>();
    contours::Tracing work(grids);
    Kept kept;
    for (Index v = 0; v < views.size(); v++) {
        if (!lines.picture.sees(v)) continue;
        const Scored scored{lines, views.cameras[v].data, v, solids};
        const contours::View view(views, v);
        const auto counts = [&](Index p) { return lines.wanted[p] && lines.looks.known(v, p); };
        kept.n = 0;
        if (any_still) {
            contours::place_solids(placements[0], parts, solids);
            contours::view_solids(parts, scored.camera, spacing.contact_m, solids);
            const Mask wanted = parts_where(n_parts, [&](Index p) { return counts(p) && still[p]; });
            kept.n = trace_view(grids, parts, solids, view, spacing, wanted.get(), still.get(), work, kept.samples());
            read_still(scored, still.get(), kept);
        }
        // As many samples as there is room for may be too few: then all parts are traced for every pose.
        const bool stand = kept.n < ROW;
        const Mask wanted = parts_where(n_parts, [&](Index p) { return counts(p) && (moving[p] || !stand); });
        for (Index b = 0; b < n_poses; b++) {
            contours::place_solids(placements[b], parts, solids);
            contours::view_solids(parts, scored.camera, spacing.contact_m, solids);
            const Index n =
                trace_view(grids, parts, solids, view, spacing, wanted.get(), everything.get(), work, traced);
            double *of_view = misfits[b][v].data;
            add_traced(scored, traced, n, everything.get(), of_view);
            if (stand && kept.n > 0) add_still(scored, moving.get(), spacing.contact_m, kept, *spots, of_view);
        }
    }
}

}  // namespace bodytrack::regions
