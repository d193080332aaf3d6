// The blocks that are on the graphics card: asked for, brought there as they come, and let go.
import { clampTexture } from "./gpu.js";
import { rims } from "./rim.js";

/** Requests that run at the same time. */
export const AT_ONCE = 6;
/** Slots in a row of a block's texture. */
const ROW = 1024;

export class Blocks {
  /** `arrived(node)` and `failed(node, error)` are called as answers come; `early` are answers by node that were asked for before. */
  constructor(gl, server, set, early, { arrived, failed }) {
    Object.assign(this, { gl, server, set, early, limit: set.gpu_memory, arrived, failed });
    this.bytes = 0;
    this.uploaded = 0;
    this.turn = 0;
    this.there = new Set();
    this.flying = new Map();
    this.queue = [];
  }

  has(node) {
    return this.there.has(node);
  }

  /** What is wanted from now on, in this order. Requests for anything else but `also` are given up. */
  want(nodes, also) {
    const open = (n) => !this.there.has(n) && !n.refused;
    this.queue = nodes.filter((n) => open(n) && !this.flying.has(n));
    const still = new Set(nodes);
    for (const [node, abort] of this.flying) {
      if (!still.has(node) && !also.has(node)) abort.abort();
    }
    this.ask();
  }

  get waiting() {
    return this.queue.length + this.flying.size;
  }

  ask() {
    while (this.flying.size < AT_ONCE && this.queue.length > 0) this.fetch(this.queue.shift());
  }

  async fetch(node) {
    const abort = new AbortController();
    this.flying.set(node, abort);
    try {
      const tile = await (this.early.get(node) ?? this.server.tile(node, abort.signal));
      this.early.delete(node);
      if (abort.signal.aborted || this.flying.get(node) !== abort) return;
      this.upload(node, tile);
      this.flying.delete(node);
      this.arrived(node);
    } catch (error) {
      if (error.name !== "AbortError") {
        node.refused = error;
        this.failed(node, error);
      }
    } finally {
      if (this.flying.get(node) === abort) this.flying.delete(node);
      this.ask();
    }
  }

  upload(node, tile) {
    const { gl } = this;
    const vao = gl.createVertexArray();
    gl.bindVertexArray(vao);
    const vertices = buffer(gl, gl.ARRAY_BUFFER, tile.vertices);
    for (let i = 0; i < 3; i++) gl.enableVertexAttribArray(i);
    gl.vertexAttribIPointer(0, 4, gl.UNSIGNED_SHORT, 12, 0);
    gl.vertexAttribPointer(1, 2, gl.BYTE, true, 12, 8);
    gl.vertexAttribIPointer(2, 2, gl.UNSIGNED_BYTE, 12, 10);
    const indices = buffer(gl, gl.ELEMENT_ARRAY_BUFFER, tile.indices);
    gl.bindVertexArray(null);
    const wide = Math.max(1, Math.min(tile.slots, ROW));
    const bytes = tile.vertices.byteLength + tile.indices.byteLength + tile.ids.byteLength;
    node.card = {
      vao, vertices, indices, wide, bytes,
      rims: this.rims(node, tile),
      slots: slotTexture(gl, tile.ids, tile.slots, wide),
      count: tile.indices.length,
      type: tile.indices.BYTES_PER_ELEMENT === 2 ? gl.UNSIGNED_SHORT : gl.UNSIGNED_INT,
      origin: tile.origin,
      step: tile.step,
      triangles: tile.triangles,
      turn: this.turn,
    };
    this.there.add(node);
    this.bytes += bytes;
    this.uploaded += bytes;
  }

  // What is material on the faces of the volume that the block reaches. Caps close it where there are any.
  rims(node, tile) {
    const { set, gl } = this;
    if (set.cap) return [];
    const [low, high] = [node.low, node.high].map((e) => e.map((x, k) => Math.round((x / set.spacing[k]) * set.lattice)));
    const ends = set.dims.map((n) => (n - 1) * set.lattice);
    return rims(tile, low, high, ends).map(({ axis, top, mask, width, height }) => {
      const [u, v] = [(axis + 1) % 3, (axis + 2) % 3];
      const corners = [[0, 0], [1, 0], [0, 1], [1, 1]].map(([a, b]) => {
        const place = [0, 0, 0];
        place[axis] = (top ? node.high : node.low)[axis];
        place[u] = (a ? node.high : node.low)[u];
        place[v] = (b ? node.high : node.low)[v];
        return place;
      });
      return { axis, top, texture: maskTexture(gl, mask, width, height), corners };
    });
  }

  /** Marks blocks as drawn now. */
  touch(nodes) {
    this.turn++;
    for (const n of nodes) if (n.card) n.card.turn = this.turn;
  }

  /** Lets go what was drawn longest ago, until all fits. Neither what was drawn last nor the coarsest level goes. */
  tidy() {
    if (this.bytes <= this.limit) return;
    const old = [...this.there].filter((n) => n.card.turn < this.turn && !(n.parent === null && n.children.length > 0));
    old.sort((a, b) => a.card.turn - b.card.turn);
    for (const node of old) {
      if (this.bytes <= this.limit) return;
      this.drop(node);
    }
  }

  drop(node) {
    const { gl } = this;
    gl.deleteVertexArray(node.card.vao);
    gl.deleteBuffer(node.card.vertices);
    gl.deleteBuffer(node.card.indices);
    gl.deleteTexture(node.card.slots);
    for (const rim of node.card.rims) gl.deleteTexture(rim.texture);
    this.bytes -= node.card.bytes;
    this.there.delete(node);
    node.card = null;
  }

  /** The card has lost everything. */
  forget() {
    for (const abort of this.flying.values()) abort.abort();
    for (const node of this.there) node.card = null;
    this.flying.clear();
    this.there.clear();
    this.queue = [];
    this.bytes = 0;
  }
}

function buffer(gl, target, data) {
  const made = gl.createBuffer();
  gl.bindBuffer(target, made);
  gl.bufferData(target, data, gl.STATIC_DRAW);
  return made;
}

// Surface, cell and object of each slot.
function slotTexture(gl, ids, slots, wide) {
  const rows = Math.max(1, Math.ceil(slots / wide));
  let data = ids;
  if (ids.length !== 3 * wide * rows) {
    data = new Uint32Array(3 * wide * rows);
    data.set(ids);
  }
  const made = gl.createTexture();
  gl.activeTexture(gl.TEXTURE0);
  gl.bindTexture(gl.TEXTURE_2D, made);
  gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGB32UI, wide, rows);
  gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, wide, rows, gl.RGB_INTEGER, gl.UNSIGNED_INT, data);
  clampTexture(gl, gl.NEAREST);
  return made;
}

function maskTexture(gl, mask, width, height) {
  const made = gl.createTexture();
  gl.activeTexture(gl.TEXTURE0);
  gl.bindTexture(gl.TEXTURE_2D, made);
  gl.texStorage2D(gl.TEXTURE_2D, 1, gl.R8, width, height);
  gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
  gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, width, height, gl.RED, gl.UNSIGNED_BYTE, mask);
  gl.pixelStorei(gl.UNPACK_ALIGNMENT, 4);
  clampTexture(gl, gl.LINEAR);
  return made;
}
