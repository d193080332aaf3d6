// Draws blocks, lights them, and tells what is under a pixel.
import { Table, Targets, begun, bind, frame, programOf, texture } from "./gpu.js";
import { FACE, FILL, LIGHT, LIGHT_CHOSEN, LINES, PROBE, SLICE, SMOOTH, blocks } from "./shaders.js";
import { add, dot, sub } from "./vector.js";

const KIND = { surfaces: 0, cells: 1, objects: 2 };
/** Of depths from 0 to 1: some steps of 24 bits. */
const EDGE = 1e-6;
const NO_PLANE = [0, 0, 0, 1];

export class Picture {
  /** Throws if the browser has no WebGL2. `set` has to be there before anything is drawn. */
  constructor(canvas) {
    const gl = canvas.getContext("webgl2", { antialias: false, depth: false, alpha: false, powerPreference: "high-performance" });
    if (!gl) throw new Error("no WebGL2");
    Object.assign(this, { canvas, gl, set: null, size: [canvas.width, canvas.height] });
    this.counts = { draws: 0, triangles: 0 };
    this.build();
  }

  /** All that is lost with the context, but the blocks. */
  build() {
    const { gl } = this;
    const { BLOCK, BLOCK_PART } = blocks(gl.getExtension("EXT_conservative_depth") !== null);
    this.programs = made(gl, { BLOCK, LIGHT, SMOOTH, LINES }, { BLOCK_PART, LIGHT_CHOSEN, SLICE, FILL, PROBE });
    this.table = new Table(gl);
    this.targets = null;
    this.screen = gl.createVertexArray();
    this.loose = looseBuffer(gl);
    this.probe = frame(gl, [texture(gl, gl.R32UI, 1, 1)]);
    this.sliceTexture = null;
  }

  /** Makes the targets as large as the picture is to be, `size`. True if they are new and empty. */
  fit() {
    const [width, height] = this.size;
    if (this.targets && this.targets.width === width && this.targets.height === height) return false;
    this.targets?.free();
    this.targets = new Targets(this.gl, width, height);
    return true;
  }

  /** Stands behind all that was asked of the card until now; `passed` tells when it is done. */
  fence() {
    const { gl } = this;
    const made = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush();
    return made;
  }

  passed(fence) {
    const { gl } = this;
    const done = gl.isContextLost() || gl.getSyncParameter(fence, gl.SYNC_STATUS) === gl.SIGNALED;
    if (done) gl.deleteSync(fence);
    return done;
  }

  /** Begins an empty picture. */
  start(view, clip, kind, targets = this.targets) {
    Object.assign(this, { view, clip, kind, counts: { draws: 0, triangles: 0 } });
    targets.clear();
  }

  /** Draws blocks into the picture that was begun. */
  add(nodes, targets = this.targets) {
    const { gl, view, table } = this;
    const program = table.all ? this.programs.BLOCK : this.programs.BLOCK_PART;
    const { made, at } = program;
    gl.bindFramebuffer(gl.FRAMEBUFFER, targets.scene);
    gl.viewport(0, 0, targets.width, targets.height);
    gl.useProgram(made);
    gl.enable(gl.DEPTH_TEST);
    gl.depthFunc(gl.LESS);
    gl.disable(gl.BLEND);
    gl.disable(gl.CULL_FACE);
    gl.frontFace(this.set.mirrored ? gl.CW : gl.CCW);
    bind(gl, program, { slots: null, table: table.texture });
    gl.activeTexture(gl.TEXTURE0);
    gl.uniformMatrix4fv(at.matrix, false, view.matrix);
    gl.uniformMatrix3fv(at.turn, false, this.turn());
    gl.uniform4fv(at.plane, this.plane());
    gl.uniform1i(at.kind, KIND[this.kind]);
    gl.uniform1ui(at.limit, table.limit);
    // a cap closes the surface, so that nobody looks at it from inside
    gl.uniform1f(at.behind, this.set.cap ? EDGE : 0);
    const { spacing, lattice } = this.set;
    const point = spacing.map((s, k) => Math.round((view.eye[k] / s) * lattice));
    gl.uniform3fv(at.step, spacing.map((s) => s / lattice));
    gl.uniform3fv(at.rest, spacing.map((s, k) => (point[k] / lattice) * s - view.eye[k]));
    for (const { card } of nodes) {
      gl.uniform3iv(at.base, card.origin.map((x, k) => x - point[k]));
      gl.uniform1i(at.stride, card.step);
      gl.uniform1i(at.wide, card.wide);
      gl.bindTexture(gl.TEXTURE_2D, card.slots);
      gl.bindVertexArray(card.vao);
      gl.drawElements(gl.TRIANGLE_STRIP, card.count, card.type, 0);
      this.counts.draws++;
      this.counts.triangles += card.triangles;
    }
    gl.bindVertexArray(null);
    gl.disable(gl.DEPTH_TEST);
  }

