// The table beside the picture: rows of what a condition keeps, in the order of a column, only those drawn that show.
import { by, h, menu } from "./dom.js";
import { count, many, singular, title, unit, value } from "./format.js";

/** Two clicks within so many ms are a double click. */
const TWICE = 500;
const ROW = 27;
/** Browsers do not scroll further than this. */
const TALLEST = 8e6;
const EXAMPLE = { cells: "volume > 0.1 and not touches_border", objects: "volume > 0.1 and tiles > 1", surfaces: "area > 0.1" };
const USUAL = {
  cells: ["volume", "equivalent_diameter", "sphericity"],
  objects: ["volume", "area", "tiles"],
  surfaces: ["cell", "object", "area"],
};

export class List {
  constructor(app) {
    this.app = app;
    this.columns = structuredClone(USUAL);
    this.asked = { cells: {}, objects: {}, surfaces: {} };
    for (const kind of Object.keys(this.asked)) this.asked[kind] = { where: "", sort: "", descending: false };
    this.order = new Uint32Array(0);
    this.place = new Map();
    this.round = 0;
    this.frame();
    app.choice.onChange((from) => {
      this.rows();
      if (from !== "list" && app.choice.ids.size > 0) this.reveal();
    });
  }

  frame() {
    this.filter = h("input", {
      type: "search", className: "grow", spellcheck: false, ariaLabel: "Condition",
      onInput: () => {
        clearTimeout(this.later);
        this.later = setTimeout(() => this.ask({ where: this.filter.value.trim() }), 350);
      },
      onKeydown: (e) => e.key === "Enter" && this.ask({ where: this.filter.value.trim() }),
    });
    this.filter.addEventListener("search", () => this.ask({ where: this.filter.value.trim() }));
    this.wrong = h("div", { className: "wrong-text", hidden: true, role: "alert" });
    this.told = h("div", { className: "soft" });
    this.heading = h("h2");
    const { app } = this;
    const act = (text, tip, run) => h("button", { title: tip, onClick: run }, text);
    this.acts = [
      act("Mark", "Mark what is chosen, or unmark it (M)", () => app.mark()),
      app.paintMenu(),
      act("Leave out", "Do not show what is chosen (H)", () => app.leave()),
      act("Show only", "Show nothing but what is chosen (Shift H)", () => app.only()),
    ];
    this.all = act("Show all", "Show what was left out (Alt H)", () => app.state.showAll());
    this.take = act("Choose listed", "Choose all that the list shows", () => app.chooseWhere(this.now.where || "id > 0", "list"));
    const columns = menu(h("button", { title: "Columns of the list" }, "Columns"), () => this.columnBoxes());
    this.head = h("div", { className: "grid-head" });
    this.spacer = h("div");
    this.shownRows = h("div", { className: "grid-rows" });
    this.body = h("div", { className: "grid-body", tabIndex: 0, onScroll: () => this.rows(), onKeydown: (e) => this.key(e) },
      this.spacer, this.shownRows);
    this.shownRows.addEventListener("click", (e) => this.click(e));
    new ResizeObserver(() => this.rows()).observe(this.body);
    by("list").replaceChildren(
      h("div", { className: "headline" }, h("div", {}, this.heading, this.told), h("div", { className: "row tight" }, this.take, columns)),
      h("div", { className: "row tight" }, this.filter),
      this.wrong,
      h("div", { className: "row acts" }, ...this.acts, this.all),
      h("div", { className: "grid" }, this.head, this.body),
    );
  }

  get kind() {
    return this.app.state.now.kind;
  }

  get now() {
    return this.asked[this.kind];
  }

  shownColumns() {
    return this.columns[this.kind].map((n) => this.app.things.column(this.kind, n)).filter(Boolean);
  }

