#include "skins/depths.hpp"

#include <algorithm>
#include <cmath>

#include "lens.hpp"
#include "pictures/pixels.hpp"

namespace bodytrack::skins {

namespace {

// What comes closer to a camera than this is not drawn, metres; as other renderers have it.
constexpr float NEAREST_M = 0.05f;

// Share of a triangle by which it is drawn larger: no cell between two of them stays empty.
constexpr float SLACK = -0.01f;

// Which faces are seen from outside, given where the vertices are; all of a face is before the camera.
void find_front(const Mesh &mesh, View &view) {
    for (Index f = 0; f < mesh.faces.shape[0]; f++) {
        const float *p = view.seen_at(mesh.faces(f, 0)), *q = view.seen_at(mesh.faces(f, 1));
        const float *r = view.seen_at(mesh.faces(f, 2));
        const float one = (q[0] - p[0]) * (r[1] - p[1]), other = (q[1] - p[1]) * (r[0] - p[0]);
        view.front[f] = one < other && std::min({p[2], q[2], r[2]}) > 0.0f;
    }
}

// Draws a face, given where its corners are seen.
void draw(const float *p, const float *q, const float *r, View &view) {
    const float scale = float(1.0 / view.cell_px), most_x = float(view.columns - 1), most_y = float(view.rows - 1);
    const float x0 = p[0] * scale, y0 = p[1] * scale, z0 = p[2];
    const float x1 = q[0] * scale - x0, y1 = q[1] * scale - y0, x2 = r[0] * scale - x0, y2 = r[1] * scale - y0;
    const float z1 = q[2] - z0, z2 = r[2] - z0;
    const float left = x0 + std::min({x1, x2, 0.0f}), right = x0 + std::max({x1, x2, 0.0f});
    const float top = y0 + std::min({y1, y2, 0.0f}), bottom = y0 + std::max({y1, y2, 0.0f});
    if (!(right >= 0.0f && bottom >= 0.0f && left <= most_x && top <= most_y)) return;
    const Index low_x = pictures::first_pixel(left), high_x = pictures::last_pixel(right, view.columns);
    const Index low_y = pictures::first_pixel(top), high_y = pictures::last_pixel(bottom, view.rows);
    const float inverse = 1.0f / (x1 * y2 - y1 * x2), a_x = y2 * inverse, b_x = -y1 * inverse;
    for (Index i = low_y; i <= high_y; i++) {
        const float dy = float(i) - y0, a_0 = -dy * x2 * inverse, b_0 = dy * x1 * inverse;
        float *row = view.depths.data() + i * view.columns;
        for (Index j = low_x; j <= high_x; j++) {
            const float dx = float(j) - x0, a = a_0 + dx * a_x, b = b_0 + dx * b_x;
            if (a >= SLACK && b >= SLACK && a + b <= 1.0f - SLACK) row[j] = std::max(row[j], z0 + a * z1 + b * z2);
        }
    }
}

}  // namespace

View::View(const double *packed, double image_width, double image_height, double n_cells, const Mesh &mesh)
    : camera(packed), lens(packed, packed + rows::camera::N_COLUMNS), width(image_width), height(image_height),
      cell_px(std::max(width, height) / n_cells), rows(Index(height / cell_px) + 1), columns(Index(width / cell_px) + 1),
      depths(rows * columns), seen(3 * mesh.points.shape[0]), facing(mesh.points.shape[0]), front(mesh.faces.shape[0]) {}

void see_vertices(const float *points, const float *normals, Index n, const float *camera, float *seen, float *facing) {
    using namespace rows::camera;
    const Lens<float> lens(camera);
    for (Index i = 0; i < n; i++) {
        const float *point = points + 3 * i, *normal = normals + 3 * i;
        const float x = point[0], y = point[1], z = point[2];
        const float depth = camera[R31] * x + camera[R32] * y + camera[R33] * z + camera[TZ];
        const float inverse = 1.0f / std::max(depth, NEAREST_M);
        const float a = (camera[R11] * x + camera[R12] * y + camera[R13] * z + camera[TX]) * inverse;
        const float b = (camera[R21] * x + camera[R22] * y + camera[R23] * z + camera[TY]) * inverse;
        float u, v;
        bend(lens, a, b, u, v);
        seen[3 * i] = camera[FX] * u + camera[SHEAR] * v + camera[CX];
        seen[3 * i + 1] = camera[FY] * v + camera[CY];
        seen[3 * i + 2] = depth <= NEAREST_M || beyond_reach(camera, a, b) ? 0.0f : inverse;
        facing[i] = normal[0] * (camera[CENTRE_X] - x) + normal[1] * (camera[CENTRE_Y] - y) +
                    normal[2] * (camera[CENTRE_Z] - z);
    }
}

void draw_depths(const Mesh &mesh, Array<const float, 2> points, Array<const float, 2> normals, View &view) {
    see_vertices(points.data, normals.data, points.shape[0], view.lens.data(), view.seen.data(), view.facing.data());
    find_front(mesh, view);
    std::fill(view.depths.begin(), view.depths.end(), 0.0f);
    for (Index f = 0; f < mesh.faces.shape[0]; f++)
        if (view.front[f])
            draw(view.seen_at(mesh.faces(f, 0)), view.seen_at(mesh.faces(f, 1)), view.seen_at(mesh.faces(f, 2)), view);
}

}  // namespace bodytrack::skins
