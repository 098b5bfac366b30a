#include "images/appearance.hpp"

#include <algorithm>
#include <cstdlib>
#include <vector>

#include "images/channels.hpp"

namespace bodytrack::images {

namespace {

// Side of the square that slopes are averaged over, px: of persons some 300 px high forearms are 20 to 30 px wide.
constexpr Index WINDOW = 7, HALF = WINDOW / 2;

// Rows that are held at a time: no fewer than the window's, and a power of two.
constexpr Index HELD = 8;

// 255 grey levels eight times over, and five times that, leave room in 16 bits; so do 49 slopes of 255.
using Slope = std::int16_t;
using Sum = std::uint16_t;

// A place beyond the border of a line of n, mirrored at its end pixels.
Index mirrored(Index at, Index n) {
    if (n == 1) return 0;
    while (at < 0 || at >= n) at = at < 0 ? -at : 2 * (n - 1) - at;
    return at;
}

// Lightness, and of Cr and Cb the place of chroma; ITU-R BT.601 in fixed-point numbers of 14 bits, as `cv2.cvtColor`.
void take_colours(const Byte *__restrict blue, const Byte *__restrict green, const Byte *__restrict red, Index n,
                  const Appearances &appearances, Byte *__restrict lightness, std::int16_t *__restrict places) {
    constexpr std::int32_t SHIFT = 14, ROUND = 1 << (SHIFT - 1), MIDDLE = 128 << SHIFT;
    const auto of_red = std::int32_t(appearances.red), of_blue = std::int32_t(appearances.blue);
    const auto added = std::int32_t(appearances.added);
    for (Index k = 0; k < n; k++) {
        const std::int32_t light = (1868 * blue[k] + 9617 * green[k] + 4899 * red[k] + ROUND) >> SHIFT;
        const std::int32_t cr = ((red[k] - light) * 11682 + MIDDLE + ROUND) >> SHIFT;
        const std::int32_t cb = ((blue[k] - light) * 9241 + MIDDLE + ROUND) >> SHIFT;
        lightness[k] = Byte(light);
        places[k] = std::int16_t(of_red * std::min(std::max(cr, 0), 255) + of_blue * std::min(std::max(cb, 0), 255) +
                                 added);
    }
}

// Five quarters of a whole number, halves to the even one: eighths of a grey level a px in tenths.
inline Byte tenths(Slope eighths) {
    const Slope fives = Slope(5 * eighths), tenths = Slope(Slope(fives + 1 + (fives >> 2 & 1)) >> 2);
    return Byte(std::min(tenths, Slope(255)));
}

// Slopes of n pixels by Sobel's filter, from three rows of lightness that begin a pixel before.
void take_slopes(const Byte *__restrict above, const Byte *__restrict here, const Byte *__restrict below, Index n,
                 Byte *__restrict across, Byte *__restrict along) {
    for (Index k = 0; k < n; k++) {
        const Slope left = Slope(above[k] + 2 * here[k] + below[k]);
        const Slope right = Slope(above[k + 2] + 2 * here[k + 2] + below[k + 2]);
        const Slope upper = Slope(above[k] + 2 * above[k + 1] + above[k + 2]);
        const Slope lower = Slope(below[k] + 2 * below[k + 1] + below[k + 2]);
        across[k] = tenths(std::max(Slope(right - left), Slope(left - right)));
        along[k] = tenths(std::max(Slope(lower - upper), Slope(upper - lower)));
    }
}

// Sums over the window along a row, of n pixels from the row's first on.
void sum_along(const Byte *__restrict slopes, Index n, Sum *__restrict sums) {
    for (Index k = 0; k < n; k++) {
        Sum sum = 0;
        for (Index i = 0; i < WINDOW; i++) sum = Sum(sum + slopes[k + i]);
        sums[k] = sum;
    }
}

// Mean slopes of n pixels from sums over the window, rounded.
void take_means(const Sum *__restrict sums, Index n, Byte *__restrict means) {
    // a division by 49 that is exact for all sums of 49 slopes
    constexpr std::uint32_t FACTOR = 171197, SHIFT = 23;
    static_assert(WINDOW * WINDOW == 49);
    for (Index k = 0; k < n; k++) means[k] = Byte((std::uint32_t(sums[k]) + 24) * FACTOR >> SHIFT);
}

// The rows of a region of an image, asked for from above.
class Rows {
  public:
    Rows(Array<const Byte, 3> image, Index x, Index y, Index width, const Appearances &appearances)
        : image_(image), appearances_(appearances), width_(width), wide_(width + 2 * HALF), left_(x - HALF),
          from_(std::max(left_, Index(0))), end_(std::min(left_ + wide_, image.shape[1])),
          first_(std::max(from_ - 1, Index(0))), n_(std::min(end_ + 1, image.shape[1]) - first_), kept_(HELD, -1),
          parted_(std::size_t(3 * n_)), lightness_(std::size_t(HELD * (n_ + 2))), places_(std::size_t(HELD * n_)),
          slopes_(std::size_t(2 * wide_)), sums_(std::size_t(2 * HELD * width), 0),
          windows_(std::size_t(2 * width), 0), means_(windows_.size()) {
        for (Index row = y - HALF; row < y + HALF; row++) add(row);
    }

    // Goes on to a row of the region.
    void go_to(Index row) {
        add(row + HALF);
        take_means(windows_.data(), 2 * width_, means_.data());
        row_ = row;
    }

