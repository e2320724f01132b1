// The four texels around a place of the texture, and their bilinear weights.

uniform ivec2 size;  // columns and rows of texels

struct Corners {
    ivec4 texel;
    vec4 share;
};

int continued(int index, int count) {
#if MIRROR
    int period = 2 * count;
    int place_ = ((index % period) + period) % period;
    return min(place_, period - 1 - place_);
#else
    return ((index % count) + count) % count;
#endif
}

// The place between the first and last of the centres that looks as `at`.
vec2 mirrored(vec2 at, vec2 count) {
    vec2 edge = mod(at + 0.5, 2.0 * count);
    return clamp(min(edge, 2.0 * count - edge) - 0.5, vec2(0.0), count - 1.0);
}

// Column and row of a place of the texture; 0 is the centre of the first texel.
vec2 texel_coordinates(vec2 uv) {
    return vec2(uv.x, 1.0 - uv.y) * vec2(size) - 0.5;
}

Corners corners_around(vec2 uv) {
    vec2 at = texel_coordinates(uv);
#if MIRROR
    at = mirrored(at, vec2(size));
#endif
    vec2 low = floor(at);
    vec2 part = at - low;
    ivec2 first = ivec2(low);
    ivec2 left_top = ivec2(continued(first.x, size.x), continued(first.y, size.y));
    ivec2 right_bottom = ivec2(continued(first.x + 1, size.x), continued(first.y + 1, size.y));
    ivec4 columns = ivec4(left_top.x, right_bottom.x, left_top.x, right_bottom.x);
    ivec4 rows = ivec4(left_top.y, left_top.y, right_bottom.y, right_bottom.y);
    vec4 share = vec4(1.0 - part.x, part.x, 1.0 - part.x, part.x);
    share *= vec4(1.0 - part.y, 1.0 - part.y, part.y, part.y);
    return Corners(rows * size.x + columns, share);
}
