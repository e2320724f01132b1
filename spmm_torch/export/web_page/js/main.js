// The page: reads the model, follows the controls, draws.

const canvas = document.getElementById("stage");

async function opened() {
  const gl = canvas.getContext("webgl2", { antialias: false, alpha: true, powerPreference: "high-performance" });
  if (!gl) throw new Error("This browser has no WebGL 2, which the picture needs.");
  if (!gl.getExtension("EXT_color_buffer_float") && !gl.getExtension("EXT_color_buffer_half_float")) {
    throw new Error("This graphics card cannot draw into float pictures.");
  }
  const model = parsedTensors(await inflated("model"));
  const facts = window.texts.facts;
  facts.specular = model.tensors["page.specular"].array;
  return { gl, scene: uploaded(gl, model, facts) };
}

function follow(gl, scene, stage) {
  const widths = { diffuse_width: 0, specular_width: 0 };
  const start = { ...stage.view };
  const changed = (reset = false) => {
    const state = readControls();
    if (reset) Object.assign(stage.view, start);
    if (Object.keys(widths).some((name) => widths[name] !== state[name])) {
      Object.keys(widths).forEach((name) => { widths[name] = state[name]; });
      const factors = [2 ** widths.diffuse_width, 2 ** widths.specular_width];
      const kappa = scaledKappa(scene.model, scene.facts, factors);
      rowTexture(gl, "numbers", lobeTexels(scene.model, kappa), scene.textures.lobes);
    }
    stage.change(state);
  };
  followControls(changed);
  followPointers(canvas, {
    orbit: (dx, dy) => {
      stage.view.azimuth -= 0.008 * dx;
      stage.view.elevation = clamped(stage.view.elevation + 0.008 * dy, -HIGHEST, HIGHEST);
      changed();
    },
    light: (dx, dy) => {
      const { azimuth, elevation } = readControls();
      setControl("azimuth", ((azimuth + 0.5 * dx + 540) % 360) - 180);
      setControl("elevation", clamped(elevation - 0.5 * dy, -90, 90));
      changed();
    },
    zoom: (factor) => {
      stage.view.distance = clamped(stage.view.distance * factor, ...DISTANCES);
      changed();
    },
  });
  new ResizeObserver(() => changed()).observe(canvas);
  changed();
}

opened().then(({ gl, scene }) => {
  const stage = new Stage(gl, scene);
  follow(gl, scene, stage);
  window.spmm = {
    stage,
    evaluate: (queries) => evaluated(gl, scene, readControls(), queries),
  };
  document.body.dataset.ready = "yes";
}).catch((error) => {
  document.getElementById("trouble").textContent = error.message;
  document.body.dataset.ready = "no";
});
