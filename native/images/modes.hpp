// What most pictures of a pile show, pixel by pixel.
#pragma once
#include "array.hpp"

namespace bodytrack::images {

// So many pictures at most are a pile: their number is told in a byte.
constexpr Index MOST_PICTURES = 255;

// The colour that most pictures agree with, and how many do. A mean would mix persons into it, and a median takes one
// where he stands for half of the time in many colours.
// pile (n, h, w, 3); colours agree that differ by `reach` grey levels at most in any channel; plate (h, w, 3) receives
// the mean of those that agree, counts (h, w) their number, rivals (h, w) the number of those that agree on a colour of
// the others, at most.
void dominant_modes(Array<const Byte, 4> pile, Index reach, Array<Byte, 3> plate,
                    Array<Byte, 2> counts, Array<Byte, 2> rivals);

}  // namespace bodytrack::images
