// The model: named arrays of the model file, which the page holds compressed, as text.

const ARRAYS = {
  U8: Uint8Array, I8: Int8Array, I16: Int16Array, I32: Int32Array,
  F16: Uint16Array, F32: Float32Array,  // halves stay as they are stored
};

/** {tensors: {name: {array, shape, type}}, metadata} of a safetensors file. */
function parsedTensors(buffer) {
  const start = 8 + Number(new DataView(buffer).getBigUint64(0, true));
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 8, start - 8)));
  const { __metadata__: metadata, ...entries } = header;
  const tensors = {};
  for (const [name, entry] of Object.entries(entries)) {
    const [first, last] = entry.data_offsets;
    const array = new ARRAYS[entry.dtype](buffer.slice(start + first, start + last));
    tensors[name] = { array, shape: entry.shape, type: entry.dtype };
  }
  return { tensors, metadata };
}

/** {first, count, lobe, weight}: where the entries of each texel start, and what each holds. */
function decodedEntries(tensors) {
  const counts = tensors["weights.count"];
  const groups = counts.shape[1] ?? 1;
  const texels = counts.shape[0];
  const index = tensors["weights.index"].array;
  const first = new Uint32Array(texels), count = new Uint32Array(texels);
  const lobe = new Uint32Array(index.length);
  let entry = 0;
  for (let texel = 0; texel < texels; ++texel) {
    first[texel] = entry;
    for (let group = 0; group < groups; ++group) {
      const end = entry + counts.array[texel * groups + group];
      for (; entry < end; ++entry) lobe[entry] = index[entry] + 256 * group;
    }
    count[texel] = entry - first[texel];
  }
  return { first, count, lobe, weight: decodedWeights(tensors) };
}

/** Weights of red, green and blue of each entry; codes are places on a logarithmic scale. */
function decodedWeights(tensors) {
  if ("weights.weight" in tensors) return tensors["weights.weight"].array;
  const { array: code, type } = tensors["weights.code"];
  const range = tensors["weights.range"].array;
  const last = type === "U8" ? 255 : 32767;
  const tables = [0, 1, 2].map((channel) => {
    const [least, largest] = range.subarray(2 * channel, 2 * channel + 2);
    const value = (n) => (n ? least * (largest / least) ** ((n - 1) / (last - 1)) : 0);
    return Float32Array.from({ length: last + 1 }, (_, n) => value(n));
  });
  return Float32Array.from(code, (n, place) => tables[place % 3][n]);
}

/** Rows tangent, bitangent and normal of a lobe: z is turned to the normal, then about it. */
function frameOfLobe([x, y, z], angle) {
  const scale = 1 / (1 + z);
  const tangent = [1 - x * x * scale, -x * y * scale, -x];
  const bitangent = [-x * y * scale, 1 - y * y * scale, -y];
  const cosine = Math.cos(angle), sine = Math.sin(angle);
  return [
    tangent.map((value, axis) => cosine * value + sine * bitangent[axis]),
    bitangent.map((value, axis) => cosine * value - sine * tangent[axis]),
    [x, y, z],
  ];
}

/** Kappa of lobes whose widths are scaled, within the bounds of their parameters. */
function scaledKappa(model, facts, factors) {
  const { array, shape } = model.tensors["dictionary.kappa"];
  const kappa = Float32Array.from(array);
  model.tensors["dictionary.model"].array.forEach((brdf, lobe) => {
    const factor = factors[facts.specular[lobe]];
    facts.widths[brdf].forEach(({ column, power, low, high }) => {
      const place = lobe * shape[1] + column;
      if (factor !== 1) kappa[place] = Math.min(Math.max(array[place] * factor ** power, low), high);
    });
  });
  return kappa;
}
