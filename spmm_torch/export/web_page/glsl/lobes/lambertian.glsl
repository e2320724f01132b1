float lambertian(vec3 kappa, vec3 wi, vec3 wo) {
    return 1.0 / PI;
}
