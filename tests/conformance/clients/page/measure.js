// What is measured of a tile set as a program in the browser has loaded it; as measure.py does.

export class Sum {
  constructor() {
    this.triangles = 0;
    this.agree = 0;
    this.volume = 0;
    this.places = new Set();
    this.names = [];
    this.extras = {};
    this.pixels = 0;
    this.picked = null;
  }

  // positions and normals: flat arrays in world space; indices: a flat list, or a strip
  add(positions, indices, normals, strip) {
    const corner = (array, i) => [array[3 * i], array[3 * i + 1], array[3 * i + 2]];
    const step = strip ? 1 : 3;
    const used = new Set();
    for (let k = 0; k + 2 < indices.length; k += step) {
      let [i, j, l] = [indices[k], indices[k + 1], indices[k + 2]];
      if (i === j || j === l || i === l) continue;
      if (strip && k % 2 === 1) [i, j] = [j, i];
      const [a, b, c] = [i, j, l].map((v) => corner(positions, v));
      const u = [0, 1, 2].map((x) => b[x] - a[x]);
      const v = [0, 1, 2].map((x) => c[x] - a[x]);
      const face = cross(u, v);
      this.triangles += 1;
      this.volume += dot(a, cross(b, c)) / 6;
      let along = 0;
      for (const at of [i, j, l]) along += dot(face, corner(normals, at));
      if (along > 0) this.agree += 1;
      used.add(i).add(j).add(l);
    }
    for (const i of used) {
      // minus zero is zero
      this.places.add(corner(positions, i).map((x) => Math.fround(x) + 0).join());
    }
  }

  result() {
    const { triangles, volume, agree, extras, pixels, picked } = this;
    return { triangles, volume, agree, places: this.places.size, names: this.names.sort(), extras, pixels, picked };
  }
}

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];

const KEYS = ["cell", "object", "surface", "volume", "sphericity"];

export function kept(extras) {
  return Object.fromEntries(KEYS.filter((k) => k in extras).map((k) => [k, Number(extras[k])]));
}

// The pixels of the drawing buffer that are not black, as [x, y] from the upper left corner.
export function lit(gl) {
  const [width, height] = [gl.drawingBufferWidth, gl.drawingBufferHeight];
  const pixels = new Uint8Array(4 * width * height);
  gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
  const found = [];
  for (let i = 0; i < width * height; i++) {
    const [r, g, b] = pixels.subarray(4 * i, 4 * i + 3);
    if (r + g + b > 12) found.push([i % width, height - 1 - Math.floor(i / width)]);
  }
  return found;
}

// What the harness calls: begin(), add(url) for each tile, end().
export function serve(version, load) {
  let sum;
  window.begin = () => {
    sum = new Sum();
  };
  window.add = (url) => load(url, sum, url.split("/").pop());
  window.end = () => sum.result();
  window.version = version;
  window.ready = true;
}
