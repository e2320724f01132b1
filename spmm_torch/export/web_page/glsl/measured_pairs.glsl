// The measured directions around a direction, and their weights: the walk over a triangulation of
// the hemisphere, from a cell near the direction to the one that holds it.

uniform sampler2D cells;  // of lights and of views; see Mesh for what lies where

// Where the parts of the cells of one hemisphere start in the texture.
struct Mesh {
    int cell;        // four texels for each: three rows of its matrix with a neighbour, its corners
    int map_;        // one for each square of a map of the equal-area disk: a cell near it
    int direction;   // measured directions
    int directions;  // number of these
};

struct Around {
    ivec3 index;
    vec3 weight;
};

const int NO_CELL = -1;
const float INSIDE = -1e-7;         // least weight of a direction that a cell holds
const float EDGE_TOLERANCE = 1e-4;  // down to which rounding explains a negative one
const int LONGEST_WALK = 64;

int start_of_walk(Mesh mesh, vec3 w) {
    vec2 disk = w.xy / sqrt(1.0 + w.z);
    ivec2 square = clamp(ivec2((disk + 1.0) * 0.5 * float(MAP_SIZE)), 0, MAP_SIZE - 1);
    return int(texelFetch(cells, place(mesh.map_ + square.y * MAP_SIZE + square.x), 0).r);
}

Around nearest(Mesh mesh, vec3 w) {
    int best = 0;
    float largest = -2.0;
    for (int index = 0; index < mesh.directions; ++index) {
        float cosine = dot(texelFetch(cells, place(mesh.direction + index), 0).xyz, w);
        if (cosine > largest) {
            largest = cosine;
            best = index;
        }
    }
    return Around(ivec3(best), vec3(1.0, 0.0, 0.0));
}

Around around(Mesh mesh, vec3 w) {
    int cell = start_of_walk(mesh, w);
    int best = NO_CELL;
    float least = -EDGE_TOLERANCE;
    vec3 best_weight;
    for (int step_ = 0; step_ < LONGEST_WALK && cell != NO_CELL; ++step_) {
        int first = mesh.cell + 4 * cell;
        vec4 row_0 = texelFetch(cells, place(first), 0);
        vec4 row_1 = texelFetch(cells, place(first + 1), 0);
        vec4 row_2 = texelFetch(cells, place(first + 2), 0);
        vec3 weight = vec3(dot(row_0.xyz, w), dot(row_1.xyz, w), dot(row_2.xyz, w));
        float smallest = min(weight.x, min(weight.y, weight.z));
        if (smallest > least) {
            least = smallest;
            best = cell;
            best_weight = weight;
        }
        if (smallest >= INSIDE) {
            break;
        }
        float next = weight.x == smallest ? row_0.w : (weight.y == smallest ? row_1.w : row_2.w);
        cell = int(next);
    }
    if (best == NO_CELL) {
        return nearest(mesh, w);
    }
    vec4 corners = texelFetch(cells, place(mesh.cell + 4 * best + 3), 0);
    vec3 weight = max(best_weight, 0.0) * vec3(1.0, 1.0, corners.w);
    float total = weight.x + weight.y + weight.z;
    if (total <= EDGE_TOLERANCE) {
        return nearest(mesh, w);
    }
    return Around(ivec3(corners.xyz), weight / total);
}
