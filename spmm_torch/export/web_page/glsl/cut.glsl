// Where a lobe ends: at its own horizon for views, and below the lowest measured light.

uniform float horizon_sine;  // sine of the width of the step; 0 for a hard one
uniform float lowest_light;  // z of the lowest measured light

float view_step(float cosine) {
    if (horizon_sine == 0.0) {
        return cosine > 0.0 ? 1.0 : 0.0;
    }
    float t = clamp(cosine / horizon_sine, 0.0, 1.0);
    return t * t * (3.0 - 2.0 * t);
}

float grazing_fade(float cosine) {
    return clamp(cosine / lowest_light, 0.0, 1.0);
}

// n_j . wi without what the tilt of a lobe adds where light grazes the texel.
float lit_cosine(float cosine, float upright, float of_texel) {
    float excess = max(cosine - upright * of_texel, 0.0);
    return cosine - (1.0 - grazing_fade(of_texel)) * excess;
}
