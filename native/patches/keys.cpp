#include "patches/keys.hpp"

#include <algorithm>

namespace bodytrack::patches {

void cut_keys(const SplineImage &image, Array<const Index, 2> centres, Index half, Array<float, 2> keys,
              Array<bool, 1> inside) {
    const Index side = key_side(half), reach = side / 2;
    for (Index k = 0; k < centres.shape[0]; k++) {
        const Index x = centres(k, 0), y = centres(k, 1);
        inside[k] = x >= reach && y >= reach && x < image.width - reach && y < image.height - reach;
        for (Index j = 0; inside[k] && j < side; j++)
            std::copy_n(image.flat + (y - reach + j) * image.width + x - reach, side, &keys(k, j * side));
    }
}

void match_keys(Array<const float, 2> keys, Array<const Index, 1> which, const SplineImage &search,
                Array<double, 2> found, Array<Index, 1> ended, const Rule &rule, const Noise &noise) {
    const Index side = key_side(rule.half);
    const double at[2] = {double(side / 2), double(side / 2)};
    Workspace work(rule.half, noise.taps.size());
    for (Index k = 0; k < which.size(); k++)
        ended[k] = match_patch({{keys[which[k]].data, side, side}, search}, at, found[k].data, rule, noise, work);
}

}  // namespace bodytrack::patches
