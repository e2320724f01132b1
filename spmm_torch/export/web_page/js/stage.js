// The picture: a shape under two lights, sharper with each frame in which nothing moves.

const SAMPLES = 32;          // frames whose mean is shown at last
const SLOW = 45, FAST = 20;  // milliseconds of a frame, between which the resolution stays
const SCALES = [1, 0.7, 0.5, 0.35];
const REST = 180;            // milliseconds after which nothing is taken to move
const LONGEST = 6000;        // and after which a slow picture is good enough
const FILL = { turn: 2.3, elevation: 0.35 };  // where the fill light is, from the other one
const RADIANS = Math.PI / 180;

/** Numbers of the shader that follow from the model and the sliders. */
function modelUniforms({ model, facts, meshes }, state) {
  const { tensors, metadata } = model;
  const offset = tensors["relief.offset"]?.array[0] ?? 0;
  const scale = tensors["relief.scale"]?.array[0] ?? 0;
  const middle = offset + scale * facts.mean_code;
  const uniforms = {
    size: Int32Array.of(metadata.width, metadata.height),
    horizon_sine: [facts.horizon_sine],
    lowest_light: [facts.lowest_light],
    strength: [state.diffuse, state.specular],
    residual_strength: [state.residual],
    steepest: [facts.steepest],
    lowest_view: [offset || scale ? facts.lowest_view : 0],
    height_offset: [middle + (offset - middle) * state.depth],
    height_scale: [scale * state.depth],
  };
  for (const [name, mesh] of Object.entries(meshes)) {
    for (const [part, value] of Object.entries(mesh)) uniforms[`${name}.${part}`] = Int32Array.of(value);
  }
  return uniforms;
}

/** The model on the graphics card: textures, and where the cells of its directions lie. */
function uploaded(gl, model, facts) {
  const { tensors } = model;
  const light = meshTexels(tensors["directions.light"].array, tensors["page.light_cells"].array, 0);
  const view = meshTexels(
    tensors["directions.view"].array, tensors["page.view_cells"].array, light.texels.length / 4,
  );
  const cells = new Float32Array([...light.texels, ...view.texels]);
  const textures = { ...modelTextures(gl, model, facts), cells: rowTexture(gl, "numbers", cells) };
  return { model, facts, textures, meshes: { light_mesh: light.mesh, view_mesh: view.mesh } };
}

const halton = (index, base) => {
  let result = 0;
  for (let part = 1 / base; index > 0; index = Math.floor(index / base), part /= base) {
    result += part * (index % base);
  }
  return result;
};

class Stage {
  constructor(gl, scene) {
    this.gl = gl;
    this.scene = scene;
    this.programs = {
      shape: linked(gl, "shape.vert", "shape.frag"),
      mean: linked(gl, "screen.vert", "mean.frag"),
      show: linked(gl, "screen.vert", "show.frag"),
    };
    this.meshes = {};
    this.view = { azimuth: 0.35, elevation: 0.3, distance: 4.9 };
    this.scale = 0;
    this.moved = -Infinity;
    this.pictures = [];
    this.waiting = false;
  }

  /** Draws anew: something changed. */
  change(state) {
    this.state = state;
    this.moved = performance.now();
    this.samples = 0;
    if (!this.waiting) this.request();
  }

  request() {
    this.waiting = true;
    requestAnimationFrame((now) => {
      this.waiting = false;
      this.frame(now);
    });
  }

  frame(now) {
    const moving = now - this.moved < REST;
    this.adapt(now, moving);
    this.resize(moving ? SCALES[this.scale] : 1);
    const open = this.samples < SAMPLES && (moving || this.samples < 2 || now - this.moved < LONGEST);
    if (open) this.draw();
    if (open || moving) this.request();
  }

  /** Coarser pictures while things move, where the graphics card is slow. */
  adapt(now, moving) {
    const time = now - (this.last ?? now);
    this.last = now;
    if (!moving || time > 1000) return;
    if (time > SLOW && this.scale < SCALES.length - 1) this.scale += 1;
    else if (time < FAST && this.scale > 0) this.scale -= 1;
  }

  resize(scale) {
    const { canvas } = this.gl;
    const pixels = scale * Math.min(window.devicePixelRatio || 1, 2);
    const width = Math.max(1, Math.round(canvas.clientWidth * pixels));
    const height = Math.max(1, Math.round(canvas.clientHeight * pixels));
    if (this.pictures.length && canvas.width === width && canvas.height === height) return;
    [canvas.width, canvas.height] = [width, height];
    this.pictures.forEach((each) => each.free());
    const { gl } = this;
    this.pictures = [true, false, false].map((depth) => picture(gl, gl.RGBA16F, width, height, depth));
    this.samples = 0;
  }

  draw() {
    const { gl, pictures, programs } = this;
    const [added, before, mean] = pictures;
    gl.viewport(0, 0, added.width, added.height);
    this.drawShape(added);
    this.samples += 1;
    gl.bindFramebuffer(gl.FRAMEBUFFER, mean.framebuffer);
    use(gl, programs.mean, { share: [1 / this.samples] }, { before: before.texture, added: added.texture });
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    const exposure = this.scene.facts.exposure * 2 ** this.state.exposure;
    use(gl, programs.show, { exposure: [exposure] }, { picture: mean.texture });
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    this.pictures = [added, mean, before];
  }

  drawShape(target) {
    const { gl, state, programs } = this;
    const shift = [2, 3].map((base) => 2 * halton(this.samples, base) - (this.samples ? 1 : 0));
    const pixel = [shift[0] / target.width, shift[1] / target.height];
    const camera = cameraOf(this.view, target.width / target.height, pixel);
    const turn = state.azimuth * RADIANS;
    const uniforms = {
      ...modelUniforms(this.scene, state),
      projection: camera.projection,
      camera: camera.position,
      copies: [state.copies, state.copies * this.scene.facts.aspect],
      light_direction: [
        directionOf(turn, state.elevation * RADIANS), directionOf(turn + FILL.turn, FILL.elevation),
      ],
      irradiance: [state.brightness, state.fill * state.brightness].map((value) => [value, value, value]),
    };
    const shape = this.meshes[state.shape] ??= shapeMesh(gl, programs.shape, SHAPES[state.shape]);
    gl.bindFramebuffer(gl.FRAMEBUFFER, target.framebuffer);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    use(gl, programs.shape, uniforms, this.scene.textures);
    gl.bindVertexArray(shape.array);
    gl.drawElements(gl.TRIANGLES, shape.count, gl.UNSIGNED_INT, 0);
    gl.bindVertexArray(null);
    gl.disable(gl.DEPTH_TEST);
  }
}
