#include "images/appearance.hpp"

namespace bodytrack::images {

void mark_appearance(Array<const Byte, 3> colours, Array<const Byte, 2> across,
                     Array<const Byte, 2> along, Index x, Index y, const Appearances &tables,
                     Array<Byte, 3> looks) {
    for (Index row = 0; row < looks.shape[0]; row++) {
        const Index first = (row + y) * across.shape[1] + x;
        Byte *look = looks[row].data;
        for (Index at = first; at < first + looks.shape[1]; at++, look += 3) {
            const Byte *colour = colours.data + 3 * at;
            look[0] = colour[0];
            look[1] = tables.chroma[tables.red * colour[1] + tables.blue * colour[2] + tables.added];
            look[2] = tables.classes[4 * tables.steps[across.data[at]] + tables.steps[along.data[at]]];
        }
    }
}

}  // namespace bodytrack::images
