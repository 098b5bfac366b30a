#include "images/slopes.hpp"

#include <algorithm>
#include <cstdlib>
#include <vector>

#include "images/channels.hpp"

namespace bodytrack::images {

namespace {

constexpr int N_CHANNELS = 3;

using Slope = std::int16_t;

// Three rows of one channel, one below the other.
struct Rows {
    const Byte *above, *here, *below;
};

// The strongest slopes of a row so far, and what they measure.
struct Strongest {
    Slope *dx, *dy, *strength;
};

// Replaces the slopes of a row's inner pixels where this channel's are stronger. 255 grey levels eight times over leave
// room in 16 bits.
void take_inner(const Rows &rows, Index width, const Strongest &strongest) {
    const Byte *__restrict above = rows.above, *__restrict here = rows.here, *__restrict below = rows.below;
    Slope *__restrict dx = strongest.dx, *__restrict dy = strongest.dy, *__restrict strengths = strongest.strength;
    for (Index x = 1; x < width - 1; x++) {
        const Slope falling = Slope(below[x + 1] - above[x - 1]), rising = Slope(above[x + 1] - below[x - 1]);
        const Slope across = Slope(here[x + 1] - here[x - 1]), down = Slope(below[x] - above[x]);
        const Slope slope_x = Slope(falling + rising + 2 * across), slope_y = Slope(falling - rising + 2 * down);
        const Slope strength = Slope(std::abs(slope_x) + std::abs(slope_y));
        // read before they are compared: a store under a condition keeps the compiler from vectors
        const Slope before_x = dx[x], before_y = dy[x], before = strengths[x];
        dx[x] = strength > before ? slope_x : before_x;
        dy[x] = strength > before ? slope_y : before_y;
        strengths[x] = std::max(strength, before);
    }
}

// The same for a pixel at an end of the row and its neighbour; mirrored, there is no slope along the row.
void take_end(const Rows &rows, Index x, Index beside, const Strongest &strongest) {
    const int slope = 2 * (rows.below[x] - rows.above[x] + rows.below[beside] - rows.above[beside]);
    if (std::abs(slope) <= strongest.strength[x]) return;
    strongest.strength[x] = Slope(std::abs(slope));
    strongest.dx[x] = 0;
    strongest.dy[x] = Slope(slope);
}

}  // namespace

void strongest_slopes(Array<const Byte, 3> image, Array<std::int16_t, 2> dx, Array<std::int16_t, 2> dy) {
    const Index height = dx.shape[0], width = dx.shape[1];
    std::vector<Slope> strengths(std::size_t(width), 0);
    // the channels of the last three rows
    std::vector<Byte> parted(std::size_t(3 * N_CHANNELS * width));
    const auto channel = [&](Index y, Index c) { return parted.data() + (y % 3 * N_CHANNELS + c) * width; };
    const auto part = [&](Index y) {
        part_channels(image[y].data, width, channel(y, 0), channel(y, 1), channel(y, 2));
    };
    part(0);
    for (Index y = 0; y < height; y++) {
        const Index above = std::abs(y - 1), below = height - 1 - std::abs(height - 2 - y);
        if (below > y) part(below);
        std::fill(strengths.begin(), strengths.end(), Slope(-1));
        const Strongest strongest{dx[y].data, dy[y].data, strengths.data()};
        for (Index c = 0; c < N_CHANNELS; c++) {
            const Rows rows{channel(above, c), channel(y, c), channel(below, c)};
            take_inner(rows, width, strongest);
            take_end(rows, 0, 1, strongest);
            take_end(rows, width - 1, width - 2, strongest);
        }
    }
}

}  // namespace bodytrack::images
