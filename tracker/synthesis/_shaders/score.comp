// Directed chamfer distances of one pose in one view, a workgroup a tile: tracker/kernels/contours.py.
layout(local_size_x = 256) in;
layout(std430, binding = 5) readonly buffer Views { int views[]; };     // 9 a view: image size, chamfer image, points
layout(std430, binding = 6) readonly buffer Chamfer { float chamfer[]; };
layout(std430, binding = 7) readonly buffer Points { vec4 points[]; };  // scene points: x, y, weight, 0
layout(std430, binding = 8) buffer Edges { vec2 edges[]; };             // capacity a tile
layout(std430, binding = 9) writeonly buffer Scores { vec4 scores[]; }; // model to scene, scene to model, samples

uniform float theta;
uniform int capacity;

shared int counts[256];
shared vec2 sums[256];

float looked_up(int view, vec2 pixel) {
    int start = views[9 * view + 2], width = views[9 * view + 5], height = views[9 * view + 6];
    vec2 at = pixel - vec2(views[9 * view + 3], views[9 * view + 4]);
    if (any(lessThan(at, vec2(0.0))) || at.x > float(width - 1) || at.y > float(height - 1)) return theta + 1.0;
    ivec2 cell = min(ivec2(at), ivec2(width, height) - 2);
    if (any(lessThan(cell, ivec2(0)))) return theta + 1.0;
    vec2 t = at - vec2(cell);
    int first = start + cell.y * width + cell.x;
    float upper = mix(chamfer[first], chamfer[first + 1], t.x);
    float lower = mix(chamfer[first + width], chamfer[first + width + 1], t.x);
    return mix(upper, lower, t.y);
}

// mean of all invocations' weighted distances; theta where nothing weighs
float mean_of(vec2 own) {
    uint me = gl_LocalInvocationID.x;
    sums[me] = own;
    barrier();
    for (uint half_ = 128u; half_ > 0u; half_ /= 2u) {
        if (me < half_) sums[me] += sums[me + half_];
        barrier();
    }
    vec2 all_ = sums[0];
    barrier();
    return all_.y > 0.0 ? all_.x / all_.y : theta;
}

// lists the pixels on contours, in the same order every time; returns their number
int listed(int base) {
    uint me = gl_LocalInvocationID.x;
    int n_pixels = box.z * box.w, own = 0;
    for (int i = int(me); i < n_pixels; i += 256) own += int(on_contour(ivec2(i % box.z, i / box.z)));
    counts[me] = own;
    barrier();
    int at = base, n = 0;
    for (uint other = 0u; other < 256u; other++) {
        if (other < me) at += counts[other];
        n += counts[other];
    }
    for (int i = int(me); own > 0 && i < n_pixels; i += 256) {
        ivec2 pixel = ivec2(i % box.z, i / box.z);
        if (!on_contour(pixel)) continue;
        if (at < base + capacity) edges[at] = vec2(pixel);
        at++;
        own--;
    }
    memoryBarrierBuffer();
    barrier();
    return n;
}

void main() {
    int number = int(gl_WorkGroupID.x), me = int(gl_LocalInvocationID.x), base = number * capacity;
    tile = tiles[3 * number];
    box = tiles[3 * number + 1];
    range = intBitsToFloat(tiles[3 * number + 2].xy);
    image = ivec2(views[9 * tile.z], views[9 * tile.z + 1]);
    int n_found = listed(base), n = min(n_found, capacity);

    vec2 own = vec2(0.0);
    for (int k = me; k < n; k += 256) {
        Sample found = sample_at(ivec2(edges[base + k]));
        float gap = looked_up(tile.z, found.pixel);
        // below 0 something hides the sample: it is not measured
        if (gap >= 0.0) own += found.weight * vec2(min(gap, theta), 1.0);
        edges[base + k] = found.weight > 0.0 ? found.pixel : vec2(1e9);
    }
    memoryBarrierBuffer();
    barrier();
    float model_to_scene = mean_of(own);

    own = vec2(0.0);
    for (int j = views[9 * tile.z + 7] + me; j < views[9 * tile.z + 8]; j += 256) {
        vec2 point = points[j].xy;
        float best = theta * theta;
        for (int k = 0; k < n; k++) {
            vec2 gap = edges[base + k] - point;
            best = min(best, dot(gap, gap));
        }
        own += points[j].z * vec2(sqrt(best), 1.0);
    }
    float scene_to_model = mean_of(own);
    if (me == 0) scores[number] = vec4(model_to_scene, scene_to_model, float(n_found), 0.0);
}
