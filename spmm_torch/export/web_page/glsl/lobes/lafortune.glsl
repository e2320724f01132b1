const float BASE_EPS = 1e-6;  // least base of the power

float lafortune(vec3 kappa, vec3 wi, vec3 wo) {
    float c_xy = kappa.x;
    float n = kappa.y;
    float base = (c_xy * dot(wi.xy, wo.xy) + wi.z * wo.z) / max(abs(c_xy), 1.0);
    if (base <= BASE_EPS) {
        return 0.0;
    }
    return (n + 2.0) / (2.0 * PI) * exp_of_negative(n * log_of_one_plus(base - 1.0));
}
