// The list of modes, against the automatic result, and the list of all poles: every edit of the
// diagram can be made here too.
import { columns, middlePole, pick, polesOf } from "./diagram.js";
import { button, el, find, fixed, follow, key, percent, refill, signed } from "./dom.js";

const MOVED_SIGMA = 3; // a shift worth a look

/** Go to the mode (in pick mode: the pole column) before or after the chosen one. */
export function step(bench, by) {
  if (bench.view.pick !== null) return stepColumn(bench, by);
  const rows = bench.modes, at = rows.indexOf(bench.mode);
  const next = rows[Math.max(0, Math.min(rows.length - 1, at + by))];
  if (next) bench.look({ mode: next.key });
}

const withPoles = (bench) => columns(bench).filter(({ cluster }) => cluster !== null);

function chosenCluster(bench) {
  const { pick: held } = bench.view;
  return held?.pole == null ? null : bench.data.diagram.cluster[held.pole];
}

function stepColumn(bench, by) {
  const all = withPoles(bench), now = chosenCluster(bench);
  const at = all.findIndex(({ cluster }) => cluster === now);
  const next = all[at < 0 ? 0 : Math.max(0, Math.min(all.length - 1, at + by))];
  if (next) bench.look({ pick: { pole: middlePole(bench, next.cluster) } });
}

/** Go to the pole of the same column at the model order before or after. */
export function stepOrder(bench, by) {
  if (!bench.data.diagram) return;
  let cluster = chosenCluster(bench);
  if (cluster === null || cluster < 0) {
    const own = withPoles(bench).find(({ mode }) => mode === bench.mode) ?? withPoles(bench)[0];
    if (!own) return;
    cluster = own.cluster;
    return bench.look({ pick: { pole: middlePole(bench, cluster) } });
  }
  const poles = polesOf(bench, cluster), at = poles.indexOf(bench.view.pick.pole);
  bench.look({ pick: { pole: poles[Math.max(0, Math.min(poles.length - 1, at + by))] } });
}

const head = (...names) => el("thead", {}, el("tr", {}, names.map((name) => el("th", { scope: "col" }, name))));
const headed = (name, title) => el("span", { title }, name);
const cell = (text, className = "") => el("td", { className }, text);

