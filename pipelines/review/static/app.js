// The review page: puts the panels together.
import { Bench } from "./bench.js";
import * as channels from "./channels.js";
import * as curves from "./curves.js";
import * as diagram from "./diagram.js";
import { button, complain, dialog, el, find, fixed, key, refill } from "./dom.js";
import * as history from "./history.js";
import * as keys from "./keys.js";
import { get } from "./server.js";
import * as settings from "./settings.js";
import { mountMac, mountShape } from "./shape.js";
import { signOff } from "./signoff.js";
import * as table from "./table.js";
import * as why from "./why.js";

const STAGES = {
  opening: "numbers as stored; first fit running", fitting: "fitting …", preview: "preview; final fit running",
  final: "final", failed: "the fit failed",
};

function head(bench, sign, compare) {
  const { state } = bench, { chi2, chi2_automatic: automatic, cursor, edits } = state;
  document.title = `${state.name} · ringmodal review`;
  const notes = [...state.findings.map((each) => [[each.run, each.channel].filter(Boolean).join(" "), each.detail].filter(Boolean).join(": ")), ...state.notes];
  refill(find("#what"), [state.name, state.title].filter(Boolean).join(" · "));
  refill(find("#stage"),
    el("span", { className: `chip ${state.stage === "final" ? "good" : state.stage === "failed" ? "warning" : "preview"}` }, STAGES[state.stage] ?? state.stage),
    el("span", { title: "Reduced χ² of all FRFs: now, and of the automatic result" },
      `χ² ${fixed(chi2, 2)}${cursor ? ` (automatic ${fixed(automatic, 2)})` : ""}`),
    notes.length ? button(`${notes.length} note${notes.length > 1 ? "s" : ""}`, () => showNotes(notes), { className: "small", "data-focus": "notes" }) : null);
  refill(find("#acts"),
    button(["↶ Undo ", key("Ctrl Z")], () => bench.undo(), { id: "undo", disabled: cursor === 0, "data-focus": "undo" }),
    button(["↷ Redo ", key("Ctrl Y")], () => bench.redo(), { id: "redo", disabled: cursor === edits.length, "data-focus": "redo" }),
    button(["Compare… ", key("C")], compare, { id: "compare", "data-focus": "compare" }),
    button(["Sign off… ", key("Ctrl S")], sign, { id: "sign-off", className: "main", "data-focus": "sign" }));
}

function showNotes(notes) {
  const box = dialog("Notes and findings", el("ul", { className: "scroll", tabIndex: 0 }, notes.map((text) => el("li", {}, text))),
    el("p", { className: "buttons" }, button("Close", () => box.close(), { className: "main" })));
}

/** Choose other results of the folder to compare with. */
async function compareWith(bench) {
  let others = [];
  try {
    others = (await get("home")).results.filter(({ id }) => id !== bench.id);
  } catch (problem) {
    return complain(problem.message);
  }
  const boxes = others.map(({ id, name, tyre }) => el("label", {}, el("input", { type: "checkbox", value: id }), ` ${name} `, el("span", { className: "soft" }, tyre)));
  const go = () => {
    const chosen = boxes.map((each) => find("input", each)).filter((input) => input.checked).map((input) => input.value);
    if (chosen.length) location.assign(`/compare?ids=${[bench.id, ...chosen].map(encodeURIComponent).join(",")}`);
  };
  const box = dialog("Compare with",
    boxes.length ? el("div", { className: "choices" }, boxes) : el("p", {}, "There is no other result beside this one. Open the folder that holds all of them: ringmodal review FOLDER"),
    el("p", { className: "buttons" }, button(["Cancel ", key("Esc")], () => box.close()), boxes.length ? button("Compare", go, { className: "main" }) : null));
}

async function start() {
  const bench = new Bench(decodeURIComponent(location.pathname.split("/")[2]));
  window.ringmodalBench = bench; // for tests and for the curious
  const sign = () => signOff(bench), compare = () => compareWith(bench);
  for (const [name, panel] of Object.entries({ settings, channels, history, diagram, curves, table })) panel.mount(find(`#${name}`), bench);
  const animate = mountShape(find("#shape"), bench);
  mountMac(find("#mac"), bench);
  const tryOut = why.mount(find("#why"), bench);
  const showKeys = keys.mount(bench, { animate, tryOut, compare, sign });
  find("#help").addEventListener("click", showKeys);
  bench.watch(["state"], () => {
    head(bench, sign, compare);
    bench.signing?.();
  });
  try {
    await bench.open();
    document.documentElement.dataset.ready = "";
  } catch (problem) {
    complain(problem.message);
  }
}

start();
