// The keyboard, and the page of help that tells of it.
import { STANDARD, panned, turned } from "./camera.js";
import { by, h } from "./dom.js";
import { askToSave } from "./save.js";

const TURN = Math.PI / 24;

// Each: keys, what they do in words, what they run. The order is that of the help.
function table(app) {
  const { state } = app;
  const camera = () => state.now.camera;
  const look = (to) => app.steer(to);
  const turn = (left, up) => look(turned(camera(), camera().target, left, up));
  const pan = (x, y) => look(panned(camera(), app.director.view(), camera().target, x, y));
  const standard = (name, other) => app.fly({ ...camera(), ...(other ? opposite(STANDARD[name]) : STANDARD[name]) });
  return {
    View: [
      [["x", "y", "z"], "Look along an axis", (k) => standard(k, false)],
      [["X", "Y", "Z"], "from the other end", (k) => standard(k.toLowerCase(), true), "Shift X, Y, Z"],
      [["f", "."], "Show what is chosen from near", () => app.frame()],
      [["Home", "r"], "Show everything", () => app.home()],
      [["o", "5"], "With or without perspective", () => look({ ...camera(), flat: !camera().flat })],
      [["+", "=", "-"], "Nearer, farther", (k) => app.gestures.zoom(k === "-" ? 1.25 : 0.8)],
      [["ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown"], "Turn; with Shift: move", (k, e) => {
        const [x, y] = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[k];
        if (e.shiftKey) pan(-x * 0.06, -y * 0.06);
        else turn(x * TURN, -y * TURN);
      }, "Arrows"],
    ],
    "What is chosen": [
      [["i", "Enter"], "All that is known of it", () => app.choice.ids.size === 1 && app.info.open([...app.choice.ids][0])],
      [["m"], "Mark, unmark", () => app.mark()],
      [["p"], "Paint in the last colour", () => app.paint()],
      [["h", "Delete"], "Leave out", () => app.leave()],
      [["H"], "Show only these", () => app.only(), "Shift H"],
      [["alt+h"], "Show all again", () => state.showAll(), "Alt H"],
      [["ctrl+z"], "Undo", () => state.undo(), "Ctrl Z"],
      [["ctrl+Z", "ctrl+y"], "Redo", () => state.redo(), "Ctrl Shift Z"],
      [["Escape"], "Choose nothing, close panels", () => app.escape()],
    ],
    "The rest": [
      [["c"], "Section on, off", () => app.section.toggle()],
      [["[", "]"], "Move the section", (k) => app.section.step(k === "[" ? -0.02 : 0.02)],
      [["/"], "Type a condition", () => by("list").querySelector("input").focus()],
      [["t"], "Hide, show the panel", () => app.toggleDock()],
      [["s"], "Save a picture", () => askToSave(app)],
      [["l"], "Dark, light", () => app.toggleTheme()],
      [["?"], "This page", () => toggleHelp(app)],
    ],
  };
}

const MOUSE = [
  ["Click", "Choose. With Ctrl: one more, or one less"],
  ["Double click", "All that is known of it"],
  ["Drag", "Turn about what is under the cursor"],
  ["Shift-drag, right-drag", "Move"],
  ["Wheel, + and -", "Nearer to the cursor, farther"],
  ["Alt-drag", "Choose all that shows in a box"],
  ["Drag in the distribution", "Choose by value"],
];

function opposite({ azimuth, elevation }) {
  return elevation === 0 ? { azimuth: azimuth + Math.PI, elevation } : { azimuth, elevation: -elevation };
}

export function listen(app) {
  const known = new Map();
  for (const rows of Object.values(table(app))) {
    for (const [keys, , run] of rows) for (const k of keys) known.set(k, run);
  }
  addEventListener("keydown", (event) => {
    // a sheet that lies over the page has the keys
    if (["help", "save"].some((name) => by(name).open) && event.key !== "?") return;
    const typing = event.target.matches("input:not([type=checkbox]):not([type=range]), select, textarea");
    const control = event.ctrlKey || event.metaKey;
    const name = (control ? "ctrl+" : event.altKey ? "alt+" : "") + (event.altKey ? event.code.replace(/^Key/, "").toLowerCase() : event.key);
    if (typing && event.key !== "Escape" && !(control && /[zy]/i.test(event.key) && !event.target.matches("[type=search], [type=text]"))) return;
    // buttons and rows have keys of their own
    if (event.key === "Enter" && event.target.matches("button")) return;
    if (event.key.startsWith("Arrow") && event.target.matches("[type=range]")) return;
    const run = known.get(name);
    if (!run) return;
    event.preventDefault();
    run(event.key, event);
  });
}

export function toggleHelp(app) {
  const sheet = by("help");
  if (sheet.open) {
    sheet.close();
    return;
  }
  const shown = { ArrowLeft: "←", ".": ".", Home: "Home", Escape: "Esc" };
  const keys = ([names, text, , instead]) => [
    h("dt", {}, ...(instead ? [h("kbd", {}, instead)] : names.filter((n) => n !== "=").flatMap((n, i) => [i ? " " : "", h("kbd", {}, shown[n] ?? (n.length === 1 ? n.toUpperCase() : n))]))),
    h("dd", {}, text),
  ];
  const groups = Object.entries(table(app)).map(([name, rows]) => [h("h3", {}, name), h("dl", { className: "keys" }, ...rows.flatMap(keys))]);
  const mouse = MOUSE.flatMap(([what, text]) => [h("dt", {}, h("kbd", {}, what)), h("dd", {}, text)]);
  const close = h("button", { onClick: () => toggleHelp(app) }, "Close");
  sheet.replaceChildren(h("div", {},
    h("div", { className: "headline" }, h("h2", {}, "Mouse and keyboard"), close),
    h("div", { className: "columns" },
      h("div", {}, h("h3", {}, "Mouse"), h("dl", { className: "keys" }, ...mouse), ...groups[2]),
      h("div", {}, ...groups[0], ...groups[1]))));
  sheet.showModal();
  close.focus();
}