export function mount(host, bench) {
  const bar = find(".bar", host), list = find(".list", host);
  let which = "modes";

  function modeRow(mode, k) {
    const chosen = mode === bench.mode, tabIndex = chosen ? 0 : -1; // the others: arrow keys
    const who = mode.order === null ? `${k}` : mode.name;
    const moved = Math.abs(mode.delta_sigma ?? 0) > MOVED_SIGMA;
    const verb = mode.listed ? "Set aside" : "Keep";
    const row = el("tr", { className: [chosen && "chosen", !mode.listed && "aside", bench.view.hover?.mode === mode && "hover"].filter(Boolean).join(" ") },
      el("th", { scope: "row" }, button(mode.name, () => bench.look({ mode: mode.key }), {
        className: "name", tabIndex, "aria-pressed": String(chosen), "data-focus": `mode ${who}`, "data-mode": "",
        label: `${mode.name}, ${fixed(mode.frequency_hz, 2)} Hz, ${mode.listed ? mode.pair : mode.chosen}`,
      })),
      cell(fixed(mode.frequency_hz, 2), "f"), cell(fixed(mode.frequency_std_hz, 3), "std"),
      el("td", { className: moved ? "moved" : "", title: mode.delta_sigma === null ? "" : `${signed(mode.delta_sigma, 1)} σ` },
        mode.listed ? (mode.automatic_hz === null ? "new" : signed(mode.delta_hz, 2)) : mode.chosen === "set aside" ? "aside" : mode.chosen),
      cell(percent(mode.damping_ratio, 2), "f"), cell(percent(mode.damping_std, 3), "std"),
      cell(fixed(mode.purity, 2), "purity"),
      el("td", {}, mode.chosen !== "outside" && button(mode.listed ? "×" : "+", () => bench.toggle(mode), {
        className: "small", tabIndex, label: `${verb} ${mode.name}, ${fixed(mode.frequency_hz, 2)} Hz`, "data-focus": `toggle ${who}`,
      })));
    row.addEventListener("click", (event) => event.target.closest("button") ?? bench.look({ mode: mode.key }));
    return row;
  }

  function modes() {
    return el("table", { className: bench.isPreview ? "preview" : "" },
      el("caption", { className: "hidden" }, bench.isPreview ? "Modes, preview" : "Modes"),
      head("mode", "f / Hz", "±", "Δf / Hz", "ζ / %", "±", "purity", el("span", { className: "hidden" }, "change")),
      el("tbody", {}, bench.modes.map(modeRow)));
  }

  function poleRow({ cluster, mode }) {
    const { diagram } = bench.data, { frequency_hz: f, damping_ratio: zeta, size, reason } = diagram.clusters[cluster];
    const held = chosenCluster(bench) === cluster, at = held ? bench.view.pick.pole : middlePole(bench, cluster);
    const order = diagram.model_order[at];
    return el("tr", { className: [held && "chosen", bench.view.hover?.cluster === cluster && "hover"].filter(Boolean).join(" ") },
      el("th", { scope: "row" }, button(mode ? mode.name : "–", () => bench.look({ pick: { pole: at } }), {
        className: "name", "data-mode": "", "data-focus": `column ${cluster}`, "aria-pressed": String(held), label: `Column at ${fixed(f, 2)} Hz`,
      })),
      cell(fixed(held ? diagram.frequency_hz[at] : f, 2)), cell(percent(held ? diagram.damping_ratio[at] : zeta, 2)),
      cell(String(size)), cell(String(order)), el("td", { className: "word reason-of", title: reason }, mode ? (mode.listed ? "mode" : "aside") : reason || "not kept"),
      el("td", {}, mode?.listed ? "" : button("Pick", () => (mode ? bench.toggle(mode) : pick(bench, at)), {
        className: "small", label: `Pick the pole at ${fixed(f, 2)} Hz, order ${order}`, "data-focus": `pick ${cluster}`,
      })));
  }

  function poles() {
    if (!bench.data.diagram) return el("p", {}, "Reading the diagram …");
    return el("table", {},
      el("caption", { className: "hidden" }, "Columns of the stability diagram"),
      head("mode", "f / Hz", "ζ / %", headed("seen", "at how many model orders"), headed("order", "model order of the pole"), "state", el("span", { className: "hidden" }, "change")),
      el("tbody", {}, withPoles(bench).map(poleRow)));
  }

  function draw() {
    const out = bench.modes.filter((mode) => !mode.listed).length, n = bench.modes.length - out;
    const choice = (name, text) => button(text, () => {
      which = name;
      draw();
    }, { "aria-pressed": String(which === name), className: "choice", "data-focus": name });
    refill(bar, el("h2", { className: "hidden" }, "Modes and poles"),
      choice("modes", `Modes (${n})`), choice("poles", `Poles (${bench.data.diagram?.clusters.length ?? "…"})`),
      el("span", { className: "grow" }),
      out ? el("span", { className: "chip warning" }, `${out} out`) : null,
      el("span", { className: "soft" }, key("↑"), key("↓"), " ", key("Enter")));
    refill(list, which === "modes" ? modes() : poles());
    list.querySelector("tr.chosen")?.scrollIntoView({ block: "nearest" });
    follow(list, "tr.chosen", which === "modes" ? bench.modes.indexOf(bench.mode) : chosenCluster(bench));
  }

  bench.watch(["pick"], () => {
    const wanted = bench.view.pick === null ? "modes" : "poles";
    if (wanted !== which) which = wanted;
  });
  bench.watch(["state", "mode", "diagram", "pick"], draw);
  bench.watch(["hover"], () => {
    const { hover } = bench.view, rows = which === "modes" ? bench.modes : withPoles(bench);
    find("tbody", list)?.childNodes.forEach((row, k) => {
      const held = hover && (which === "modes" ? rows[k] === hover.mode : rows[k].cluster === hover.cluster);
      row.classList.toggle("hover", Boolean(held));
    });
  });
}
