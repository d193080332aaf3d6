// Holds the parts of the page together: what a gesture, a key or a button does to the state, and what the state does to
// the picture and the panels.
import { between, boxOf, corners, framed } from "./camera.js";
import { Choice } from "./choice.js";
import { PAINTS } from "./colours.js";
import { Colouring } from "./colouring.js";
import { command } from "./command.js";
import { Director } from "./director.js";
import { by, h, menu } from "./dom.js";
import { about, count, many, singular, title, unit, value } from "./format.js";
import { furnish } from "./furniture.js";
import { Gestures } from "./gestures.js";
import { Info } from "./info.js";
import { listen } from "./keys.js";
import { encode } from "./link.js";
import { List } from "./list.js";
import { CHOSEN, Look } from "./look.js";
import { note, trouble } from "./messages.js";
import { enlarge } from "./picture.js";
import { Section } from "./section.js";
import { FACE } from "./shaders.js";
import { buildTop } from "./top.js";
import { mix } from "./vector.js";

const STYLE = {
  dark: { top: [0.17, 0.195, 0.23], bottom: [0.075, 0.085, 0.1], cut: [0.45, 0.48, 0.53], accent: [0.2, 0.85, 1], box: [0.6, 0.68, 0.78, 0.55], wait: [0.6, 0.68, 0.78, 0.28] },
  light: { top: [0.97, 0.98, 0.99], bottom: [0.83, 0.86, 0.89], cut: [0.5, 0.53, 0.57], accent: [0, 0.38, 1], box: [0.3, 0.36, 0.44, 0.6], wait: [0.3, 0.36, 0.44, 0.28] },
};
const FLIGHT = 350;
/** Pixels of the layout across a picture in which a legend would cover what is looked at. */
const NARROW = 600;
/** Milliseconds that tables wait for the picture. */
const PATIENCE = 1500;

export class App {
  constructor({ server, set, tree, picture, blocks, things, state, token }) {
    Object.assign(this, { server, set, tree, picture, blocks, things, state, token });
    this.maker = new Look(things, server);
    this.look = null;
    this.choice = new Choice();
    this.box = boxOf(set);
    this.dark = !matchMedia("(prefers-color-scheme: light)").matches;
    this.lastPaint = PAINTS[0];
    this.round = 0;
    this.opened = false;
    this.tried = false;
    this.director = new Director({
      picture, tree, blocks, state, set, drawn: (view, moving) => this.drawn(view, moving), known: () => this.tried,
    });
    this.section = new Section(this);
    this.info = new Info(this);
    this.colouring = new Colouring(this);
    this.list = new List(this);
    this.gestures = new Gestures(this);
    buildTop(this);
    listen(this);
    this.setTheme(this.dark);
    matchMedia("(prefers-color-scheme: light)").addEventListener("change", (e) => this.setTheme(!e.matches));
    state.onChange((now, before) => this.changed(now, before));
    this.choice.onChange(() => this.chosenChanged());
    new ResizeObserver(() => this.resize()).observe(by("stage"));
  }

  /** Everything for the first time. */
  async begin() {
    this.upload();
    this.resize();
    this.section.build();
    this.section.update();
    this.top.update();
    await this.relook();
    // tables come after the picture, unless that takes long
    await Promise.race([this.director.ready, new Promise((resolve) => setTimeout(resolve, PATIENCE))]);
    this.opened = true;
    await this.showPanels(true);
  }

  async showPanels(otherList) {
    if (this.look) await this.colouring.build(this.look);
    if (otherList) await this.list.show();
    else this.list.rows();
  }

  resize() {
    const { clientWidth, clientHeight } = by("stage");
    this.picture.size = [clientWidth, clientHeight].map((n) => Math.max(1, Math.round(n * devicePixelRatio)));
    this.director.renew();
  }

  // ---- the state has changed

  changed(now, before) {
    if (now.camera !== before.camera) this.director.renew();
    if (now.clip !== before.clip) {
      this.section.build();
      this.section.update();
      this.director.renew();
    }
    if (now.kind !== before.kind) {
      this.choice.clear();
      this.info.close();
    }
    const same = now.kind === before.kind && now.colour[now.kind] === before.colour[now.kind] && now.rules[now.kind] === before.rules[now.kind];
    if (!same) this.relook(now.kind !== before.kind);
    this.top.update();
  }

