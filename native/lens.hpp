// The lens: from the plane z = 1 of a camera to what its distortion makes of it.
//
// Radial distortion is a quotient of polynomials, decentring is Brown's, as in OpenCV's model of eight numbers:
// x (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 + k6 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2), and so for y with p1
// and p2 exchanged. Lenses of few millimetres need the denominator; with k4 = k5 = k6 = 0 it divides by 1, exactly.
#pragma once
#include "rows.hpp"

namespace bodytrack {

template <class T>
struct Lens {
    T k1, k2, p1, p2, k3, k4, k5, k6;

    Lens(T k1, T k2, T p1, T p2, T k3, T k4, T k5, T k6)
        : k1(k1), k2(k2), p1(p1), p2(p2), k3(k3), k4(k4), k5(k5), k6(k6) {}

    // Of a packed camera in the same precision.
    explicit Lens(const T *camera)
        : k1(camera[rows::camera::K1]), k2(camera[rows::camera::K2]), p1(camera[rows::camera::P1]),
          p2(camera[rows::camera::P2]), k3(camera[rows::camera::K3]), k4(camera[rows::camera::K4]),
          k5(camera[rows::camera::K5]), k6(camera[rows::camera::K6]) {}

    // Whether it does anything at all.
    bool bends() const {
        return k1 != 0 || k2 != 0 || k3 != 0 || k4 != 0 || k5 != 0 || k6 != 0 || p1 != 0 || p2 != 0;
    }
};

// Where a lens images a point of the plane z = 1, in the same plane.
template <class T>
inline void bend(const Lens<T> &lens, T a, T b, T &u, T &v) {
    const T r2 = a * a + b * b;
    const T radial = (1 + r2 * (lens.k1 + r2 * (lens.k2 + r2 * lens.k3))) /
                     (1 + r2 * (lens.k4 + r2 * (lens.k5 + r2 * lens.k6)));
    u = a * radial + 2 * lens.p1 * a * b + lens.p2 * (r2 + 2 * a * a);
    v = b * radial + lens.p1 * (r2 + 2 * b * b) + 2 * lens.p2 * a * b;
}

template <class T>
struct Bent {
    T u, v;
    // derivatives: of u by a; of u by b, which is that of v by a; of v by b
    T aa, ab, bb;
};

// `bend`, and its derivatives.
template <class T>
inline Bent<T> bend_with_slopes(const Lens<T> &lens, T a, T b) {
    const T r2 = a * a + b * b;
    const T under = 1 / (1 + r2 * (lens.k4 + r2 * (lens.k5 + r2 * lens.k6)));
    const T radial = (1 + r2 * (lens.k1 + r2 * (lens.k2 + r2 * lens.k3))) * under;
    const T slope = 2 * under * (lens.k1 + r2 * (2 * lens.k2 + r2 * 3 * lens.k3) -
                                 radial * (lens.k4 + r2 * (2 * lens.k5 + r2 * 3 * lens.k6)));
    const T pull = 2 * (lens.p1 * b + lens.p2 * a);
    return {a * radial + 2 * lens.p1 * a * b + lens.p2 * (r2 + 2 * a * a),
            b * radial + lens.p1 * (r2 + 2 * b * b) + 2 * lens.p2 * a * b,
            radial + a * a * slope + pull + 4 * lens.p2 * a,
            a * b * slope + 2 * (lens.p1 * a + lens.p2 * b),
            radial + b * b * slope + pull + 4 * lens.p1 * b};
}

// Whether a point of the plane z = 1 is so far from the axis that the lens of a packed camera does not image it.
template <class T>
inline bool beyond_reach(const T *camera, T a, T b) {
    return a * a + b * b > camera[rows::camera::REACH2];
}

// Coordinates of a pixel in the plane z = 1; the twin is `Lens.undistort_clamped`.
void undistort(const double *camera, double x, double y, double &a, double &b);

}  // namespace bodytrack
