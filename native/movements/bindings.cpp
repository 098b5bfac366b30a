#include "border.hpp"
#include "movements/warping.hpp"

namespace bodytrack {

void bind_movements(nb::module_ &module) {
    module.def(
        "direction_gaps",
        [](nb::handle queried, nb::handle known, nb::handle weights, nb::handle gaps) {
            const Input<float, 3> q(queried, "queried", {ANY, ANY, 3});
            const Input<float, 3> k(known, "known", {ANY, q.length(1), 3});
            const Input<float, 1> w(weights, "weights", {q.length(1)});
            const Output<float, 2> g(gaps, "gaps", {q.length(0), k.length(0)});
            unlocked([&] { movements::direction_gaps(*q, *k, *w, *g); });
        },
        named("queried"), named("known"), named("weights"), named("gaps"));
    module.def(
        "warp_sequence",
        [](nb::handle gaps, nb::handle first, nb::handle repeats, nb::handle slack, double unknown, double entry,
           nb::handle found) {
            const Input<float, 2> g(gaps, "gaps", {ANY, ANY});
            const Input<bool, 1> r(repeats, "repeats", {ANY});
            const Input<Index, 1> f(first, "first", {r.length(0) + 1});
            const Input<Index, 1> s(slack, "slack", {r.length(0)});
            const Output<Index, 2> out(found, "found", {g.length(0) + 1, 3});
            rising(*f, "first", g.length(1));
            return unlocked([&] { return movements::warp_sequence({*g, *f, *r, *s}, unknown, entry, *out); });
        },
        named("gaps"), named("first"), named("repeats"), named("slack"), nb::arg("unknown"), nb::arg("entry"),
        named("found"));
}

}  // namespace bodytrack