  columnBoxes() {
    return this.app.things.columns(this.kind).filter((c) => c.name !== "id").map((c) => {
      const box = h("input", { type: "checkbox", checked: this.columns[this.kind].includes(c.name), onChange: () => {
        const list = this.columns[this.kind];
        this.columns[this.kind] = box.checked ? [...list, c.name] : list.filter((n) => n !== c.name);
        this.load();
      } });
      return h("label", {}, box, title(c));
    });
  }

  /** Another kind, or a new look: what is listed stays as it was asked for. */
  async show() {
    this.filter.value = this.now.where;
    this.filter.placeholder = EXAMPLE[this.kind];
    this.body.scrollTop = 0;
    const names = this.app.things.columns(this.kind).map((c) => c.name).join(", ");
    this.filter.title = `Columns: ${names}. and, or, not, ( ), < <= > >= ==, + - * / ^, abs, sqrt, cbrt, exp, log, log10, min, max; missing(column)`;
    await this.load();
  }

  ask(members) {
    clearTimeout(this.later);
    Object.assign(this.now, members);
    return this.load();
  }

  async load() {
    const round = ++this.round;
    const { kind } = this;
    const { where, sort, descending } = this.now;
    try {
      const [order] = await Promise.all([
        this.app.server.query(kind, { where, sort, descending }),
        this.app.things.need(kind, this.shownColumns().map((c) => c.name)),
      ]);
      if (round !== this.round) return;
      this.order = order;
      this.place = new Map();
      order.forEach((id, i) => this.place.set(id, i));
      this.wrong.hidden = true;
      this.filter.classList.remove("wrong");
    } catch (error) {
      if (round !== this.round) return;
      this.wrong.textContent = error.message;
      this.wrong.hidden = false;
      this.filter.classList.add("wrong");
      return;
    }
    this.headings();
    this.spacer.style.height = `${Math.min(this.order.length * ROW, TALLEST)}px`;
    this.rows();
  }

  headings() {
    const columns = this.shownColumns();
    const widths = `28px 64px ${columns.map(() => "minmax(64px, 1fr)").join(" ")}`;
    this.head.style.gridTemplateColumns = this.widths = widths;
    const cell = (name, text, small) => {
      const on = (this.now.sort || "id") === name;
      return h("button", { title: `Sort by ${name}`, ariaPressed: String(on), onClick: () => this.sort(name) },
        text, on ? (this.now.descending ? " ▾" : " ▴") : "", small ? h("small", {}, small) : null);
    };
    this.head.replaceChildren(h("span"), cell("id", "id", ""), ...columns.map((c) => cell(c.name, title(c), unit(c.unit))));
  }

  sort(name) {
    const { sort, descending } = this.now;
    // the largest first, as one asks for mostly; the second time the other way round
    const same = (sort || "id") === name;
    this.ask({ sort: name === "id" ? "" : name, descending: same ? !descending : name !== "id" });
  }

  // Rows are as many as fit; where all would be too tall to scroll, the bar moves over shares of them.
  first() {
    const fit = this.body.clientHeight / ROW;
    const tall = Math.min(this.order.length * ROW, TALLEST);
    const most = Math.max(this.order.length - fit, 0);
    const share = this.body.scrollTop / Math.max(tall - this.body.clientHeight, 1);
    return Math.min(share, 1) * most;
  }

