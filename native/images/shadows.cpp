#include "images/shadows.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "images/texture.hpp"

namespace bodytrack::images {

namespace {

// Half the distance over which the ratio's slope is taken, px.
constexpr Index STEP = 2;

// A region is an object or a shadow as a whole where so much of its outline is sharp or hardly any is; else, when
// clothes and their shadow look alike and meet, each part of it is what the outline beside it is.
constexpr double MOSTLY = 0.5, HARDLY = 0.2;

// What a pixel is taken for while the image is classified.
enum Class : Byte { UNCHANGED, OBJECT, UNDECIDED, SHADOW, REGION, SHARP_REGION };

// The smoothed image of an area and the plate behind it; pixels are counted from the area's corner.
struct Pair {
    Array<const Byte, 3> now, plate;
    Index x, y;

    // Sums over the channels of image times plate and of plate times plate.
    struct Products {
        const Byte *now, *before;
        float both = 0.0f, square = 0.0f;
    };

    Products products(Index column, Index row) const {
        Products sums{&now(row + MARGIN, column + MARGIN, 0), &plate(row + MARGIN + y, column + MARGIN + x, 0)};
        for (int c = 0; c < 3; c++) {
            const float a = sums.now[c], b = sums.before[c];
            sums.both += a * b;
            sums.square += b * b;
        }
        sums.square = std::max(sums.square, 1.0f);
        return sums;
    }

    // Share of the plate's light that is left, by least squares over the channels.
    double ratio(Index column, Index row) const {
        const Products sums = products(column, row);
        return sums.both / sums.square;
    }

    // Share of the light that is left if the pixel may be a shadow, else 0.
    double shadow_ratio(Index column, Index row, const ShadowRule &rule) const {
        const Products sums = products(column, row);
        const double square = sums.square;
        if (!(rule.least * square < sums.both && sums.both < rule.most * square)) return 0.0;
        for (int c = 0; c < 3; c++)
            if (std::abs(sums.now[c] * sums.square - sums.before[c] * sums.both) >= rule.chroma * square) return 0.0;
        return sums.both / sums.square;
    }

    // Slope of the ratio of the light, 1/px.
    double slope(Index column, Index row) const {
        const double across = ratio(column + STEP, row) - ratio(column - STEP, row);
        const double down = ratio(column, row + STEP) - ratio(column, row - STEP);
        return std::sqrt(across * across + down * down) / (2 * STEP);
    }
};

// Regions of undecided pixels, each of which its outline decides.
class Regions {
  public:
    Regions(const Pair &pair, const ShadowRule &rule, Array<Byte, 2> mask)
        : pair_(pair), rule_(rule), mask_(mask), height_(mask.shape[0]), width_(mask.shape[1]) {}

    // Finds the 4-connected undecided region around a pixel and decides it by its outline.
    void judge(Index start) {
        const double mean = collect(start);
        // the ratio rises over the width of the outline from the region's to 1
        const double steepest = (1.0 - mean) / rule_.outline_px;
        border_.clear();
        Index n_sharp = 0;
        for (const Index place : queue_) {
            const Index x = place % width_, y = place / width_;
            if (!at_outline(x, y)) continue;
            const bool sharp = beside_object(x, y) || pair_.slope(x, y) > steepest;
            border_.push_back({place, sharp});
            n_sharp += sharp;
        }
        const double n = double(border_.size());
        if (double(n_sharp) >= MOSTLY * n) decide(SHARP_REGION);
        else if (double(n_sharp) < HARDLY * n) decide(SHADOW);
        else divide();
    }

  private:
    struct Border {
        Index place;
        bool sharp;
    };

    // Calls with the places of the four neighbours that lie inside the area.
    template <class Visit>
    void each_neighbour(Index place, Visit visit) const {
        const Index x = place % width_;
        if (x + 1 < width_) visit(place + 1);
        if (x > 0) visit(place - 1);
        if (place + width_ < mask_.size()) visit(place + width_);
        if (place >= width_) visit(place - width_);
    }

