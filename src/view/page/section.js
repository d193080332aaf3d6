// The section: a plane along an axis, or as the picture is seen; how far it lies; the volume's slice in it.
import { extent, project } from "./camera.js";
import { by, choices, h, oneOf, refill } from "./dom.js";
import { digitsBetween, number, unit } from "./format.js";
import { note } from "./messages.js";
import { add, cross, dot, mix, normal, scale } from "./vector.js";

const NORMALS = { x: [1, 0, 0], y: [0, 1, 0], z: [0, 0, 1] };

export class Section {
  constructor(app) {
    this.app = app;
    this.slice = { key: "", corners: null, abort: null };
    this.panel = by("section");
    this.handle = by("handle");
    this.grabbed = null;
    this.handle.addEventListener("pointerdown", (e) => this.grab(e));
    this.handle.addEventListener("pointermove", (e) => this.pull(e));
    for (const end of ["pointerup", "pointercancel"]) this.handle.addEventListener(end, () => this.release());
    this.build();
  }

  get now() {
    return this.app.state.now.clip;
  }

  /** Least and largest place of the plane. */
  reach(towards = this.now.normal) {
    return extent(this.app.box, towards);
  }

  /** What a place along the axis of the plane has more in the axes of the scan, in which tables tell places. */
  begin() {
    const k = "xyz".indexOf(this.now.axis);
    const { origin, directions } = this.app.set;
    return k >= 0 && directions[k][k] === 1 ? origin[k] : 0;
  }

  toggle() {
    const { state } = this.app;
    if (this.now.on) state.setClip({ on: false });
    else this.choose(this.now.axis === "free" ? "z" : this.now.axis);
  }

  /** A plane along an axis, or facing the eye, through the middle; what lies before it is cut off. */
  choose(axis) {
    const { back } = this.app.director.view();
    const towards = axis === "free" ? normal(back) : NORMALS[axis];
    const [low, high] = this.reach(towards);
    const slice = axis === "free" ? "none" : this.now.slice;
    const at = this.snapped((low + high) / 2, axis, slice);
    this.app.state.setClip({ on: true, axis, normal: towards, at, flip: dot(towards, back) < 0, slice });
  }

  // A slice lies where its voxels are.
  snapped(at, axis = this.now.axis, slice = this.now.slice) {
    const k = "xyz".indexOf(axis);
    if (slice === "none" || k < 0) return at;
    const { spacing, dims } = this.app.set;
    return Math.min(Math.max(Math.round(at / spacing[k]), 0), dims[k] - 1) * spacing[k];
  }

  move(at, gesture) {
    const [low, high] = this.reach();
    this.app.state.setClip({ at: this.snapped(Math.min(Math.max(at, low), high)) }, gesture);
  }

  /** By a share of the way. */
  step(share) {
    if (!this.now.on) return;
    const [low, high] = this.reach();
    const k = "xyz".indexOf(this.now.axis);
    const least = k < 0 ? 0 : this.app.set.spacing[k];
    this.move(this.now.at + Math.sign(share) * Math.max(Math.abs(share) * (high - low), least), "section keys");
  }

  build() {
    const { state, set } = this.app;
    const { on, axis, at, slice } = this.now;
    this.panel.hidden = !on;
    by("section-button")?.classList.toggle("on", on);
    if (!on) return;
    const [low, high] = this.reach();
    const begin = this.begin();
    const slider = h("input", {
      type: "range", className: "grow", min: 0, max: 1000, step: 1, value: Math.round(((at - low) / (high - low)) * 1000),
      ariaLabel: "Place of the section",
      onInput: () => this.move(low + (slider.value / 1000) * (high - low), "section"),
      onChange: () => state.close(),
    });
    const place = h("input", {
      type: "text", inputMode: "decimal", className: "number", ariaLabel: "Place of the section",
      value: number(at + begin, digitsBetween(low + begin, high + begin, 5)),
      onChange: () => Number.isFinite(Number(place.value)) && this.move(Number(place.value) - begin),
    });
    if (this.slider && this.slider === document.activeElement) {
      // the one that is being dragged stays
      this.place.value = place.value;
      this.slider.value = slider.value;
      return;
    }
    Object.assign(this, { slider, place });
    const slices = [["none", "not shown"], ["material", "in the material"], ["whole", "as a whole"]];
    refill(this.panel,
      h("div", { className: "headline" }, h("h2", {}, "Section"),
        h("button", { onClick: () => state.setClip({ on: false }), title: "Show the whole again (C)" }, "Remove")),
      h("div", { className: "row tight" },
        oneOf([["x", "x"], ["y", "y"], ["z", "z"], ["free", "as seen"]], axis, (a) => this.choose(a), "Direction of the section"),
        h("button", { onClick: () => state.setClip({ flip: !this.now.flip }), title: "Cut off the other side" }, "Other side")),
      h("div", { className: "row tight" }, slider, place, h("span", { className: "soft" }, unit(set.unit))),
      set.slices && axis !== "free"
        ? h("label", { className: "row tight" }, "Slice of the volume",
          choices(slices, slice, (s) => state.setClip({ slice: s, at: this.snapped(at, axis, s) }), { className: "grow" }))
        : "",
    );
  }

