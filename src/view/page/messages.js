// What the page has to say beside the picture: passing notes, and troubles that stay until they are over.
import { by, h } from "./dom.js";

const kept = new Map();

/** A note that goes by itself, or when the next one comes. */
export function note(...inside) {
  for (const other of by("messages").querySelectorAll(".message:not(.bad)")) other.remove();
  const made = h("div", { className: "message" }, ...inside);
  by("messages").append(made);
  setTimeout(() => made.remove(), 6000);
}

/** A trouble: stays until `over(name)`, or until somebody closes it. */
export function trouble(name, text, action = null) {
  over(name);
  const close = h("button", { ariaLabel: "Close", onClick: () => over(name) }, "✕");
  const act = action ? h("button", { onClick: action.run }, action.text) : null;
  const made = h("div", { className: "message bad", role: "alert" }, h("span", {}, text), act, close);
  kept.set(name, made);
  by("messages").append(made);
}

export function over(name) {
  kept.get(name)?.remove();
  kept.delete(name);
}

/** Covers the picture: there is nothing to show. Without a text, the cover goes. */
export function cover(text, more = "") {
  by("cover").hidden = text === null;
  if (text !== null) by("cover-text").replaceChildren(text, ...(more ? [h("p", {}, more)] : []));
}
