#include "adjustment/ray_intersection.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "projection.hpp"

namespace bodytrack::adjustment {

namespace {

// A bound: from the linear intersection each Newton step doubles the digits.
constexpr int MOST_STEPS = 10;

// Far below any measurement, far above rounding.
constexpr double SMALL_STEP_M = 1e-8;

constexpr double NOWHERE = std::numeric_limits<double>::quiet_NaN(), FAR = std::numeric_limits<double>::infinity();

// Image of a point with its derivatives by the position; the twins are `Camera.project(_jacobian)`.
struct Seen {
    double u = 0.0, v = 0.0, slopes[2][3] = {};
    bool before = false;

    Seen(const double *camera, const double *point) {
        using namespace rows::camera;
        const Point p = bodytrack::in_camera(camera, point[0], point[1], point[2]);
        if (!(p.z > 1e-9)) return;
        before = true;
        const double a = p.x / p.z, b = p.y / p.z;
        const Bent<double> bent = bend_with_slopes(Lens<double>(camera), a, b);
        const double fx = camera[FX], fy = camera[FY], shear = camera[SHEAR];
        const double ua = fx * bent.aa + shear * bent.ab, ub = fx * bent.ab + shear * bent.bb;
        const double va = fy * bent.ab, vb = fy * bent.bb, uz = -(ua * a + ub * b), vz = -(va * a + vb * b);
        for (int k = 0; k < 3; k++) {
            slopes[0][k] = (ua * camera[R11 + k] + ub * camera[R21 + k] + uz * camera[R31 + k]) / p.z;
            slopes[1][k] = (va * camera[R11 + k] + vb * camera[R21 + k] + vz * camera[R31 + k]) / p.z;
        }
        u = fx * bent.u + shear * bent.v + camera[CX];
        v = fy * bent.v + camera[CY];
    }
};

// The normal equations of one point, the sum of its squared residuals, px^2, and how many views show it; none where it
// lies behind one of them.
struct Equations {
    double normal[3][3] = {}, right[3] = {}, squares = 0.0;
    Index n_views = 0;

    Equations(const Images &images, Index k, const double *point) {
        for (Index v = 0; v < images.cameras.shape[0]; v++) {
            const double *pixel = &images.pixels(v, k, 0), *variance = &images.variances(v, k, 0);
            const double xx = variance[0], yy = variance[1], xy = variance[2], determinant = xx * yy - xy * xy;
            if (!(std::isfinite(pixel[0]) && determinant > 0.0)) continue;
            const Seen seen(images.cameras[v].data, point);
            if (!seen.before) {
                n_views = 0;
                return;
            }
            const double dx = pixel[0] - seen.u, dy = pixel[1] - seen.v;
            const double wxx = yy / determinant, wyy = xx / determinant, wxy = -xy / determinant;
            for (int i = 0; i < 3; i++) {
                const double gx = wxx * seen.slopes[0][i] + wxy * seen.slopes[1][i];
                const double gy = wxy * seen.slopes[0][i] + wyy * seen.slopes[1][i];
                right[i] += gx * dx + gy * dy;
                for (int j = 0; j < 3; j++) normal[i][j] += gx * seen.slopes[0][j] + gy * seen.slopes[1][j];
            }
            squares += dx * dx + dy * dy;
            n_views++;
        }
    }
};

// Inverse of a symmetric matrix; false for a singular one.
bool invert(const double (&m)[3][3], double (&out)[3][3]) {
    out[0][0] = m[1][1] * m[2][2] - m[1][2] * m[1][2];
    out[0][1] = out[1][0] = m[0][2] * m[1][2] - m[0][1] * m[2][2];
    out[0][2] = out[2][0] = m[0][1] * m[1][2] - m[0][2] * m[1][1];
    out[1][1] = m[0][0] * m[2][2] - m[0][2] * m[0][2];
    out[1][2] = out[2][1] = m[0][1] * m[0][2] - m[0][0] * m[1][2];
    out[2][2] = m[0][0] * m[1][1] - m[0][1] * m[0][1];
    const double determinant = m[0][0] * out[0][0] + m[0][1] * out[0][1] + m[0][2] * out[0][2];
    const double size = (m[0][0] + m[1][1] + m[2][2]) / 3.0;
    if (!(determinant > 1e-14 * size * size * size)) return false;
    for (auto &row : out)
        for (double &value : row) value /= determinant;
    return true;
}

// Moves a point to where its rays meet, and fills its inverse normal matrix; false where fewer than two do.
bool meet(const Images &images, Index k, double *point, double (&inverse)[3][3]) {
    for (int n = 0; n < MOST_STEPS; n++) {
        const Equations of(images, k, point);
        if (of.n_views < 2 || !invert(of.normal, inverse)) return false;
        double step2 = 0.0;
        for (int i = 0; i < 3; i++) {
            const double step = inverse[i][0] * of.right[0] + inverse[i][1] * of.right[1] + inverse[i][2] * of.right[2];
            point[i] += step;
            step2 += step * step;
        }
        if (step2 < SMALL_STEP_M * SMALL_STEP_M) break;
    }
    return true;
}

}  // namespace

void intersect_rays(const Images &images, Array<double, 2> points, Array<double, 3> covariances,
                    Array<double, 1> residuals) {
    for (Index k = 0; k < points.shape[0]; k++) {
        double inverse[3][3];
        double *point = points[k].data, *covariance = covariances[k].data;
        if (!meet(images, k, point, inverse)) {
            std::fill_n(point, 3, NOWHERE);
            std::fill_n(covariance, 9, NOWHERE);
            residuals[k] = FAR;
            continue;
        }
        const Equations of(images, k, point);
        std::copy_n(&inverse[0][0], 9, covariance);
        residuals[k] = std::sqrt((of.n_views > 0 ? of.squares : FAR) / double(2 * of.n_views));
    }
}

}  // namespace bodytrack::adjustment
