// What the server of `alvis view` hands out, asked for with the token of the address and read into arrays. Numbers are
// little-endian, as those of every machine that draws.

/** An answer that is none: `status` as HTTP has it, 0 if nobody answered; `message` is for people. */
export class Refused extends Error {
  constructor(status, message) {
    super(message);
    this.status = status;
  }
}

/** How often, and after how many ms, a server that has no connection left is asked again. */
const AGAIN = { times: 20, ms: 250 };

const GONE = "Nobody answers any more. Is alvis view still running in the terminal?";

export class Server {
  /** `changed(message)` is called when an answer tells that the set is another one by now. */
  constructor(token, changed) {
    this.changed = changed;
    this.headers = { Authorization: `Bearer ${token}` };
    this.counts = { requests: 0, bytes: 0, aborted: 0 };
  }

  async get(path, signal) {
    for (let tries = 0; ; tries++) {
      try {
        return await this.once(path, signal);
      } catch (error) {
        if (error.status !== 503 || tries === AGAIN.times) throw error;
      }
      await new Promise((resolve) => setTimeout(resolve, AGAIN.ms));
    }
  }

  async once(path, signal) {
    this.counts.requests++;
    let answer;
    let body;
    try {
      answer = await fetch(path, { headers: this.headers, signal });
      body = await answer.arrayBuffer();
    } catch (error) {
      if (error.name === "AbortError") {
        this.counts.aborted++;
        throw error;
      }
      throw new Refused(0, GONE);
    }
    if (answer.status === 409) this.changed(told(body));
    if (!answer.ok) throw new Refused(answer.status, told(body) || `The server answers ${answer.status} to ${path}.`);
    this.counts.bytes += body.byteLength;
    return { body, headers: answer.headers };
  }

  async json(path) {
    const { body } = await this.get(path);
    return JSON.parse(new TextDecoder().decode(body));
  }

  /** Sections of 32-bit numbers after a header of four, which starts with `magic` and its version. */
  async words(path, magic, header, version = 1) {
    const { body } = await this.get(path);
    if (body.byteLength < 4 * header || body.byteLength % 4 !== 0) throw new Refused(500, `${path} is cut off.`);
    const words = new Uint32Array(body);
    if (magicOf(words[0]) !== magic || words[1] !== version) throw new Refused(500, `${path} is of another version.`);
    return words;
  }

  set() {
    return this.json("/set.json");
  }

  async tree() {
    const words = await this.words("/tree.bin", "ALVT", 4);
    if (words[3] !== 40 || words.length !== 4 + 10 * words[2]) throw new Refused(500, "/tree.bin is cut off.");
    return words;
  }

  /** The section of a table: ids, and a Float64Array for each of the columns by name. */
  async table(kind, columns) {
    const words = await this.words(`/table/${kind}?columns=${columns.map(encodeURIComponent).join(",")}`, "ALVC", 4, 2);
    const [rows, count] = [words[2], words[3]];
    // numbers of 64 bits lie at multiples of 8 bytes
    const first = Math.ceil((4 + rows) / 2);
    if (count !== columns.length || words.length !== 2 * (first + rows * count)) {
      throw new Refused(500, `The table of ${kind} is cut off.`);
    }
    const floats = new Float64Array(words.buffer);
    const part = (k) => floats.subarray(first + k * rows, first + (k + 1) * rows);
    return { ids: words.subarray(4, 4 + rows), columns: new Map(columns.map((c, k) => [c, part(k)])) };
  }

  /** Ids of the rows for which a condition holds, in the order asked for. */
  async query(kind, { where = "", sort = "", descending = false }) {
    const asked = new URLSearchParams();
    if (where) asked.set("where", where);
    if (sort) asked.set("sort", sort);
    if (descending) asked.set("descending", "1");
    try {
      const words = await this.words(`/query/${kind}?${asked}`, "ALVQ", 3);
      return words.subarray(3, 3 + words[2]);
    } catch (error) {
      // nobody typed an option here
      if (error instanceof Refused) error.message = error.message.replace(/^--(where|sort): /, "");
      throw error;
    }
  }

  row(kind, id) {
    return this.json(`/row/${kind}/${id}`);
  }

  /** The picture of a slice, how many voxels there are from one of its pixels to the next, and the samples of its ends. */
  async slice(axis, index, signal) {
    const { body, headers } = await this.get(`/slice/${axis}/${index}.png`, signal);
    const picture = await createImageBitmap(new Blob([body], { type: "image/png" }), { colorSpaceConversion: "none" });
    const [step, low, high] = ["Step", "Low", "High"].map((name) => Number(headers.get(`X-${name}`)));
    return { picture, step, low, high };
  }

  async tile({ level, x, y, z }, signal) {
    const { body } = await this.get(`/tile/${level}/${z}/${y}/${x}`, signal);
    return readTile(body);
  }
}

function told(body) {
  try {
    return JSON.parse(new TextDecoder().decode(body)).error;
  } catch {
    return "";
  }
}

function magicOf(word) {
  return String.fromCharCode(word & 255, (word >> 8) & 255, (word >> 16) & 255, word >>> 24);
}

/** Views of the sections of a tile, which go to the graphics card as they are. */
export function readTile(body) {
  const bad = () => new Refused(500, "A block of the picture is cut off.");
  if (body.byteLength < 48) throw bad();
  const head = new Uint32Array(body, 0, 12);
  const [, version, vertices, indices, slots, width, triangles] = head;
  const shift = head[10];
  if (magicOf(head[0]) !== "ALVM" || version !== 1 || head[11] !== 12) throw bad();
  const at = [48, 48 + 12 * vertices, 48 + 12 * vertices + 12 * slots];
  if (body.byteLength < at[2] + indices * width || (width !== 2 && width !== 4)) throw bad();
  return {
    origin: [...new Int32Array(body, 28, 3)],
    step: 2 ** shift,
    triangles,
    slots,
    vertices: new Uint8Array(body, at[0], 12 * vertices),
    ids: new Uint32Array(body, at[1], 3 * slots),
    indices: width === 2 ? new Uint16Array(body, at[2], indices) : new Uint32Array(body, at[2], indices),
  };
}
