// Band, model order, method, and how the recordings are averaged.
import { button, el, find, refill } from "./dom.js";

const METHODS = ["lsce", "plscf"], SHOWN = { lsce: "LSCE", plscf: "p-LSCF" }, WINDOWS = ["hann", "boxcar", "hamming", "blackman", "flattop"], ESTIMATORS = ["H1", "H2", "Hv"];
const POLES = [["max_order", "model order", 1], ["method", "method", METHODS]];
const AVERAGING = [
  ["block_seconds", "block / s", "any"], ["window", "window", WINDOWS], ["overlap", "overlap", "any"], ["averages", "averages", 1], ["estimator", "estimator", ESTIMATORS],
];

export function mount(host, bench) {
  const bar = find(".bar", host), body = find(".list", host);

  const change = (settings) => bench.edit({ kind: "settings", settings });

  function number(value, step, label, onchange, disabled = false) {
    const input = el("input", { type: "number", value: value ?? "", step: String(step), min: "0", "aria-label": label, "data-focus": label, disabled });
    input.addEventListener("change", () => {
      if (input.value !== "" && input.checkValidity()) onchange(Number(input.value));
    });
    return input;
  }

  function row([name, label, kind]) {
    const { settings, rereads, can_reread: can } = bench.state, value = settings[name];
    const reads = rereads.includes(name), disabled = reads && !can;
    let control;
    if (Array.isArray(kind)) {
      const options = value === null || kind.includes(value) ? kind : [value, ...kind];
      control = el("select", { "aria-label": label, "data-focus": label, disabled, onchange: () => change({ [name]: control.value }) },
        value === null && el("option", { value: "", disabled: true, selected: true }, "automatic"),
        options.map((each) => el("option", { value: each, selected: each === value }, SHOWN[each] ?? each)));
    } else control = number(value, kind, label, (wanted) => change({ [name]: wanted }), disabled);
    return el("div", { className: "setting" }, el("span", {}, label), control);
  }

  function band() {
    const [low, high] = bench.state.band_hz;
    const from = number(+low.toFixed(3), "any", "Band from, Hz", (value) => change({ band_hz: [value, Number(to.value)] }));
    const to = number(+high.toFixed(3), "any", "Band to, Hz", (value) => change({ band_hz: [Number(from.value), value] }));
    return el("div", { className: "setting" }, el("span", {}, "band / Hz"), from, to);
  }

  function draw() {
    const { can_reread: can, averaged, drift } = bench.state;
    refill(bar, el("h2", {}, "Band and poles"));
    refill(body, band(), POLES.map(row),
      el("div", { className: "setting" },
        button("Only kept", () => bench.edit({ kind: "only_kept" }), { className: "small", label: "Only kept: list what was kept or picked, nothing else", "data-focus": "only kept" }),
        button("No partners", () => bench.edit({ kind: "no_partners" }), { className: "small", label: "No partners: add no second pole to an order", "data-focus": "no partners" }),
        bench.view.zoom && button("= view", () => change({ band_hz: bench.view.zoom.map((value) => +value.toFixed(2)) }), {
          className: "small", label: "= view: fit the band that is shown", "data-focus": "band view" })),
      el("h3", {}, "Averaging ", el("span", { className: "soft" }, !averaged ? "FRFs were read" : can ? "reads the files again" : "files not found")),
      averaged && AVERAGING.map(row),
      drift && drift !== "none" && el("p", { className: "soft" }, `Drift: ${drift}`));
  }

  bench.watch(["state", "zoom"], draw, () => {
    const { revision, drift, settings, band_hz: band } = bench.state;
    return [revision, drift, JSON.stringify([settings, band]), bench.view.zoom];
  });
}
