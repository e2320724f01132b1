// The frame of a lobe, and its parameters: three texels, or three reads.

uniform sampler2D lobes;

struct Lobe {
    mat3 to_local;  // columns are x, y and z of tangent, bitangent and normal
    float upright;  // z of the normal
    vec3 kappa;
};

Lobe lobe_at(int index) {
    vec4 tangent = texelFetch(lobes, place(3 * index), 0);
    vec4 bitangent = texelFetch(lobes, place(3 * index + 1), 0);
    vec4 normal = texelFetch(lobes, place(3 * index + 2), 0);
    mat3 rows = mat3(tangent.xyz, bitangent.xyz, normal.xyz);
    return Lobe(transpose(rows), normal.z, vec3(tangent.w, bitangent.w, normal.w));
}
