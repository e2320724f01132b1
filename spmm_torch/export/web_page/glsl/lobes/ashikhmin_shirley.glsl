const float PLANAR_EPS = 1e-12;  // squared sine under which the azimuth does not matter

float ashikhmin_shirley(vec3 kappa, vec3 wi, vec3 wo) {
    vec2 cosines = guarded_cosines(wi, wo);
    Half h = half_vector(wi, wo);
    float along = kappa.x * h.x_squared + kappa.y * h.y_squared;
    float exponent = along / max(h.planar_squared, PLANAR_EPS);
    float lobe = exp_of_negative(exponent * log_cos_theta_h(h));
    float scale = sqrt((kappa.x + 1.0) * (kappa.y + 1.0)) / (8.0 * PI);
    float facing = h.cos_theta_d * max(cosines.x, cosines.y);
    return scale * lobe * schlick_fresnel(kappa.z, h.cos_theta_d) / facing;
}
