// Arrays as textures, each one long row that is folded at ROW texels.

const ROW = 2048;

/** Formats by what one texel is: numbers, and how the array holds them. */
function formats(gl) {
  return {
    bytes: [1, gl.R8UI, gl.RED_INTEGER, gl.UNSIGNED_BYTE],
    integers: [4, gl.RGBA32UI, gl.RGBA_INTEGER, gl.UNSIGNED_INT],
    number: [1, gl.R32F, gl.RED, gl.FLOAT],
    numbers: [4, gl.RGBA32F, gl.RGBA, gl.FLOAT],
    halves: [3, gl.RGB16F, gl.RGB, gl.HALF_FLOAT],
    colours: [3, gl.RGB32F, gl.RGB, gl.FLOAT],
  };
}

function rowTexture(gl, format, array, texture = gl.createTexture()) {
  const [numbers, internal, external, type] = formats(gl)[format];
  const rows = Math.max(1, Math.ceil(array.length / numbers / ROW));
  if (rows > gl.getParameter(gl.MAX_TEXTURE_SIZE)) {
    throw new Error("The model is too large for the textures of this graphics card.");
  }
  const padded = new array.constructor(rows * ROW * numbers);
  padded.set(array);
  gl.bindTexture(gl.TEXTURE_2D, texture);
  gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
  gl.texImage2D(gl.TEXTURE_2D, 0, internal, ROW, rows, 0, external, type, padded);
  nearestFilter(gl);
  return texture;
}

function nearestFilter(gl) {
  for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) {
    gl.texParameteri(gl.TEXTURE_2D, name, gl.NEAREST);
  }
  for (const name of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) {
    gl.texParameteri(gl.TEXTURE_2D, name, gl.CLAMP_TO_EDGE);
  }
}

const PER_TEXEL = { I8: 16, F16: 8, F32: 4 };

/** Rows of `rank` numbers, each padded to whole texels of 16 bytes. */
function packedRows(array, rank, type) {
  const length = PER_TEXEL[type] * Math.ceil(rank / PER_TEXEL[type]);
  const rows = array.length / rank;
  const padded = new array.constructor(rows * length);
  for (let row = 0; row < rows; ++row) {
    padded.set(array.subarray(row * rank, (row + 1) * rank), row * length);
  }
  return new Uint32Array(padded.buffer);
}

/** Components last: [R, P] as [P, R]. */
function transposed(array, rank) {
  const pairs = array.length / rank;
  const result = new array.constructor(array.length);
  for (let r = 0; r < rank; ++r) {
    for (let pair = 0; pair < pairs; ++pair) result[pair * rank + r] = array[r * pairs + pair];
  }
  return result;
}

function lobeTexels(model, kappa) {
  const normals = model.tensors["dictionary.normal"].array;
  const angles = model.tensors["dictionary.angle"].array;
  const columns = model.tensors["dictionary.kappa"].shape[1];
  const texels = new Float32Array(12 * angles.length);
  angles.forEach((angle, lobe) => {
    const rows = frameOfLobe(normals.subarray(3 * lobe, 3 * lobe + 3), angle);
    rows.forEach((row, axis) => {
      const value = axis < columns ? kappa[lobe * columns + axis] : 0;
      texels.set([...row, value], 12 * lobe + 4 * axis);
    });
  });
  return texels;
}

function entryTexels(entries, model, facts) {
  const brdf = model.tensors["dictionary.model"].array;
  const texels = new Uint32Array(4 * entries.lobe.length);
  const weights = new Float32Array(texels.buffer);
  entries.lobe.forEach((lobe, entry) => {
    const weight = entries.weight.subarray(3 * entry, 3 * entry + 3);
    weights.set(weight, 4 * entry + 1);
    texels[4 * entry] = (lobe | (brdf[lobe] << 24) | (facts.specular[lobe] << 31)) >>> 0;
  });
  return texels;
}

function texelTexels(entries, labels) {
  const texels = new Uint32Array(4 * entries.first.length);
  entries.first.forEach((first, texel) => {
    texels.set([first, entries.count[texel], labels[texel], 0], 4 * texel);
  });
  return texels;
}

/** Textures of the lobes and of the residual by the names of their samplers. */
function modelTextures(gl, model, facts) {
  const { tensors } = model;
  const entries = decodedEntries(tensors);
  const textures = {
    texels: rowTexture(gl, "integers", texelTexels(entries, tensors["weights.label"].array)),
    entries: rowTexture(gl, "integers", entryTexels(entries, model, facts)),
    lobes: rowTexture(gl, "numbers", lobeTexels(model, tensors["dictionary.kappa"].array)),
  };
  if ("relief.code" in tensors) {
    textures.heights = rowTexture(gl, "bytes", tensors["relief.code"].array);
  }
  return { ...textures, ...clusterTextures(gl, tensors), ...componentTextures(gl, tensors) };
}

function clusterTextures(gl, tensors) {
  const code = tensors["residual.code"];
  if (!code.shape[0]) return {};
  return {
    cluster_codes: rowTexture(gl, code.type === "F16" ? "halves" : "colours", code.array),
    cluster_scales: rowTexture(gl, "number", tensors["residual.scale"].array),
  };
}

function componentTextures(gl, tensors) {
  const code = tensors["components.code"];
  if (!code) return {};
  const rank = code.shape[0];
  const coefficient = tensors["components.coefficient"];
  const functions = packedRows(transposed(code.array, rank), rank, code.type);
  const packed = packedRows(coefficient.array, rank, coefficient.type);
  return {
    functions: rowTexture(gl, "integers", functions),
    coefficients: rowTexture(gl, "integers", packed),
    function_scales: rowTexture(gl, "numbers", functionScales(tensors, rank)),
  };
}

/** Scales of functions times those of their coefficients, by view, in groups of four. */
function functionScales(tensors, rank) {
  const scale = transposed(tensors["components.scale"].array, rank);
  const padded = 4 * Math.ceil(rank / 4);
  const result = new Float32Array((scale.length / rank) * padded);
  tensors["components.coefficient_scale"].array.forEach((factor, r) => {
    for (let view = 0; view * rank < scale.length; ++view) {
      result[view * padded + r] = scale[view * rank + r] * factor;
    }
  });
  return result;
}