  /** Makes colours and states anew; blocks are drawn again only if other things show. */
  async relook(otherKind = false) {
    const round = ++this.round;
    let look;
    try {
      look = await this.maker.make(this.state.now);
    } catch (error) {
      trouble("look", error.message);
      this.tried = true;
      this.director.redraw();
      return;
    }
    if (round !== this.round) return;
    this.tried = true;
    const old = this.look;
    this.look = look;
    this.upload();
    // blocks that were drawn before anything was known of things stay where all are shown
    const otherShown = !old ? !look.all || look.kind !== this.picture.kind : old.kind !== look.kind || old.shown !== look.shown || [...look.hidden].some((id) => !old.hidden.has(id));
    if (otherShown) this.director.renew();
    else this.director.redraw();
    if (this.opened) await this.showPanels(otherKind);
  }

  // The table of the card, with what is chosen.
  upload() {
    if (!this.look) {
      const plain = this.maker.plain(this.state.now);
      if (plain) this.picture.table.fill(plain, true);
      return;
    }
    const { bytes } = this.look;
    const out = bytes.slice();
    for (const id of this.choice.ids) if (4 * id < out.length) out[4 * id + 3] |= CHOSEN;
    this.picture.table.fill(out, this.look.all);
  }

  chosenChanged() {
    if (!this.look) return;
    this.upload();
    this.director.redraw();
    this.top.update();
  }

  // ---- drawing

  // Nothing is left out, as far as is known.
  get solid() {
    return (this.look?.solid ?? true) && !this.buried();
  }

  /** Whether cells are shown through the material that hides them from all sides, until a section opens it. */
  buried() {
    return this.set.buried && !this.state.now.clip.on && !this.director.inside();
  }

  style() {
    const s = STYLE[this.dark ? "dark" : "light"];
    return { ...s, ...this.cut(), solid: this.solid, any: this.choice.ids.size > 0, dot: devicePixelRatio };
  }

  /**
   * The kind of face that one sees where the body before it is cut, which shows a flat face instead, and whether that has
   * the colour of its thing. While all is shown the body is the material. Where something is left out, cells are bodies
   * that stand by themselves, and objects are material of their own; a surface alone bounds nothing.
   */
  cut() {
    const { kind } = this.state.now;
    if (this.solid) return { cutKind: FACE.back, cutOwn: false };
    if (kind === "objects" && !this.buried()) return { cutKind: FACE.back, cutOwn: true };
    // inside of a cell nothing is cut: one looks at its wall
    if (kind === "cells" && !this.director.inside()) return { cutKind: FACE.front, cutOwn: true };
    return { cutKind: FACE.none, cutOwn: false };
  }

  overlays(waiting = true) {
    const s = STYLE[this.dark ? "dark" : "light"];
    const lines = edges(this.box, s.box, this.director.view().eye);
    if (waiting) for (const node of this.director.missing()) lines.push(...edges(node, node.refused ? [0.9, 0.2, 0.2, 0.8] : s.wait));
    lines.push(...this.section.lines([...s.accent.map((x) => x * 0.9), 0.9]));
    // while blocks come, what is not there yet would be filled as well
    const filled = ["complete", "moving"].includes(this.director.phase) ? this.director.shown : [];
    return { lines, slice: this.section.drawn(), filled };
  }

  drawn(view, moving) {
    const rough = ["drawing", "loading"].includes(this.director.phase);
    this.picture.show({ ...this.style(), rough }, this.overlays());
    this.section.putHandle(view);
    const canvas = by("furniture");
    enlarge(canvas, this.picture.size);
    const context = canvas.getContext("2d");
    context.setTransform(devicePixelRatio, 0, 0, devicePixelRatio, 0, 0);
    const { clientWidth: width, clientHeight: height } = canvas;
    context.clearRect(0, 0, width, height);
    const furniture = this.furniture(width, height);
    // where there is little room, the panel of colours is the legend
    if (width < NARROW && by("dock").offsetHeight > 0) furniture.scale = null;
    furnish(context, furniture);
    this.tellStatus();
    if (!moving) this.keepLink();
  }

  /** What `furnish` wants to know. */
  furniture(width, height) {
    const { camera } = this.state.now;
    const pixel = this.director.pixel() * (this.picture.size[1] / height);
    return { width, height, dark: this.dark, scale: this.look?.scale ?? null, camera, mirrored: this.set.mirrored, pixel, unit: this.set.unit };
  }

