#include "contours/pieces.hpp"

#include <cmath>

#include "bits.hpp"
#include "lens.hpp"

namespace bodytrack::contours {

namespace {

// Columns of a node: place, normal, their product.
constexpr int NODE = 7;

// Facing of a part's first n grid points: n . (c - p), metres; positive where the camera sees the surface.
void face(const float *planes, int n, const Solid &solid, float *facing) {
    const float e0 = solid.camera[0], e1 = solid.camera[1], e2 = solid.camera[2];
    const float *nx = planes, *ny = nx + n, *nz = ny + n, *product = nz + n;
    for (int i = 0; i < n; i++) facing[i] = nx[i] * e0 + ny[i] * e1 + nz[i] * e2 - product[i];
}

// The signs of a row of facings as bits.
Bits signs(const float *facing, int n_columns) {
    Bits bits = 0;
    for (int c = 0; c < n_columns; c++) bits |= Bits(facing[c] > 0.0f) << c;
    return bits;
}

// Takes up crossing i: the half of a grid edge (first end, middle, second end) in which the facing changes.
void take(const float *first, const float *middle, const float *second, float f0, float f1, const Solid &solid,
          Crossings &crossings, int i) {
    const float facing = middle[3] * solid.camera[0] + middle[4] * solid.camera[1] + middle[5] * solid.camera[2] - middle[6];
    const bool late = (facing > 0.0f) == (f0 > 0.0f);
    const float *a = late ? middle : first, *b = late ? second : middle;
    crossings.facing_a[i] = late ? facing : f0;
    crossings.facing_b[i] = late ? f1 : facing;
    for (int k = 0; k < 6; k++) {
        crossings.a[k][i] = a[k];
        crossings.b[k][i] = b[k];
    }
}

// World point and normal of n crossings, and what the camera sees of them before its lens.
void place(Crossings &c, int n, const Solid &solid, const float *lens) {
    using namespace rows::camera;
    const Solid s = solid;
    float k[12];
    for (int i = 0; i < 12; i++) k[i] = lens[i];
    const auto &r = s.rotation;
    const int n_whole = whole_blocks(n);
    for (int i = 0; i < n_whole; i++) {
        const float f0 = c.facing_a[i], f1 = c.facing_b[i], t = f0 / (f0 - f1);
        float x = c.a[0][i], y = c.a[1][i], z = c.a[2][i], a = c.a[3][i], b = c.a[4][i], e = c.a[5][i];
        const float dx = c.b[0][i] - x, dy = c.b[1][i] - y, dz = c.b[2][i] - z;
        const float da = c.b[3][i] - a, db = c.b[4][i] - b, de = c.b[5][i] - e;
        const float height = 0.5f * t * (1.0f - t) * (da * dx + db * dy + de * dz);
        a += t * da;
        b += t * db;
        e += t * de;
        x += t * dx + height * a;
        y += t * dy + height * b;
        z += t * dz + height * e;
        const float wx = r[0][0] * x + r[0][1] * y + r[0][2] * z + s.position[0];
        const float wy = r[1][0] * x + r[1][1] * y + r[1][2] * z + s.position[1];
        const float wz = r[2][0] * x + r[2][1] * y + r[2][2] * z + s.position[2];
        const float nx = r[0][0] * a + r[0][1] * b + r[0][2] * e;
        const float ny = r[1][0] * a + r[1][1] * b + r[1][2] * e;
        const float nz = r[2][0] * a + r[2][1] * b + r[2][2] * e;
        c.x[i] = wx;
        c.y[i] = wy;
        c.z[i] = wz;
        c.nx[i] = nx;
        c.ny[i] = ny;
        c.nz[i] = nz;
        const float nearness = 1.0f / (k[R31] * wx + k[R32] * wy + k[R33] * wz + k[TZ]);
        c.u[i] = (k[R11] * wx + k[R12] * wy + k[R13] * wz + k[TX]) * nearness;
        c.v[i] = (k[R21] * wx + k[R22] * wy + k[R23] * wz + k[TY]) * nearness;
        c.nu[i] = k[R11] * nx + k[R12] * ny + k[R13] * nz;
        c.nv[i] = k[R21] * nx + k[R22] * ny + k[R23] * nz;
    }
}

// World point and normal, pixel and unit image normal of n crossings. The tangent plane of the contour passes through the
// camera and projects to the line K^-T J^-T n, J the slopes of the lens there.
void see(Crossings &c, int n, const Solid &solid, const float *camera) {
    using namespace rows::camera;
    place(c, n, solid, camera);
    const int n_whole = whole_blocks(n);
    const Lens<float> lens(camera);
    // in a loop of its own: views without distortion, most simulated ones, do without 4 % of the time of a pose
    if (lens.bends())
        for (int i = 0; i < n_whole; i++) {
            const Bent<float> bent = bend_with_slopes(lens, c.u[i], c.v[i]);
            const float e = c.nu[i], d = c.nv[i];
            c.u[i] = bent.u;
            c.v[i] = bent.v;
            c.nu[i] = bent.bb * e - bent.ab * d;
            c.nv[i] = bent.aa * d - bent.ab * e;
        }
    const float fx = camera[FX], fy = camera[FY], cx = camera[CX], cy = camera[CY], shear = camera[SHEAR];
    const float flat = fy / fx, slant = shear / fy;
    for (int i = 0; i < n_whole; i++) {
        const float u = c.u[i], v = c.v[i];
        c.u[i] = fx * u + shear * v + cx;
        c.v[i] = fy * v + cy;
        const float e = c.nu[i] * flat, d = c.nv[i] - slant * e;
        const float norm = 1.0f / std::sqrt(e * e + d * d);
        c.nu[i] = e * norm;
        c.nv[i] = d * norm;
    }
}

// Links the crossings of a cell, -1 where a side has none, two by two.
void join(const int (&met)[4], int (*links)[2]) {
    int waiting = -1;
    for (const int here : met) {
        if (here < 0) continue;
        if (waiting < 0) {
            waiting = here;
            continue;
        }
        links[waiting][links[waiting][0] < 0 ? 0 : 1] = here;
        links[here][links[here][0] < 0 ? 0 : 1] = waiting;
        waiting = -1;
    }
}

// Walks along the n linked crossings: pieces in the order of the contour, with their lengths; their number.
int chain(Tracing &work, int n) {
    Crossings &c = *work.crossings;
    auto &links = work.links;
    int n_pieces = 0;
    for (int first = 0; first < n; first++) {
        int before = -1, here = first;
        while (here >= 0 && links[here][0] != -2) {
            const int after = links[here][0] != before ? links[here][0] : links[here][1];
            links[here][0] = -2;
            if (after >= 0) {
                const float du = c.u[after] - c.u[here], dv = c.v[after] - c.v[here];
                work.pieces[n_pieces][0] = here;
                work.pieces[n_pieces][1] = after;
                c.length[n_pieces++] = std::sqrt(du * du + dv * dv);
            }
            before = here;
            here = after;
        }
    }
    return n_pieces;
}

// Takes up all crossings of a part and links them; their number.
int cross(const Grids &grids, Index p, const Solid &solid, Tracing &work) {
    const int n_rows = grids.n_rows, n_columns = grids.n_columns, wide = 2 * n_columns, last = n_columns - 1;
    const float *facing = work.facing.data(), *nodes = grids.nodes[p].data;
    const auto node = [nodes](int i) { return nodes + NODE * i; };
    int *ids[3];
    for (int k = 0; k < 3; k++) ids[k] = work.ids.data() + k * n_columns;
    Crossings &crossings = *work.crossings;
    const Bits everything = (Bits(1) << n_columns) - 1;
    // all points of a pole are one
    Bits above = facing[0] > 0.0f ? everything : 0, along_above = 0;
    int n = 0;
    for (int r = 1; r < n_rows; r++) {
        const float *here = facing + r * n_columns;
        const int start = 2 * r * wide;
        Bits row = signs(here, n_columns);
        if (r == n_rows - 1) row = here[0] > 0.0f ? everything : 0;
        if ((row == above && (row == 0 || row == everything)) || n + 2 * n_columns > ROW) {
            along_above = 0;
            above = row;
            continue;
        }
        int *own = ids[r & 1], *over = ids[1 - (r & 1)], *side = ids[2];
        const auto met = [&](int *kind, int c, int a, int b, int e, float f0, float f1) {
            take(node(a), node(b), node(e), f0, f1, solid, crossings, n);
            kind[c] = n;
            work.links[n][0] = work.links[n][1] = -1;
            n++;
        };
        const Bits along = row ^ rolled(row, n_columns), down = row ^ above;
        for (Bits left = along; left; left &= left - 1) {
            const int c = lowest_bit(left), after = c < last ? c + 1 : 0;
            met(own, c, start + 2 * c, start + 2 * c + 1, start + 2 * after, here[c], here[after]);
        }
        for (Bits left = down; left; left &= left - 1) {
            const int c = lowest_bit(left);
            met(side, c, start - 2 * wide + 2 * c, start - wide + 2 * c, start + 2 * c, here[c - n_columns], here[c]);
        }
        for (Bits left = along | along_above | down | rolled(down, n_columns); left; left &= left - 1) {
            const int c = lowest_bit(left), after = c < last ? c + 1 : 0;
            join({along_above >> c & 1 ? over[c] : -1, down >> after & 1 ? side[after] : -1,
                  along >> c & 1 ? own[c] : -1, down >> c & 1 ? side[c] : -1},
                 work.links);
        }
        above = row;
        along_above = along;
    }
    return n;
}

}  // namespace

Tracing::Tracing(const Grids &grids)
    : facing(size_t(grids.n_rows) * grids.n_columns), ids(size_t(3) * grids.n_columns), links{}, pieces{},
      crossings(std::make_unique<Crossings>()), spots(std::make_unique<Spots>()) {}

int find_pieces(const Grids &grids, Index p, const Solid &solid, const float *lens, Tracing &work) {
    face(grids.planes[p].data, grids.n_rows * grids.n_columns, solid, work.facing.data());
    const int n = cross(grids, p, solid, work);
    see(*work.crossings, n, solid, lens);
    return chain(work, n);
}

}  // namespace bodytrack::contours