  /** Corners of the plane's rectangle around the volume. */
  rectangle() {
    const { normal: towards, at } = this.now;
    const { low, high } = this.app.box;
    const k = "xyz".indexOf(this.now.axis);
    const [u, v] = k >= 0 ? [0, 1, 2].filter((a) => a !== k).map((a) => [0, 1, 2].map((b) => (a === b ? 1 : 0))) : this.across(towards);
    const middle = mix(low, high, 0.5);
    const base = add(middle, scale(towards, at - dot(middle, towards)));
    const [[u0, u1], [v0, v1]] = [this.reach(u), this.reach(v)];
    const point = (a, b) => add(add(base, scale(u, a - dot(base, u))), scale(v, b - dot(base, v)));
    return [point(u0, v0), point(u1, v0), point(u1, v1), point(u0, v1)];
  }

  across(towards) {
    const u = normal(cross(Math.abs(towards[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0], towards));
    return [u, cross(towards, u)];
  }

  /** Lines around the plane, and where its handle goes. */
  lines(tint) {
    if (!this.now.on) return [];
    const points = this.rectangle();
    return points.map((from, i) => ({ from, to: points[(i + 1) % 4], tint }));
  }

  middle() {
    const points = this.rectangle();
    return scale(points.reduce(add), 1 / 4);
  }

  /** Puts the handle where the middle of the plane shows. */
  putHandle(view) {
    this.handle.hidden = !this.now.on;
    if (!this.now.on) return;
    const { x, y, behind } = project(view, this.middle());
    const shown = !behind && x > 0 && x < 1 && y > 0 && y < 1;
    this.handle.hidden = !shown && !this.grabbed;
    this.handle.style.left = `${100 * x}%`;
    this.handle.style.top = `${100 * y}%`;
  }

  grab(event) {
    this.handle.setPointerCapture(event.pointerId);
    const { director } = this.app;
    const view = director.view();
    const middle = this.middle();
    // a length along the normal, as the picture shows it
    const [low, high] = this.reach();
    const long = (high - low) / 10;
    const [a, b] = [project(view, middle), project(view, add(middle, scale(this.now.normal, long)))];
    const box = by("picture").getBoundingClientRect();
    const way = [(b.x - a.x) * box.width, (b.y - a.y) * box.height];
    const size = Math.hypot(...way);
    // seen from straight ahead the normal is a point: up and down move the plane
    const straight = size < 12;
    this.grabbed = { x: event.clientX, y: event.clientY, at: this.now.at, long,
      way: straight ? [0, -60 * Math.sign(dot(view.back, this.now.normal) || 1)] : way };
  }

  pull(event) {
    const g = this.grabbed;
    if (!g) return;
    const size2 = g.way[0] ** 2 + g.way[1] ** 2;
    const share = ((event.clientX - g.x) * g.way[0] + (event.clientY - g.y) * g.way[1]) / size2;
    this.app.director.moved();
    this.move(g.at + share * g.long, "section handle");
  }

  release() {
    this.grabbed = null;
    this.app.state.close();
  }

  /** Fetches the slice that the state asks for, if it is another one. */
  async update() {
    const { picture, director, server, set } = this.app;
    const { on, axis, at, slice } = this.now;
    const k = "xyz".indexOf(axis);
    const index = k < 0 ? 0 : Math.round(at / set.spacing[k]);
    const key = on && set.slices && slice !== "none" && k >= 0 ? `${axis} ${index}` : "";
    if (key === this.slice.key) return;
    this.slice.abort?.abort();
    const abort = new AbortController();
    this.slice = { key, corners: key ? this.slice.corners : null, level: this.slice.level, abort };
    if (!key) {
      picture.setSlice(null);
      return;
    }
    try {
      const { picture: image, step, low, high } = await server.slice(axis, index, abort.signal);
      if (abort.signal.aborted) return;
      picture.setSlice(image);
      this.slice.corners = sliceCorners(k, index, [image.width, image.height], step, set.spacing);
      this.slice.level = (set.threshold - low) / (high - low || 1);
      director.redraw();
    } catch (error) {
      if (error.name !== "AbortError") note(`The slice cannot be shown: ${error.message}`);
    }
  }

  /** What the picture draws of the slice. */
  drawn() {
    return this.slice.corners ? { corners: this.slice.corners, level: this.slice.level, whole: this.now.slice === "whole" } : null;
  }
}

// Pixels of a slice have voxels at their middles: columns along the first of the two other axes, rows along the second.
function sliceCorners(k, index, [width, height], step, spacing) {
  const [u, v] = [0, 1, 2].filter((a) => a !== k);
  return [[0, 0], [1, 0], [0, 1], [1, 1]].map(([a, b]) => {
    const place = [0, 0, 0];
    place[k] = index * spacing[k];
    place[u] = (a * width - 0.5) * step * spacing[u];
    place[v] = (b * height - 0.5) * step * spacing[v];
    return place;
  });
}
