// The bar at the top: what is shown, and what one can do with the whole.
import { STANDARD } from "./camera.js";
import { by, h, menu } from "./dom.js";
import { count, number, unit } from "./format.js";
import { toggleHelp } from "./keys.js";
import { askToSave } from "./save.js";
import { KINDS } from "./state.js";

export function buildTop(app) {
  const { set, state } = app;
  by("name").textContent = set.name;
  document.title = `${set.name} – alvis view`;
  const spacing = new Set(set.spacing).size === 1 ? [set.spacing[0]] : set.spacing;
  const size = set.unit === "voxel" ? "voxels" : `voxels of ${spacing.map((s) => number(s)).join(" × ")} ${unit(set.unit)}`;
  by("about").textContent = `${set.dims.join(" × ")} ${size}`;
  by("about").title = [`made of ${set.source}`, `threshold ${number(set.threshold)}`, ...set.filters].join(", ");
  const button = (text, tip, run, id = "") => h("button", { title: tip, onClick: run, id }, text);
  const standard = (name) => button(name.toUpperCase(), `Look along ${name} (${name.toUpperCase()}; with Shift from the other end)`, () => app.fly({ ...state.now.camera, ...STANDARD[name] }));
  const undo = button("↶", "Undo (Ctrl Z)", () => state.undo());
  undo.ariaLabel = "Undo";
  const redo = button("↷", "Redo (Ctrl Shift Z)", () => state.redo());
  redo.ariaLabel = "Redo";
  const flat = button("Parallel", "Without perspective: lengths are the same near and far (O)", () => app.steer({ ...state.now.camera, flat: !state.now.camera.flat }));
  const gap = () => h("span", { className: "gap" });
  const panel = button("Panel", "Hide or show the panel (T)", () => app.toggleDock());
  const share = menu(button("Share", "A picture, a link, a command"), (close) => [
    ["Save picture …", () => askToSave(app)],
    ["Copy link to this view", () => app.copyLink()],
    ["Copy as command", () => app.copyCommand()],
  ].map(([text, run]) => h("button", { className: "item", onClick: () => {
    close();
    run();
  } }, text)));
  // what opens a menu stands over the picture, not over the panel
  by("tools").replaceChildren(undo, redo, gap(), share, gap(),
    button("All", "Show everything (Home)", () => app.home()), standard("x"), standard("y"), standard("z"), flat, gap(),
    button("Section", "Cut the picture open (C)", () => app.section.toggle(), "section-button"), panel,
    button("◐", "Dark or light (L)", () => app.toggleTheme()), button("?", "Mouse and keyboard (?)", () => toggleHelp(app)));
  const kinds = KINDS.map((kind) => h("button", { role: "radio", onClick: () => state.set({ kind }) },
    `${kind[0].toUpperCase()}${kind.slice(1)} `, h("span", { className: "wide-only" }, count(set.tables[kind].rows))));
  by("kinds").replaceChildren(...kinds);
  app.top = {
    update() {
      undo.disabled = state.past.length === 0;
      redo.disabled = state.future.length === 0;
      flat.classList.toggle("on", state.now.camera.flat);
      panel.classList.toggle("on", !by("dock").classList.contains("closed"));
      KINDS.forEach((kind, i) => kinds[i].setAttribute("aria-checked", String(state.now.kind === kind)));
    },
  };
}