  // Normals of the lattice to right, up and back of the picture: they go with the inverse of the spacing.
  turn() {
    const { spacing } = this.set;
    const most = Math.max(...spacing);
    const { right, up, back } = this.view;
    return [0, 1, 2].flatMap((k) => [right, up, back].map((v) => (v[k] * most) / spacing[k]));
  }

  // The plane as the card has it, from the eye.
  plane() {
    const { clip, view } = this;
    return clip ? [...clip.normal, clip.at - dot(clip.normal, view.eye)] : NO_PLANE;
  }

  /** Lights the picture and brings it to the canvas, or to another frame. `style` has colours of 0 to 1. */
  show(style, { lines = [], slice = null, filled = [] } = {}, targets = this.targets, onto = null) {
    const { gl, view } = this;
    // a canvas of another size is black until something is drawn: so it gets that only now
    if (!onto) enlarge(this.canvas, [targets.width, targets.height]);
    gl.bindVertexArray(this.screen);
    gl.viewport(0, 0, targets.width, targets.height);
    this.light(style, targets);
    gl.bindFramebuffer(gl.FRAMEBUFFER, targets.lit);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    // edges behind the volume before what fills it, all others over it
    this.drawLines(lines.filter((l) => l.behind), view, targets);
    if (style.solid) this.drawRims(filled, style, targets);
    if (slice && this.sliceTexture) this.drawSlice({ ...slice, bodies: style.cutKind === FACE.back }, targets);
    this.drawLines(lines.filter((l) => !l.behind), view, targets);
    gl.disable(gl.BLEND);
    if (style.rough) {
      this.bring(targets, onto);
      return;
    }
    gl.bindVertexArray(this.screen);
    gl.bindFramebuffer(gl.FRAMEBUFFER, onto);
    gl.useProgram(this.programs.SMOOTH.made);
    bind(gl, this.programs.SMOOTH, { image: targets.image });
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.bindVertexArray(null);
  }

