// Mouse, pen and fingers on the picture: one verb for each gesture. Click: choose. Double click: tell. Drag: turn.
// Shift-drag or right-drag: move. Wheel: nearer to the cursor. Alt-drag: choose all that shows in a box.
import { neared, panned, ray, turned } from "./camera.js";
import { by } from "./dom.js";
import { add, length, scale, sub } from "./vector.js";

/** Pixels of movement that make a click a drag. */
const SLACK = 4;

export class Gestures {
  constructor(app) {
    this.app = app;
    this.canvas = by("picture");
    this.held = null;
    this.wheelAt = null;
    const on = (type, run) => this.canvas.addEventListener(type, run, { passive: false });
    on("pointerdown", (e) => this.down(e));
    on("pointermove", (e) => this.move(e));
    on("pointerup", (e) => this.up(e));
    on("pointercancel", () => this.cancel());
    on("pointerleave", () => app.hover(null));
    on("dblclick", (e) => app.tell(this.under(e)));
    on("wheel", (e) => this.wheel(e));
    on("contextmenu", (e) => e.preventDefault());
  }

  /** What is under the cursor, in pixels of the canvas. */
  under(event) {
    const box = this.canvas.getBoundingClientRect();
    return this.app.under(event.clientX - box.left, event.clientY - box.top);
  }

  // The place that a movement holds fast: the surface under the cursor, else a place as far as the camera's target.
  grip(event) {
    const found = this.under(event);
    if (found) return found.place;
    const { director } = this.app;
    const view = director.view();
    const box = this.canvas.getBoundingClientRect();
    const { from, along } = ray(view, (event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height);
    const forward = -along.reduce((s, x, k) => s + x * view.back[k], 0);
    return add(from, scale(along, view.camera.distance / forward));
  }

  down(event) {
    if (this.held) return;
    // keys belong to the picture again
    document.activeElement?.blur();
    this.app.hover(null);
    this.canvas.setPointerCapture(event.pointerId);
    const verb = event.altKey ? "box" : event.button === 2 || event.button === 1 || event.shiftKey ? "pan" : "turn";
    this.held = { verb, x: event.clientX, y: event.clientY, startX: event.clientX, startY: event.clientY,
      button: event.button, dragged: false, pivot: null };
  }

  move(event) {
    const { held, app } = this;
    if (!held) {
      app.hover(event);
      return;
    }
    const far = Math.hypot(event.clientX - held.startX, event.clientY - held.startY) > SLACK;
    if (!held.dragged && !far) return;
    if (!held.dragged) {
      held.dragged = true;
      held.pivot = this.grip({ clientX: held.startX, clientY: held.startY });
      this.canvas.classList.add("busy");
    }
    const [dx, dy] = [event.clientX - held.x, event.clientY - held.y];
    [held.x, held.y] = [event.clientX, event.clientY];
    if (held.verb === "box") return this.rubber(held);
    const height = this.canvas.clientHeight;
    const { camera } = app.state.now;
    if (held.verb === "turn") {
      const left = ((-dx * Math.PI) / height) * (app.set.mirrored ? -1 : 1);
      app.steer(turned(camera, held.pivot, left, (dy * Math.PI) / height));
    } else {
      app.steer(panned(camera, app.director.view(), held.pivot, dx / height, dy / height));
    }
  }

  rubber({ startX, startY, x, y }) {
    const box = this.canvas.getBoundingClientRect();
    const made = by("rubber");
    made.hidden = false;
    made.style.left = `${Math.min(startX, x) - box.left}px`;
    made.style.top = `${Math.min(startY, y) - box.top}px`;
    made.style.width = `${Math.abs(x - startX)}px`;
    made.style.height = `${Math.abs(y - startY)}px`;
  }

  up(event) {
    const { held, app } = this;
    if (!held) return;
    this.cancel();
    if (held.dragged && held.verb === "box") {
      const box = this.canvas.getBoundingClientRect();
      const sorted = (a, b) => [Math.min(a, b), Math.max(a, b)];
      app.chooseIn(sorted(held.startX - box.left, held.x - box.left), sorted(held.startY - box.top, held.y - box.top));
    } else if (!held.dragged && held.button === 0) {
      app.choose(this.under(event), event.ctrlKey || event.metaKey);
    }
  }

  cancel() {
    this.held = null;
    by("rubber").hidden = true;
    this.canvas.classList.remove("busy");
  }

  wheel(event) {
    event.preventDefault();
    const unit = event.deltaMode === 1 ? 16 : event.deltaMode === 2 ? 200 : 1;
    const by = Math.min(Math.max(event.deltaY * unit, -240), 240);
    this.zoom(Math.exp(by * 0.0016), event);
  }

  /** Nearer or farther by a factor; the place under the cursor, or in the middle, stays where it is. */
  zoom(factor, event = null) {
    const { app } = this;
    const box = this.canvas.getBoundingClientRect();
    const at = event ?? { clientX: box.left + box.width / 2, clientY: box.top + box.height / 2 };
    const now = performance.now();
    // while one wheels on, the place is kept: what is under the cursor is still being drawn
    const same = this.wheelAt && now - this.wheelAt.time < 300
      && Math.hypot(at.clientX - this.wheelAt.x, at.clientY - this.wheelAt.y) < SLACK;
    const place = same ? this.wheelAt.place : this.grip(at);
    this.wheelAt = { time: now, x: at.clientX, y: at.clientY, place };
    const voxel = Math.max(...app.set.spacing);
    const { camera } = app.state.now;
    const { eye } = app.director.view();
    const way = sub(place, eye);
    // a wall is passed, not approached for ever
    if (factor < 1 && !camera.flat && length(way) < 6 * voxel) {
      this.wheelAt = null;
      app.steer({ ...camera, target: add(camera.target, scale(way, (6 * voxel) / (length(way) || 1))) });
    } else {
      app.steer(neared(camera, place, factor, 6 * voxel));
    }
  }
}
