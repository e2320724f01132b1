// The mean picture on the screen; the page shows where no shape is.

uniform sampler2D picture;
uniform float exposure;

out vec4 colour;

void main() {
    vec4 linear = texelFetch(picture, ivec2(gl_FragCoord.xy), 0);
    float covered = max(linear.a, 1e-3);
    colour = vec4(tone_mapped(linear.rgb / covered, exposure) * linear.a, linear.a);
}
