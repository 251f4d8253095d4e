// Shapes that move: the deflection Re(φ·e^{jωt}) in slow motion, on the circle or over the nodes.
const { unpacked, torus } = window.ringmodal;
const PERIOD_MS = 2000; // of the slow motion
const ARC_DEG = 3; // the circle between two positions is drawn in such steps
const SVG = "http://www.w3.org/2000/svg";

function element(name, attributes, parent) {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  parent.append(made);
  return made;
}

const line = (points) => points.map(([x, y], k) => `${k ? "L" : "M"}${x.toFixed(4)} ${y.toFixed(4)}`).join("");
const spots = (points) => points.map(([x, y]) => `M${x.toFixed(4)} ${y.toFixed(4)}h0`).join("");

function onCircle(radius, angleDeg) {
  const angle = (angleDeg * Math.PI) / 180;
  return [radius * Math.cos(angle), -radius * Math.sin(angle)];
}

/** Where a shape is drawn on a circle; between positions the deflection goes over evenly. */
function circle({ angle_deg, force_deg }) {
  const angles = unpacked(angle_deg);
  const order = Array.from(angles.keys()).sort((a, b) => angles[a] - angles[b]);
  const next = (k) => order[(k + 1) % order.length];
  const gap = (k) => {
    const turn = k === order.length - 1 ? 360 : 0;
    return angles[next(k)] + turn - angles[order[k]];
  };

  function outline(deflection) {
    const points = order.flatMap((row, k) => {
      const steps = Math.max(1, Math.ceil(gap(k) / ARC_DEG));
      return Array.from({ length: steps }, (_, step) => {
        const share = step / steps;
        const between = (1 - share) * deflection[row] + share * deflection[next(k)];
        return onCircle(1 + between, angles[row] + share * gap(k));
      });
    });
    return `${line(points)}Z`;
  }

  /** The deflection at even angles from 0° on. */
  function around(deflection, count) {
    const values = new Float64Array(count);
    order.forEach((row, k) => {
      const first = Math.ceil((angles[row] * count) / 360), width = Math.max(gap(k), 1e-9);
      for (let place = first; (place * 360) / count < angles[row] + width; place++) {
        const share = ((place * 360) / count - angles[row]) / width;
        values[((place % count) + count) % count] =
          (1 - share) * deflection[row] + share * deflection[next(k)];
      }
    });
    return values;
  }

  function nodes(deflection) {
    return order.flatMap((row, k) => {
      const here = deflection[row], there = deflection[next(k)];
      return here * there < 0 ? [onCircle(1, angles[row] + (gap(k) * here) / (here - there))] : [];
    });
  }

  return {
    box: "-1.5 -1.5 3 3",
    outline,
    nodes,
    around,
    dots: (deflection) => order.map((row) => onCircle(1 + deflection[row], angles[row])),
    rest: `${line(Array.from({ length: 120 }, (_, k) => onCircle(1, 3 * k)))}Z`,
    force: force_deg === null ? "" : arrow(force_deg),
  };
}

/** An arrow from outside onto the tread, as in the sketch of the set-up. */
function arrow(angleDeg) {
  const tip = onCircle(1.04, angleDeg), tail = onCircle(1.46, angleDeg);
  return line([tail, tip]) + line([onCircle(1.16, angleDeg - 4), tip, onCircle(1.16, angleDeg + 4)]);
}

/** Where a shape is drawn over its nodes. */
function row({ names }) {
  const place = (k) => -1.5 + (3 * k) / Math.max(1, names.length - 1);
  const points = (deflection) => Array.from(deflection, (value, k) => [place(k), -2 * value]);
  return {
    box: "-1.56 -1 3.12 2",
    outline: (deflection) => line(points(deflection)),
    nodes: () => [],
    dots: points,
    rest: line([[-1.5, 0], [1.5, 0]]),
    force: "",
  };
}

