// A point of a shape, with the frame of its surface.

in vec3 position;
in vec3 normal;
in vec3 tangent;
in vec2 place_in_texture;

uniform mat4 projection;
uniform vec2 copies;  // of the texture across and up

out vec3 world_position;
out vec3 world_normal;
out vec3 world_tangent;
out vec2 uv;

void main() {
    world_position = position;
    world_normal = normal;
    world_tangent = tangent;
    uv = place_in_texture * copies + 0.5;
    gl_Position = projection * vec4(position, 1.0);
}
