// The contour of the smooth surface that a mesh stands for, face by face.
//
// The contour of a smooth surface is where its normal is perpendicular to the line of sight. On a mesh with a normal at each
// vertex that is a line across the faces whose corners differ in facing (A. Hertzmann, D. Zorin, Illustrating smooth
// surfaces, SIGGRAPH 2000): unlike the edges between front and back faces it does not zigzag, so that its normals are those
// of the surface. Between the vertices the surface is bent by the turn of their normals, as the superquadric tracer does it
// (contours/tracing).
#pragma once
#include "array.hpp"

namespace bodytrack::skins {

// A place of a surface in the world, metres, and the normal there.
struct Surface {
    double point[3], normal[3];
};

// Points and normals (N, 3) of a posed mesh, and whether they face the camera (N,).
struct Posed {
    Array<const float, 2> points, normals;
    const float *facing;
};

// Whether the surface of a face p, q, r turns away from a packed camera along the line of sight; on a hollow it turns to it.
bool turns_away(const Posed &posed, Index p, Index q, Index r, const double *camera);

// Where the contour crosses an edge i, j: point and unit normal of the surface bent between its ends.
Surface cross_edge(const Posed &posed, Index i, Index j);

// Point and normal of the surface at a share t of the way between two crossings.
Surface bent(const Surface &one, const Surface &other, double t);

// Unit image normal of a contour: perpendicular to the image of its tangent, which is to normal and sight.
void image_normal(const double *camera, const Surface &at, double &nu, double &nv);

}  // namespace bodytrack::skins
