// The value of each of a list of queries, one a pixel.

uniform sampler2D query_uv;
uniform sampler2D query_wi;
uniform sampler2D query_wo;

out vec4 colour;

void main() {
    ivec2 at = ivec2(gl_FragCoord.xy);
    vec3 wi[LIGHTS];
    wi[0] = texelFetch(query_wi, at, 0).xyz;
    vec3 value[LIGHTS];
    reflectance(texelFetch(query_uv, at, 0).xy, wi, texelFetch(query_wo, at, 0).xyz, value);
    colour = vec4(value[0], 1.0);
}