  // As it is, with steps on edges: soon another picture takes its place.
  bring({ lit, width, height }, onto) {
    const { gl } = this;
    gl.bindVertexArray(null);
    gl.bindFramebuffer(gl.READ_FRAMEBUFFER, lit);
    gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, onto);
    gl.blitFramebuffer(0, 0, width, height, 0, 0, width, height, gl.COLOR_BUFFER_BIT, gl.NEAREST);
  }

  light(style, targets) {
    const { gl, view, table } = this;
    const program = style.any ? this.programs.LIGHT_CHOSEN : this.programs.LIGHT;
    const { made, at } = program;
    gl.bindFramebuffer(gl.FRAMEBUFFER, targets.lit);
    gl.useProgram(made);
    bind(gl, program, {
      faces: targets.faces, things: targets.things, depths: targets.depths, table: table.texture,
    });
    gl.uniform1ui(at.limit, table.limit);
    for (const name of ["cut", "top", "bottom", "accent"]) gl.uniform3fv(at[name], style[name]);
    gl.uniform2fv(at.span, style.span ?? [0, targets.height]);
    gl.uniform1i(at.cutKind, style.cutKind);
    gl.uniform1i(at.cutOwn, style.cutOwn ? 1 : 0);
    gl.uniform1i(at.flatView, view.camera.flat ? 1 : 0);
    gl.uniform3f(at.range, view.near, view.far, 2 * view.half * (view.camera.flat ? 1 : view.camera.distance));
    gl.uniform1f(at.dot_size, style.dot);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  // Material where no surface is seen, at the faces of the volume that blocks reach.
  drawRims(nodes, style, targets) {
    const { gl, view } = this;
    const { made, at } = this.programs.FILL;
    gl.useProgram(made);
    gl.uniformMatrix4fv(at.matrix, false, view.matrix);
    gl.uniform4fv(at.plane, this.plane());
    gl.uniform3fv(at.cut, style.cut);
    for (const { card } of nodes) {
      for (const rim of card?.rims ?? []) {
        // a line of sight that meets nothing tells the same where it enters and where it leaves
        const out = rim.top ? 1 : -1;
        if (view.camera.flat ? out * view.back[rim.axis] > 0 : out * (view.eye[rim.axis] - rim.corners[0][rim.axis]) > 0) continue;
        bind(gl, this.programs.FILL, { mask: rim.texture, faces: targets.faces });
        this.loose.draw(gl.TRIANGLE_STRIP, this.sheet(rim.corners), [3, 2]);
      }
    }
  }

  // Places from the eye with shares of a texture: [0, 0], [1, 0], [0, 1], [1, 1].
  sheet(corners) {
    return corners.flatMap((c, i) => [...sub(c, this.view.eye), i % 2, i >> 1]);
  }

  drawSlice({ corners, whole, level, bodies }, targets) {
    const { gl, view } = this;
    const data = this.sheet(corners);
    gl.useProgram(this.programs.SLICE.made);
    bind(gl, this.programs.SLICE, { image: this.sliceTexture, depths: targets.depths, faces: targets.faces });
    gl.uniformMatrix4fv(this.programs.SLICE.at.matrix, false, view.matrix);
    gl.uniform1i(this.programs.SLICE.at.whole, whole ? 1 : 0);
    gl.uniform1f(this.programs.SLICE.at.level, level);
    gl.uniform1i(this.programs.SLICE.at.bodies, bodies ? 1 : 0);
    this.loose.draw(gl.TRIANGLE_STRIP, data, [3, 2]);
  }

  drawLines(lines, view, targets) {
    const { gl } = this;
    if (lines.length === 0) return;
    const data = [];
    for (const { from, to, tint } of lines) {
      data.push(...sub(from, view.eye), ...tint, ...sub(to, view.eye), ...tint);
    }
    gl.useProgram(this.programs.LINES.made);
    bind(gl, this.programs.LINES, { depths: targets.depths });
    gl.uniformMatrix4fv(this.programs.LINES.at.matrix, false, view.matrix);
    this.loose.draw(gl.LINES, data, [3, 4]);
  }

  /** The picture of a slice, or null for none. */
  setSlice(image) {
    const { gl } = this;
    gl.deleteTexture(this.sliceTexture);
    this.sliceTexture = null;
    if (!image) return;
    this.sliceTexture = texture(gl, gl.RGBA8, image.width, image.height, gl.LINEAR);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, image.width, image.height, gl.RGBA, gl.UNSIGNED_BYTE, image);
  }

  /** Thing, kind of face and place under a pixel of the canvas, from its upper left corner; null for nothing. */
  at(x, y) {
    const { gl, targets } = this;
    if (!targets || x < 0 || y < 0 || x >= targets.width || y >= targets.height) return null;
    const row = targets.height - 1 - y;
    const face = this.faces(x, row, 1, 1)[3];
    if (face === FACE.none) return null;
    const id = this.things(x, row, 1, 1)[0];
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.probe);
    gl.viewport(0, 0, 1, 1);
    gl.bindVertexArray(this.screen);
    gl.useProgram(this.programs.PROBE.made);
    bind(gl, this.programs.PROBE, { depths: targets.depths });
    gl.uniform2i(this.programs.PROBE.at.pixel, x, row);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.bindVertexArray(null);
    const bits = new Uint32Array(1);
    gl.readPixels(0, 0, 1, 1, gl.RED_INTEGER, gl.UNSIGNED_INT, bits);
    return { id, face, place: this.place(x, row, new Float32Array(bits.buffer)[0]) };
  }

  // Where a depth of the card lies.
  place(x, row, d) {
    const { view, targets } = this;
    const { near, far, half, aspect } = view;
    const depth = view.camera.flat ? near + d * (far - near) : (near * far) / (far - d * (far - near));
    const w = view.camera.flat ? 1 : depth;
    const u = ((2 * (x + 0.5)) / targets.width - 1) * half * aspect * w;
    const v = ((2 * (row + 0.5)) / targets.height - 1) * half * w;
    const off = [0, 1, 2].map((k) => u * view.right[k] + v * view.up[k] - depth * view.back[k]);
    return add(off, view.eye);
  }

  faces(x, row, width, height) {
    return this.read(this.targets, 0, x, row, width, height);
  }

  things(x, row, width, height) {
    return this.read(this.targets, 1, x, row, width, height);
  }

  // One of the two targets that blocks are drawn into: bytes of faces (0) or ids of things (1), from below.
  read(targets, which, x, row, width, height) {
    const { gl } = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, targets.scene);
    gl.readBuffer(gl.COLOR_ATTACHMENT0 + which);
    const out = which === 0 ? new Uint8Array(4 * width * height) : new Uint32Array(width * height);
    const [format, type] = which === 0 ? [gl.RGBA, gl.UNSIGNED_BYTE] : [gl.RED_INTEGER, gl.UNSIGNED_INT];
    gl.readPixels(x, row, width, height, format, type, out);
    return out;
  }

  /** Pixels [x, y] of the canvas where the inside of a surface shows. */
  backFaces() {
    const { width, height } = this.targets;
    const faces = this.faces(0, 0, width, height);
    const found = [];
    for (let i = 0; i < width * height; i++) {
      if (faces[4 * i + 3] === FACE.back) found.push([i % width, height - 1 - Math.floor(i / width)]);
    }
    return found;
  }
}

