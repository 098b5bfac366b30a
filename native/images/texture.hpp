// How alike the texture of two pictures is: correlation in a window that goes along the rows.
#pragma once
#include <vector>

#include "array.hpp"

namespace bodytrack::images {

// Half the window of the correlation, px.
constexpr Index WINDOW = 4;

class Texture {
  public:
    // now (h, w, 3) and before (H, W, 3) are smoothed, image and plate; the plate's corner x, y is the image's.
    Texture(Array<const Byte, 3> now, Array<const Byte, 3> before, Index x, Index y);

    // Normalized cross-correlation in the window around a pixel of the image, near 0 where there is no texture. The
    // window must lie inside; it is quick where pixels are asked row by row from above.
    double correlation(Index x, Index y);

  private:
    // Sums and products of grey values in a column of the window.
    struct Sums {
        Index a = 0, b = 0, aa = 0, bb = 0, ab = 0;
    };

    // Adds a pixel to the sums of its column, or takes it away.
    void add(Index x, Index y, int sign);
    // Brings the sums of a column to the window around row y.
    void move_to(Index x, Index y);

    Array<const Byte, 3> now_, before_;
    Index x_, y_;
    std::vector<Sums> sums_;
    // row around which the sums of each column are known
    std::vector<Index> known_;
};

}  // namespace bodytrack::images
