float ward(vec3 kappa, vec3 wi, vec3 wo) {
    vec2 cosines = guarded_cosines(wi, wo);
    Half h = half_vector(wi, wo);
    float slope = (h.x_squared / (kappa.x * kappa.x) + h.y_squared / (kappa.y * kappa.y));
    float lobe = exp_of_negative(-slope / (h.z * h.z));
    return lobe / (4.0 * PI * kappa.x * kappa.y * sqrt(cosines.x * cosines.y));
}
