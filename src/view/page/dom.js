// Elements in few words.

/** An element: properties and listeners (`onClick`), `data` and `aria` members, then what it holds. */
export function h(tag, properties = {}, ...inside) {
  const made = document.createElement(tag);
  for (const [key, value] of Object.entries(properties)) {
    if (key.startsWith("on")) made.addEventListener(key.slice(2).toLowerCase(), value);
    else if (key.startsWith("aria") || key === "role") made.setAttribute(key.replace(/[A-Z]/, (c) => `-${c.toLowerCase()}`), value);
    else made[key] = value;
  }
  made.append(...inside.filter((i) => i !== null && i !== undefined));
  return made;
}

export const by = (id) => document.getElementById(id);

/** A button that opens what `fill` puts beside it, and closes it again at any click elsewhere. */
export function menu(button, fill, shape = "") {
  const pop = h("div", { className: `pop ${shape}`, hidden: true });
  const close = (event) => {
    if (!event || !pop.parentElement.contains(event.target)) {
      pop.hidden = true;
      document.removeEventListener("pointerdown", close, true);
    }
  };
  button.addEventListener("click", () => {
    if (!pop.hidden) return close();
    pop.replaceChildren(...fill(() => close()));
    pop.hidden = false;
    document.addEventListener("pointerdown", close, true);
  });
  return h("div", { className: "menu" }, button, pop);
}

/** A list to choose one of: [[value, text]]. */
export function choices(list, chosen, pick, properties = {}) {
  const made = h("select", { ...properties, onChange: () => pick(made.value) });
  for (const [value, text] of list) made.append(h("option", { value, selected: value === chosen }, text));
  return made;
}

/** Buttons of which one is on. */
export function oneOf(list, chosen, pick, label) {
  const made = h("div", { className: "switch", role: "radiogroup", ariaLabel: label });
  for (const [value, text] of list) {
    const on = value === chosen;
    made.append(h("button", { role: "radio", ariaChecked: String(on), onClick: () => pick(value) }, text));
  }
  return made;
}
