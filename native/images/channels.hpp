// Rows of BGR pixels, a channel at a time.
#pragma once
#include "array.hpp"

namespace bodytrack::images {

// Takes a row of n pixels (3 n) apart into its channels, n each.
inline void part_channels(const Byte *__restrict pixels, Index n, Byte *__restrict blue, Byte *__restrict green,
                          Byte *__restrict red) {
    for (Index k = 0; k < n; k++) {
        blue[k] = pixels[3 * k];
        green[k] = pixels[3 * k + 1];
        red[k] = pixels[3 * k + 2];
    }
}

}  // namespace bodytrack::images