  tellStatus() {
    const t = this.director.told();
    const coarse = t.coarse > 0 ? ` (${t.coarse === t.blocks ? "all" : count(t.coarse)} simplified: finer from near)` : "";
    const blocks = `${many(t.blocks, "block")}${coarse}, ${about(t.drawn)} triangles`;
    const rest = t.left > 0 ? ` · ${about(t.inView)} triangles are in view: the nearest are drawn, ${many(t.left, "block")} stand as boxes` : "";
    const refused = t.refused > 0 ? ` · ${many(t.refused, "block")} cannot be read` : "";
    by("status").textContent = {
      moving: `Moving · ${blocks}`,
      drawing: `Drawing · ${blocks}`,
      loading: `Loading ${many(t.waiting, "block")} · ${blocks}`,
      complete: t.blocks === 0 ? "Nothing in view" : `Complete · ${blocks}`,
    }[t.phase] + rest + refused;
  }

  // The address holds the view, so that a reload and a bookmark come back to it.
  keepLink() {
    clearTimeout(this.linkLater);
    this.linkLater = setTimeout(() => history.replaceState(null, "", this.link()), 250);
  }

  link() {
    return `#${this.token}&${encode(this.state.now)}`;
  }

  // ---- the camera

  steer(camera) {
    this.flight = null;
    this.director.moved();
    this.state.set({ camera });
  }

  /** Goes there in a moment, or at once where people do not want movement. */
  fly(camera) {
    if (matchMedia("(prefers-reduced-motion: reduce)").matches) return this.steer(camera);
    const from = this.state.now.camera;
    const start = performance.now();
    const flight = (this.flight = () => {
      if (this.flight !== flight) return;
      const t = Math.min((performance.now() - start) / FLIGHT, 1);
      this.director.moved();
      this.state.set({ camera: t < 1 ? between(from, camera, t * t * (3 - 2 * t)) : camera });
      if (t < 1) requestAnimationFrame(flight);
      else this.flight = null;
    });
    flight();
  }

  home() {
    this.fly(framed(this.state.now.camera, this.box, this.aspect));
  }

  get aspect() {
    const [width, height] = this.picture.size;
    return width / height;
  }

  /** Flies to what is chosen, or shows everything. */
  async frame() {
    const { kind, camera } = this.state.now;
    const boxes = await Promise.all([...this.choice.ids].slice(0, 2000).map((id) => this.things.box(kind, id)));
    const good = boxes.filter((b) => b !== null);
    if (good.length === 0) return this.home();
    const join = (f, end) => [0, 1, 2].map((k) => good.reduce((s, b) => f(s, b[end][k]), good[0][end][k]));
    const box = { low: join(Math.min, "low"), high: join(Math.max, "high") };
    const to = framed(camera, box, this.aspect);
    this.fly({ ...to, distance: to.distance * 1.35 });
  }

  // ---- what is under the cursor, and what is chosen

  /** The thing, kind of face and place at a point of the picture in pixels of the layout; null for nothing. */
  under(x, y) {
    const found = this.picture.at(Math.floor(x * devicePixelRatio), Math.floor(y * devicePixelRatio));
    if (!found) return null;
    const material = found.face === FACE.cap || (found.face === FACE.back && this.cut().cutKind === FACE.back);
    // where material is cut one sees the object, but no cell
    return { ...found, material, id: material && this.state.now.kind !== "objects" ? 0 : found.id };
  }

  choose(found, more) {
    const id = found?.id ?? 0;
    if (more && id > 0) this.choice.toggle(id, "picture");
    else if (!more) this.choice.set(id > 0 ? [id] : [], { from: "picture" });
  }

  chooseIn([x0, x1], [y0, y1]) {
    const ratio = devicePixelRatio;
    const [left, right] = [Math.max(Math.floor(x0 * ratio), 0), Math.min(Math.ceil(x1 * ratio), this.picture.size[0])];
    const [top, low] = [Math.max(Math.floor(y0 * ratio), 0), Math.min(Math.ceil(y1 * ratio), this.picture.size[1])];
    if (right <= left || low <= top) return;
    const row = this.picture.size[1] - low;
    const ids = this.picture.things(left, row, right - left, low - top);
    const faces = this.picture.faces(left, row, right - left, low - top);
    const found = new Set();
    const solid = this.solid && this.state.now.kind !== "objects";
    ids.forEach((id, i) => {
      if (id > 0 && !(solid && faces[4 * i + 3] !== FACE.front)) found.add(id);
    });
    this.choice.set([...found], { from: "picture" });
  }

  async chooseWhere(where, from) {
    try {
      const ids = await this.maker.where(this.state.now.kind, where);
      this.choice.set([...ids], { where, from });
    } catch (error) {
      trouble("where", error.message);
    }
  }

