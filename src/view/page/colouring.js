// The panel of colours: plain, by a column, best and worst; the column's distribution and the ends of the scale.
import { BEST, MAP_NAMES, WORST } from "./colours.js";
import { by, choices, h, oneOf, refill } from "./dom.js";
import { count, digitsBetween, number, title, unit } from "./format.js";
import { Histogram, spread } from "./histogram.js";
import { over, trouble } from "./messages.js";
import { quantile } from "./things.js";

const FIRST = { cells: "volume", objects: "volume", surfaces: "area" };

export class Colouring {
  constructor(app) {
    this.app = app;
    this.panel = by("colour");
    this.histogram = new Histogram((low, high) => this.brushed(low, high));
    this.round = 0;
    app.choice.onChange((from) => {
      if (from !== "histogram") this.histogram.clearBrush();
    });
  }

  /** The column that colours, else the one that is asked for, or the usual one. */
  column() {
    const { kind, colour } = this.app.state.now;
    const { things } = this.app;
    const { by, column } = colour[kind];
    const ranks = by === "best" ? things.column(kind, "form_factor") : null;
    return ranks ?? things.column(kind, column) ?? this.usual(kind);
  }

  usual(kind) {
    const { things } = this.app;
    return things.column(kind, FIRST[kind]) ?? things.columns(kind)[0];
  }

  /** Shows what the look has made of the state. */
  async build(look) {
    const round = ++this.round;
    const { state, things } = this.app;
    const { kind } = state.now;
    const asked = state.now.colour[kind];
    const column = this.column();
    const values = await things.values(kind, column.name);
    const ids = await things.ids(kind);
    if (round !== this.round) return;
    const { scale } = look;
    const best = scale?.by === "best";
    const log = asked.log && !best;
    const [one, more] = { cells: ["cell", "cells"], objects: ["object", "objects"], surfaces: ["surface", "surfaces"] }[kind];
    const use = (i) => !look.hidden.has(ids[i]);
    this.histogram.show(spread(values, use, { log, scale, one, more }));
    const modes = [["plain", "Plain"], ["column", "By value"]];
    if (things.column(kind, "form_factor")) modes.push(["best", "Best and worst"]);
    refill(this.panel,
      h("div", { className: "headline" }, h("h2", {}, "Colour"), oneOf(modes, asked.by, (m) => this.mode(m), "Colour")),
      ...(best ? this.bestRows(asked, scale, { more, shown: look.shown }) : [this.columnRow(kind, asked, column)]),
      this.histogram.element,
      ...(scale && !best ? [this.ends(asked, scale)] : []),
    );
  }

  columnRow(kind, asked, column) {
    const { state, things } = this.app;
    const names = things.columns(kind).filter((c) => c.name !== "id").map((c) => [c.name, title(c)]);
    return h("div", { className: "row tight" },
      choices(names, column.name, (name) => this.take(name), { className: "grow", ariaLabel: "Column" }),
      h("span", { className: "soft" }, unit(column.unit)),
      asked.by === "column"
        ? choices(MAP_NAMES.map((m) => [m, m]), asked.map, (map) => state.setColour({ map }), { ariaLabel: "Colour map" })
        : null,
      h("label", { title: "Logarithmic scale" },
        h("input", { type: "checkbox", checked: asked.log, onChange: (e) => state.setColour({ log: e.target.checked, low: null, high: null }) }),
        "log"));
  }

  mode(by) {
    const { state } = this.app;
    const { kind, colour } = state.now;
    if (by === "column" && colour[kind].column === "") this.take(this.usual(kind).name);
    else state.setColour({ by });
  }

  /** Colours by a column; a logarithmic scale where values are spread over powers of ten. */
  async take(name) {
    const { state, things } = this.app;
    let values;
    try {
      values = await things.sorted(state.now.kind, name);
      over("column");
    } catch (error) {
      trouble("column", error.message);
      // the list of columns names the one that colours again
      await this.build(this.app.look);
      return;
    }
    const [low, high] = [0.02, 0.98].map((share) => quantile(values, share));
    const log = low > 0 && high / low > 60;
    state.setColour({ by: "column", column: name, log, low: null, high: null });
  }

  // How many are asked for, and how many there are: things that the edge of the scan cuts have no form factor.
  bestRows(asked, scale, { more, shown }) {
    const { state } = this.app;
    const input = h("input", {
      type: "number", className: "brief", min: 1, value: asked.count, ariaLabel: "How many",
      onChange: () => Number.isInteger(input.valueAsNumber) && input.valueAsNumber > 0 && state.setColour({ count: input.valueAsNumber }),
    });
    const dot = (colour) => {
      const made = h("span", { className: "chip" });
      made.style.background = `rgb(${colour.rgb.join()})`;
      return made;
    };
    const few = scale.count < asked.count ? `, half of them best: ${count(scale.count)}` : "";
    return [
      h("div", { className: "row" }, "The ", input, dot(BEST), "best,", dot(WORST), "worst form factors"),
      h("div", { className: "soft told" }, `Only whole ${more} have one: ${count(scale.ranked)} of ${count(shown)} shown${few}.`),
    ];
  }

  ends(asked, scale) {
    const { state } = this.app;
    const end = (name) => {
      const input = h("input", {
        type: "text", inputMode: "decimal", className: "number", value: number(scale[name], digitsBetween(scale.low, scale.high, 4)),
        ariaLabel: name === "low" ? "First colour at" : "Last colour at",
        onChange: () => {
          const x = Number(input.value);
          if (input.value.trim() === "") state.setColour({ [name]: null });
          else if (Number.isFinite(x)) state.setColour({ [name]: x });
          else input.classList.add("wrong");
        },
      });
      return input;
    };
    const own = asked.low !== null || asked.high !== null;
    return h("div", { className: "row tight" }, end("low"), h("span", { className: "soft" }, "to"), end("high"),
      h("button", { disabled: !own, title: "Ends that leave 2 % of the values out on either side", onClick: () => state.setColour({ low: null, high: null }) }, "Fit"),
      h("button", { title: "From the smallest to the largest", onClick: () => state.setColour({ low: scale.least, high: scale.most }) }, "All"));
  }

  async brushed(low, high) {
    if (low === undefined) {
      this.app.choice.clear("histogram");
      return;
    }
    const { name } = this.column();
    const parts = [];
    if (low !== null) parts.push(`${name} >= ${low}`);
    if (high !== null) parts.push(`${name} <= ${high}`);
    await this.app.chooseWhere(parts.join(" and ") || `not missing(${name})`, "histogram");
  }
}
