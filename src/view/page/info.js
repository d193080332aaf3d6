// All that the tables say of one thing.
import { by, h } from "./dom.js";
import { singular, title, unit, value } from "./format.js";
import { trouble } from "./messages.js";

// Columns that are x, y and z of one thing stand in one line.
function grouped(columns) {
  const lines = new Map();
  for (const c of columns) {
    const name = c.name.replace(/_[xyz]$/, "");
    lines.set(name, [...(lines.get(name) ?? []), c]);
  }
  return [...lines].map(([name, parts]) => ({ name, parts }));
}

export class Info {
  constructor(app) {
    this.app = app;
    this.card = by("info");
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
    const word = singular(kind);
    const name = `${word[0].toUpperCase()}${word.slice(1)} ${id}`;
    const line = ({ name, parts }) => {
      const known = { ...app.things.column(kind, parts[0].name), ...parts[0] };
      const digits = parts.length > 1 ? (known.unit ? 4 : 3) : 6;
      const empty = parts.every((c) => c.value === null);
      const text = empty ? "–" : `${parts.map((c) => value(c.value, known, digits)).join(", ")} ${unit(known.unit)}`;
      const tip = empty ? "This has no meaning here" : parts.map((c) => c.value).join(", ");
      return h("tr", {}, h("td", { title: parts.map((c) => c.name).join(", ") }, title({ name })), h("td", { title: tip }, text));
    };
    const act = (text, tip, run) => h("button", { title: tip, onClick: run }, text);
    const chosen = (run) => () => {
      app.choice.set([id], { from: "info" });
      run();
    };
    this.card.replaceChildren(
      h("header", {}, h("h2", {}, name), h("button", { ariaLabel: "Close", onClick: () => this.close() }, "✕")),
      h("div", { className: "rows" }, h("table", {}, h("tbody", {}, ...grouped(row.columns.filter((c) => c.name !== "id")).map(line)))),
      h("div", { className: "actions row" },
        act("Fly there", "The camera goes there (F)", chosen(() => app.frame())),
        act("Mark", "Mark it, or unmark it (M)", chosen(() => app.mark())),
        act("Leave out", "Do not show it (H)", chosen(() => app.leave())),
        act("Show only", "Show nothing else (Shift H)", chosen(() => app.only()))),
    );
    this.card.hidden = false;
    app.showDock();
    this.card.scrollIntoView({ block: "nearest" });
    app.choice.set([id], { from: "info" });
    if (fly) app.frame();
  }

  close() {
    this.card.hidden = true;
  }
}
