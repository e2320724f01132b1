// Shapes: grids of points with frames and places in the texture, around the origin.

const minus = (a, b) => a.map((value, axis) => value - b[axis]);
const scaled = (a, factor) => a.map((value) => value * factor);
const unit = (a) => scaled(a, 1 / Math.hypot(...a));

/** The unit sphere: u runs along the longitude, v along the latitude, poles are +-y. */
function spherePoint(a, b) {
  const longitude = Math.PI * (2 * a - 1), latitude = Math.PI * (b - 0.5);
  const [x, y, z] = [Math.sin(longitude), Math.sin(latitude), Math.cos(longitude)];
  const normal = [Math.cos(latitude) * x, y, Math.cos(latitude) * z];
  return { position: normal, normal, tangent: [z, 0, -x], place: [2 * a - 1, b - 0.5] };
}

function planePoint(a, b) {
  const position = [2 * a - 1, 2 * b - 1, 0];
  return { position, normal: [0, 0, 1], tangent: [1, 0, 0], place: [a - 0.5, b - 0.5] };
}

const BALL = 0.6, CLOTH = 1.42;  // radius of the ball, half of the side of the cloth
const FREE = 0.72;               // length along the cloth from its middle to where folds begin
const FOLDS = 8, DEPTH = 0.16;
const STEPS = 24;                // of the path from the middle to a point

/** Slope of the cloth at a length along it: flat on top of the ball, then ever steeper. */
const slopeAt = (length) => 1.36 * (1 - Math.exp(-((length / BALL) ** 1.5) / 1.36));

/** A square cloth that lies over a ball and hangs down in folds; x and y are along the cloth. */
function clothPosition(x, y) {
  const length = Math.hypot(x, y), angle = Math.atan2(y, x);
  let radius = 0, height = 0;
  for (let step = 0; step < STEPS; ++step) {
    const slope = slopeAt(((step + 0.5) / STEPS) * length);
    radius += (Math.cos(slope) * length) / STEPS;
    height -= (Math.sin(slope) * length) / STEPS;
  }
  const free = Math.max(length - FREE, 0);
  const wave = Math.cos(FOLDS * angle + 0.5 * Math.sin(3 * angle)) + 0.25 * Math.cos(5 * angle + 1);
  radius += DEPTH * wave * (1 - Math.exp(-(free * free) / 0.2));
  return [radius * Math.cos(angle), height + 0.82, -radius * Math.sin(angle)];
}

function clothPoint(a, b) {
  const [x, y] = [CLOTH * (2 * a - 1), CLOTH * (2 * b - 1)];
  const step = 1e-3;
  const along = (dx, dy) => minus(
    clothPosition(x + dx * step, y + dy * step), clothPosition(x - dx * step, y - dy * step),
  );
  const tangent = unit(along(1, 0));
  const normal = unit(cross(tangent, along(0, 1)));
  return { position: clothPosition(x, y), normal, tangent, place: [0.5 * x, 0.5 * y] };
}

const SHAPES = {
  sphere: { point: spherePoint, columns: 192, rows: 96 },
  plane: { point: planePoint, columns: 1, rows: 1 },
  cloth: { point: clothPoint, columns: 360, rows: 360 },
};

/** Buffers of a shape, ready to be drawn by the program of `shape.vert`. */
function shapeMesh(gl, program, { point, columns, rows }) {
  const numbers = [];
  for (let row = 0; row <= rows; ++row) {
    for (let column = 0; column <= columns; ++column) {
      const at = point(column / columns, row / rows);
      numbers.push(...at.position, ...at.normal, ...at.tangent, ...at.place);
    }
  }
  const corners = [];
  for (let row = 0; row < rows; ++row) {
    for (let column = 0; column < columns; ++column) {
      const first = row * (columns + 1) + column, above = first + columns + 1;
      corners.push(first, first + 1, above, above, first + 1, above + 1);
    }
  }
  const array = gl.createVertexArray();
  gl.bindVertexArray(array);
  gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
  gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(numbers), gl.STATIC_DRAW);
  gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
  gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, new Uint32Array(corners), gl.STATIC_DRAW);
  let offset = 0;
  for (const [name, size] of [["position", 3], ["normal", 3], ["tangent", 3], ["place_in_texture", 2]]) {
    const at = gl.getAttribLocation(program, name);
    if (at >= 0) {
      gl.enableVertexAttribArray(at);
      gl.vertexAttribPointer(at, size, gl.FLOAT, false, 44, offset);
    }
    offset += 4 * size;
  }
  gl.bindVertexArray(null);
  return { array, count: corners.length };
}