  tell(found) {
    if (found?.id > 0) this.info.open(found.id);
    else if (found?.material) note("This is material that is cut. Cells are the hollows in it.");
  }

  /** Tells in the status line what the cursor is over. Only while nothing is drawn: reading a pixel waits for that. */
  hover(event) {
    clearTimeout(this.hoverLater);
    if (!event || this.director.phase !== "complete") {
      by("under").textContent = "";
      return;
    }
    const [x, y] = [event.offsetX, event.offsetY];
    this.hoverLater = setTimeout(() => {
      if (this.director.phase !== "complete" || !this.look) return;
      const found = this.under(x, y);
      const { kind } = this.state.now;
      by("under").textContent = !found ? "" : found.id > 0 ? this.brief(kind, found.id) : found.material ? "Material" : "";
    }, 40);
  }

  brief(kind, id) {
    const column = this.colouring.column();
    const x = this.things.known(kind, column.name)?.[this.things.row(kind, id)];
    const name = `${singular(kind)} ${id}`;
    return x === undefined ? name : `${name} · ${title(column)} ${value(x, column)} ${Number.isNaN(x) ? "" : unit(column.unit)}`;
  }

  // ---- what is done to what is chosen

  rule(make) {
    if (this.choice.ids.size === 0) {
      note("Choose something first: click on it, in the picture or in the list.");
      return;
    }
    this.state.addRule({ ...make, ...this.choice.rule() });
  }

  mark() {
    const all = this.choice.ids.size > 0 && [...this.choice.ids].every((id) => this.look?.marked.has(id));
    this.rule({ do: all ? "unmark" : "mark" });
  }

  paint(colour = this.lastPaint) {
    this.lastPaint = colour;
    this.rule({ do: "paint", colour });
  }

  leave() {
    this.rule({ do: "leave" });
    this.choice.clear();
  }

  only() {
    this.rule({ do: "only" });
    this.choice.clear();
  }

  paintMenu() {
    return menu(h("button", { title: "Paint what is chosen (P: the last colour)" }, "Paint"), (close) => [
      ...PAINTS.map((colour) => {
        const made = h("button", { className: "swatch", ariaLabel: colour, title: colour, onClick: () => {
          this.paint(colour);
          close();
        } });
        made.style.background = colour;
        return made;
      }),
      h("button", { className: "item wide", onClick: () => {
        this.rule({ do: "unpaint" });
        close();
      } }, "No paint"),
    ], "paints");
  }

  escape() {
    if (!this.info.card.hidden) this.info.close();
    else this.choice.clear();
    if (document.activeElement !== document.body) document.activeElement.blur();
  }

  // ---- copies

  async copy(text, told) {
    try {
      await navigator.clipboard.writeText(text);
      note(told);
    } catch {
      note("Copy this: ", h("code", {}, text));
    }
  }

  copyLink() {
    return this.copy(location.href.split("#")[0] + this.link(), "The link is copied. It opens this view as long as alvis view runs.");
  }

  copyCommand() {
    if (!this.look) {
      note("There is nothing to select by before the tables are read.");
      return null;
    }
    const text = command(this.state.now, this.set.command.where, this.look);
    if (text.length > 30000) {
      note("So many single things do not fit into a command. Choose them by a condition, then it is short.");
      return null;
    }
    return this.copy(text, h("span", {}, "Copied: ", h("code", {}, text.length > 160 ? `${text.slice(0, 160)} …` : text)));
  }

  // ---- the page

  setTheme(dark) {
    this.dark = dark;
    document.documentElement.dataset.theme = dark ? "dark" : "light";
    this.colouring.histogram.draw();
    this.director.redraw();
  }

  toggleTheme() {
    this.setTheme(!this.dark);
  }

  showDock() {
    by("dock").classList.remove("closed");
    this.top.update();
  }

  toggleDock() {
    by("dock").classList.toggle("closed");
    this.top.update();
  }
}

// The twelve edges of a box; those that meet in the corner farthest from the eye are behind it.
function edges({ low, high }, tint, eye = null) {
  const ends = corners({ low, high });
  const far = eye ? mix(low, high, 0.5).reduce((s, x, k) => s | (eye[k] < x ? 1 << k : 0), 0) : -1;
  const out = [];
  for (let i = 0; i < 8; i++) {
    for (let k = 0; k < 3; k++) {
      const j = i | (1 << k);
      if (j !== i) out.push({ from: ends[i], to: ends[j], tint, behind: i === far || j === far });
    }
  }
  return out;
}

