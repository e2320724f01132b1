float cook_torrance(vec3 kappa, vec3 wi, vec3 wo) {
    float alpha_squared = kappa.x * kappa.x;
    vec2 cosines = guarded_cosines(wi, wo);
    Half h = half_vector(wi, wo);
    float z_squared = h.z * h.z;
    float sec_squared = h.length_squared / z_squared;
    float beckmann = exp_of_negative(-h.planar_squared / (z_squared * alpha_squared));
    float groove = 4.0 * h.z / h.length_squared * min(cosines.x, cosines.y);
    float value = beckmann * sec_squared * sec_squared * min(groove, 1.0);
    float fresnel = schlick_fresnel(kappa.y, h.cos_theta_d);
    return value * fresnel / (4.0 * PI * alpha_squared * cosines.x * cosines.y);
}
