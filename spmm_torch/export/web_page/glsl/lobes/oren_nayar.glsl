float oren_nayar(vec3 kappa, vec3 wi, vec3 wo) {
    float squared = kappa.x * kappa.x;
    float a = 1.0 - 0.5 * squared / (squared + 0.33);
    float b = 0.45 * squared / (squared + 0.09);
    vec2 cosines = guarded_cosines(wi, wo);
    float swing = max(dot(wi.xy, wo.xy), 0.0) / max(cosines.x, cosines.y);
    return (a + b * swing) / PI;
}
