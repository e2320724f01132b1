// Values of a list of queries, by the shader that draws the shapes: for programs that test the page.

/**
 * Cosine-weighted RGB of Q queries, Float32Array of 3 Q.
 * @param {number[]} queries u, v, then wi and wo, 8 numbers each.
 */
function evaluated(gl, scene, state, queries) {
  if (!gl.getExtension("EXT_color_buffer_float")) {
    throw new Error("This browser has no float framebuffers.");
  }
  const count = queries.length / 8;
  const parts = [[0, 2], [2, 5], [5, 8]].map(([first, last]) => {
    const texels = new Float32Array(4 * count);
    for (let q = 0; q < count; ++q) texels.set(queries.slice(8 * q + first, 8 * q + last), 4 * q);
    return rowTexture(gl, "numbers", texels);
  });
  const [query_uv, query_wi, query_wo] = parts;
  const rows = Math.ceil(count / ROW);
  const target = picture(gl, gl.RGBA32F, ROW, rows);
  gl.viewport(0, 0, ROW, rows);
  const program = linked(gl, "screen.vert", "queries.frag");
  const textures = { ...scene.textures, query_uv, query_wi, query_wo };
  use(gl, program, modelUniforms(scene, state), textures);
  gl.drawArrays(gl.TRIANGLES, 0, 3);
  const values = new Float32Array(4 * ROW * rows);
  gl.readPixels(0, 0, ROW, rows, gl.RGBA, gl.FLOAT, values);
  gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  target.free();
  parts.forEach((texture) => gl.deleteTexture(texture));
  gl.deleteProgram(program);
  return values.filter((_, place) => place % 4 < 3).subarray(0, 3 * count);
}
