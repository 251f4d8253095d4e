// The curves of one position: FRF with its fit and what the fit leaves, and the other tabs.
import { stem } from "./channels.js";
import { Chart, dots, limits, line, namesBeside, verticals } from "./chart.js";
import { perOrder } from "./diagram.js";
import { button, colour, el, find, fixed, orderColour, refill } from "./dom.js";

export const TABS = [
  ["frf", "FRF"], ["indicator", "Indicator"], ["nyquist", "Nyquist"], ["coherence", "Coherence"],
  ["phase", "Phase"], ["force", "Force"],
];
const OUTLIER_SIGMA = 3;
const NEAR_PX = 9; // a point this near is meant
const FREQUENCY = "Frequency / Hz";
const NAMES_SHARE = 0.06; // of the width, for the names of orders

export function tabsOf(bench) {
  return TABS.filter(([name]) => name !== "force" || bench.state.has_force);
}

/** Go to the position before or after this one. */
export function step(bench, by) {
  const rows = bench.around.map((channel) => channel.row);
  const at = rows.indexOf(bench.view.row);
  bench.look({ row: rows[(at + by + rows.length) % rows.length] });
}

const size = (curve) => Float32Array.from(curve.real, (real, k) => Math.hypot(real, curve.imag[k]));
const angle = (curve) => Float32Array.from(curve.real, (real, k) => (Math.atan2(curve.imag[k], real) * 180) / Math.PI);

/** Those points of a curve whose frequency is shown. */
function within(curve, [low, high]) {
  const rows = Array.from(curve.frequency_hz.keys()).filter((k) => curve.frequency_hz[k] >= low && curve.frequency_hz[k] <= high);
  return { real: rows.map((k) => curve.real[k]), imag: rows.map((k) => curve.imag[k]) };
}

