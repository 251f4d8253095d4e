// Several results beside each other: their modes, how these move with pressure, load, temperature
// or time, and their FRFs at one position.
import { Chart, deviations, dots, limits, line, namesBeside } from "./chart.js";
import { colour, complain, el, find, fixed, orderColour, percent, refill, short, signed } from "./dom.js";
import { arrays, get } from "./server.js";

const ids = new URLSearchParams(location.search).get("ids") ?? "";
const ink = (k) => colour(`--series-${(k % 7) + 1}`);
// Results differ in their lines too, not in colour alone: on the canvas and in the legend.
const DASHES = [["solid", []], ["dashed", [7, 4]], ["dotted", [2, 3]]];
const dashed = (k) => DASHES[k % DASHES.length];
const NAMES_SHARE = 0.1; // of the width, for the names of modes

function choice(label, options, chosen, change) {
  const select = el("select", { onchange: () => change(select.value) }, options.map(([value, text]) => el("option", { value, selected: value === chosen }, text)));
  return el("label", {}, `${label} `, select);
}

/** Modes in rows, results in columns; against the first one in percent. */
function modesTable({ results, tracks }) {
  const cells = (points) => points.flatMap((point, k) => {
    const first = points[0];
    if (!point) return [el("td", {}, "–"), el("td", {}, "")];
    const moved = k && first ? `${signed(100 * (point.frequency_hz / first.frequency_hz - 1), 2)} %` : "";
    const title = `± ${fixed(point.frequency_std_hz, 3)} Hz${point.is_mean ? "; mean of the pair: another result has one mode" : ""}`;
    return [el("td", { title }, point.is_mean && el("span", { className: "soft" }, "mean "), fixed(point.frequency_hz, 2), k ? el("span", { className: "soft" }, ` ${moved}`) : ""), el("td", {}, percent(point.damping_ratio, 2))];
  });
  return el("section", { "aria-label": "Modes" }, el("h2", {}, "Modes"), el("div", { className: "scroll", tabIndex: 0, role: "region", "aria-label": "Table of modes" }, el("table", {},
    el("thead", {},
      el("tr", {}, el("td"), results.map(({ name, condition }) => el("th", { scope: "colgroup", colSpan: 2, className: "result" }, name, condition && el("div", { className: "soft" }, condition)))),
      el("tr", {}, el("th", { scope: "col" }, "mode"), results.flatMap(() => [el("th", { scope: "col" }, "f / Hz"), el("th", { scope: "col" }, "ζ / %")]))),
    el("tbody", {}, tracks.map(({ name, points }) => el("tr", {}, el("th", { scope: "row" }, name), cells(points)))))));
}

/** How modes move along an axis that is known for all results. */
function tracking({ tracks, axes, results }) {
  const plot = el("div", { className: "plot tall" }), bar = el("div", { className: "bar" });
  const kinds = { change: "frequency, change", frequency_hz: "frequency", damping_ratio: "damping" };
  const told = axes.filter(({ values }) => new Set(values).size > 1);
  const view = { axis: told[0]?.name ?? "", kind: "change" };
  const places = () => told.find(({ name }) => name === view.axis) ?? { name: "result, as in the table", unit: "", values: results.map((_, k) => k + 1), whole: true };
  const value = (point, first) => {
    if (!point) return NaN;
    if (view.kind === "change") return first ? 100 * (point.frequency_hz / first.frequency_hz - 1) : NaN;
    return view.kind === "damping_ratio" ? 100 * point.damping_ratio : point.frequency_hz;
  };
  const std = (point, first) => {
    if (!point) return NaN;
    if (view.kind === "damping_ratio") return 100 * (point.damping_std ?? NaN);
    return (point.frequency_std_hz ?? NaN) * (view.kind === "change" ? 100 / first?.frequency_hz : 1);
  };
  const chart = new Chart(plot, { label: "Modes over the condition; the numbers are in the table", compose });

  function compose() {
    const { name, unit, values, whole = false } = places(), order = Array.from(values.keys()).sort((a, b) => values[a] - values[b]);
    const xs = order.map((k) => values[k]);
    const curves = tracks.map(({ name: mode, order: n, points }) => {
      const of = (what) => order.map((k) => what(points[k], points[order[0]]));
      const ys = of(value), last = ys.findLastIndex(Number.isFinite), stroked = orderColour(n);
      return { ys, stds: of(std), stroked, dash: mode.endsWith("b") ? DASHES[1][1] : [], end: { x: xs[last], y: ys[last], name: mode, stroked } };
    });
    const [left, right] = limits(xs, [xs], [-Infinity, Infinity]), ends = (sign) => curves.map(({ ys, stds }) => ys.map((y, k) => y + sign * (stds[k] || 0)));
    const [low, high] = limits(xs, [...ends(-1), ...ends(1)], [-Infinity, Infinity]);
    chart.x = { label: `${name}${unit ? ` / ${unit}` : ""}`, min: left, max: right + NAMES_SHARE * (right - left), whole };
    chart.y = { label: { change: "Δf / %", frequency_hz: "f / Hz", damping_ratio: "ζ / %" }[view.kind], min: low, max: high };
    return [
      ...curves.flatMap(({ ys, stds, stroked, dash }) => [line(xs, ys, stroked, 1.4, dash), deviations(xs, ys, stds, stroked), dots(xs, ys, stroked, 4)]),
      namesBeside(curves.map(({ end }) => end)),
    ];
  }

  const change = (changes) => {
    Object.assign(view, changes);
    chart.draw();
  };
  refill(bar, el("h2", {}, "Tracking"), el("span", { className: "grow" }),
    told.length ? choice("over", told.map(({ name }) => [name, name]), view.axis, (axis) => change({ axis })) : el("span", { className: "soft" }, "no known condition differs"),
    choice("show", Object.entries(kinds), view.kind, (kind) => change({ kind })));
  chart.draw();
  return el("section", { "aria-label": "Tracking" }, bar, plot);
}

