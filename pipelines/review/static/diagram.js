// The stability diagram: poles of all model orders over an indicator function. Hovering names the
// mode or pole under the hand, a click toggles the mode or picks the pole.
import { Chart, line, limits } from "./chart.js";
import { button, colour, el, find, fixed, key, orderColour, refill } from "./dom.js";

const NEAR_PX = 9; // a pole this near is meant
const COLUMN_PX = 7; // and a column this near, where no pole is
const SAME = 0.02; // relative distance of a mode's pole to the cluster it comes from
const INDICATORS = { rms: "RMS", nmif: "NMIF", orders: "orders" };

/** Columns of the diagram: every mode, with its cluster if it has one, and every other cluster. */
export function columns(bench) {
  const clusters = bench.data.diagram?.clusters ?? [], modes = bench.modes;
  const pole = ({ frequency_hz: f, damping_ratio: zeta }) => [f * zeta, f * Math.sqrt(Math.max(0, 1 - zeta * zeta))];
  const pairs = modes.flatMap((mode, m) => clusters.map((cluster, c) => {
    const [a, b] = pole(mode), [x, y] = pole(cluster);
    return { m, c, apart: Math.hypot(a - x, b - y) / mode.frequency_hz };
  })).filter(({ apart }) => apart < SAME).sort((one, other) => one.apart - other.apart);
  const ofMode = new Map(), taken = new Set();
  for (const { m, c } of pairs) {
    if (ofMode.has(m) || taken.has(c)) continue;
    ofMode.set(m, c);
    taken.add(c);
  }
  const rows = modes.map((mode, m) => ({ mode, cluster: ofMode.get(m) ?? null, frequency_hz: mode.frequency_hz }));
  const rest = clusters.map((cluster, c) => ({ mode: null, cluster: c, frequency_hz: cluster.frequency_hz }))
    .filter(({ cluster }) => !taken.has(cluster));
  return [...rows, ...rest].sort((one, other) => one.frequency_hz - other.frequency_hz);
}

/** "1b, 79.29 Hz, 32 orders". */
export function named(column, bench) {
  const cluster = column.cluster === null ? null : bench.data.diagram.clusters[column.cluster];
  const { mode } = column;
  const who = !mode ? "not a mode" : mode.order === null ? "mode" : mode.name;
  const seen = cluster ? `${cluster.size} model orders` : "added as partner";
  return `${who}, ${fixed((mode ?? cluster).frequency_hz, 2)} Hz, ${seen}${mode && !mode.listed ? ", set aside" : ""}`;
}

/** The poles of a cluster, by model order. */
export function polesOf(bench, cluster) {
  const { data: { diagram } } = bench;
  return Array.from(diagram.cluster.keys()).filter((k) => diagram.cluster[k] === cluster)
    .sort((a, b) => diagram.model_order[a] - diagram.model_order[b]);
}

/** Fit and list a pole of the diagram. */
export function pick(bench, pole) {
  const { diagram } = bench.data;
  bench.look({ pick: null });
  bench.edit({
    kind: "pick",
    pole: {
      frequency_hz: diagram.frequency_hz[pole], damping_ratio: diagram.damping_ratio[pole],
      method: diagram.method, order: Math.round(diagram.model_order[pole]),
    },
  });
}

/** That pole of a cluster which lies nearest to its median. */
export function middlePole(bench, cluster) {
  const { diagram } = bench.data, { frequency_hz: f, damping_ratio: zeta } = diagram.clusters[cluster];
  const apart = (k) => Math.hypot(diagram.frequency_hz[k] / f - 1, diagram.damping_ratio[k] - zeta);
  return polesOf(bench, cluster).sort((a, b) => apart(a) - apart(b))[0];
}