/** Gives a canvas a size in pixels; what is on it stays if it has that already. */
export function enlarge(canvas, [width, height]) {
  if (canvas.width !== width) canvas.width = width;
  if (canvas.height !== height) canvas.height = height;
}

// Programs by name: some are begun at once, others when they are needed first.
function made(gl, early, others) {
  const waiting = new Map(Object.entries(early).map(([name, source]) => [name, begun(gl, source)]));
  const programs = {};
  for (const [name, source] of Object.entries({ ...early, ...others })) {
    let own = null;
    Object.defineProperty(programs, name, { get: () => (own ??= programOf(gl, waiting.get(name) ?? begun(gl, source))) });
  }
  return programs;
}

// Lines and the slice change with each picture: one buffer that is filled anew. `parts` are numbers of an attribute.
function looseBuffer(gl) {
  const vao = gl.createVertexArray();
  const buffer = gl.createBuffer();
  return {
    draw(mode, data, parts) {
      const stride = 4 * (parts[0] + parts[1]);
      gl.bindVertexArray(vao);
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(data), gl.STREAM_DRAW);
      let at = 0;
      parts.forEach((count, i) => {
        gl.enableVertexAttribArray(i);
        gl.vertexAttribPointer(i, count, gl.FLOAT, false, stride, at);
        at += 4 * count;
      });
      gl.drawArrays(mode, 0, (4 * data.length) / stride);
      gl.bindVertexArray(null);
    },
  };
}
