// The cosine-weighted reflectance at a place of the texture, for each light.

void reflectance(vec2 uv, vec3 wi[LIGHTS], vec3 wo, out vec3 value[LIGHTS]) {
    for (int light = 0; light < LIGHTS; ++light) {
        value[light] = vec3(0.0);
    }
    if (wo.z <= 0.0) {
        return;
    }
    wo = held_view(wo);
    Corners corners = corners_around(hit(uv, wo));
    add_lobes(corners, wi, wo, value);
    add_residual(corners, wi, wo, value);
}
