#include "skins/mesh.hpp"

namespace bodytrack::skins {

void pose_mesh(const Mesh &mesh, Array<const float, 3> motions, Array<float, 2> points, Array<float, 2> normals) {
    for (Index i = 0; i < mesh.points.shape[0]; i++) {
        const float *place = mesh.points[i].data, *normal = mesh.normals[i].data, *weights = mesh.weights[i].data;
        const Index *bones = mesh.bones[i].data;
        for (int j = 0; j < 3; j++) {
            float moved = 0.0f, turned = 0.0f;
            for (Index k = 0; k < mesh.bones.shape[1] && weights[k] > 0.0f; k++) {
                const float *m = &motions(bones[k], j, 0);
                moved += weights[k] * (m[0] * place[0] + m[1] * place[1] + m[2] * place[2] + m[3]);
                turned += weights[k] * (m[0] * normal[0] + m[1] * normal[1] + m[2] * normal[2]);
            }
            points(i, j) = moved;
            normals(i, j) = turned;
        }
    }
}

void motions_of(Array<const double, 3> placements, Array<const double, 3> part_from_rest, Array<float, 3> motions) {
    for (Index p = 0; p < placements.shape[0]; p++)
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 4; j++) {
                double total = 0.0;
                for (int k = 0; k < 4; k++) total += placements(p, i, k) * part_from_rest(p, k, j);
                motions(p, i, j) = float(total);
            }
}

}  // namespace bodytrack::skins
