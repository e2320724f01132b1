// The camera, and the hand that turns it: one finger or the mouse orbits, two fingers or the wheel
// go near, the right button or Shift move the light.

const FIELD_OF_VIEW = Math.PI / 6;
const DISTANCES = [2.2, 9];
const HIGHEST = 1.54;  // just short of the poles, where up has no direction

const clamped = (value, low, high) => Math.min(Math.max(value, low), high);

/** The direction of an azimuth and elevation in radians; y is up, z is towards the front. */
const directionOf = (azimuth, elevation) => [
  Math.cos(elevation) * Math.sin(azimuth), Math.sin(elevation), Math.cos(elevation) * Math.cos(azimuth),
];

/** {position, projection} of a camera that looks at the origin, shifted by a part of a pixel. */
function cameraOf(view, aspect, shift) {
  const back = directionOf(view.azimuth, view.elevation);
  const right = unit(cross([0, 1, 0], back)), up = cross(back, right);
  const focal = 1 / Math.tan(FIELD_OF_VIEW / 2) / Math.max(1, 1 / aspect);
  const [near, far] = [0.5, 20], depth = (near + far) / (near - far);
  const rows = [
    [...scaled(right, focal / aspect), 0],
    [...scaled(up, focal), 0],
    [...scaled(back, depth), -depth * view.distance + (2 * near * far) / (near - far)],
    [...scaled(back, -1), view.distance],
  ];
  for (const axis of [0, 1]) rows[axis] = rows[axis].map((value, n) => value + shift[axis] * rows[3][n]);
  const projection = new Float32Array(16);
  rows.forEach((row, r) => row.forEach((value, c) => { projection[4 * c + r] = value; }));
  return { position: scaled(back, view.distance), projection };
}

/** Calls orbit(dx, dy), light(dx, dy) and zoom(factor) as pointers move over an element. */
function followPointers(element, { orbit, light, zoom }) {
  const pointers = new Map();
  const spread = () => {
    const [a, b] = [...pointers.values()];
    return Math.hypot(a.clientX - b.clientX, a.clientY - b.clientY);
  };
  element.addEventListener("pointerdown", (event) => {
    element.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, event);
  });
  element.addEventListener("pointermove", (event) => {
    const before = pointers.get(event.pointerId);
    if (!before) return;
    const apart = pointers.size === 2 ? spread() : 0;
    pointers.set(event.pointerId, event);
    if (pointers.size === 2) return zoom(apart / Math.max(spread(), 1));
    const move = event.shiftKey || event.buttons === 2 ? light : orbit;
    return move(event.clientX - before.clientX, event.clientY - before.clientY);
  });
  for (const name of ["pointerup", "pointercancel"]) {
    element.addEventListener(name, (event) => pointers.delete(event.pointerId));
  }
  element.addEventListener("contextmenu", (event) => event.preventDefault());
  element.addEventListener("wheel", (event) => {
    event.preventDefault();
    zoom(Math.exp(event.deltaY * 0.001));
  }, { passive: false });
}
