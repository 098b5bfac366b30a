#include "body/kinematics.hpp"

#include <algorithm>
#include <cmath>

namespace bodytrack::body {

namespace {

// Length of a motion (4, 4).
constexpr int MOTION = 16;

// A vector turned by a motion.
void turn(const double *motion, const double *vector, double *turned) {
    for (int r = 0; r < 3; r++)
        turned[r] = motion[4 * r] * vector[0] + motion[4 * r + 1] * vector[1] + motion[4 * r + 2] * vector[2];
}

// The rotation (3, 3) by an angle about an axis (Rodrigues).
void rotation_about(const double *axis, double angle, double (&r)[3][3]) {
    const double cosine = std::cos(angle), sine = std::sin(angle), rest = 1.0 - cosine;
    const double x = axis[0], y = axis[1], z = axis[2];
    r[0][0] = cosine + x * x * rest;
    r[0][1] = x * y * rest - z * sine;
    r[0][2] = x * z * rest + y * sine;
    r[1][0] = y * x * rest + z * sine;
    r[1][1] = cosine + y * y * rest;
    r[1][2] = y * z * rest - x * sine;
    r[2][0] = z * x * rest - y * sine;
    r[2][1] = z * y * rest + x * sine;
    r[2][2] = cosine + z * z * rest;
}

// The motion `before`, then a rotation about an axis through a point.
void rotate(const double *before, const double (&r)[3][3], const double *point, double *own) {
    double shift[3];
    for (int k = 0; k < 3; k++) shift[k] = point[k] - (r[k][0] * point[0] + r[k][1] * point[1] + r[k][2] * point[2]);
    for (int k = 0; k < 3; k++) {
        const double *b = before + 4 * k;
        for (int c = 0; c < 3; c++) own[4 * k + c] = b[0] * r[0][c] + b[1] * r[1][c] + b[2] * r[2][c];
        own[4 * k + 3] = b[0] * shift[0] + b[1] * shift[1] + b[2] * shift[2] + b[3];
    }
}

}  // namespace

void chain_transforms(Array<const double, 2> poses, const Chain &chain, Array<double, 4> motions) {
    const Index dof = chain.dof();
    std::fill_n(motions.data, motions.size(), 0.0);
    for (Index b = 0; b < poses.shape[0]; b++) {
        double *of_pose = motions[b].data;
        for (int k = 0; k < 4; k++) of_pose[dof * MOTION + 5 * k] = 1.0;
        for (Index i = 0; i < dof; i++) {
            const double *before = of_pose + chain.before(i) * MOTION, *axis = chain.axes[i].data;
            double *own = of_pose + i * MOTION;
            const double value = poses(b, i);
            if (chain.rotates[i]) {
                double r[3][3];
                rotation_about(axis, value, r);
                rotate(before, r, chain.points[i].data, own);
            } else {
                double along[3];
                turn(before, axis, along);
                std::copy_n(before, 12, own);
                for (int r = 0; r < 3; r++) own[4 * r + 3] += value * along[r];
            }
            own[15] = 1.0;
        }
    }
}

void twists_in_world(Array<const double, 4> motions, const Chain &chain, Array<double, 3> twists) {
    for (Index b = 0; b < motions.shape[0]; b++)
        for (Index i = 0; i < chain.dof(); i++) {
            const double *before = motions[b][chain.before(i)].data, *axis = chain.axes[i].data;
            double *v = twists[b][i].data, *w = v + 3;
            if (!chain.rotates[i]) {
                turn(before, axis, v);
                std::fill_n(w, 3, 0.0);
                continue;
            }
            double place[3];
            turn(before, axis, w);
            turn(before, chain.points[i].data, place);
            for (int r = 0; r < 3; r++) place[r] += before[4 * r + 3];
            v[0] = place[1] * w[2] - place[2] * w[1];
            v[1] = place[2] * w[0] - place[0] * w[2];
            v[2] = place[0] * w[1] - place[1] * w[0];
        }
}

}  // namespace bodytrack::body
