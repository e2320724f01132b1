// The residual: functions on measured pairs, of clusters or of components that all texels share.

#if RANK || CLUSTERS
uniform Mesh light_mesh;
uniform Mesh view_mesh;
#endif
uniform float residual_strength;

#if CLUSTERS
uniform sampler2D cluster_codes;   // RGB of cluster, view and light
uniform sampler2D cluster_scales;  // one for each cluster

void add_clusters(Corners corners, Around view, Around light, float fade, inout vec3 value) {
    for (int corner = 0; corner < 4; ++corner) {
        float share = corners.share[corner] * fade;
        if (share == 0.0) {
            continue;
        }
        int cluster = int(texelFetch(texels, place(corners.texel[corner]), 0).z);
        share *= texelFetch(cluster_scales, place(cluster), 0).r;
        for (int v = 0; v < 3; ++v) {
            int row = (cluster * view_mesh.directions + view.index[v]) * light_mesh.directions;
            for (int l = 0; l < 3; ++l) {
                float weight = share * view.weight[v] * light.weight[l];
                if (weight != 0.0) {
                    value += weight * texelFetch(cluster_codes, place(row + light.index[l]), 0).rgb;
                }
            }
        }
    }
}
#endif

#if RANK
uniform usampler2D functions;      // of view, light and channel, then the components
uniform usampler2D coefficients;   // of texels, then the components
uniform sampler2D function_scales; // of views, then four components a texel

const int GROUPS = (RANK + 3) / 4;  // of four components
const int FUNCTION_TEXELS = (RANK + FUNCTION_NUMBERS - 1) / FUNCTION_NUMBERS;
const int COEFFICIENT_TEXELS = (RANK + COEFFICIENT_NUMBERS - 1) / COEFFICIENT_NUMBERS;

// The coefficients of the four texels, mixed.
void mix_coefficients(Corners corners, out vec4 mixed[GROUPS]) {
    for (int group = 0; group < GROUPS; ++group) {
        mixed[group] = vec4(0.0);
    }
    for (int corner = 0; corner < 4; ++corner) {
        for (int k = 0; k < COEFFICIENT_TEXELS; ++k) {
            int index = corners.texel[corner] * COEFFICIENT_TEXELS + k;
            uvec4 texel = texelFetch(coefficients, place(index), 0);
            for (int part = 0; part < COEFFICIENT_NUMBERS / 4; ++part) {
                int group = k * (COEFFICIENT_NUMBERS / 4) + part;
                if (group < GROUPS) {
                    vec4 numbers = unpacked(texel, COEFFICIENT_NUMBERS, part);
                    mixed[group] += corners.share[corner] * numbers;
                }
            }
        }
    }
}

// The sum of components at one measured pair, in one channel.
float at_pair(int pair, int channel, vec4 scaled[GROUPS]) {
    float value = 0.0;
    for (int k = 0; k < FUNCTION_TEXELS; ++k) {
        int index = (pair * 3 + channel) * FUNCTION_TEXELS + k;
        uvec4 texel = texelFetch(functions, place(index), 0);
        for (int part = 0; part < FUNCTION_NUMBERS / 4; ++part) {
            int group = k * (FUNCTION_NUMBERS / 4) + part;
            if (group < GROUPS) {
                value += dot(scaled[group], unpacked(texel, FUNCTION_NUMBERS, part));
            }
        }
    }
    return value;
}

void add_components(
    Corners corners, Around view, Around light[LIGHTS], float fade[LIGHTS], inout vec3 value[LIGHTS]
) {
    vec4 mixed[GROUPS];
    mix_coefficients(corners, mixed);
    for (int v = 0; v < 3; ++v) {
        if (view.weight[v] == 0.0) {
            continue;
        }
        vec4 scaled[GROUPS];
        for (int group = 0; group < GROUPS; ++group) {
            int index = view.index[v] * GROUPS + group;
            scaled[group] = mixed[group] * texelFetch(function_scales, place(index), 0);
        }
        for (int i = 0; i < LIGHTS; ++i) {
            for (int l = 0; l < 3; ++l) {
                float weight = fade[i] * view.weight[v] * light[i].weight[l];
                if (weight != 0.0) {
                    int pair = view.index[v] * light_mesh.directions + light[i].index[l];
                    vec3 sum = vec3(
                        at_pair(pair, 0, scaled), at_pair(pair, 1, scaled), at_pair(pair, 2, scaled)
                    );
                    value[i] += weight * sum;
                }
            }
        }
    }
}
#endif

void add_residual(Corners corners, vec3 wi[LIGHTS], vec3 wo, inout vec3 value[LIGHTS]) {
#if RANK || CLUSTERS
    if (residual_strength == 0.0) {
        return;
    }
    Around view = around(view_mesh, wo);
    Around light[LIGHTS];
    float fade[LIGHTS];
    for (int i = 0; i < LIGHTS; ++i) {
        fade[i] = residual_strength * grazing_fade(wi[i].z);
        light[i] = Around(ivec3(0), vec3(0.0));
        if (fade[i] > 0.0) {
            light[i] = around(light_mesh, wi[i]);
        }
    }
#if CLUSTERS
    for (int i = 0; i < LIGHTS; ++i) {
        add_clusters(corners, view, light[i], fade[i], value[i]);
    }
#endif
#if RANK
    add_components(corners, view, light, fade, value);
#endif
#endif
}
