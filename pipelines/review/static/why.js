// Why a mode is listed, what setting it aside would cost, and what else can be decided about it.
import { ask, button, called, el, find, fixed, key, numberField, refill, signed } from "./dom.js";
import { get, post } from "./server.js";

const MOST_ORDER = 40;

export function mount(host, bench) {
  const bar = find(".bar", host), body = find(".list", host);
  let evidence = null, cost = null, wanted = "";

  async function read() {
    const { mode } = bench;
    const now = mode ? `${mode.key} ${bench.state.revision} ${bench.state.stage}` : "";
    const isSame = now === wanted;
    wanted = now;
    if (!isSame) evidence = cost = null;
    draw();
    if (isSame) return;
    if (!mode || bench.state.stage === "fitting") return;
    try {
      const found = await get(`${bench.path}/why?key=${encodeURIComponent(mode.key)}`);
      if (wanted === now) evidence = found;
    } catch (problem) {
      if (wanted === now) evidence = { lines: [{ label: "Evidence", value: problem.message, verdict: "warning" }] };
    }
    if (wanted === now) draw();
  }

  /** Fit without keeping the result: what setting the mode aside, or keeping it, would change. */
  async function tryOut() {
    const { mode, state } = bench, now = wanted;
    if (!mode) return;
    cost = { text: "Fitting …" };
    draw();
    const edit = { kind: mode.listed ? "set_aside" : "keep", pole: mode.pole, reason: "" };
    try {
      const found = await post(`${bench.path}/try`, { revision: state.revision, edit });
      if (wanted === now) cost = found;
    } catch (problem) {
      if (wanted === now) cost = { text: problem.message };
    }
    if (wanted === now) draw();
  }

  function costText() {
    if (!cost) return null;
    const parts = [];
    if (cost.chi2_after !== undefined) parts.push(el("strong", { title: "Of all poles fitted together, without and with the edit: to be compared with each other" }, `χ² ${fixed(cost.chi2_before, 2)} → ${fixed(cost.chi2_after, 2)}. `));
    if (cost.text) parts.push(cost.text);
    else for (const { name, frequency_shift_std: shift } of cost.shifts ?? []) parts.push(`${name} ${signed(shift, 1)} σ `);
    return el("p", { className: "cost", role: "status" }, parts);
  }

  /** Start the fit of a mode elsewhere, where it ran to a wrong place. */
  const startAt = ({ name, frequency_hz: hz, damping_ratio: ratio }) => ask(`Start of ${name}`, "The fit of this mode starts there, and may end elsewhere.",
    { "frequency / Hz": numberField(+hz.toFixed(3), { min: "0.001" }), "damping / %": numberField(+(100 * ratio).toFixed(3), { min: "0.001", max: "99" }) },
    (fields) => {
      const [frequency_hz, percentage] = Object.values(fields).map(({ value }) => Number(value));
      bench.edit({ kind: "start", pole: { frequency_hz, damping_ratio: percentage / 100 } });
    });

  function actions(mode) {
    const order = el("select", { className: "small", "aria-label": `Order of ${called(mode)}`, "data-focus": "order is", onchange: () => {
      if (order.value !== "") bench.edit({ kind: "order_is", pole: mode.pole, value: Number(order.value) });
    } }, el("option", { value: "" }, "order…"), Array.from({ length: Math.min(MOST_ORDER, 21) }, (_, k) => el("option", { value: String(k) }, `order ${k}`)));
    return el("p", { className: "actions" },
      button([mode.listed ? "Set aside " : "Keep ", key("Enter")], () => bench.toggle(mode), { className: "small", "data-focus": "why toggle" }),
      button(["Cost? ", key("T")], tryOut, { className: "small", title: "Fit without keeping the result", "data-focus": "why cost" }),
      mode.listed && button("Lock", () => bench.edit({ kind: "lock", pole: mode.pole }), {
        className: "small", label: "Lock: frequency and damping stay as they are", "data-focus": "why lock" }),
      mode.listed && button("Start…", () => startAt(mode), { className: "small", label: "Start the fit of this mode elsewhere", "data-focus": "why start" }),
      bench.state.on_circle && mode.listed && order);
  }

  function draw() {
    const { mode } = bench;
    refill(bar, el("h2", {}, mode ? mode.order === null ? `Why ${called(mode)}` : `Why ${mode.name}, ${fixed(mode.frequency_hz, 2)} Hz` : "Why"));
    if (!mode) return refill(body, el("p", {}, "No mode is chosen."));
    const lines = evidence?.lines ?? [];
    refill(body, actions(mode), costText(),
      el("dl", {}, lines.map(({ label, value, verdict }) => el("div", { className: verdict ?? "" }, el("dt", {}, label), el("dd", {}, value)))));
  }

  bench.watch(["mode", "state"], read);
  return tryOut;
}
