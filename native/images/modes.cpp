#include "images/modes.hpp"

#include <algorithm>
#include <cstdlib>

namespace bodytrack::images {

namespace {

constexpr int N_CHANNELS = 3;

// The colours of one pixel in all pictures, one array a channel.
struct Colours {
    Byte of[N_CHANNELS][MOST_PICTURES];
    int n;

    // Whether two pictures show the same colour.
    bool near(int i, int j, int reach) const {
        int most = 0;
        for (int c = 0; c < N_CHANNELS; c++) most = std::max(most, std::abs(int(of[c][i]) - int(of[c][j])));
        return most <= reach;
    }

    // How many pictures show the colour of one.
    int n_near(int i, int reach) const {
        int agree = 0;
        for (int j = 0; j < n; j++) agree += near(i, j, reach);
        return agree;
    }

    // Mean of those that show the colour of one, which are so many.
    Byte mean(int c, int chosen, int agree, int reach) const {
        int total = 0;
        for (int j = 0; j < n; j++)
            if (near(chosen, j, reach)) total += of[c][j];
        return Byte((2 * total + agree) / (2 * agree));
    }
};

}  // namespace

void dominant_modes(Array<const Byte, 4> pile, Index reach, Array<Byte, 3> plate,
                    Array<Byte, 2> counts, Array<Byte, 2> rivals) {
    const int near = int(reach);
    Colours colours;
    colours.n = int(pile.shape[0]);
    const int n = colours.n;
    for (Index pixel = 0; pixel < counts.size(); pixel++) {
        for (int i = 0; i < n; i++)
            for (int c = 0; c < N_CHANNELS; c++)
                colours.of[c][i] = pile.data[(i * counts.size() + pixel) * N_CHANNELS + c];
        int best = 0, chosen = 0, rival = 0;
        for (int i = 0; i < n && 2 * best <= n; i++) {
            const int agree = colours.n_near(i, near);
            if (agree > best) {
                best = agree;
                chosen = i;
            }
        }
        for (int i = 0; i < n && best + rival < n; i++)
            if (!colours.near(chosen, i, 2 * near)) rival = std::max(rival, colours.n_near(i, near));
        counts.data[pixel] = Byte(best);
        rivals.data[pixel] = Byte(rival);
        for (int c = 0; c < N_CHANNELS; c++)
            plate.data[pixel * N_CHANNELS + c] = colours.mean(c, chosen, best, near);
    }
}

}  // namespace bodytrack::images
