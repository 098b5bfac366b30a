// Places a vertex of one part of one pose in the tile of one view; lens distortion is applied to every vertex.
layout(std430, binding = 0) readonly buffer Vertices { float vertices[]; };       // part by part, x y z, metres
layout(std430, binding = 1) readonly buffer Placements { vec4 placements[]; };     // 3 rows a part: world_from_part
layout(std430, binding = 3) readonly buffer Tiles { ivec4 tiles[]; };              // 3 a tile: atlas x y, view, pose; box; depths
layout(std430, binding = 10) readonly buffer Instances { ivec2 instances[]; };     // tile, part

uniform ivec2 atlas;       // size, px
uniform int n_vertices;    // of a part
uniform int n_parts;

flat out uint shown;

vec2 project(int view, vec3 point) {
    int c = CAMERA * view;
    vec2 bent = bend(c, point.xy / point.z).point;
    return vec2(cameras[c + 15] * bent.x + cameras[c + 24] * bent.y + cameras[c + 17],
                cameras[c + 16] * bent.y + cameras[c + 18]);
}

vec3 in_camera(int view, vec3 world) {
    int c = CAMERA * view;
    vec3 moved;
    for (int r = 0; r < 3; r++) {
        vec3 row = vec3(cameras[c + 4 * r], cameras[c + 4 * r + 1], cameras[c + 4 * r + 2]);
        moved[r] = dot(row, world) + cameras[c + 4 * r + 3];
    }
    return moved;
}

void main() {
    ivec2 instance = instances[gl_InstanceID];
    ivec4 tile = tiles[3 * instance.x], box = tiles[3 * instance.x + 1];
    vec2 range = intBitsToFloat(tiles[3 * instance.x + 2].xy);
    int at = 3 * (instance.y * n_vertices + gl_VertexID), row = 3 * (tile.w * n_parts + instance.y);
    vec4 own = vec4(vertices[at], vertices[at + 1], vertices[at + 2], 1.0);
    vec3 world = vec3(dot(placements[row], own), dot(placements[row + 1], own), dot(placements[row + 2], own));
    vec3 local = in_camera(tile.z, world);
    // pixel centres are integers in the image and halves in the window
    vec2 inside = project(tile.z, local) - vec2(box.xy) + 0.5;
    // on the rasterizer's own grid, so that a pose looks the same wherever its tile lies
    inside = round(inside * 256.0) / 256.0;
    float depth = local.z, behind = 2.0 * range.y * (depth - range.x) / (range.y - range.x) - depth;
    gl_Position = vec4((2.0 * (inside + vec2(tile.xy)) / vec2(atlas) - 1.0) * depth, behind, depth);
    gl_ClipDistance[0] = inside.x * depth;
    gl_ClipDistance[1] = inside.y * depth;
    gl_ClipDistance[2] = (float(box.z) - inside.x) * depth;
    gl_ClipDistance[3] = (float(box.w) - inside.y) * depth;
    shown = uint(instance.y) + 1u;
}
