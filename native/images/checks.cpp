#include "images/checks.hpp"

#include <algorithm>
#include <cstdlib>

namespace bodytrack::images {

bool pixels_within(Array<const std::int32_t, 2> pixels, Index width, Index height) {
    bool inside = true;
    for (Index i = 0; i < pixels.shape[0]; i++) {
        const Index x = pixels(i, 0), y = pixels(i, 1);
        inside = inside & (0 <= x) & (x < width) & (0 <= y) & (y < height);
    }
    return inside;
}

bool labels_below(Array<const std::int32_t, 2> labels, Index n) {
    std::int32_t least = 0, most = 0;
    for (Index i = 0; i < labels.size(); i++) {
        least = std::min(least, labels.data[i]);
        most = std::max(most, labels.data[i]);
    }
    return least == 0 && Index(most) < n;
}

bool framed(Array<const Byte, 2> edges, Index most) {
    const Index height = edges.shape[0], width = edges.shape[1];
    if (height < 2 || width < 2) return false;
    Index n = 0, n_border = 0;
    for (Index i = 0; i < edges.size(); i++) n += edges.data[i] != 0;
    for (Index x = 0; x < width; x++) n_border += (edges(0, x) != 0) + (edges(height - 1, x) != 0);
    for (Index y = 0; y < height; y++) n_border += (edges(y, 0) != 0) + (edges(y, width - 1) != 0);
    return n_border == 0 && n <= most;
}

bool linked(const Chains &chains, Index n_chains) {
    if (n_chains < 0 || n_chains >= chains.starts.size()) return false;
    if (chains.starts[0] < 0 || chains.starts[n_chains] > chains.points.shape[0]) return false;
    for (Index k = 0; k < n_chains; k++)
        if (chains.starts[k] > chains.starts[k + 1]) return false;
    bool beside = true;
    for (Index k = 0; k < n_chains; k++)
        for (Index i = chains.starts[k] + 1; i < chains.starts[k + 1]; i++)
            for (int axis = 0; axis < 2; axis++)
                beside = beside & (std::abs(Index(chains.points(i, axis)) - Index(chains.points(i - 1, axis))) <= 1);
    return beside;
}

}  // namespace bodytrack::images
