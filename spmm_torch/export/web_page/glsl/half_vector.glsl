// What the BRDFs share: guarded cosines, the half vector, Fresnel, a safe exponential.

const float COS_EPS = 1e-3;             // least cosine in a denominator
const float LEAST_EXPONENT = -80.3365;  // exp stays a normal number, with room for factors

struct Half {
    float x_squared;
    float y_squared;
    float planar_squared;
    float z;
    float length_squared;
    float cos_theta_d;
};

// wi + wo, which is not normalized.
Half half_vector(vec3 wi, vec3 wo) {
    vec2 planar = (wi.xy + wo.xy) * (wi.xy + wo.xy);
    float z = max(wi.z + wo.z, COS_EPS);
    float squared = planar.x + planar.y + z * z;
    return Half(planar.x, planar.y, planar.x + planar.y, z, squared, 0.5 * sqrt(squared));
}

vec2 guarded_cosines(vec3 wi, vec3 wo) {
    return max(vec2(wi.z, wo.z), COS_EPS);
}

float log_cos_theta_h(Half h) {
    return -0.5 * log_of_one_plus(h.planar_squared / (h.z * h.z));
}

float exp_of_negative(float exponent) {
    return exp(max(exponent, LEAST_EXPONENT));
}

float schlick_fresnel(float f0, float cos_theta_d) {
    float grazing = max(1.0 - cos_theta_d, 0.0);
    float squared = grazing * grazing;
    return f0 + (1.0 - f0) * squared * squared * grazing;
}
