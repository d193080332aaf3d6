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

/** Puts other things into a panel; what had the keyboard has it again if it is still there. */
export function refill(panel, ...inside) {
  const name = (e) => `${e.tagName} ${e.type} ${e.getAttribute("aria-label") ?? e.textContent}`;
  const held = panel.contains(document.activeElement) ? name(document.activeElement) : null;
  panel.replaceChildren(...inside);
  if (held) [...panel.querySelectorAll("button, input, select")].find((e) => name(e) === held)?.focus();
}

/**
 * A button that opens what `fill` puts beside it, within the window. Escape, a click elsewhere, and the keyboard's going
 * elsewhere close it.
 */
export function menu(button, fill, shape = "") {
  const pop = h("div", { className: `pop ${shape}`, hidden: true });
  const made = h("div", { className: "menu" }, button, pop);
  const close = () => {
    const held = pop.contains(document.activeElement);
    pop.hidden = true;
    if (held) button.focus();
    button.ariaExpanded = "false";
    document.removeEventListener("pointerdown", elsewhere, true);
  };
  const elsewhere = (event) => made.contains(event.target) || close();
  button.ariaExpanded = "false";
  button.addEventListener("click", () => {
    if (!pop.hidden) return close();
    pop.replaceChildren(...fill(close));
    pop.hidden = false;
    button.ariaExpanded = "true";
    put(pop, button);
    document.addEventListener("pointerdown", elsewhere, true);
    pop.querySelector("button, input")?.focus({ focusVisible: button.matches(":focus-visible") });
  });
  made.addEventListener("keydown", (event) => {
    if (event.key !== "Escape" || pop.hidden) return;
    event.stopPropagation();
    close();
  });
  made.addEventListener("focusout", (event) => event.relatedTarget && !made.contains(event.relatedTarget) && close());
  return made;
}

// Below a button, or above it where there is no room; its right side where the button's is, inside of the window.
function put(pop, button) {
  const at = button.getBoundingClientRect();
  const [above, below] = [at.top - 12, innerHeight - at.bottom - 12];
  const down = below >= Math.min(pop.scrollHeight + 2, 200) || below >= above;
  pop.style.maxHeight = `${Math.min(down ? below : above, 320)}px`;
  const { width, height } = pop.getBoundingClientRect();
  pop.style.top = `${down ? at.bottom + 4 : at.top - 4 - height}px`;
  pop.style.left = `${Math.max(Math.min(at.right - width, innerWidth - width - 8), 8)}px`;
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
