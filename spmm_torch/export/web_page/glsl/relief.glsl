// The relief: which point of the surface a view shows at a place of its plane.

#if RELIEF
uniform float height_offset;  // height of code 0, or of the whole plane
uniform float steepest;       // greatest |wo.xy| / wo.z that is walked
uniform float lowest_view;    // z of the lowest measured view

const float LEAST_SLOPE = 1e-30;  // of views from straight above alone

// Views below all measured ones are turned up to the lowest of them.
vec3 held_view(vec3 wo) {
    float planar = sqrt(1.0 - lowest_view * lowest_view) / length(wo.xy);
    return wo.z < lowest_view ? vec3(planar * wo.xy, lowest_view) : wo;
}

// Texture widths rightwards and texture heights upwards for each of height.
vec2 shift_in_uv(vec3 wo) {
    float down = max(wo.z, length(wo.xy) / max(steepest, LEAST_SLOPE));
    return wo.xy / down * vec2(1.0, float(size.x) / float(size.y));
}
#endif

#if RELIEF == 2
uniform usampler2D heights;
uniform float height_scale;  // height of one step of the codes

const float SLOWEST = 1e-9;  // least speed of a ray across texels for each of height
const float CODE_MAX = 255.0;

float height_at(ivec2 at) {
    ivec2 within = ivec2(continued(at.x, size.x), continued(at.y, size.y));
    uint code = texelFetch(heights, place(within.y * size.x + within.x), 0).r;
    return height_offset + height_scale * float(code);
}

// An equal ray that starts within the map: it runs the other way in reversed copies.
void fold(inout vec2 at, inout vec2 speed) {
    vec2 count = vec2(size);
#if MIRROR
    vec2 edge = mod(at + 0.5, 2.0 * count);
    bvec2 turned = greaterThan(edge, count);
    at = mix(edge, 2.0 * count - edge, turned) - 0.5;
    speed = mix(speed, -speed, turned);
#else
    at = mod(at + 0.5, count) - 0.5;
#endif
}

// Where a ray is: in one cell of 2 x 2 texel centres, in which the surface is bilinear.
struct Crossing {
    ivec2 cell;
    ivec2 direction;
    vec2 next;  // heights of the next column and row
    vec2 pace;  // heights between two columns, two rows
};

Crossing crossing_at(vec2 at, vec2 speed, float height) {
    vec2 here = at + height * speed;
    vec2 cell = floor(here);
    bvec2 forward = lessThan(speed, vec2(0.0));  // heights fall on the way
    vec2 gap = mix(here - cell, cell + 1.0 - here, forward);
    vec2 pace = 1.0 / max(abs(speed), SLOWEST);
    return Crossing(ivec2(cell), ivec2(mix(vec2(-1.0), vec2(1.0), forward)), height - gap * pace, pace);
}

// Whether a ray meets the surface within its cell, and at which height: the first root of
// g(l) = g0 + (g1 - g0 - q) l + q l^2, the surface less the ray, for l from 0 to 1.
bool meets(vec2 at, vec2 speed, ivec2 cell, float enter, float leave, float low, out float height) {
    vec2 start = at - vec2(cell);
    float a = height_at(cell);
    float b = height_at(cell + ivec2(1, 0));
    float c = height_at(cell + ivec2(0, 1));
    float d = height_at(cell + ivec2(1, 1));
    float right = b - a;
    float below = c - a;
    float twist = a - b - c + d;
    float fall = leave - enter;
    vec2 from = start + enter * speed;
    vec2 to = start + leave * speed;
    float first = a + right * from.x + (below + twist * from.x) * from.y - enter;
    float last = a + right * to.x + (below + twist * to.x) * to.y - leave;
    float curve = twist * (speed.x * fall) * (speed.y * fall);
    float slope = last - first - curve;
    float root = slope * slope - 4.0 * curve * first;
    float share = -2.0 * first / (slope + sqrt(max(root, 0.0)));
    bool inside = root >= 0.0 && share >= 0.0 && share <= 1.0;
    share = first >= 0.0 ? 0.0 : (inside ? share : 1.0);
    height = enter + share * fall;
    return inside || first >= 0.0 || last >= 0.0 || leave <= low;
}

float first_height(vec2 at, vec2 speed) {
    float low = min(height_offset, height_offset + height_scale * CODE_MAX);
    float high = max(height_offset, height_offset + height_scale * CODE_MAX);
    if (low == high) {
        return low;
    }
    fold(at, speed);
    float enter = high;
    Crossing crossing = crossing_at(at, speed, enter);
    int most = int((abs(speed.x) + abs(speed.y)) * (high - low)) + 4;
    for (int step_ = 0; step_ < most; ++step_) {
        float leave = max(max(crossing.next.x, crossing.next.y), low);
        float height;
        if (meets(at, speed, crossing.cell, enter, leave, low, height)) {
            return height;
        }
        if (crossing.next.x >= crossing.next.y) {
            crossing.cell.x += crossing.direction.x;
            crossing.next.x -= crossing.pace.x;
        } else {
            crossing.cell.y += crossing.direction.y;
            crossing.next.y -= crossing.pace.y;
        }
        enter = leave;
    }
    return low;
}

vec2 hit(vec2 uv, vec3 wo) {
    vec2 shift = shift_in_uv(wo);
    vec2 speed = shift * vec2(size) * vec2(1.0, -1.0);
    return uv + first_height(texel_coordinates(uv), speed) * shift;
}
#elif RELIEF == 1
vec2 hit(vec2 uv, vec3 wo) {
    return uv + height_offset * shift_in_uv(wo);
}
#else
vec3 held_view(vec3 wo) {
    return wo;
}

vec2 hit(vec2 uv, vec3 wo) {
    return uv;
}
#endif
