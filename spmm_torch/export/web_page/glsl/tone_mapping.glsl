// Linear values to display values: exposure, a soft end of highlights, the curve of sRGB.

const float SHOULDER = 0.8;  // what is brighter is compressed

vec3 soft_end(vec3 linear) {
    vec3 over = max(linear - SHOULDER, 0.0) / (1.0 - SHOULDER);
    return min(linear, SHOULDER) + (1.0 - SHOULDER) * over / (1.0 + over);
}

vec3 encode_display(vec3 linear) {
    vec3 curve = 1.055 * pow(max(linear, 0.0), vec3(1.0 / 2.4)) - 0.055;
    return mix(curve, 12.92 * linear, lessThanEqual(linear, vec3(0.0031308)));
}

vec3 tone_mapped(vec3 linear, float exposure) {
    return encode_display(soft_end(max(linear * exposure, 0.0)));
}
