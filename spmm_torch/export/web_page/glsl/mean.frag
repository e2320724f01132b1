// The mean of pictures: what was there, and one more.

uniform sampler2D before;
uniform sampler2D added;
uniform float share;  // of the one that is added

out vec4 colour;

void main() {
    ivec2 at = ivec2(gl_FragCoord.xy);
    colour = mix(texelFetch(before, at, 0), texelFetch(added, at, 0), share);
}
