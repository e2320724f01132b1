// Programs of the graphics card: the shaders of the page, their uniforms and samplers.

const shaderText = (name) => window.texts.shaders[name].trim();
const HEADER = "#version 300 es\nprecision highp float;\nprecision highp int;\n"
  + "precision highp sampler2D;\nprecision highp usampler2D;\n";
// Fragment shaders that evaluate the model, and how many lights each of them has.
const LIGHTS = { "shape.frag": 2, "queries.frag": 1 };

/** The whole text of a shader of the page. */
function wholeText(name) {
  const lights = LIGHTS[name];
  const constants = { LIGHTS: lights, MAP_SIZE, ROW };
  const defines = Object.entries(constants).map(([key, value]) => `#define ${key} ${value}\n`);
  const before = lights ? `${defines.join("")}${shaderText("model.glsl")}\n` : "";
  return HEADER + before + shaderText(name);
}

function compiled(gl, kind, text) {
  const shader = gl.createShader(kind);
  gl.shaderSource(shader, text);
  gl.compileShader(shader);
  return shader;
}

function linked(gl, vertex, fragment) {
  const program = gl.createProgram();
  const shaders = [
    compiled(gl, gl.VERTEX_SHADER, wholeText(vertex)),
    compiled(gl, gl.FRAGMENT_SHADER, wholeText(fragment)),
  ];
  shaders.forEach((shader) => gl.attachShader(program, shader));
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) {
    const logs = shaders.map((shader) => gl.getShaderInfoLog(shader)).join("\n");
    throw new Error(`A shader does not compile: ${logs} ${gl.getProgramInfoLog(program)}`);
  }
  return program;
}

function setUniform(gl, program, name, value) {
  const at = gl.getUniformLocation(program, name);
  if (at === null) return;  // the compiler leaves out what is not used
  if (value instanceof Int32Array) {
    ({ 1: () => gl.uniform1iv(at, value), 2: () => gl.uniform2iv(at, value) })[value.length]();
  } else if (value.length === 16) {
    gl.uniformMatrix4fv(at, false, value);
  } else if (Array.isArray(value[0])) {
    gl.uniform3fv(at, value.flat());
  } else {
    gl[`uniform${value.length}fv`](at, value);
  }
}

/** Makes a program current, with numbers and textures by their names in the shader. */
function use(gl, program, uniforms, textures) {
  gl.useProgram(program);
  Object.entries(uniforms).forEach(([name, value]) => setUniform(gl, program, name, value));
  Object.entries(textures).forEach(([name, texture], unit) => {
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.bindTexture(gl.TEXTURE_2D, texture);
    setUniform(gl, program, name, Int32Array.of(unit));
  });
}

/** A framebuffer of one float picture, with depth where shapes are drawn. */
function picture(gl, internal, width, height, depth = false) {
  const texture = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D, texture);
  gl.texStorage2D(gl.TEXTURE_2D, 1, internal, width, height);
  nearestFilter(gl);
  const framebuffer = gl.createFramebuffer();
  gl.bindFramebuffer(gl.FRAMEBUFFER, framebuffer);
  gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, texture, 0);
  const buffer = depth ? gl.createRenderbuffer() : null;
  if (depth) {
    gl.bindRenderbuffer(gl.RENDERBUFFER, buffer);
    gl.renderbufferStorage(gl.RENDERBUFFER, gl.DEPTH_COMPONENT24, width, height);
    gl.framebufferRenderbuffer(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.RENDERBUFFER, buffer);
  }
  const free = () => {
    gl.deleteFramebuffer(framebuffer);
    gl.deleteTexture(texture);
    if (buffer) gl.deleteRenderbuffer(buffer);
  };
  return { framebuffer, texture, width, height, free };
}
