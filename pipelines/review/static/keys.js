// The keys of the review page, and their list.
import { dialog, el, key, button } from "./dom.js";
import { outOrIn, scale } from "./channels.js";
import { step as stepPosition, tabsOf } from "./curves.js";
import { pick, toMode } from "./diagram.js";
import { step as stepMode, stepOrder } from "./table.js";

const TYPING = "input, select, textarea, dialog";
const PRESSING = "button:not([data-mode]), a, summary"; // they answer Enter and Space themselves

export function mount(bench, { animate, tryOut, compare, sign }) {
  const enter = () => {
    const { pick: held } = bench.view;
    if (held === null) return bench.toggle(bench.mode);
    if (held.pole !== null) pick(bench, held.pole);
  };
  const channel = (act) => bench.channel && act(bench.channel);
  const list = [
    [["ArrowUp", "ArrowDown"], "↑ ↓", "mode (in pick mode: column) before, after", (name) => stepMode(bench, name === "ArrowUp" ? -1 : 1)],
    [["ArrowLeft", "ArrowRight"], "← →", "position before, after", (name) => stepPosition(bench, name === "ArrowLeft" ? -1 : 1)],
    [["Enter"], "Enter", "set the mode aside or keep it; in pick mode: pick the pole", enter],
    [["p"], "P", "pick mode on, off", () => bench.look({ pick: bench.view.pick ? null : { pole: null } })],
    [["[", "]"], "[ ]", "model order of the pole to pick", (name) => stepOrder(bench, name === "[" ? -1 : 1)],
    [["x"], "X", "leave the channel out, or use it", () => channel((each) => outOrIn(bench, each))],
    [["f"], "F", "flip the sign of the channel", () => channel((each) => bench.onChannel("flip", each))],
    [["g"], "G", "gain of the channel", () => channel((each) => scale(bench, each))],
    [["z"], "Z", "zoom to the mode, and back", () => toMode(bench)],
    [["1", "2", "3", "4", "5", "6"], "1 – 6", "curves: FRF, indicator, Nyquist, coherence, phase, force", (name) => {
      const tab = tabsOf(bench)[Number(name) - 1];
      if (tab) bench.look({ tab: tab[0] });
    }],
    [[" "], "Space", "animate the shape, stop", animate],
    [["t"], "T", "what the edit would cost", tryOut],
    [["c"], "C", "compare with another result", compare],
    [["?"], "?", "this list", () => showKeys(list)],
    [["Escape"], "Esc", "leave pick mode, full band", () => bench.look(bench.view.pick ? { pick: null } : { zoom: null })],
  ];
  const held = [
    [["z"], "Ctrl Z", "undo", () => bench.undo()],
    [["y"], "Ctrl Y", "redo", () => bench.redo()],
    [["s"], "Ctrl S", "sign off", sign],
  ];
  list.push(...held);

  document.addEventListener("keydown", (event) => {
    if (!bench.state || event.altKey || event.target.closest(TYPING) || document.querySelector("dialog[open]")) return;
    const pressed = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    const withControl = event.ctrlKey || event.metaKey;
    if (!withControl && ["Enter", " "].includes(pressed) && event.target.closest(PRESSING)) return;
    if (["ArrowLeft", "ArrowRight"].includes(pressed) && event.target.closest("[role=tablist]")) return moveTab(event, bench);
    const redo = withControl && event.shiftKey && pressed === "z" ? "y" : pressed;
    const found = (withControl ? held : list.slice(0, -held.length)).find(([names]) => names.includes(redo));
    if (!found) return;
    event.preventDefault();
    found[3](redo);
  });

  return () => showKeys(list);
}

/** Arrow keys within the row of tabs, as for every row of tabs. */
function moveTab(event, bench) {
  event.preventDefault();
  const names = tabsOf(bench).map(([name]) => name), at = names.indexOf(bench.view.tab);
  const next = names[(at + (event.key === "ArrowLeft" ? -1 : 1) + names.length) % names.length];
  bench.look({ tab: next });
  queueMicrotask(() => queueMicrotask(() => document.getElementById(`tab-${next}`)?.focus()));
}

function showKeys(list) {
  const box = dialog("Keys", el("dl", { className: "keys" }, list.map(([, shown, text]) => el("div", {}, el("dt", {}, key(shown)), el("dd", {}, text)))),
    el("p", { className: "buttons" }, button(["Close ", key("Esc")], () => box.close(), { className: "main" })));
}
