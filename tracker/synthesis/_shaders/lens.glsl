// Cameras, and what their lenses do: tracker/kernels/projection.py for a graphics card.
layout(std430, binding = 2) readonly buffer Cameras { float cameras[]; };          // CAMERA a view: Rig.packed

const int CAMERA = 29;

struct Bent { vec2 point; vec2 own; float mixed; };  // in the plane z = 1; slopes of u by a and v by b; of u by b, v by a

Bent bend(int c, vec2 a) {
    vec3 k = vec3(cameras[c + 19], cameras[c + 20], cameras[c + 23]);
    vec3 under = vec3(cameras[c + 25], cameras[c + 26], cameras[c + 27]);
    vec2 p = vec2(cameras[c + 21], cameras[c + 22]);
    float r2 = dot(a, a), below = 1.0 + r2 * (under.x + r2 * (under.y + r2 * under.z));
    float radial = (1.0 + r2 * (k.x + r2 * (k.y + r2 * k.z))) / below;
    vec3 powers = vec3(1.0, 2.0 * r2, 3.0 * r2 * r2);
    float slope = 2.0 * (dot(k, powers) - radial * dot(under, powers)) / below;
    return Bent(a * radial + 2.0 * p * a.x * a.y + p.yx * (r2 + 2.0 * a * a),
                radial + slope * a * a + 2.0 * p * a.yx + 6.0 * p.yx * a,
                slope * a.x * a.y + 2.0 * dot(p, a));
}
