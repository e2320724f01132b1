float blinn_phong(vec3 kappa, vec3 wi, vec3 wo) {
    float n = kappa.x;
    float scale = (n + 2.0) * (n + 4.0) / (8.0 * PI * (exp2(-0.5 * n) + n));
    return scale * exp_of_negative(n * log_cos_theta_h(half_vector(wi, wo)));
}
