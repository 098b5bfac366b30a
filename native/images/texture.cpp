#include "images/texture.hpp"

#include <algorithm>
#include <cmath>

namespace bodytrack::images {

namespace {

// The least variance is that of a grey level; three channels are summed.
constexpr double LEAST_VARIANCE = 9.0;

Index grey(const Byte *pixel) { return Index(pixel[0]) + Index(pixel[1]) + Index(pixel[2]); }

}  // namespace

Texture::Texture(Array<const Byte, 3> now, Array<const Byte, 3> before, Index x, Index y)
    : now_(now), before_(before), x_(x), y_(y), sums_(std::size_t(now.shape[1])), known_(sums_.size(), -2) {}

void Texture::add(Index x, Index y, int sign) {
    const Index a = grey(&now_(y, x, 0)), b = grey(&before_(y + y_, x + x_, 0));
    Sums &sums = sums_[std::size_t(x)];
    sums.a += sign * a;
    sums.b += sign * b;
    sums.aa += sign * a * a;
    sums.bb += sign * b * b;
    sums.ab += sign * a * b;
}

// From the row before, the sums take two pixels.
void Texture::move_to(Index x, Index y) {
    Index &known = known_[std::size_t(x)];
    if (known == y) return;
    if (known == y - 1) {
        add(x, y - WINDOW - 1, -1);
        add(x, y + WINDOW, 1);
    } else {
        sums_[std::size_t(x)] = {};
        for (Index row = y - WINDOW; row <= y + WINDOW; row++) add(x, row, 1);
    }
    known = y;
}

double Texture::correlation(Index x, Index y) {
    Sums sums;
    for (Index column = x - WINDOW; column <= x + WINDOW; column++) {
        move_to(column, y);
        const Sums &of = sums_[std::size_t(column)];
        sums.a += of.a;
        sums.b += of.b;
        sums.aa += of.aa;
        sums.bb += of.bb;
        sums.ab += of.ab;
    }
    const double n = double((2 * WINDOW + 1) * (2 * WINDOW + 1));
    const double a = double(sums.a) / n, b = double(sums.b) / n;
    const double varying = std::max(double(sums.aa) / n - a * a, LEAST_VARIANCE) *
                           std::max(double(sums.bb) / n - b * b, LEAST_VARIANCE);
    return (double(sums.ab) / n - a * b) / std::sqrt(varying);
}

}  // namespace bodytrack::images
