#include "images/linking.hpp"

#include <algorithm>
#include <cstring>

namespace bodytrack::images {

namespace {

// Columns and rows from a pixel to its neighbours, in the order in which a chain goes on: straight ones first.
constexpr int N_NEIGHBOURS = 8;
constexpr int RIGHT[N_NEIGHBOURS] = {1, 0, -1, 0, 1, -1, -1, 1};
constexpr int DOWN[N_NEIGHBOURS] = {0, 1, 0, -1, 1, 1, -1, -1};

// So many pixels at a time are passed over.
constexpr Index WORD = 8;

class Linking {
  public:
    Linking(Array<Byte, 2> edges, Pixels points) : flat_(edges.data), width_(edges.shape[1]), points_(points) {
        for (int k = 0; k < N_NEIGHBOURS; k++) to_[k] = DOWN[k] * width_ + RIGHT[k];
    }

    // Writes the chain through one pixel after what is there; its ends are looked for on both sides.
    void link(Index place) {
        const Index begin = n_;
        walk(place);
        const int k = next_neighbour(place);
        if (k < 0) return;
        for (Index low = begin, high = n_ - 1; low < high; low++, high--)
            for (int axis = 0; axis < 2; axis++) std::swap(points_(low, axis), points_(high, axis));
        walk(place + to_[k]);
    }

    Index n_points() const { return n_; }

  private:
    // Writes the pixels from one on in one direction, and clears them.
    void walk(Index place) {
        // once: dividing each place by the width would take as long as all else
        Index y = place / width_, x = place - y * width_;
        for (int k = 0; k >= 0;) {
            flat_[place] = 0;
            points_(n_, 0) = std::int32_t(x - 1);
            points_(n_++, 1) = std::int32_t(y - 1);
            k = next_neighbour(place);
            if (k < 0) return;
            place += to_[k];
            x += RIGHT[k];
            y += DOWN[k];
        }
    }

    // Number of the first unvisited neighbour; -1 if there is none.
    int next_neighbour(Index place) const {
        for (int k = 0; k < N_NEIGHBOURS; k++)
            if (flat_[place + to_[k]] != 0) return k;
        return -1;
    }

    Byte *flat_;
    Index width_, to_[N_NEIGHBOURS];
    Pixels points_;
    Index n_ = 0;
};

}  // namespace

Index link_edges(Array<Byte, 2> edges, const Chains &chains) {
    Linking linking(edges, chains.points);
    const Index size = edges.size();
    Index n_chains = 0;
    for (Index first = 0; first < size; first += WORD) {
        const Index end = std::min(first + WORD, size);
        std::uint64_t word = 1;
        if (end - first == WORD) std::memcpy(&word, edges.data + first, WORD);
        if (word == 0) continue;
        for (Index place = first; place < end; place++) {
            if (edges.data[place] == 0) continue;
            chains.starts[n_chains++] = std::int32_t(linking.n_points());
            linking.link(place);
        }
    }
    chains.starts[n_chains] = std::int32_t(linking.n_points());
    return n_chains;
}

}  // namespace bodytrack::images
