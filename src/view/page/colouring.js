// The panel of colours: plain, by a column, best and worst; the column's distribution and the ends of the scale.
import { BEST, MAP_NAMES, WORST } from "./colours.js";
import { by, choices, h, oneOf } from "./dom.js";
import { number, title, unit } from "./format.js";
import { Histogram, spread } from "./histogram.js";

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

  /** The column that is asked for, or the usual one. */
  column() {
    const { kind, colour } = this.app.state.now;
    const { things } = this.app;
    return things.column(kind, colour[kind].column) ?? things.column(kind, FIRST[kind]) ?? things.columns(kind)[0];
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
    const scale = look.scale?.by === "column" ? look.scale : null;
    const [one, more] = { cells: ["cell", "cells"], objects: ["object", "objects"], surfaces: ["surface", "surfaces"] }[kind];
    const use = (i) => !look.hidden.has(ids[i]);
    this.histogram.show(spread(values, use, { log: asked.log, map: asked.map, scale, one, more }));
    const modes = [["plain", "Plain"], ["column", "By value"]];
    if (things.column(kind, "form_factor")) modes.push(["best", "Best and worst"]);
    const names = things.columns(kind).filter((c) => c.name !== "id").map((c) => [c.name, title(c)]);
    this.panel.replaceChildren(
      h("div", { className: "headline" }, h("h2", {}, "Colour"), oneOf(modes, asked.by, (m) => this.mode(m), "Colour")),
      ...(asked.by === "best" ? [this.bestRow(asked)] : []),
      h("div", { className: "row tight" },
        choices(names, column.name, (name) => this.take(name), { className: "grow", ariaLabel: "Column" }),
        h("span", { className: "soft" }, unit(column.unit)),
        asked.by === "column"
          ? choices(MAP_NAMES.map((m) => [m, m]), asked.map, (map) => state.setColour({ map }), { ariaLabel: "Colour map" })
          : null,
        h("label", { title: "Logarithmic scale" },
          h("input", { type: "checkbox", checked: asked.log, onChange: (e) => state.setColour({ log: e.target.checked, low: null, high: null }) }),
          "log")),
      this.histogram.element,
      ...(scale ? [this.ends(asked, scale)] : []),
    );
  }

  mode(by) {
    const { state } = this.app;
    const { kind, colour } = state.now;
    if (by === "column" && colour[kind].column === "") this.take(this.column().name);
    else state.setColour({ by });
  }

  /** Colours by a column; a logarithmic scale where values are spread over powers of ten. */
  async take(name) {
    const { state, things } = this.app;
    const { kind, colour } = state.now;
    const values = (await things.values(kind, name)).filter((v) => Number.isFinite(v)).sort();
    const at = (share) => values[Math.round(share * (values.length - 1))];
    const log = values.length > 0 && at(0.02) > 0 && at(0.98) / at(0.02) > 60;
    const by = colour[kind].by === "best" ? "best" : "column";
    state.setColour({ by, column: name, log, low: null, high: null });
  }

  bestRow(asked) {
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
    return h("div", { className: "row" }, "The ", input, dot(BEST), "best and", dot(WORST), "worst by form factor");
  }

  ends(asked, scale) {
    const { state } = this.app;
    const end = (name) => {
      const input = h("input", {
        type: "text", inputMode: "decimal", className: "number", value: number(scale[name], 4),
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
