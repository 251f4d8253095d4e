// Small helpers of all pages: elements, numbers, dialogs, colours.

const shown = (children) => children.flat(Infinity).filter((child) => child !== null && child !== undefined && child !== false && child !== "");

/** An element with properties, `on…` handlers, attributes (`aria-…`, `data-…`, `role`) and children. */
export function el(tag, properties = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (value === undefined || value === null) continue;
    if (name.includes("-") || name === "role" || name === "for") made.setAttribute(name, value);
    else made[name] = value;
  }
  made.append(...shown(children));
  return made;
}

export const find = (selector, within = document) => within?.querySelector(selector) ?? null;

/** Fill an element anew; what had the focus has it afterwards, by its `data-focus`. */
export function refill(parent, ...children) {
  const held = parent.contains(document.activeElement) ? document.activeElement.dataset.focus : undefined;
  const top = parent.scrollTop;
  parent.replaceChildren(...shown(children));
  parent.scrollTop = top;
  if (held === undefined) return;
  const again = [...parent.querySelectorAll("[data-focus]")].find((each) => each.dataset.focus === held);
  again?.focus({ preventScroll: true });
}

/** Where the focus is in a list whose chosen line was changed by a key, it goes to that line. */
export function follow(list, chosen, now) {
  const line = find(chosen, list), moved = list.chosenLine !== undefined && list.chosenLine !== now;
  list.chosenLine = now;
  const held = document.activeElement;
  if (moved && held !== list && list.contains(held) && !line?.contains(held)) find("button", line)?.focus({ preventScroll: true });
}

/** A number with fixed decimals, a true minus sign, and a dash where it is unknown. */
export function fixed(value, decimals) {
  if (value === null || value === undefined || Number.isNaN(value)) return "–";
  const said = value.toFixed(decimals);
  return Number(said) === 0 ? said.replace("-", "") : said.replace("-", "−");
}

export const signed = (value, decimals) => (Number(value?.toFixed(decimals)) > 0 ? "+" : "") + fixed(value, decimals);

/** Three significant digits. */
export function short(value) {
  if (value === null || value === undefined || Number.isNaN(value)) return "–";
  const rounded = Number(value.toPrecision(3)); // 9.999 is 10.0, not 10.00
  const decimals = rounded === 0 ? 0 : Math.max(0, 2 - Math.floor(Math.log10(Math.abs(rounded))));
  return fixed(rounded, Math.min(decimals, 6));
}

export const percent = (ratio, decimals) => fixed(ratio === null ? null : 100 * ratio, decimals);

/** What a mode is called in a sentence: its order and member, or its frequency where no order is known. */
export const called = ({ order, name, frequency_hz: f }) => (order === null ? `${fixed(f, 2)} Hz` : name);

/** A button; `label` is read out where the text is only a sign. */
export function button(text, onclick, more = {}) {
  const { label, ...rest } = more;
  return el("button", { type: "button", onclick, title: label, "aria-label": label, ...rest }, text);
}

export const key = (text) => el("kbd", {}, text);

const scheme = matchMedia("(prefers-color-scheme: dark)");
let palette = new Map();
scheme.addEventListener("change", () => (palette = new Map()));

/** Call when the colour scheme changes: canvases are drawn again. */
export const onScheme = (draw) => scheme.addEventListener("change", draw);

/** A colour of the style sheet, such as "--ring". */
export function colour(name) {
  if (!palette.has(name)) palette.set(name, getComputedStyle(document.documentElement).getPropertyValue(name).trim());
  return palette.get(name);
}

/** The colour of a circumferential order. */
export function orderColour(order) {
  if (order === null || order === undefined) return colour("--faint");
  return order === 0 ? colour("--ink") : colour(`--series-${((order - 1) % 6) + 1}`);
}

/** Say something to everyone: in the status line, which screen readers read out. */
export function say(text) {
  const line = find("#said");
  if (line) line.textContent = text;
}

/** Show an error until the next success; null takes it away. */
export function complain(text) {
  const box = find("#trouble");
  box.textContent = text ?? "";
  box.hidden = !text;
}

/** An error of the server in one sentence each: place, value, rule, remedy. */
export function inWords({ where, found, rule, remedy }) {
  const first = [where, found].filter(Boolean).join(": ");
  return [first, rule, remedy].filter(Boolean).join(". ").replace(/\.\./g, ".");
}

/** A dialog that asks for values: fields by their labels; `done` gets them when all are valid. */
export function ask(title, text, fields, done) {
  const ok = () => {
    if (!Object.values(fields).every((field) => field.reportValidity())) return;
    box.close();
    done(fields);
  };
  const rows = Object.entries(fields).map(([name, field]) => el("label", { className: "field" }, el("span", {}, name), field));
  const box = dialog(title, el("p", { className: "soft" }, text), rows,
    el("p", { className: "buttons" }, button(["Cancel ", key("Esc")], () => box.close()), button("OK", ok, { className: "main", id: "ok" })));
  box.addEventListener("keydown", (event) => {
    if (event.key !== "Enter" || event.target.tagName !== "INPUT") return;
    event.preventDefault();
    ok();
  });
  Object.values(fields)[0].focus();
  Object.values(fields)[0].select(); // what is typed replaces it
}

/** A field for a number. */
export const numberField = (value, limits = {}) => el("input", { type: "number", step: "any", required: true, value: String(value), ...limits });

/** A modal dialog with a title; the answer is the element, shown. */
export function dialog(title, ...children) {
  const box = el("dialog", { "aria-label": title }, el("h2", {}, title), ...children);
  box.addEventListener("close", () => box.remove());
  document.body.append(box);
  box.showModal();
  return box;
}
