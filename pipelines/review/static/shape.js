// The chosen mode moving on the tyre beside the ring's shape of its order, and the AutoMAC.
import { called, colour, el, find, fixed, onScheme, orderColour, refill, button, key } from "./dom.js";

const PERIOD_MS = 2000; // of the slow motion
const ARC_DEG = 3; // the circle between two positions is drawn in such steps
const DEFLECTION = 0.3; // of the radius
const MOST_GAP = 3; // usual distances of positions: nothing is drawn where nothing was measured
const SVG = "http://www.w3.org/2000/svg";

function onCircle(radius, angleDeg) {
  const angle = (angleDeg * Math.PI) / 180;
  return [radius * Math.cos(angle), -radius * Math.sin(angle)];
}

const spot = ([x, y]) => `${x.toFixed(3)} ${y.toFixed(3)}`;
const path = (points) => points.map((point, k) => (k ? "L" : "M") + spot(point)).join("");
const spots = (points) => points.map((point) => `M${spot(point)}h0`).join("");

/** A curve through deflections at angles; between them the deflection goes over evenly, gaps stay open. */
function outline(angles, order, deflection) {
  const after = (k) => order[(k + 1) % order.length];
  const gaps = order.map((row, k) => angles[after(k)] - angles[row] + (k === order.length - 1 ? 360 : 0));
  const most = MOST_GAP * [...gaps].sort((a, b) => a - b)[Math.floor(gaps.length / 2)];
  let drawn = "", letter = "M";
  order.forEach((row, k) => {
    const isGap = gaps[k] > most, steps = isGap ? 1 : Math.max(1, Math.ceil(gaps[k] / ARC_DEG));
    for (let step = 0; step < steps; step += 1) {
      const share = step / steps, between = (1 - share) * deflection[row] + share * deflection[after(k)];
      drawn += letter + spot(onCircle(1 + between, angles[row] + share * gaps[k]));
      letter = "L";
    }
    if (isGap) letter = "M";
  });
  return letter === "L" ? drawn + letter + spot(onCircle(1 + deflection[order[0]], angles[order[0]])) : drawn;
}

/** The values of one mode out of a table of all. */
function rowOf(shapes, name, key) {
  const k = shapes.keys.indexOf(key), n = shapes.position_deg.length;
  return k < 0 ? null : shapes[name].subarray(k * n, (k + 1) * n);
}

export function mountShape(host, bench) {
  const bar = find(".bar", host), svg = find("svg", host);
  const made = {};
  for (const name of ["rest", "ring", "force", "deformed", "dots"]) {
    made[name] = document.createElementNS(SVG, "path");
    made[name].setAttribute("class", name);
    svg.append(made[name]);
  }
  let playing = false, phase = 0, last = 0;

  function show() {
    const { shapes } = bench.data, { mode, state } = bench;
    const real = shapes && mode && rowOf(shapes, "real", mode.key);
    for (const each of Object.values(made)) each.setAttribute("d", "");
    find(".none", host).hidden = Boolean(real) || !shapes;
    if (!real) return;
    const imag = rowOf(shapes, "imag", mode.key), ring = rowOf(shapes, "ring", mode.key);
    const cosine = Math.cos(phase) * DEFLECTION, sine = Math.sin(phase) * DEFLECTION;
    const deflection = Array.from(real, (value, k) => value * cosine - imag[k] * sine);
    made.deformed.style.stroke = made.dots.style.stroke = orderColour(mode.order);
    const angles = shapes.position_deg, order = Array.from(angles.keys()).sort((a, b) => angles[a] - angles[b]);
    if (!state.on_circle) {
      const place = (k) => -1.4 + (2.8 * k) / Math.max(1, real.length - 1);
      const points = deflection.map((value, k) => [place(k), -2.5 * value]);
      made.rest.setAttribute("d", "M-1.4 0H1.4");
      made.deformed.setAttribute("d", path(points));
      return made.dots.setAttribute("d", spots(points));
    }
    made.rest.setAttribute("d", `${path(Array.from({ length: 120 }, (_, k) => onCircle(1, 3 * k)))}Z`);
    made.deformed.setAttribute("d", outline(angles, order, deflection));
    made.dots.setAttribute("d", spots(order.map((row) => onCircle(1 + deflection[row], angles[row]))));
    if (!Number.isNaN(ring[0])) made.ring.setAttribute("d", outline(angles, order, ring.map((value) => value * cosine)));
    if (state.excitation_deg !== null) {
      const at = state.excitation_deg, tip = onCircle(0.93, at);
      made.force.setAttribute("d", path([onCircle(0.45, at), tip]) + path([onCircle(0.8, at - 6), tip, onCircle(0.8, at + 6)]));
    }
  }

  function frame(now) {
    if (!playing) return;
    phase = (phase + (2 * Math.PI * Math.min(now - last, 100)) / PERIOD_MS) % (2 * Math.PI);
    last = now;
    show();
    requestAnimationFrame(frame);
  }

  function animate() {
    playing = !playing;
    last = performance.now();
    if (playing) requestAnimationFrame(frame);
    else {
      phase = 0;
      show();
    }
    draw();
  }

  function draw() {
    const { mode } = bench;
    refill(bar, el("h2", {}, !mode ? "Shape" : mode.order === null ? called(mode) : `Shape ${mode.name}`), el("span", { className: "grow" }),
      button([playing ? "Stop " : "Play ", key("Space")], animate, { className: "small", "data-focus": "animate" }));
    const kind = mode?.order == null ? "" : `, order ${mode.order}, purity ${fixed(mode.purity, 2)}, MPC ${fixed(mode.mpc, 2)}`;
    svg.setAttribute("aria-label", mode ? `Shape of ${called(mode)}${kind}; dashed: the ring's shape` : "No mode");
    show();
  }

  bench.watch(["mode", "shapes", "state"], draw, () => [bench.data.shapes, JSON.stringify(bench.mode)]);
  onScheme(show);
  return animate;
}

