#include "contours/occlusion.hpp"

#include <algorithm>
#include <cmath>

namespace bodytrack::contours {

namespace {

// In place of 1 / 0.
constexpr float HUGE_INVERSE = 1e30f;

// Narrows a ray between low and high to what is inside the slab from -side to side.
void clip(float origin, float direction, float side, float &low, float &high) {
    const float inverse = direction != 0.0f ? 1.0f / direction : HUGE_INVERSE;
    const float enter = (-side - origin) * inverse, leave = (side - origin) * inverse;
    low = std::max(low, std::min(enter, leave));
    high = std::min(high, std::max(enter, leave));
}

// How n samples stand to a part: fills local_x to near of the samples, eight at a time.
void approach(const Solid &part, Spots &spots, int n) {
    const Solid s = part;
    const float ox = s.eye[0], oy = s.eye[1], oz = s.eye[2];
    const int n_whole = whole_blocks(n);
    for (int i = 0; i < n_whole; i++) {
        float x = spots.u[i] - s.start_u, y = spots.v[i] - s.start_v;
        const float t = std::min(std::max(x * s.share_u + y * s.share_v, 0.0f), 1.0f);
        x -= t * s.axis_u;
        y -= t * s.axis_v;
        const float beyond = x * x + y * y - s.width2;
        float z;
        in_part(s, spots.x[i], spots.y[i], spots.z[i], x, y, z);
        spots.local_x[i] = x;
        spots.local_y[i] = y;
        spots.local_z[i] = z;
        const float near = 4.0f * s.reach - (x * x + y * y + z * z);
        const float dx = x - ox, dy = y - oy, dz = z - oz;
        const float cx = oy * dz - oz * dy, cy = oz * dx - ox * dz, cz = ox * dy - oy * dx;
        const float gap = s.reach - (cx * cx + cy * cy + cz * cz) / (dx * dx + dy * dy + dz * dz);
        spots.near[i] = beyond < 0.0f ? near : -1.0f;
        spots.meets[i] = beyond < 0.0f ? gap : -1.0f;
    }
}

// Whether the point at distance contact_m on the outer side of a sample lies in a part.
bool touches(const Solid &s, const Spots &spots, int i, float apart) {
    const float nx = spots.nx[i], ny = spots.ny[i], nz = spots.nz[i];
    return inside_value(s, spots.local_x[i] + apart * (s.m[0][0] * nx + s.m[0][1] * ny + s.m[0][2] * nz),
                        spots.local_y[i] + apart * (s.m[1][0] * nx + s.m[1][1] * ny + s.m[1][2] * nz),
                        spots.local_z[i] + apart * (s.m[2][0] * nx + s.m[2][1] * ny + s.m[2][2] * nz)) < 1.0f;
}

}  // namespace

double beside(const Solid &part, double u, double v) {
    double x = u - part.start_u, y = v - part.start_v;
    const double t = std::min(std::max(x * part.share_u + y * part.share_v, 0.0), 1.0);
    x -= t * part.axis_u;
    y -= t * part.axis_v;
    return x * x + y * y;
}

// In the image both are axes with a width. Axes that cross are near; else the least distance is at an end of one.
void neighbours(Index p, const Solids &solids, const bool *covering, double radius, std::vector<Index> &listed) {
    listed.clear();
    const Solid &own = solids[p];
    const float u0 = own.start_u, v0 = own.start_v, du = own.axis_u, dv = own.axis_v, width = std::sqrt(own.width2);
    for (Index q = 0; q < Index(solids.size()); q++) {
        const Solid &other = solids[q];
        if (!covering[q] || q == p || other.least_u > own.most_u || other.most_u < own.least_u ||
            other.least_v > own.most_v || other.most_v < own.least_v)
            continue;
        if (other.nearest < 0.0f || other.nearest > own.nearest + 2.0 * radius + 0.1) continue;
        const float x = other.start_u - u0, y = other.start_v - v0, eu = other.axis_u, ev = other.axis_v;
        const float both = width + std::sqrt(other.width2), near = both * both;
        float cross = du * ev - dv * eu, along_own = x * ev - y * eu, along_other = x * dv - y * du;
        if (cross < 0.0f) {
            cross = -cross;
            along_own = -along_own;
            along_other = -along_other;
        }
        const bool crossing = 0.0f <= along_own && along_own <= cross && 0.0f <= along_other && along_other <= cross;
        if (crossing || beside(other, u0, v0) < near || beside(other, u0 + du, v0 + dv) < near ||
            beside(own, u0 + x, v0 + y) < near || beside(own, u0 + x + eu, v0 + y + ev) < near)
            listed.push_back(q);
    }
}

// The ray is clipped to the part's bounding ellipsoid and box. Where it comes nearest to the centre, in units of the half
// extents, the inside-outside function is close to its least value along the ray; there and half-way to both ends of what
// is left of the ray it is evaluated.
bool blocks_ray(const Solid &s, float x, float y, float z) {
    const float ox = s.eye[0], oy = s.eye[1], oz = s.eye[2], dx = x - ox, dy = y - oy, dz = z - oz;
    const float length2 = dx * dx + dy * dy + dz * dz;
    const float along = -(ox * dx + oy * dy + oz * dz) / length2;
    const float nx = ox + along * dx, ny = oy + along * dy, nz = oz + along * dz;
    const float gap = s.reach - (nx * nx + ny * ny + nz * nz);
    if (gap <= 0.0f) return false;
    const float half = std::sqrt(gap / length2);
    float low = along - half, high = std::min(along + half, 1.0f);
    if (high <= low) return false;
    clip(ox, dx, 1.0f + std::fabs(s.k1), low, high);
    clip(oy, dy, 1.0f + std::fabs(s.k2), low, high);
    clip(oz, dz, 1.0f, low, high);
    if (high <= low) return false;
    const float middle = std::min(std::max(along, low), high);
    for (const float t : {middle, 0.5f * (low + middle), 0.5f * (middle + high)})
        if (inside_value(s, ox + t * dx, oy + t * dy, oz + t * dz) < 1.0f) return true;
    return false;
}

void cover(const Solid &part, double contact_m, Spots &spots, int n) {
    approach(part, spots, n);
    const float apart = float(contact_m);
    for (int i = 0; i < n; i++) {
        const bool meets = spots.meets[i] > 0.0f, near = spots.near[i] > 0.0f;
        if (!(meets || near) || spots.state[i] == COVERED) continue;
        if (meets && blocks_ray(part, spots.local_x[i], spots.local_y[i], spots.local_z[i]))
            spots.state[i] = COVERED;
        else if (near && spots.state[i] == FREE && touches(part, spots, i, apart))
            spots.state[i] = TOUCHED;
    }
}

}  // namespace bodytrack::contours
