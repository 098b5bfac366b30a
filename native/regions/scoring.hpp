// Poses synthesized and compared with the colours of the images in one go: no contour is written to memory.
//
// In a decomposed search most parts of the body stand still. They are traced, and their lines read, once for all poses; of
// each pose only the moving parts are, and it is asked which lines of the others they cover or lie beside.
#pragma once
#include "contours/tracing.hpp"
#include "regions/misfits.hpp"

namespace bodytrack::regions {

// Misfits (B, V, P, 3), see `score_lines`, of many poses (B, P, 4, 4), added to; the twin is `trace_contours`,
// `parts_beside` and `score_lines`.
void score_regions(Array<const double, 4> placements, const contours::Grids &grids, const contours::Parts &parts,
                   const contours::Views &views, const contours::Spacing &spacing, const Lines &lines,
                   Array<double, 4> misfits);

}  // namespace bodytrack::regions
