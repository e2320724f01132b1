// The sparse sum of lobes of a texel: one read for each entry, three for its lobe.

uniform usampler2D texels;   // first entry, number of entries, cluster
uniform usampler2D entries;  // lobe, group and BRDF; then the weights of red, green and blue
uniform vec2 strength;       // of the diffuse lobes and of the specular ones

const uint LOBE_MASK = 0x00ffffffu;
const uint BRDF_SHIFT = 24u;
const uint BRDF_MASK = 0x7fu;
const uint GROUP_SHIFT = 31u;

void add_lobe(uvec4 entry, float share, vec3 wi[LIGHTS], vec3 wo, inout vec3 value[LIGHTS]) {
    Lobe lobe = lobe_at(int(entry.x & LOBE_MASK));
    vec3 local_wo = lobe.to_local * wo;
    if (local_wo.z <= 0.0) {
        return;
    }
    uint group = entry.x >> GROUP_SHIFT;
    vec3 weight = uintBitsToFloat(entry.yzw) * (share * strength[group] * view_step(local_wo.z));
    for (int light = 0; light < LIGHTS; ++light) {
        vec3 local_wi = lobe.to_local * wi[light];
        if (local_wi.z > 0.0 && wi[light].z > 0.0) {
            float cosine = lit_cosine(local_wi.z, lobe.upright, wi[light].z);
            uint brdf = (entry.x >> BRDF_SHIFT) & BRDF_MASK;
            value[light] += weight * (cosine * brdf_value(brdf, lobe.kappa, local_wi, local_wo));
        }
    }
}

void add_lobes(Corners corners, vec3 wi[LIGHTS], vec3 wo, inout vec3 value[LIGHTS]) {
    for (int corner = 0; corner < 4; ++corner) {
        float share = corners.share[corner];
        if (share == 0.0) {
            continue;
        }
        uvec4 texel = texelFetch(texels, place(corners.texel[corner]), 0);
        for (uint entry = texel.x; entry < texel.x + texel.y; ++entry) {
            add_lobe(texelFetch(entries, place(int(entry)), 0), share, wi, wo, value);
        }
    }
}
