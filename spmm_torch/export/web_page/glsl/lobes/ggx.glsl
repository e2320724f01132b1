float stretched_length(vec2 alpha, vec2 planar, float cosine) {
    return length(vec3(alpha * planar, cosine));
}

float ggx(vec3 kappa, vec3 wi, vec3 wo) {
    vec2 alpha = kappa.xy;
    vec2 cosines = guarded_cosines(wi, wo);
    Half h = half_vector(wi, wo);
    float spread =
        h.x_squared / (alpha.x * alpha.x) + h.y_squared / (alpha.y * alpha.y) + h.z * h.z;
    float ratio = h.length_squared / spread;
    float distribution = ratio * ratio / (PI * alpha.x * alpha.y);
    float length_i = stretched_length(alpha, wi.xy, cosines.x);
    float length_o = stretched_length(alpha, wo.xy, cosines.y);
    float masking = 0.5 / (cosines.y * length_i + cosines.x * length_o);
    return distribution * masking * schlick_fresnel(kappa.z, h.cos_theta_d);
}
