// Which of the pixels that have changed are a shadow on the background.
#pragma once
#include "array.hpp"

namespace bodytrack::images {

// Pixels that the smoothed pictures show beyond the area looked at; smoothing may spoil the outer two.
constexpr Index MARGIN = 6;

// Least share of the light left where the texture shows, and where it does not; largest share; largest departure of a
// channel, grey levels; least correlation of the texture; width of the softest outline of an object, px.
struct ShadowRule {
    double least, least_smooth, most, chroma, texture, outline_px;
};

// The changed pixels that are no shadow: mask (h, w) receives 1 on objects, 0 elsewhere.
// now (h + 2 MARGIN, w + 2 MARGIN, 3) is the smoothed image of an area whose corner is x, y of the image; plate (H + 2
// MARGIN, W + 2 MARGIN, 3) that of the whole plate; moving (h, w) is non-zero where the image has changed.
void without_shadows(Array<const Byte, 3> now, Array<const Byte, 3> plate, Index x, Index y,
                     Array<const Byte, 2> moving, const ShadowRule &rule, Array<Byte, 2> mask);

}  // namespace bodytrack::images
