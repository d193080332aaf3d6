// Where one looks from. Places are lengths along the grid's axes, in the unit of the set, from the first voxel on.
// The camera turns about a point with z up: {target, distance, azimuth, elevation (radians), flat (no perspective)}.
import { add, clamp, cross, dot, length, scale, sub } from "./vector.js";

/** Angle of the view from bottom to top. */
export const FIELD = (35 * Math.PI) / 180;
const HALF = Math.tan(FIELD / 2);

/** Views along the axes: from the right (x), from the front (y), from above (z). */
export const STANDARD = {
  x: { azimuth: 0, elevation: 0 },
  y: { azimuth: -Math.PI / 2, elevation: 0 },
  z: { azimuth: -Math.PI / 2, elevation: Math.PI / 2 },
};

/** Unit vectors to the right, up and back of the picture, and the eye. */
export function axes(camera) {
  const [ca, sa] = [Math.cos(camera.azimuth), Math.sin(camera.azimuth)];
  const [ce, se] = [Math.cos(camera.elevation), Math.sin(camera.elevation)];
  const back = [ce * ca, ce * sa, se];
  const right = [-sa, ca, 0];
  return { right, back, up: cross(back, right), eye: add(camera.target, scale(back, camera.distance)) };
}

/**
 * All that drawing needs: the matrix for places relative to the eye, its planes, sizes. `box` ({low, high}) is what
 * has to lie between the near and the far plane; `part` is the share [x0, y0, x1, y1] of the picture to draw.
 */
export function lens(camera, { width, height, box, mirrored, part = [0, 0, 1, 1] }) {
  const { right, up, back, eye } = axes(camera);
  const side = scale(right, mirrored ? -1 : 1);
  const aspect = width / height;
  const depths = corners(box).map((c) => -dot(sub(c, eye), back));
  const far = Math.max(Math.max(...depths) * 1.001, camera.distance * 1e-3);
  let near = Math.min(...depths) - far * 1e-3;
  const half = camera.flat ? HALF * camera.distance : HALF;
  // within the box the near plane is as near as 24 bits of depth allow
  if (!camera.flat) near = Math.min(Math.max(near * 0.999, camera.distance * 0.01, far * 1e-5), far / 2);
  const [sx, sy] = [2 / (part[2] - part[0]), 2 / (part[3] - part[1])];
  const [ox, oy] = [sx * (0.5 - (part[0] + part[2]) / 2), sy * (0.5 - (part[1] + part[3]) / 2)];
  const [kx, ky] = [sx / (2 * half * aspect), sy / (2 * half)];
  const rows = camera.flat
    ? [[...scale(side, kx), ox], [...scale(up, ky), oy],
      [...scale(back, -2 / (far - near)), -(far + near) / (far - near)], [0, 0, 0, 1]]
    : [[...add(scale(side, kx), scale(back, -ox)), 0], [...add(scale(up, ky), scale(back, -oy)), 0],
      [...scale(back, -(far + near) / (far - near)), (-2 * far * near) / (far - near)], [...scale(back, -1), 0]];
  const matrix = new Float32Array(16);
  for (let r = 0; r < 4; r++) for (let c = 0; c < 4; c++) matrix[4 * c + r] = rows[r][c];
  return { camera, eye, right: side, up, back, near, far, half, aspect, rows, matrix, planes: planes(rows), width, height };
}

// Half-spaces a x + b y + c z + d >= 0 of what is in the picture, relative to the eye.
function planes(rows) {
  return [0, 1, 2].flatMap((k) => [1, -1].map((s) => rows[3].map((w, i) => w + s * rows[k][i])));
}

/** The box of the volume along its axes. */
export function boxOf({ dims, spacing, cap }) {
  const out = cap ? 0.5 : 0;
  return { low: spacing.map((s) => -out * s), high: spacing.map((s, k) => (dims[k] - 1 + out) * s) };
}

export function corners({ low, high }) {
  return Array.from({ length: 8 }, (_, i) => [0, 1, 2].map((k) => ((i >> k) & 1 ? high[k] : low[k])));
}

/** The line of sight through a place of the picture (0 to 1 from left and top): {from, along}. */
export function ray(view, x, y) {
  const [u, v] = [(2 * x - 1) * view.half * view.aspect, (1 - 2 * y) * view.half];
  const across = add(scale(view.right, u), scale(view.up, v));
  if (view.camera.flat) return { from: add(view.eye, across), along: scale(view.back, -1) };
  const along = sub(across, view.back);
  return { from: view.eye, along: scale(along, 1 / length(along)) };
}

/** Where a place stands in the picture: x and y from 0 to 1, and its depth. */
export function project(view, place) {
  const p = sub(place, view.eye);
  const w = view.camera.flat ? 1 : -dot(p, view.back);
  const x = dot(p, view.right) / (view.half * view.aspect * w);
  const y = dot(p, view.up) / (view.half * w);
  return { x: (1 + x) / 2, y: (1 - y) / 2, depth: -dot(p, view.back), behind: !view.camera.flat && w <= 0 };
}

/** Length of a pixel of the picture at a depth. */
export function pixel(view, depth) {
  return (2 * view.half * (view.camera.flat ? 1 : Math.max(depth, view.near))) / view.height;
}

/** The camera that shows a box from where it looks now. */
export function framed(camera, { low, high }, aspect = 1) {
  const radius = length(sub(high, low)) / 2;
  const target = scale(add(low, high), 0.5);
  const distance = (radius * 1.02) / Math.sin(FIELD / 2) / Math.min(1, aspect);
  return { ...camera, target, distance };
}

/** Turned by angles about a point, which stays where it is in the picture. */
export function turned(camera, about, left, up) {
  const elevation = clamp(camera.elevation + up, -Math.PI / 2, Math.PI / 2);
  const next = { ...camera, azimuth: wrapped(camera.azimuth + left), elevation };
  const [a, b] = [axes(camera), axes(next)];
  const off = sub(camera.target, about);
  const moved = [a.right, a.up, a.back].map((v) => dot(off, v));
  next.target = add(about, add(scale(b.right, moved[0]), add(scale(b.up, moved[1]), scale(b.back, moved[2]))));
  return next;
}

function wrapped(angle) {
  return angle - 2 * Math.PI * Math.round(angle / (2 * Math.PI));
}

/** Moved sideways by shares of the picture's height, at the depth of a point. */
export function panned(camera, view, about, dx, dy) {
  const depth = camera.flat ? 1 : Math.max(-dot(sub(about, view.eye), view.back), view.near);
  const step = 2 * view.half * depth;
  const by = add(scale(view.right, -dx * step), scale(view.up, dy * step));
  return { ...camera, target: add(camera.target, by) };
}

/** Nearer to a point (factor below 1) or farther from it, which stays where it is in the picture. */
export function neared(camera, about, factor, least) {
  const target = add(about, scale(sub(camera.target, about), factor));
  const distance = Math.max(camera.distance * factor, least);
  return { ...camera, target, distance };
}

/** Between two cameras, the short way round. */
export function between(a, b, t) {
  const azimuth = a.azimuth + t * wrapped(b.azimuth - a.azimuth);
  return {
    ...b,
    target: a.target.map((x, i) => x + t * (b.target[i] - x)),
    distance: a.distance * (b.distance / a.distance) ** t,
    azimuth,
    elevation: a.elevation + t * (b.elevation - a.elevation),
  };
}
