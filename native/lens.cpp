#include "lens.hpp"

#include <algorithm>
#include <cmath>

namespace bodytrack {

namespace {

// Of Newton's method from the pixel itself, of that from a better start, of an interval to find this start in.
constexpr int STEPS = 8, MOST_STEPS = 20, HALVINGS = 60;

// In the plane z = 1: a solution is one if its last step was shorter; the end of lenses that have none.
constexpr double SETTLED = 1e-6, FARTHEST = 1e6;

// Moves a, b by n Newton steps at most to the point that the lens images at tx, ty; whether it is one.
bool stepped(const double *camera, double tx, double ty, double &a, double &b, int n) {
    const Lens<double> lens(camera);
    double da = 0.0, db = 0.0;
    for (int step = 0; step < n; step++) {
        const Bent<double> bent = bend_with_slopes(lens, a, b);
        const double ex = tx - bent.u, ey = ty - bent.v;
        if (ex == 0.0 && ey == 0.0) return !beyond_reach(camera, a, b);
        const double det = bent.aa * bent.bb - bent.ab * bent.ab;
        da = (bent.bb * ex - bent.ab * ey) / det;
        db = (bent.aa * ey - bent.ab * ex) / det;
        a += da;
        b += db;
    }
    return std::abs(da) < SETTLED && std::abs(db) < SETTLED && !beyond_reach(camera, a, b);
}

// How far from the axis is what the radial distortion images at a distance from it: by halving, within a reach.
double straightened(const double *camera, double distance, double reach) {
    Lens<double> radial(camera);
    radial.p1 = radial.p2 = 0.0;
    double low = 0.0, high = reach;
    for (int k = 0; k < HALVINGS; k++) {
        const double middle = (low + high) / 2;
        double u, v;
        bend(radial, middle, 0.0, u, v);
        (u < distance ? low : high) = middle;
    }
    return low;
}

}  // namespace

// What is next to where the lens turns back may be imaged beyond, where its slopes lead away: then steps begin at what
// the radial distortion alone images there. A contour lies up to a pixel beside what is seen: if the lens images nothing
// there, it is at the end of its reach.
void undistort(const double *camera, double x, double y, double &a, double &b) {
    using namespace rows::camera;
    const double ty = (y - camera[CY]) / camera[FY];
    const double tx = (x - camera[CX] - camera[SHEAR] * ty) / camera[FX];
    a = tx;
    b = ty;
    if (stepped(camera, tx, ty, a, b, STEPS)) return;
    const double distance = std::sqrt(tx * tx + ty * ty), reach = std::min(std::sqrt(camera[REACH2]), FARTHEST);
    const double straight = straightened(camera, distance, reach) / distance;
    a = straight * tx;
    b = straight * ty;
    if (stepped(camera, tx, ty, a, b, MOST_STEPS)) return;
    a = tx * reach / distance;
    b = ty * reach / distance;
}

}  // namespace bodytrack