  rows() {
    const { app, kind } = this;
    const { look, choice } = app;
    const chosen = choice.ids.size;
    const listed = this.order.length;
    const all = app.set.tables[kind].rows;
    this.heading.textContent = `${kind[0].toUpperCase()}${kind.slice(1)}`;
    const left = look ? look.hidden.size : 0;
    this.told.textContent = [listed < all ? `${count(listed)} of ${count(all)} listed` : many(all, singular(kind)),
      chosen > 0 ? `${count(chosen)} chosen` : "", left > 0 ? `${count(left)} left out` : "",
      look?.marked.size ? `${count(look.marked.size)} marked` : ""].filter(Boolean).join(" · ");
    for (const b of this.acts) for (const e of b.matches("button") ? [b] : b.querySelectorAll(":scope > button")) e.disabled = chosen === 0;
    this.all.disabled = left === 0;
    if (!this.widths || !look || look.kind !== kind) return;
    const first = this.first();
    const from = Math.floor(first);
    const to = Math.min(from + Math.ceil(this.body.clientHeight / ROW) + 1, listed);
    const columns = this.shownColumns();
    const made = [];
    for (let i = from; i < to; i++) made.push(this.row(this.order[i], columns));
    this.shownRows.replaceChildren(...made);
    this.shownRows.style.transform = `translateY(${this.body.scrollTop - (first - from) * ROW}px)`;
  }

  row(id, columns) {
    const { things, look, choice } = this.app;
    const at = things.row(this.kind, id);
    const chip = h("span", { className: look.marked.has(id) ? "chip marked" : "chip" });
    chip.style.background = `rgb(${look.bytes.subarray(4 * id, 4 * id + 3).join()})`;
    const made = h("div", { className: "grid-row" }, chip, h("span", {}, String(id)),
      ...columns.map((c) => h("span", {}, value(things.known(this.kind, c.name)?.[at] ?? NaN, c))));
    made.dataset.id = id;
    made.style.gridTemplateColumns = this.widths;
    if (choice.ids.has(id)) made.classList.add("chosen");
    if (look.hidden.has(id)) made.classList.add("hidden-thing");
    return made;
  }

  id(event) {
    const row = event.target.closest(".grid-row");
    return row ? Number(row.dataset.id) : null;
  }

  click(event) {
    const id = this.id(event);
    const { choice } = this.app;
    if (id === null) return;
    // the first click makes the row anew, so that the browser sees no double click
    const { id: before, time } = this.clicked ?? {};
    this.clicked = { id, time: event.timeStamp };
    if (id === before && event.timeStamp - time < TWICE && !event.shiftKey && !event.ctrlKey && !event.metaKey) {
      this.clicked = null;
      this.app.info.open(id, { fly: true });
      return;
    }
    if (event.shiftKey && this.anchor !== undefined && this.place.has(this.anchor)) {
      const [a, b] = [this.place.get(this.anchor), this.place.get(id)].sort((p, q) => p - q);
      choice.set([...this.order.subarray(a, b + 1)], { from: "list" });
    } else if (event.ctrlKey || event.metaKey) choice.toggle(id, "list");
    else choice.set([id], { from: "list" });
    if (!event.shiftKey) this.anchor = id;
  }

  key(event) {
    const step = { ArrowDown: 1, ArrowUp: -1, PageDown: 15, PageUp: -15 }[event.key];
    const { choice } = this.app;
    if (event.key === "Enter" && choice.ids.size === 1) {
      event.stopPropagation();
      this.app.info.open([...choice.ids][0], { fly: true });
    }
    if (!step || this.order.length === 0) return;
    event.preventDefault();
    event.stopPropagation();
    const at = choice.ids.size === 1 ? this.place.get([...choice.ids][0]) : undefined;
    const next = at === undefined ? 0 : Math.min(Math.max(at + step, 0), this.order.length - 1);
    choice.set([this.order[next]], { from: "keys" });
  }

  /** Scrolls to the first of what is chosen. */
  reveal() {
    let at = Infinity;
    for (const id of this.app.choice.ids) at = Math.min(at, this.place.get(id) ?? Infinity);
    if (!Number.isFinite(at)) return;
    const fit = this.body.clientHeight / ROW;
    const first = this.first();
    if (at >= first && at + 1 <= first + fit) return;
    const most = Math.max(this.order.length - fit, 1);
    const tall = Math.min(this.order.length * ROW, TALLEST) - this.body.clientHeight;
    this.body.scrollTop = (Math.max(at - fit / 2, 0) / most) * tall;
  }
}
