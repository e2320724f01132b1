// The radiance that a point of a shape sends to the camera.

in vec3 world_position;
in vec3 world_normal;
in vec3 world_tangent;
in vec2 uv;

uniform vec3 camera;
uniform vec3 light_direction[LIGHTS];
uniform vec3 irradiance[LIGHTS];

out vec4 colour;

void main() {
    vec3 normal = normalize(world_normal);
    vec3 towards = normalize(camera - world_position);
    normal *= dot(normal, towards) < 0.0 ? -1.0 : 1.0;  // both sides of a cloth are alike
    vec3 tangent = normalize(world_tangent - dot(world_tangent, normal) * normal);
    mat3 to_local = transpose(mat3(tangent, cross(normal, tangent), normal));
    vec3 wi[LIGHTS];
    for (int light = 0; light < LIGHTS; ++light) {
        wi[light] = to_local * light_direction[light];
    }
    vec3 value[LIGHTS];
    reflectance(uv, wi, to_local * towards, value);
    vec3 radiance = vec3(0.0);
    for (int light = 0; light < LIGHTS; ++light) {
        radiance += irradiance[light] * value[light];
    }
    colour = vec4(max(radiance, 0.0), 1.0);
}
