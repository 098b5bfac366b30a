// Colours inside and outside of body parts: pixels as colour numbers, and tables of how often each colour occurs.
//
// A colour is one of 16 x 16 x 16 bins of a picture's three channels: lightness, chroma and texture, see
// `tracker.images.operations.appearance`. Tables are kept per view and part: one table for a whole person is two to four times worse,
// and no two cameras see the same colours.
#pragma once
#include <cmath>
#include <cstdint>

#include "array.hpp"
#include "rows.hpp"

namespace bodytrack::regions {

using Code = std::uint16_t;
using Byte = std::uint8_t;

// 16 levels of each channel.
constexpr int N_COLOURS = 4096;

// Entry of a posterior table that tells nothing; 0 is surely outside, 254 surely inside.
constexpr Byte EVEN = 127;

// Entry of the colours of something that hides the part: nothing can be told there, and nothing has to be.
constexpr Byte HIDDEN = 255;

// The colour numbers of all views where they matter: regions end to end, each row by row, and their layout (V, 5).
struct Picture {
    Array<const Code, 1> codes;
    Array<const Index, 2> layout;

    bool sees(Index v) const { return layout(v, rows::region::WIDTH) > 0; }

    // Colour number of the pixel nearest to a position in view v, -1 outside of the region.
    int at(Index v, double x, double y) const {
        using namespace rows::region;
        const Index *region = layout[v].data;
        const double column = std::floor(x + 0.5) - double(region[LEFT]), row = std::floor(y + 0.5) - double(region[TOP]);
        if (!(column >= 0.0 && row >= 0.0 && column < double(region[WIDTH]) && row < double(region[HEIGHT]))) return -1;
        return codes[region[START] + Index(row) * region[WIDTH] + Index(column)] & (N_COLOURS - 1);
    }
};

// Shares of the colours, each table summing to 1, or to 0 where nothing was learnt: (V, P, 4096) of the pixels just inside
// the contour of a part and of the background just outside of it, (V, 4096) of the things that hide parts.
template <class Share>
struct Tables {
    Array<Share, 3> inside, outside;
    Array<Share, 2> hiders;
};

// Writes the colour numbers of a picture of n pixels (n, 3), row by row.
void encode(const Byte *picture, Index n, Code *codes);

// Moves a table (4096,) towards the shares of colours counted (4096,) by `news`, all the way if it is empty; whether there
// were enough pixels.
bool learn_colours(const Index *counts, double news, float *table);

// Probability that a pixel of a colour lies inside, were both sides as likely, of the wanted parts (V, P): posteriors
// (V, P, 4096), 254 times the probability; HIDDEN for colours of a thing that hides the part. floor: share that a colour
// never seen has; most: bound on the logarithm of the odds.
void tabulate_posteriors(const Tables<const float> &tables, double floor, double most, Array<const bool, 2> wanted,
                         Array<Byte, 3> posteriors);

}  // namespace bodytrack::regions
