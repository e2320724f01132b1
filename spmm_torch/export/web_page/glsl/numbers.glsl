// Numbers of the model, in textures that are read as one long row of texels.

const float PI = 3.14159265358979;

ivec2 place(int index) {
    return ivec2(index & (ROW - 1), index / ROW);
}

// log(1 + x) to the last bits near 0, where log itself has none: the series of 2 atanh(x / (2 + x)).
float log_of_one_plus(float x) {
    if (x >= 1.0 || x <= -0.5) {
        return log(1.0 + x);
    }
    float s = x / (2.0 + x);
    float squared = s * s;
    float series = 1.0 / 13.0 + squared / 15.0;
    series = 1.0 / 11.0 + squared * series;
    series = 1.0 / 9.0 + squared * series;
    series = 1.0 / 7.0 + squared * series;
    series = 1.0 / 5.0 + squared * series;
    series = 1.0 / 3.0 + squared * series;
    return 2.0 * s * (1.0 + squared * series);
}

// Signed bytes, the lowest first.
vec4 signed_bytes(uint word) {
    return vec4(ivec4(uvec4(word << 24, word << 16, word << 8, word)) >> 24);
}

// Four of the numbers that one texel holds: 16 signed bytes, 8 halves or 4 floats.
vec4 unpacked(uvec4 texel, int numbers, int part) {
    if (numbers == 16) {
        return signed_bytes(texel[part]);
    }
    if (numbers == 8) {
        return vec4(unpackHalf2x16(texel[2 * part]), unpackHalf2x16(texel[2 * part + 1]));
    }
    return uintBitsToFloat(texel);
}
