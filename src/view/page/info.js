// All that the tables say of one thing.
import { by, h } from "./dom.js";
import { singular, title, unit, value } from "./format.js";
import { trouble } from "./messages.js";

export class Info {
  constructor(app) {
    this.app = app;
    this.card = by("info");
    this.id = null;
  }

  /** Opens the card of a thing of the kind that is shown; with `fly` the camera goes there. */
  async open(id, { fly = false } = {}) {
    const { app } = this;
    const { kind } = app.state.now;
    let row;
    try {
      row = await app.server.row(kind, id);
    } catch (error) {
      trouble("row", error.message);
      return;
    }
    this.id = id;
    const word = singular(kind);
    const name = `${word[0].toUpperCase()}${word.slice(1)} ${id}`;
    const line = (c) => {
      const known = app.things.column(kind, c.name) ?? c;
      const text = `${value(c.value, { ...known, ...c }, 6)}${c.unit && c.value !== null ? ` ${unit(c.unit)}` : ""}`;
      const tip = c.value === null ? "This has no meaning here" : String(c.value);
      return h("tr", {}, h("td", { title: c.name }, title(c)), h("td", { title: tip }, text));
    };
    const act = (text, tip, run) => h("button", { title: tip, onClick: run }, text);
    const chosen = (run) => () => {
      app.choice.set([id], { from: "info" });
      run();
    };
    this.card.replaceChildren(
      h("header", {}, h("h2", {}, name), h("button", { ariaLabel: "Close", onClick: () => this.close() }, "✕")),
      h("div", { className: "rows" }, h("table", {}, h("tbody", {}, ...row.columns.filter((c) => c.name !== "id").map(line)))),
      h("div", { className: "actions row" },
        act("Fly there", "The camera goes there (F)", chosen(() => app.frame())),
        act("Mark", "Mark it, or unmark it (M)", chosen(() => app.mark())),
        act("Leave out", "Do not show it (H)", chosen(() => app.leave())),
        act("Show only", "Show nothing else (Shift H)", chosen(() => app.only()))),
    );
    this.card.hidden = false;
    app.choice.set([id], { from: "info" });
    if (fly) app.frame();
  }

  close() {
    this.card.hidden = true;
    this.id = null;
  }
}