export function mount(host, bench) {
  const bar = find(".bar", host), upper = find(".upper", host), lower = find(".lower", host);
  const zoom = (low, high) => bench.zoom(low, high);
  const shared = { onZoom: zoom, onHover: (place) => read(place) };
  const main = new Chart(upper, { label: "Curve of the chosen position", compose: () => composed[bench.view.tab](), ...shared });
  const rest = new Chart(lower, { label: "Remainder of the fit in standard deviations", compose: remainder, onZoom: zoom });

  const legend = el("div", { className: "legend" });
  upper.append(legend);

  function frequencyAxis(chart) {
    const [min, max] = bench.range;
    chart.x = { label: FREQUENCY, min, max };
  }

  const unit = () => bench.data.frf?.unit ?? "(m/s²)/N";

  function modeLines() {
    return verticals(bench.modes.filter((mode) => mode.listed).map((mode) => ({
      x: mode.frequency_hz, stroked: orderColour(mode.order), width: mode === bench.mode ? 1.5 : 0.5,
    })));
  }

  function curves() {
    const { frf, fit } = bench.data;
    return { measured: frf?.frequency_hz.length ? frf : null, fitted: fit?.frequency_hz.length ? fit : null };
  }

  /** Measured as points below, fitted as a line above: neither hides the other. */
  function compared(pairs) {
    const { measured, fitted } = curves();
    return [
      measured && line(measured.frequency_hz, pairs.measured, colour("--measured"), 2.6),
      fitted && line(fitted.frequency_hz, pairs.fitted, colour("--fitted"), 1.4),
    ].filter(Boolean);
  }

  const composed = {
    frf() {
      frequencyAxis(main);
      const { measured, fitted } = curves();
      const pairs = { measured: measured && size(measured), fitted: fitted && size(fitted) };
      const [min, max] = measured ? limits(measured.frequency_hz, [pairs.measured], bench.range, true) : [0.1, 1];
      main.y = { label: `|H| / (${unit()})`, min, max, log: true };
      return [modeLines(), ...compared(pairs)];
    },
    phase() {
      frequencyAxis(main);
      const { measured, fitted } = curves();
      main.y = { label: "Phase / °", min: -190, max: 190 };
      return [
        modeLines(),
        measured && dots(measured.frequency_hz, angle(measured), colour("--measured"), 2.5),
        fitted && dots(fitted.frequency_hz, angle(fitted), colour("--fitted"), 1.6),
      ].filter(Boolean);
    },
    coherence() {
      frequencyAxis(main);
      const { measured } = curves();
      main.y = { label: "Coherence", min: 0, max: 1.03 };
      return measured ? [modeLines(), line(measured.frequency_hz, measured.coherence, colour("--ring"), 1.3)] : [];
    },
    indicator() {
      frequencyAxis(main);
      const { diagram, orders } = bench.data, which = bench.view.indicator;
      const xs = which === "orders" ? orders?.frequency_hz : diagram?.indicator_hz;
      if (!xs) return [];
      const drawn = which === "orders" ? perOrder(orders) : [{ ys: diagram[which], stroked: colour("--ring") }];
      const [min, max] = which === "nmif" ? [0, 1.05] : limits(xs, drawn.map(({ ys }) => ys), bench.range, true);
      const label = { rms: `RMS of |H| / (${unit()})`, nmif: "NMIF", orders: `|H| per order / (${unit()})` }[which];
      main.y = { label, min, max, log: which !== "nmif" };
      const right = nearest(xs, bench.range[1] - NAMES_SHARE * (bench.range[1] - bench.range[0]));
      const names = which === "orders" ? drawn.map(({ ys, stroked, order }) => ({ x: xs[right], y: ys[right], name: String(order), stroked })) : [];
      return [modeLines(), ...drawn.map(({ ys, stroked }) => line(xs, ys, stroked, 1.3)), namesBeside(names)];
    },
    nyquist() {
      const { measured, fitted } = curves(), range = around();
      const points = [measured, fitted].filter(Boolean).map((curve) => within(curve, range));
      const span = (name) => {
        const all = points.flatMap((each) => each[name]);
        return limits(all, [all], [-Infinity, Infinity]);
      };
      const [left, right] = span("real"), [low, high] = span("imag");
      main.x = { label: `Re H / (${unit()}), ${fixed(range[0], 1)} to ${fixed(range[1], 1)} Hz`, min: left, max: right };
      main.y = { label: `Im H / (${unit()})`, min: low, max: high };
      const inks = [measured && "--measured", fitted && "--fitted"].filter(Boolean);
      return points.map(({ real, imag }, k) => (inks[k] === "--measured" ? dots(real, imag, colour(inks[k]), 3.5) : line(real, imag, colour(inks[k]), 1.5)));
    },
    force() {
      frequencyAxis(main);
      const { force } = bench.data;
      if (!force) return [];
      const [min, max] = limits(force.frequency_hz, [force.psd], bench.range, true);
      main.y = { label: "Force PSD / (N²/Hz)", min, max, log: true };
      return [line(force.frequency_hz, force.psd, colour("--ring"), 1.3)];
    },
  };

  /** Frequencies of the circle that is shown: those zoomed to, or those around the mode. */
  function around() {
    const { mode } = bench, half = mode ? 3 * mode.frequency_hz * Math.max(0.01, mode.damping_ratio) : 0;
    return bench.view.zoom ?? (mode ? [mode.frequency_hz - half, mode.frequency_hz + half] : bench.range);
  }

  /** The frequency of the measured point of the circle under the hand. */
  function readCircle({ px, py }) {
    const { measured: { frequency_hz: hz, real, imag } } = curves(), [low, high] = around();
    const apart = (k) => Math.hypot(main.toX(real[k]) - px, main.toY(imag[k]) - py);
    const [at] = Array.from(hz.keys()).filter((k) => hz[k] >= low && hz[k] <= high && apart(k) < NEAR_PX).sort((a, b) => apart(a) - apart(b));
    main.hint(at === undefined ? null : `${fixed(hz[at], 2)} Hz`, px, py);
  }

  /** What the fit leaves, in σ of the measured line; the grey band is what noise alone leaves. */
  function remainder() {
    frequencyAxis(rest);
    rest.x.label = "";
    const { fitted } = curves();
    if (!fitted) {
      rest.y = { label: "misfit / σ", min: 0, max: 5 };
      return [];
    }
    const [, most] = limits(fitted.frequency_hz, [fitted.residual_sigma], bench.range);
    rest.y = { label: "misfit / σ", min: 0, max: Math.max(5, most) };
    const noise = (pen) => {
      const top = rest.toY(OUTLIER_SIGMA), { left, width, top: above, height } = rest.inner;
      pen.fillStyle = colour("--line");
      pen.globalAlpha = 0.5;
      pen.fillRect(left, top, width, above + height - top);
      pen.globalAlpha = 1;
    };
    return [noise, line(fitted.frequency_hz, fitted.residual_sigma, colour("--soft"), 1)];
  }

  /** Frequency and values under the hand. */
  function read(place) {
    const { measured, fitted } = curves();
    if (!place || !measured) return main.hint(null);
    if (bench.view.tab === "nyquist") return readCircle(place);
    const at = nearest(measured.frequency_hz, place.x), more = fitted ? nearest(fitted.frequency_hz, place.x) : -1;
    const said = [`${fixed(measured.frequency_hz[at], 2)} Hz`];
    if (bench.view.tab === "coherence") said.push(`coherence ${fixed(measured.coherence[at], 4)}`);
    else if (bench.view.tab === "phase") said.push(`${fixed(angle(measured)[at], 1)}°`);
    else if (bench.view.tab === "frf") {
      said.push(`|H| ${Math.hypot(measured.real[at], measured.imag[at]).toPrecision(3)}`);
      if (more >= 0) said.push(`fit ${Math.hypot(fitted.real[more], fitted.imag[more]).toPrecision(3)}, rest ${fixed(fitted.residual_sigma[more], 1)} σ`);
    }
    main.hint(said.join(", "), place.px, place.py);
  }

  function drawBar() {
    const { channel } = bench, { tab } = bench.view;
    const tabs = el("div", { role: "tablist", "aria-label": "Curves" }, tabsOf(bench).map(([name, text], k) =>
      el("button", {
        type: "button", role: "tab", id: `tab-${name}`, "aria-selected": String(tab === name), "data-focus": `tab-${name}`,
        "aria-controls": "curves-panel", tabIndex: tab === name ? 0 : -1, title: `Key ${k + 1}`, onclick: () => bench.look({ tab: name }),
      }, text)));
    const place = channel.position_deg === null ? `node ${channel.node}` : `${fixed(channel.position_deg, 0)}°`;
    const frac = channel.used ? `FRAC ${fixed(channel.frac, 3)}` : ["left out", channel.why].filter(Boolean).join(", ");
    const { forces } = bench;
    const against = forces.length ? el("select", { id: "against", "aria-label": "Force", "data-focus": "against", onchange: () => bench.against(Number(against.value)) },
      forces.map((at, k) => el("option", { value: String(k + 1), selected: bench.force === k + 1 }, `force at ${at}`))) : null;
    refill(bar, tabs,
      el("span", { className: "grow" }),
      against,
      el("span", { className: "steps" },
        button("←", () => step(bench, -1), { label: "Position before", "data-focus": "before" }),
        el("output", { className: "position" }, `${place} ${channel.channel}`, el("span", {}, ` ${stem(channel.run)}, ${frac}`)),
        button("→", () => step(bench, 1), { label: "Next position", "data-focus": "next" })));
    legend.hidden = !["frf", "phase", "nyquist"].includes(tab);
    refill(legend, el("span", { className: "measured" }, "measured"), " ", el("span", { className: "fitted" }, bench.isPreview ? "fit, preview" : "fit"));
    lower.hidden = tab !== "frf" || !channel.used || bench.state.chi2 === null; // without σ there is no remainder in σ
    main.equal = tab === "nyquist";
    main.onZoom = tab === "nyquist" ? null : zoom;
    main.canvas.setAttribute("aria-label", `${tabsOf(bench).find(([name]) => name === tab)?.[1]} at ${place}, ${frac}`);
    find("#curves-panel").setAttribute("aria-labelledby", `tab-${tab}`);
  }

  bench.watch(["state", "row", "tab"], drawBar);
  bench.watch(["state", "row", "tab", "mode", "zoom", "frf", "fit", "indicator", "diagram", "orders", "force"], () => {
    main.draw();
    rest.draw();
  }, () => {
    const { data: { frf, fit, diagram, orders, force }, view: { row, tab, mode, zoom: range, indicator } } = bench;
    return [frf, fit, diagram, orders, force, row, tab, mode, range, indicator, bench.state.band_hz.join(), lower.hidden];
  });
}

/** Index of the value of an ascending list that is nearest. */
function nearest(values, wanted) {
  let low = 0, high = values.length - 1;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (values[middle] < wanted) low = middle;
    else high = middle;
  }
  return wanted - values[low] < values[high] - wanted ? low : high;
}
