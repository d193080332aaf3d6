// Small things of WebGL2: programs, targets to draw into, the table of colours.
import { TABLE_WIDTH } from "./shaders.js";

/** Begins to make a program: browsers go on with it beside the page. `programOf` ends it. */
export function begun(gl, { attributes, vertex, fragment }) {
  const made = gl.createProgram();
  for (const [type, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(type);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    gl.attachShader(made, shader);
    gl.deleteShader(shader);
  }
  attributes.forEach((name, i) => gl.bindAttribLocation(made, i, name));
  gl.linkProgram(made);
  return made;
}

/** A program that was begun, with the places of its uniforms by name. */
export function programOf(gl, made) {
  if (!gl.getProgramParameter(made, gl.LINK_STATUS) && !gl.isContextLost()) {
    const logs = gl.getAttachedShaders(made).map((s) => gl.getShaderInfoLog(s)).join("");
    throw new Error(`a shader is refused: ${gl.getProgramInfoLog(made)} ${logs}`);
  }
  const at = {};
  const count = gl.getProgramParameter(made, gl.ACTIVE_UNIFORMS) ?? 0;
  for (let i = 0; i < count; i++) {
    const { name } = gl.getActiveUniform(made, i);
    at[name] = gl.getUniformLocation(made, name);
  }
  return { made, at };
}

/** A texture of one level, bound to the first unit. */
export function texture(gl, format, width, height, filter = gl.NEAREST) {
  const made = gl.createTexture();
  gl.activeTexture(gl.TEXTURE0);
  gl.bindTexture(gl.TEXTURE_2D, made);
  gl.texStorage2D(gl.TEXTURE_2D, 1, format, width, height);
  for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, name, filter);
  for (const name of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, name, gl.CLAMP_TO_EDGE);
  return made;
}

/** What is drawn into textures; a pass without depths has none. */
export function frame(gl, colours, depths = null) {
  const made = gl.createFramebuffer();
  gl.bindFramebuffer(gl.FRAMEBUFFER, made);
  colours.forEach((t, i) => {
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0 + i, gl.TEXTURE_2D, t, 0);
  });
  if (depths) gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.TEXTURE_2D, depths, 0);
  gl.drawBuffers(colours.map((_, i) => gl.COLOR_ATTACHMENT0 + i));
  return made;
}

/** What blocks are drawn into: faces, things, depths; and `image`, which has the colours. */
export class Targets {
  constructor(gl, width, height) {
    Object.assign(this, { gl, width, height });
    this.faces = texture(gl, gl.RGBA8, width, height);
    this.things = texture(gl, gl.R32UI, width, height);
    this.depths = texture(gl, gl.DEPTH_COMPONENT24, width, height);
    this.image = texture(gl, gl.RGBA8, width, height, gl.LINEAR);
    this.scene = frame(gl, [this.faces, this.things], this.depths);
    this.lit = frame(gl, [this.image]);
  }

  clear() {
    const { gl } = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.scene);
    gl.clearBufferfv(gl.COLOR, 0, [0, 0, 0, 0]);
    gl.clearBufferuiv(gl.COLOR, 1, [0, 0, 0, 0]);
    gl.clearBufferfv(gl.DEPTH, 0, [1]);
  }

  free() {
    const { gl } = this;
    // frames first: where one that is bound for reading alone loses its texture, Chromium turns off the canvas, see
    // `findings/chromium-draw-buffer-of-the-canvas.sh`
    for (const f of [this.scene, this.lit]) gl.deleteFramebuffer(f);
    for (const t of [this.faces, this.things, this.depths, this.image]) gl.deleteTexture(t);
  }
}

/** Binds textures to units: {name of the sampler: texture}. */
export function bind(gl, { at }, textures) {
  Object.entries(textures).forEach(([name, t], unit) => {
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.bindTexture(gl.TEXTURE_2D, t);
    gl.uniform1i(at[name], unit);
  });
}

/** Colour and state of each id, four bytes an id: what decides what is shown, and how. */
export class Table {
  constructor(gl) {
    this.gl = gl;
    this.texture = null;
    this.rows = 0;
    this.limit = 0;
    this.all = true;
  }

  /** `bytes` has whole rows; `all` tells that everything is shown. */
  fill(bytes, all) {
    const { gl } = this;
    const rows = bytes.length / (4 * TABLE_WIDTH);
    if (rows !== this.rows) {
      gl.deleteTexture(this.texture);
      this.texture = texture(gl, gl.RGBA8UI, TABLE_WIDTH, rows);
      this.rows = rows;
    }
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, this.texture);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, TABLE_WIDTH, rows, gl.RGBA_INTEGER, gl.UNSIGNED_BYTE, bytes);
    this.limit = rows * TABLE_WIDTH;
    this.all = all;
  }
}