    const Byte *lightness() { return of(row_) + left_ + HALF - first_; }
    // Valid once its lightness was asked for.
    const std::int16_t *places() const { return places_.data() + row_ % HELD * n_ + left_ + HALF - first_; }
    const Byte *across() const { return means_.data(); }
    const Byte *along() const { return means_.data() + width_; }

  private:
    // Lightness of a row of the image from the first column held on, with a mirrored pixel on either side.
    const Byte *of(Index row) {
        Byte *held = lightness_.data() + row % HELD * (n_ + 2) + 1;
        if (kept_[std::size_t(row % HELD)] != row) {
            kept_[std::size_t(row % HELD)] = row;
            Byte *blue = parted_.data(), *green = blue + n_, *red = green + n_;
            part_channels(&image_(row, first_, 0), n_, blue, green, red);
            take_colours(blue, green, red, n_, appearances_, held, places_.data() + row % HELD * n_);
            held[-1] = held[mirrored(-1, n_)];
            held[n_] = held[mirrored(n_, n_)];
        }
        return held;
    }

    // Adds a row, which may lie beyond the image, to the windows, and takes the one away that leaves them.
    void add(Index row) {
        const Index height = image_.shape[0], inside = mirrored(row, height), skipped = from_ - 1 - first_;
        const Byte *above = of(mirrored(inside - 1, height)), *here = of(inside);
        const Byte *below = of(mirrored(inside + 1, height));
        Byte *across = slopes_.data(), *along = across + wide_;
        take_slopes(above + skipped, here + skipped, below + skipped, end_ - from_, across + from_ - left_,
                    along + from_ - left_);
        Sum *sums = sums_.data() + (row + HELD) % HELD * 2 * width_;
        const Sum *oldest = sums_.data() + (row + 2 * HELD - WINDOW) % HELD * 2 * width_;
        for (Byte *slopes : {across, along}) {
            for (Index x = left_; x < from_; x++) slopes[x - left_] = slopes[mirrored(x, image_.shape[1]) - left_];
            for (Index x = end_; x < left_ + wide_; x++)
                slopes[x - left_] = slopes[mirrored(x, image_.shape[1]) - left_];
        }
        sum_along(across, width_, sums);
        sum_along(along, width_, sums + width_);
        for (Index k = 0; k < 2 * width_; k++) {
            Sum &window = windows_[std::size_t(k)];
            window = Sum(window + sums[k] - oldest[k]);
        }
    }

    Array<const Byte, 3> image_;
    const Appearances &appearances_;
    // Columns of the image: of the windows, those of them inside the image, and those held.
    Index width_, wide_, left_, from_, end_, first_, n_, row_ = 0;
    // Of each row held its number; the channels of one; lightness and places of chroma.
    std::vector<Index> kept_;
    std::vector<Byte> parted_, lightness_;
    std::vector<std::int16_t> places_;
    // Across, then along: slopes of a row, their sums along rows, sums and means over windows.
    std::vector<Byte> slopes_;
    std::vector<Sum> sums_, windows_;
    std::vector<Byte> means_;
};

// The class of n pixels' texture times 16. Classes go forth and back through the steps of one direction: those beside
// each other differ by one step, so that a window over them smooths what it should.
void take_classes(const Byte *__restrict across, const Byte *__restrict along, Index n, const Byte (&slopes)[3],
                  Byte *__restrict classes) {
    const Byte first = slopes[0], second = slopes[1], third = slopes[2];
    for (Index k = 0; k < n; k++) {
        const Byte one = Byte((across[k] > first) + (across[k] > second) + (across[k] > third));
        const Byte other = Byte((along[k] > first) + (along[k] > second) + (along[k] > third));
        classes[k] = Byte(16 * (4 * one + (other ^ (3 * (one & 1)))));
    }
}

void join_channels(const Byte *__restrict first, const Byte *__restrict second, const Byte *__restrict third,
                   Index n, Byte *__restrict joined) {
    for (Index k = 0; k < n; k++) {
        joined[3 * k] = first[k];
        joined[3 * k + 1] = second[k];
        joined[3 * k + 2] = third[k];
    }
}

}  // namespace

void mark_appearance(Array<const Byte, 3> image, Index x, Index y, const Appearances &appearances, bool grey,
                     Array<Byte, 3> looks) {
    if (looks.size() == 0) return;
    const Index width = looks.shape[1];
    Rows rows(image, x, y, width, appearances);
    std::vector<Byte> chroma(static_cast<std::size_t>(width)), classes(chroma.size());
    for (Index row = 0; row < looks.shape[0]; row++) {
        rows.go_to(y + row);
        const Byte *lightness = rows.lightness(), *across = rows.across(), *along = rows.along();
        if (grey) {
            join_channels(lightness, across, along, width, looks[row].data);
            continue;
        }
        const std::int16_t *places = rows.places();
        for (Index k = 0; k < width; k++) chroma[std::size_t(k)] = appearances.chroma[places[k]];
        take_classes(across, along, width, appearances.slopes, classes.data());
        join_channels(lightness, chroma.data(), classes.data(), width, looks[row].data);
    }
}

Index count_coloured(Array<const Byte, 3> image, Index spacing, Index level) {
    Index n = 0;
    for (Index y = 0; y < image.shape[0]; y += spacing)
        for (Index x = 0; x < image.shape[1]; x += spacing) {
            const Byte *pixel = &image(y, x, 0);
            const auto [darkest, brightest] = std::minmax({pixel[0], pixel[1], pixel[2]});
            n += brightest - darkest > level;
        }
    return n;
}

}  // namespace bodytrack::images