function frfs({ results }) {
  const plot = el("div", { className: "plot tall" }), bar = el("div", { className: "bar" });
  const at = el("input", { type: "number", value: "0", step: "5", min: "0", max: "355", "aria-label": "Position in degrees" });
  let found = null, range = null;
  const zoom = (low, high) => {
    range = high - low < 0.05 ? range : [low, high];
    chart.draw();
  };
  const chart = new Chart(plot, { label: "FRFs of all results at one position", compose, onZoom: zoom });
  const size = (k) => Float32Array.from(found[`real_${k}`], (real, n) => Math.hypot(real, found[`imag_${k}`][n]));

  function compose() {
    if (!found) return [];
    const curves = results.map((_, k) => ({ xs: found[`frequency_hz_${k}`], ys: size(k) })).map((curve, k) => ({ ...curve, stroked: ink(k), dash: dashed(k)[1] })).filter(({ xs }) => xs.length);
    const ends = curves.flatMap(({ xs }) => [xs[0], xs[xs.length - 1]]), whole = [Math.min(...ends), Math.max(...ends)];
    const [min, max] = range ?? whole, levels = curves.map(({ xs, ys }) => limits(xs, [ys], [min, max], true));
    chart.x = { label: "Frequency / Hz", min, max };
    chart.y = { label: "|H| / ((m/s²)/N)", min: Math.min(...levels.map(([low]) => low)), max: Math.max(...levels.map(([, high]) => high)), log: true };
    return curves.map(({ xs, ys, stroked, dash }) => line(xs, ys, stroked, 1.3, dash));
  }

  async function read() {
    try {
      found = await arrays(`compare/frf?ids=${encodeURIComponent(ids)}&position_deg=${encodeURIComponent(at.value)}`);
      complain(null);
    } catch (problem) {
      return complain(problem.message);
    }
    refill(legend, results.map(({ name }, k) => {
      const mark = el("span", { className: "mark" }), place = found.rows?.[k]?.position_deg;
      mark.style.borderTop = `3px ${dashed(k)[0]} ${ink(k)}`;
      return el("span", {}, mark, `${name}${place === undefined || place === null ? "" : ` ${short(place)}°`} `);
    }));
    chart.draw();
  }

  const legend = el("span", { className: "names" });
  at.addEventListener("change", read);
  refill(bar, el("h2", {}, "FRFs"), legend, el("span", { className: "grow" }), el("label", {}, "position / ° ", at),
    el("button", { type: "button", onclick: () => {
      range = null;
      chart.draw();
    } }, "Full band"));
  read();
  return el("section", { "aria-label": "FRFs" }, bar, plot);
}

async function start() {
  try {
    const found = await get(`compare?ids=${encodeURIComponent(ids)}`);
    document.title = "Compare · ringmodal review";
    refill(find("#what"), `Compare ${found.results.map(({ name }) => name).join(", ")}`);
    find("main").append(el("div", { className: "two" }, frfs(found), tracking(found)), modesTable(found));
    document.documentElement.dataset.ready = "";
  } catch (problem) {
    complain(problem.message);
  }
}

start();