export function mountMac(host, bench) {
  const canvas = find("canvas", host), said = find(".worst", host);

  function draw() {
    const { shapes } = bench.data;
    const n = shapes?.keys.length ?? 0, size = canvas.clientWidth, pen = canvas.getContext("2d");
    const sharp = window.devicePixelRatio || 1;
    canvas.width = canvas.height = Math.round(size * sharp);
    pen.setTransform(sharp, 0, 0, sharp, 0, 0);
    if (!n || !size) return;
    const step = size / n, modes = shapes.keys.map((key) => bench.modes.find((mode) => mode.key === key)), names = modes.map((mode) => (mode?.order == null ? fixed(mode?.frequency_hz, 1) : mode.name));
    const chosen = shapes.keys.indexOf(bench.view.mode);
    let worst = [0, 1, 0];
    for (let k = 0; k < n; k += 1) {
      for (let m = 0; m < n; m += 1) {
        const value = shapes.automac[k * n + m];
        if (k < m && value > worst[2]) worst = [k, m, value];
        pen.fillStyle = colour("--ring");
        pen.globalAlpha = Math.max(0.04, Math.min(1, value));
        pen.fillRect(m * step + 0.5, k * step + 0.5, step - 1, step - 1);
      }
    }
    pen.globalAlpha = 1;
    if (chosen >= 0) {
      pen.strokeStyle = colour("--warning");
      pen.strokeRect(chosen * step + 0.5, 0.5, step - 1, size - 1);
      pen.strokeRect(0.5, chosen * step + 0.5, size - 1, step - 1);
    }
    const other = chosen < 0 ? [] : names.map((name, k) => [name, shapes.automac[chosen * n + k]])
      .filter((_, k) => k !== chosen).sort((a, b) => b[1] - a[1]);
    const own = other.length ? `${names[chosen]} with ${other[0][0]} ${fixed(other[0][1], 2)}; ` : "";
    said.textContent = n > 1 ? `${own}largest ${names[worst[0]]} with ${names[worst[1]]} ${fixed(worst[2], 2)}` : "";
    canvas.setAttribute("aria-label", `AutoMAC of ${n} modes: ${said.textContent}`);
  }

  canvas.addEventListener("click", (event) => {
    const { keys } = bench.data.shapes ?? { keys: [] };
    const mode = keys[Math.floor((event.offsetX / canvas.clientWidth) * keys.length)];
    if (mode) bench.look({ mode });
  });
  bench.watch(["mode", "shapes"], draw, () => [bench.data.shapes, bench.view.mode]);
  onScheme(draw);
  new ResizeObserver(draw).observe(canvas);
}
