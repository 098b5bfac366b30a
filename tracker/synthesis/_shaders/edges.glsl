// Contour samples from pictures of part numbers and depths: tracker/kernels/pictures.py for a graphics card.
layout(std430, binding = 3) readonly buffer Tiles { ivec4 tiles[]; };              // 3 a tile: atlas x y, view, pose; box; depths
layout(std430, binding = 4) readonly buffer Solids { float solids[]; };            // 17 a part: motion, taper, exponents

uniform usampler2D ids;
uniform sampler2D windows; // 0 to 1, linear in the inverse depth
uniform int n_parts;
uniform float contact_m;

const float WINDOW_PX2 = 12.0, SHARE_PER_PX = 0.245, DEEPEST_M = 0.1;

struct Sample { vec2 pixel; vec2 normal; float weight; };

ivec4 tile, box;           // of the workgroup
ivec2 image;               // size of its view, px
vec2 range;                // nearest and farthest depth, metres

bool boxed(ivec2 at) {
    return all(greaterThanEqual(at, ivec2(0))) && all(lessThan(at, box.zw));
}

int part_at(ivec2 at) {
    return boxed(at) ? int(texelFetch(ids, tile.xy + at, 0).r) - 1 : -1;
}

float depth_at(ivec2 at) {
    return range.x * range.y / mix(range.y, range.x, texelFetch(windows, tile.xy + at, 0).r);
}

// 1 inside, 2 outside, 0 neither
int side_of(ivec2 at, int part, float depth) {
    ivec2 whole = at + box.xy;
    if (any(lessThan(whole, ivec2(0))) || any(greaterThanEqual(whole, image))) return 0;
    int seen = part_at(at);
    if (seen < 0) return 2;
    if (seen == part) return 1;
    return depth_at(at) > depth ? 2 : 0;
}

float gap_behind(ivec2 at, int part, float depth) {
    float gap = 1e9;
    bool found = false;
    for (int k = 0; k < 4; k++) {
        ivec2 beside = at + (k < 2 ? ivec2(1 - 2 * k, 0) : ivec2(0, 5 - 2 * k));
        if (side_of(beside, part, depth) != 2) continue;
        found = true;
        if (part_at(beside) >= 0) gap = min(gap, depth_at(beside) - depth);
    }
    return found ? gap : -1.0;
}

// normal, and distance of the contour from the pixel's centre
vec3 place(ivec2 at, int part, float depth) {
    vec3 inside = vec3(0.0), outside = vec3(0.0);
    for (int dy = -3; dy <= 3; dy++) {
        for (int dx = -3; dx <= 3; dx++) {
            float weight = 1.0 - float(dx * dx + dy * dy) / WINDOW_PX2;
            if (weight <= 0.0) continue;
            int side = side_of(at + ivec2(dx, dy), part, depth);
            if (side == 1) inside += weight * vec3(dx, dy, 1);
            if (side == 2) outside += weight * vec3(dx, dy, 1);
        }
    }
    vec2 normal = outside.xy / outside.z - inside.xy / inside.z;
    float size = length(normal);
    if (size < 1e-3) return vec3(0.0, 1.0, 0.5);
    float beyond = (inside.z / (inside.z + outside.z) - 0.5) / SHARE_PER_PX;
    return vec3(normal / size, clamp(beyond, 0.0, 1.0));
}

float depth_there(ivec2 at, int part, float depth, vec3 placed) {
    ivec2 back = ivec2(roundEven(-placed.xy));
    if (part_at(at + back) != part) return depth;
    float near = sqrt(placed.z), far = sqrt(placed.z - dot(vec2(back), placed.xy));
    float fall = (depth - depth_at(at + back)) * near / max(far - near, 1e-3);
    return depth + clamp(fall, 0.0, DEEPEST_M);
}

// without what is done near the end of a lens: here it tells nothing but whether parts touch
vec2 undistorted(int c, vec2 pixel) {
    vec2 goal;
    goal.y = (pixel.y - cameras[c + 18]) / cameras[c + 16];
    goal.x = (pixel.x - cameras[c + 17] - cameras[c + 24] * goal.y) / cameras[c + 15];
    vec2 a = goal;
    for (int i = 0; i < 8; i++) {
        Bent bent = bend(c, a);
        vec2 off = goal - bent.point;
        if (off == vec2(0.0)) return a;
        float area = bent.own.x * bent.own.y - bent.mixed * bent.mixed;
        a += vec2(bent.own.y * off.x - bent.mixed * off.y, bent.own.x * off.y - bent.mixed * off.x) / area;
    }
    return a;
}

// world position moved outwards by the contact distance
vec3 beside_contour(int c, vec2 pixel, vec2 normal, float depth) {
    vec2 a = undistorted(c, pixel);
    vec2 n = vec2(cameras[c + 15] * normal.x, cameras[c + 24] * normal.x + cameras[c + 16] * normal.y);
    Bent bent = bend(c, a);
    n = bent.own * n + bent.mixed * n.yx;
    vec3 away = normalize(vec3(n, -dot(n, a)));
    vec3 local = depth * vec3(a, 1.0) - vec3(cameras[c + 3], cameras[c + 7], cameras[c + 11]) + contact_m * away;
    vec3 world;
    for (int k = 0; k < 3; k++) {
        world[k] = dot(vec3(cameras[c + k], cameras[c + 4 + k], cameras[c + 8 + k]), local);
    }
    return world;
}

bool inside_solid(int s, vec3 world) {
    vec3 a;
    for (int r = 0; r < 3; r++) {
        a[r] = dot(vec3(solids[s + 4 * r], solids[s + 4 * r + 1], solids[s + 4 * r + 2]), world) + solids[s + 4 * r + 3];
    }
    if (abs(a.z) > 1.0) return false;
    vec2 flat_ = abs(a.xy / (1.0 + vec2(solids[s + 12], solids[s + 13]) * a.z));
    if (max(flat_.x, flat_.y) > 1.0) return false;
    float around = pow(pow(flat_.x, solids[s + 14]) + pow(flat_.y, solids[s + 14]), solids[s + 15]);
    return around + pow(abs(a.z), solids[s + 16]) < 1.0;
}

bool touches_another(int part, vec3 world) {
    for (int q = 0; q < n_parts; q++) {
        if (q != part && inside_solid(17 * (tile.w * n_parts + q), world)) return true;
    }
    return false;
}

// whether one of the pixel's neighbours shows the background or something farther
bool on_contour(ivec2 at) {
    int part = part_at(at);
    if (part < 0) return false;
    ivec4 beside = ivec4(part_at(at + ivec2(1, 0)), part_at(at - ivec2(1, 0)), part_at(at + ivec2(0, 1)),
                         part_at(at - ivec2(0, 1)));
    return any(notEqual(beside, ivec4(part))) && gap_behind(at, part, depth_at(at)) >= 0.0;
}

// the sample of a pixel on a contour; between touching parts its weight is 0
Sample sample_at(ivec2 at) {
    Sample found;
    int part = part_at(at);
    float depth = depth_at(at);
    vec3 placed = place(at, part, depth);
    float there = depth_there(at, part, depth, placed);
    found.pixel = vec2(at + box.xy) + placed.z * placed.xy;
    found.normal = placed.xy;
    bool touching = gap_behind(at, part, depth) - (there - depth) < contact_m ||
                    touches_another(part, beside_contour(CAMERA * tile.z, found.pixel, placed.xy, there));
    found.weight = touching ? 0.0 : 1.0 / max(abs(placed.x), abs(placed.y));
    return found;
}
