// A picture to keep: the whole picture at one to four times the size of the screen, with scale bar and legend.
import { viewOf } from "./director.js";
import { by, choices, h } from "./dom.js";
import { furnish } from "./furniture.js";
import { Targets } from "./gpu.js";
import { note, trouble } from "./messages.js";

/** Pixels of a part that is drawn at once, and of its margin, which lighting looks into. */
const PART = 1536;
const MARGIN = 16;

/** Asks for a size and saves. */
export function askToSave(app) {
  const sheet = by("save");
  const { clientWidth: width, clientHeight: height } = by("picture");
  let times = 2;
  let furniture = true;
  const told = h("p", { className: "soft" });
  const size = () => {
    told.textContent = `${width * times} × ${height * times} pixels, PNG`;
  };
  size();
  const close = () => sheet.close();
  const save = async () => {
    close();
    try {
      const made = await picture(app, times, furniture);
      const link = h("a", { href: URL.createObjectURL(made), download: `${app.set.name}.png` });
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), 60000);
      note(`Saved ${link.download}.`);
    } catch (error) {
      trouble("save", `The picture could not be made: ${error.message}`);
    }
  };
  const go = h("button", { className: "on", onClick: save }, "Save");
  sheet.replaceChildren(h("div", {},
    h("h2", {}, "Save the picture"),
    h("div", { className: "row" }, "Size", choices([1, 2, 3, 4].map((n) => [String(n), `${n} ×`]), String(times), (n) => {
      times = Number(n);
      size();
    }, { ariaLabel: "Size" }),
    h("label", {}, h("input", { type: "checkbox", checked: true, onChange: (e) => {
      furniture = e.target.checked;
    } }), "scale bar and legend")),
    told,
    h("div", { className: "row" }, go, h("button", { onClick: close }, "Cancel"))));
  sheet.showModal();
  go.focus();
}

/** The picture as a PNG file, `times` as large as on the screen. */
export async function picture(app, times, furniture) {
  const { clientWidth, clientHeight } = by("picture");
  const [width, height] = [clientWidth * times, clientHeight * times];
  const canvas = h("canvas", { width, height });
  const context = canvas.getContext("2d");
  const parts = new Parts(app, width, height, times);
  try {
    for (let y = 0; y < height; y += PART) {
      for (let x = 0; x < width; x += PART) {
        const [w, t] = [Math.min(PART, width - x), Math.min(PART, height - y)];
        context.putImageData(parts.draw(x, y, w, t), x, y);
      }
    }
  } finally {
    parts.free();
    app.director.renew();
  }
  if (furniture) {
    context.scale(times, times);
    furnish(context, app.furniture(clientWidth, clientHeight));
  }
  const made = await new Promise((resolve) => canvas.toBlob(resolve, "image/png"));
  if (!made) throw new Error("it is too large for this browser");
  return made;
}

class Parts {
  constructor(app, width, height, times) {
    Object.assign(this, { app, width, height, times });
    const { gl } = app.picture;
    this.targets = new Targets(gl, Math.min(PART, width) + 2 * MARGIN, Math.min(PART, height) + 2 * MARGIN);
    this.done = new Targets(gl, this.targets.width, this.targets.height);
  }

  // Pixels of a part from its upper left corner, drawn with a margin around it.
  draw(x, y, w, t) {
    const { app, targets, width, height } = this;
    const { picture: p, director, set, state } = app;
    const [left, low] = [x - MARGIN, height - (y + t) - MARGIN];
    const part = [left / width, low / height, (left + targets.width) / width, (low + targets.height) / height];
    const view = viewOf(state.now.camera, set, [width, height], part);
    const clip = director.clip();
    p.start(view, clip, state.now.kind, targets);
    const nodes = director.complete(view, clip);
    p.add(nodes, targets);
    p.show({ ...app.style(), dot: this.times, span: [low, height] }, { ...app.overlays(false), filled: nodes }, targets, this.done.lit);
    const { gl } = p;
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.done.lit);
    gl.readBuffer(gl.COLOR_ATTACHMENT0);
    const bytes = new Uint8Array(4 * w * t);
    gl.readPixels(MARGIN, MARGIN, w, t, gl.RGBA, gl.UNSIGNED_BYTE, bytes);
    const image = new ImageData(w, t);
    for (let row = 0; row < t; row++) image.data.set(bytes.subarray(4 * w * (t - 1 - row), 4 * w * (t - row)), 4 * w * row);
    return image;
  }

  free() {
    this.targets.free();
    this.done.free();
  }
}
