// Bits of integers: the signs or cells of a row of a grid.
#pragma once
#include <cstdint>

#ifdef _MSC_VER
#include <intrin.h>
#endif

namespace bodytrack {

using Bits = std::uint64_t;

// Position of the lowest set bit of an integer that is not 0: one machine instruction.
inline int lowest_bit(Bits bits) {
#ifdef _MSC_VER
    unsigned long place;
    _BitScanForward64(&place, bits);
    return int(place);
#else
    return __builtin_ctzll(bits);
#endif
}

// Bits of a ring of n, each the one behind it.
inline Bits rolled(Bits bits, int n) { return (bits >> 1) | ((bits & 1) << (n - 1)); }

}  // namespace bodytrack
