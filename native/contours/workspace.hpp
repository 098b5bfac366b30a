// Samples and crossings of one part's contour while they are in work: numbers of one kind stand in a row of their own,
// so that the compiler sees that they are apart, and computes eight at a time.
#pragma once

namespace bodytrack::contours {

// So many numbers of a row are handled at a time; a power of 2.
constexpr int BLOCK = 32;

// Room for crossings or samples of one part: whole blocks; not a multiple of 1024, or all rows would share their cache
// lines.
constexpr int ROW = 33 * BLOCK;

// n rounded up to whole blocks; one by one, the rest would take most of the time.
constexpr int whole_blocks(int n) { return (n + BLOCK - 1) & ~(BLOCK - 1); }

static_assert(whole_blocks(ROW) == ROW, "a full row is whole blocks");

using Row = float[ROW];

// What other parts do to a sample.
enum State { FREE, TOUCHED, COVERED };

struct Spots {
    // pixel, unit image normal, contour length that a sample stands for, px
    alignas(64) Row u, v, nu, nv, length;
    // world point, metres; world normal
    Row x, y, z, nx, ny, nz;
    // of `State`
    Row state;
    // position in another part's frame in units of its half extents
    Row local_x, local_y, local_z;
    // by how much the viewing ray comes nearer than the other part's bounding ellipsoid, squared; -1 where the pixel is
    // too far from its axis
    Row meets;
    // by how much the sample lies within twice that ellipsoid, squared
    Row near;
};

// Where a contour crosses the edges of a surface grid.
struct Crossings {
    // both ends of half a grid edge, in the part's frame: place (metres) and normal of the surface there
    alignas(64) Row a[6], b[6];
    // facing of both ends; they differ in sign
    Row facing_a, facing_b;
    // the crossing in the world, metres, and its normal; pixel, and unit image normal
    Row x, y, z, nx, ny, nz, u, v, nu, nv;
    // length of each piece of contour (not of a crossing), px
    Row length;
};

}  // namespace bodytrack::contours