/** Re(φ·e^{jωt}) at a phase, scaled. */
function deflected({ real, imag }, phaseDeg, amplitude) {
  const cosine = Math.cos((phaseDeg * Math.PI) / 180) * amplitude;
  const sine = Math.sin((phaseDeg * Math.PI) / 180) * amplitude;
  return Array.from(real, (part, k) => part * cosine - imag[k] * sine);
}

/** A drawing of one shape; `move` sets its phase and amplitude. */
function drawing(svg, scene) {
  svg.setAttribute("viewBox", scene.box);
  element("path", { class: "rest", d: scene.rest }, svg);
  const force = element("path", { class: "force", d: scene.force }, svg);
  const deformed = element("path", { class: "deformed" }, svg);
  const nodes = element("g", { class: "nodes" }, svg);
  const dots = element("path", { class: "dots" }, svg);
  return {
    move(mode, phaseDeg, amplitude) {
      const deflection = deflected(mode, phaseDeg, amplitude);
      deformed.setAttribute("d", scene.outline(deflection));
      dots.setAttribute("d", spots(scene.dots(deflection)));
    },
    markNodes(mode) {
      nodes.replaceChildren();
      for (const [cx, cy] of scene.nodes(mode.real)) element("circle", { cx, cy, r: 0.035 }, nodes);
    },
    force,
  };
}

const still = (real) => ({ real, imag: new Float32Array(real.length) });

function mount(block) {
  const content = JSON.parse(document.getElementById(`${block.id}-data`).textContent);
  const modes = content.modes.map((mode) => ({
    said: mode.said, real: unpacked(mode.real), imag: unpacked(mode.imag),
    ring: mode.ring && still(unpacked(mode.ring)),
  }));
  const scene = content.angle_deg ? circle(content) : row(content);
  const find = (selector) => block.querySelector(selector);
  const select = find("select"), button = find("button"), said = find(".mode-said");
  const phase = find("[name=phase]"), amplitude = find("[name=amplitude]");
  const stage = find(".stage svg"), shape = drawing(stage, scene);
  const canvas = find("canvas"), tyre = canvas && torus(canvas);
  const ringStage = find(".of-ring"), ring = ringStage && drawing(find(".of-ring svg"), scene);
  let playing = false, last = 0;

  function show() {
    const mode = modes[select.selectedIndex];
    const at = [Number(phase.value), Number(amplitude.value) / 100];
    shape.move(mode, ...at);
    if (tyre) tyre.move(scene.around(deflected(mode, ...at), tyre.count), at[1]);
    if (mode.ring) ring?.move(mode.ring, ...at);
    find(".phase-said").textContent = `${Math.round(phase.value)}°`;
    find(".amplitude-said").textContent = `${amplitude.value} %`;
  }

  function choose(index) {
    select.selectedIndex = index;
    shape.markNodes(modes[index]);
    said.textContent = modes[index].said;
    stage.setAttribute("aria-label", `Shape of the mode ${modes[index].said}`);
    canvas?.setAttribute("aria-label", `The tyre with the mode ${modes[index].said}`);
    if (ringStage) ringStage.style.visibility = modes[index].ring ? "visible" : "hidden";
    show();
  }

  function frame(now) {
    if (!playing) return;
    phase.value = (Number(phase.value) + (360 * Math.min(now - last, 100)) / PERIOD_MS) % 360;
    last = now;
    show();
    requestAnimationFrame(frame);
  }

  button.addEventListener("click", () => {
    playing = !playing;
    button.textContent = playing ? "Pause" : "Play";
    last = performance.now();
    if (playing) requestAnimationFrame(frame);
  });
  select.addEventListener("change", () => choose(select.selectedIndex));
  phase.addEventListener("input", show);
  amplitude.addEventListener("input", show);

  modes.forEach((mode, index) => {
    const small = block.querySelectorAll(".all-shapes svg")[index];
    const still = drawing(small, scene);
    still.move(mode, 0, 0.3);
    still.markNodes(mode);
    small.parentElement.addEventListener("click", () => choose(index));
  });
  choose(0);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", show);
}

document.querySelectorAll(".animation").forEach(mount);