export function mount(host, bench) {
  const bar = find(".bar", host), plot = find(".plot", host);
  let listed = [];

  const chart = new Chart(plot, {
    label: "Stability diagram; all it offers is also in the lists of modes and poles",
    compose,
    onZoom: (low, high) => bench.zoom(low, high),
    onHover: hover,
    onClick: click,
  });

  function compose() {
    const { diagram } = bench.data, [min, max] = bench.range;
    chart.x = { label: "Frequency / Hz", min, max };
    if (!diagram) return [];
    const highest = diagram.model_order.reduce((a, b) => Math.max(a, b), 1);
    chart.y = { label: "Model order", min: 0, max: highest * 1.12 };
    return [indicator, poles, modes, cursor];
  }

  /** The indicator function over the whole height, with an axis of its own that is not shown. */
  function indicator(pen) {
    const { diagram, orders } = bench.data, which = bench.view.indicator;
    const xs = which === "orders" ? orders?.frequency_hz : diagram.indicator_hz;
    if (!xs) return;
    const curves = which === "orders" ? perOrder(orders) : [{ ys: diagram[which], stroked: colour("--faint") }];
    const [low, high] = which === "nmif" ? [0, 1.05] : limits(xs, curves.map(({ ys }) => ys), bench.range, true).map(Math.log10);
    const top = chart.y.max;
    const onScale = (value) => (((which === "nmif" ? value : Math.log10(value)) - low) / (high - low)) * top;
    for (const { ys, stroked } of curves) line(xs, Array.from(ys, onScale), stroked, 1.2)(pen, chart);
  }

  function poles(pen) {
    const { diagram } = bench.data, { show, hover: held } = bench.view;
    const inks = new Map(listed.filter(({ cluster }) => cluster !== null).map((column) => [column.cluster, column]));
    const size = diagram.frequency_hz.length > 3000 ? 2 : 3;
    for (let k = 0; k < diagram.frequency_hz.length; k += 1) {
      const column = inks.get(diagram.cluster[k]), stable = diagram.stability[k];
      if ((show === "stable" && stable < 1) || (show === "columns" && !column)) continue;
      const x = chart.toX(diagram.frequency_hz[k]), y = chart.toY(diagram.model_order[k]);
      const isMode = column?.mode, half = size / 2 + (held && column === held ? 1.5 : 0);
      if (isMode?.listed) {
        pen.fillStyle = orderColour(isMode.order);
        pen.fillRect(x - half, y - half, 2 * half, 2 * half);
      } else if (isMode || column) {
        pen.strokeStyle = colour(isMode ? "--warning" : "--soft");
        pen.lineWidth = 1;
        pen.globalAlpha = isMode || diagram.clusters[column.cluster].kept ? 1 : 0.6;
        pen.strokeRect(x - half, y - half, 2 * half, 2 * half);
        pen.globalAlpha = 1;
      } else {
        pen.fillStyle = colour("--faint");
        pen.globalAlpha = stable ? 0.9 : 0.5;
        pen.fillRect(x - 1, y - 1, stable ? 2.5 : 1.5, stable ? 2.5 : 1.5);
        pen.globalAlpha = 1;
      }
    }
  }

  /** A line and a name for each mode; members of a pair have theirs on both sides. */
  function modes(pen) {
    pen.font = "600 11px system-ui, sans-serif";
    pen.textBaseline = "top";
    const chosen = bench.mode;
    const ends = { true: -Infinity, false: -Infinity }; // of the names so far: listed, and not
    for (const { mode } of listed) {
      if (!mode) continue;
      const x = chart.toX(mode.frequency_hz), top = chart.inner.top;
      pen.strokeStyle = pen.fillStyle = mode.listed ? orderColour(mode.order) : colour("--warning");
      pen.lineWidth = mode === chosen ? 2 : 1;
      pen.globalAlpha = mode === chosen ? 0.9 : 0.35;
      pen.setLineDash(mode.listed ? [] : [4, 3]);
      pen.beginPath();
      pen.moveTo(x, top + (mode.listed ? 14 : 25));
      pen.lineTo(x, top + chart.inner.height);
      pen.stroke();
      pen.setLineDash([]);
      pen.globalAlpha = 1;
      pen.textAlign = "left";
      const wide = pen.measureText(mode.name).width, share = { a: 0.8, b: 0.2 }[mode.member] ?? 0.5;
      const left = Math.min(Math.max(x - share * wide, ends[mode.listed] + 3), chart.inner.left + chart.inner.width - wide);
      ends[mode.listed] = left + wide;
      if (mode.order !== null) pen.fillText(mode.name, left, top + (mode.listed ? 2 : 13));
    }
  }

  function cursor(pen) {
    const { pick: held } = bench.view, { diagram } = bench.data;
    if (!held || held.pole === null) return;
    const x = chart.toX(diagram.frequency_hz[held.pole]), y = chart.toY(diagram.model_order[held.pole]);
    pen.strokeStyle = colour("--accent");
    pen.lineWidth = 2;
    pen.beginPath();
    pen.arc(x, y, 7, 0, 2 * Math.PI);
    pen.stroke();
  }

  /** The pole under the hand, or nothing. */
  function poleAt({ px, py }) {
    const { diagram } = bench.data;
    let best = null, least = NEAR_PX;
    for (let k = 0; k < diagram.frequency_hz.length; k += 1) {
      const apart = Math.hypot(chart.toX(diagram.frequency_hz[k]) - px, chart.toY(diagram.model_order[k]) - py);
      if (apart < least) [best, least] = [k, apart];
    }
    return best;
  }

  function columnAt(place) {
    const pole = poleAt(place), cluster = pole === null ? -1 : bench.data.diagram.cluster[pole];
    const owner = cluster < 0 ? null : listed.find((column) => column.cluster === cluster);
    if (owner) return { pole, column: owner };
    const apart = ({ frequency_hz: f }) => Math.abs(chart.toX(f) - place.px);
    const near = listed.filter(({ mode }) => mode).sort((a, b) => apart(a) - apart(b))[0];
    return { pole, column: near && pole === null && apart(near) < COLUMN_PX ? near : null };
  }

  function hover(place) {
    if (!place || !bench.data.diagram) {
      chart.hint(null);
      return bench.look({ hover: null });
    }
    const { pole, column } = columnAt(place), picking = bench.view.pick !== null;
    const { diagram } = bench.data;
    if (picking && pole !== null) bench.look({ pick: { pole } });
    const loose = () => `pole at ${fixed(diagram.frequency_hz[pole], 2)} Hz, ζ ${fixed(100 * diagram.damping_ratio[pole], 2)} %, order ${diagram.model_order[pole]}`;
    const said = pole !== null && (picking || !column) ? loose() : column ? named(column, bench) : null;
    chart.canvas.style.cursor = said ? "pointer" : "crosshair";
    chart.hint(said, place.px, place.py);
    bench.look({ hover: column });
  }

  function click(place) {
    if (!bench.data.diagram) return;
    const { pole, column } = columnAt(place);
    if (bench.view.pick !== null || !column) return pole === null ? undefined : pick(bench, pole);
    if (!column.mode) return pick(bench, middlePole(bench, column.cluster));
    bench.look({ mode: column.mode.key });
    bench.toggle(column.mode);
  }

  const choice = (name, label, options) => {
    const select = el("select", { onchange: () => bench.look({ [name]: select.value }) },
      Object.entries(options).map(([value, text]) => el("option", { value, selected: bench.view[name] === value }, text)));
    return el("label", {}, label, select);
  };
  refill(bar,
    el("h2", {}, "Stability diagram"),
    choice("indicator", "over", INDICATORS),
    choice("show", "show", { all: "all poles", stable: "stable poles", columns: "columns only" }),
    el("span", { className: "grow" }),
    button(["Pick a pole ", key("P")], () => bench.look({ pick: bench.view.pick ? null : { pole: null } }), { id: "pick" }),
    button(["Zoom ", key("Z")], () => toMode(bench), { id: "to-mode" }),
  );

  bench.watch(["diagram", "state"], () => (listed = columns(bench)));
  bench.watch(["diagram", "state", "mode", "zoom", "hover", "pick", "indicator", "orders"], () => {
    find("#pick").setAttribute("aria-pressed", String(bench.view.pick !== null));
    find("#to-mode").firstChild.textContent = bench.view.zoom ? "Full band " : "Zoom ";
    chart.draw();
  }, () => {
    const { data: { diagram, orders }, view: { zoom, hover: held, pick: picked, indicator: which, show } } = bench;
    return [diagram, orders, zoom, held, picked, which, show, bench.view.mode, JSON.stringify(bench.modes), bench.state.band_hz.join()];
  });
}

/** Zoom to the chosen mode, and from there back to the band. */
export function toMode(bench) {
  const { mode } = bench;
  if (bench.view.zoom || !mode) return bench.look({ zoom: null });
  const half = mode.frequency_hz * Math.max(0.02, 3 * mode.damping_ratio);
  bench.zoom(mode.frequency_hz - half, mode.frequency_hz + half);
}

/** The FRFs of the circumferential orders as curves in their colours. */
export function perOrder({ orders, level, frequency_hz: xs }) {
  return orders.map((order, k) => ({ order, ys: level.subarray(k * xs.length, (k + 1) * xs.length), stroked: orderColour(order) }));
}