    // Puts the region around a pixel into the queue; mean share of the light that is left.
    double collect(Index start) {
        queue_.assign(1, start);
        mask_.data[start] = REGION;
        double total = 0.0;
        for (std::size_t i = 0; i < queue_.size(); i++) {
            total += pair_.ratio(queue_[i] % width_, queue_[i] / width_);
            spread(i, UNDECIDED, REGION);
        }
        return total / double(queue_.size());
    }

    // Puts the neighbours of a class around a place of the queue behind it, as another class.
    void spread(std::size_t i, Class from, Class to) {
        each_neighbour(queue_[i], [&](Index place) {
            if (mask_.data[place] != from) return;
            mask_.data[place] = to;
            queue_.push_back(place);
        });
    }

    void decide(Class verdict) {
        for (const Index place : queue_) mask_.data[place] = verdict;
    }

    // Every pixel of the region is taken for what the outline is where it is nearest.
    void divide() {
        queue_.clear();
        for (const Border &border : border_) {
            queue_.push_back(border.place);
            mask_.data[border.place] = border.sharp ? SHARP_REGION : SHADOW;
        }
        for (std::size_t i = 0; i < queue_.size(); i++) spread(i, REGION, Class(mask_.data[queue_[i]]));
    }

    // Whether one of the four neighbours lies outside of the region.
    bool at_outline(Index x, Index y) const {
        if (x == 0 || y == 0 || x == width_ - 1 || y == height_ - 1) return true;
        return mask_(y, x - 1) != REGION || mask_(y, x + 1) != REGION || mask_(y - 1, x) != REGION ||
               mask_(y + 1, x) != REGION;
    }

    // Whether one of the eight neighbours is surely an object.
    bool beside_object(Index x, Index y) const {
        for (Index v = std::max(y - 1, Index(0)); v < std::min(y + 2, height_); v++)
            for (Index u = std::max(x - 1, Index(0)); u < std::min(x + 2, width_); u++)
                if (mask_(v, u) == OBJECT) return true;
        return false;
    }

    const Pair &pair_;
    const ShadowRule &rule_;
    Array<Byte, 2> mask_;
    Index height_, width_;
    std::vector<Index> queue_;
    std::vector<Border> border_;
};

}  // namespace

// A shadow is the plate darkened alike in all channels. Such a pixel is a shadow where the plate's texture still shows
// or where it is hardly darker. The others, where a smooth floor and smooth clothes look the same, are judged region by
// region by their outline: the light returns softly at the border of a shadow, within 4 px at the border of an object
// (camera and smoothing).
void without_shadows(Array<const Byte, 3> now, Array<const Byte, 3> plate, Index x, Index y,
                     Array<const Byte, 2> moving, const ShadowRule &rule, Array<Byte, 2> mask) {
    const Pair pair{now, plate, x, y};
    Texture texture(now, plate, x, y);
    std::vector<Index> undecided;
    for (Index row = 0; row < mask.shape[0]; row++)
        for (Index column = 0; column < mask.shape[1]; column++) {
            Byte &taken = mask(row, column);
            taken = UNCHANGED;
            if (moving(row, column) == 0) continue;
            const double ratio = pair.shadow_ratio(column, row, rule);
            if (ratio <= 0.0) taken = OBJECT;
            else if (ratio > rule.least_smooth) taken = SHADOW;
            else if (texture.correlation(column + MARGIN, row + MARGIN) > rule.texture) taken = SHADOW;
            else {
                taken = UNDECIDED;
                undecided.push_back(row * mask.shape[1] + column);
            }
        }
    Regions regions(pair, rule, mask);
    for (const Index place : undecided)
        if (mask.data[place] == UNDECIDED) regions.judge(place);
    for (Index i = 0; i < mask.size(); i++) mask.data[i] = mask.data[i] == OBJECT || mask.data[i] == SHARP_REGION;
}

}  // namespace bodytrack::images
