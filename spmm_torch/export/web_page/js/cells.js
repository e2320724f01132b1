// Cells between measured directions: matrices, neighbours, and a map of where a walk starts.

const MAP_SIZE = 32;
const NO_CELL = -1;
const DOWN = [0, 0, -1];

const cross = (a, b) => [
  a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0],
];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

/** Rows that give the weights of three corners, of which a direction is a sum. */
function inverseOf(corners) {
  const [a, b, c] = corners;
  const volume = dot(a, cross(b, c));
  return [cross(b, c), cross(c, a), cross(a, b)].map((row) => row.map((value) => value / volume));
}

/** The cell beyond the edge opposite of each corner, or NO_CELL. */
function neighboursOf(cells) {
  const owner = new Map();
  const key = (a, b) => `${Math.min(a, b)},${Math.max(a, b)}`;
  const edges = cells.map(([a, b, c]) => [key(b, c), key(a, c), key(a, b)]);
  edges.forEach((sides, cell) => sides.forEach((side) => {
    owner.set(side, [...(owner.get(side) ?? []), cell]);
  }));
  return edges.map((sides, cell) => sides.map(
    (side) => owner.get(side).find((other) => other !== cell) ?? NO_CELL,
  ));
}

/** The direction of the centre of a square of the map of the equal-area disk. */
function centreOfSquare(square) {
  let x = ((square % MAP_SIZE) + 0.5) * (2 / MAP_SIZE) - 1;
  let y = (Math.floor(square / MAP_SIZE) + 0.5) * (2 / MAP_SIZE) - 1;
  const length = Math.max(Math.hypot(x, y), 1);
  [x, y] = [x / length, y / length];
  const stretch = Math.sqrt(2 - x * x - y * y);
  return [x * stretch, y * stretch, 1 - x * x - y * y];
}

/** The cell that holds a direction best, by a look at all of them. */
function bestCell(inverses, direction) {
  let best = NO_CELL, most = -Infinity;
  inverses.forEach((rows, cell) => {
    const least = Math.min(...rows.map((row) => dot(row, direction)));
    if (least > most) [best, most] = [cell, least];
  });
  return best;
}

/** Texels of RGBA for one hemisphere, and where its parts start; see measured_pairs.glsl. */
function meshTexels(directions, corners, offset) {
  const points = [];
  for (let n = 0; n < directions.length; n += 3) points.push([...directions.subarray(n, n + 3)]);
  const cells = [];
  for (let n = 0; n < corners.length; n += 3) cells.push([...corners.subarray(n, n + 3)]);
  const inverses = cells.map((cell) => inverseOf(cell.map((corner) => points[corner] ?? DOWN)));
  const neighbours = neighboursOf(cells);
  const texels = [];
  cells.forEach(([a, b, c], cell) => {
    inverses[cell].forEach((row, corner) => texels.push(...row, neighbours[cell][corner]));
    texels.push(a, b, c < points.length ? c : a, c < points.length ? 1 : 0);
  });
  const map_ = offset + texels.length / 4;
  for (let square = 0; square < MAP_SIZE * MAP_SIZE; ++square) {
    texels.push(bestCell(inverses, centreOfSquare(square)), 0, 0, 0);
  }
  const direction = offset + texels.length / 4;
  points.forEach((point) => texels.push(...point, 0));
  return { texels, mesh: { cell: offset, map_, direction, directions: points.length } };
}
