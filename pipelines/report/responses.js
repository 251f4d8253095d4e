// FRFs of any position: unpacked (measured), put together from poles and residues (fitted) and
// from the matrices of the ring, for the position that is chosen.
const { charts, unpacked } = window.ringmodal;
const BREAK_DEG = 180; // where the phase jumps by more, the curve is broken

/** (a + jb)/(c + jd) */
function divided(a, b, c, d) {
  const square = c * c + d * d;
  return [(a * c + b * d) / square, (b * c - a * d) / square];
}

/** Curves from real and imaginary parts: magnitude, and phase with a gap where it wraps. */
function curves(frequencyHz, real, imag) {
  const level = Array.from(real, (part, k) => Math.hypot(part, imag[k]) || null);
  const phase = Array.from(real, (part, k) => (Math.atan2(imag[k], part) * 180) / Math.PI);
  return { x: Array.from(frequencyHz), level, phase };
}

function withGaps({ x, level, phase }) {
  const places = [], degrees = [];
  phase.forEach((value, k) => {
    if (k > 0 && Math.abs(value - phase[k - 1]) > BREAK_DEG) {
      places.push(x[k]);
      degrees.push(null);
    }
    places.push(x[k]);
    degrees.push(value);
  });
  return { level: { x, y: level }, phase: { x: places, y: degrees } };
}

function measured(content, row) {
  const count = content.frequencyHz.length;
  const part = (values) => values.subarray(row * count, (row + 1) * count);
  const unknown = -32768;
  return {
    x: Array.from(content.frequencyHz),
    level: Array.from(part(content.levelDb), (v) => (v === unknown ? null : 10 ** (v / 2000))),
    phase: Array.from(part(content.phaseDeg), (v) => v / 100),
  };
}

/** −ω² (Σ [A/(jω−s) + A*∕(jω−s*)] + U) + L, over the lines that were fitted. */
function fitted(content, row) {
  const { states, run, band_hz } = content.fitted;
  const poles = states[run[row]];
  const { real, imag, lower, upper } = content.unpackedFit;
  const inBand = content.frequencyHz.filter((f) => f >= band_hz[0] && f <= band_hz[1]);
  const count = poles.real.length, first = row * count;
  const sums = Array.from(inBand, (frequencyHz) => {
    const omega = 2 * Math.PI * frequencyHz;
    let re = upper[row], im = 0;
    for (let mode = 0; mode < count; mode++) {
      const decay = -poles.real[mode], natural = poles.imag[mode];
      const a = real[first + mode], b = imag[first + mode];
      const direct = divided(a, b, decay, omega - natural);
      const mirrored = divided(a, -b, decay, omega + natural);
      re += direct[0] + mirrored[0];
      im += direct[1] + mirrored[1];
    }
    return [lower[row] - omega ** 2 * re, -(omega ** 2) * im];
  });
  return curves(inBand, sums.map((sum) => sum[0]), sums.map((sum) => sum[1]));
}

/** Compliance M22/(M11·M22 − C²) of every order at every line: the same for all positions. */
function compliances({ ring, frequencyHz }) {
  const orders = ring.m11.real.length;
  const real = new Float64Array(orders * frequencyHz.length), imag = new Float64Array(real.length);
  frequencyHz.forEach((frequency, k) => {
    const omega = 2 * Math.PI * frequency, inertia = ring.mass_per_area_kg_m2 * omega ** 2;
    for (let n = 0; n < orders; n++) {
      const a = ring.m11.real[n] - inertia, b = ring.m11.imag[n] + ring.radial_n_s_m3 * omega;
      const c = ring.m22.real[n] - inertia;
      const d = ring.m22.imag[n] + ring.circumferential_n_s_m3 * omega;
      const e = ring.coupling.real[n], f = ring.coupling.imag[n];
      const found = divided(c, d, a * c - b * d - e * e + f * f, a * d + b * c - 2 * e * f);
      [real[k * orders + n], imag[k * orders + n]] = found;
    }
  });
  return { orders, real, imag };
}

function ringCurve(content, row) {
  content.compliances ??= compliances(content);
  const { orders, real, imag } = content.compliances;
  const weights = Array.from({ length: orders }, (_, n) =>
    n === 0 ? 1 : 2 * Math.cos(n * content.ring.angle_rad[row]),
  );
  const sums = Array.from(content.frequencyHz, (frequency, k) => {
    const scale = -((2 * Math.PI * frequency) ** 2) / content.ring.area_m2;
    let re = 0, im = 0;
    for (let n = 0; n < orders; n++) {
      re += weights[n] * real[k * orders + n];
      im += weights[n] * imag[k * orders + n];
    }
    return [scale * re, scale * im];
  });
  return curves(content.frequencyHz, sums.map((sum) => sum[0]), sums.map((sum) => sum[1]));
}

function read(name) {
  const content = JSON.parse(document.getElementById(`${name}-content-data`).textContent);
  const { fitted: fit, measured: seen } = content;
  return {
    ...content,
    frequencyHz: unpacked(content.frequency_hz),
    levelDb: unpacked({ dtype: "i2", bdata: seen.level_db }),
    phaseDeg: unpacked({ dtype: "i2", bdata: seen.phase_deg }),
    unpackedFit: {
      real: unpacked(fit.residues.real), imag: unpacked(fit.residues.imag),
      lower: unpacked(fit.lower), upper: unpacked(fit.upper),
    },
  };
}

function mount(chooser) {
  const name = chooser.dataset.chart, content = read(name);
  const select = chooser.querySelector("select"), said = chooser.querySelector(".said");
  const sources = { measured, fitted, ...(content.ring && { ring: ringCurve }) };

  function show() {
    const row = select.selectedIndex, option = select.options[row].text;
    const whole = Object.entries(sources).map(([curve, source]) => [curve, source(content, row)]);
    const found = Object.fromEntries(whole.map(([curve, values]) => [curve, withGaps(values)]));
    drawNyquist(Object.fromEntries(whole), option);
    const data = charts.data(name).map((trace) => {
      const { level, phase } = found[trace.name];
      return { ...trace, ...(trace.yaxis === "y2" ? phase : level) };
    });
    const what = content.ring ? "measured, fitted and of the ring" : "measured and fitted";
    charts.change(name, { data }, `Magnitude and phase of the inertance at ${option}, ${what}.`);
    markInFrac(content.rows[row]);
  }

  /** Real and imaginary parts of the same curves, in the band of the modes. */
  function drawNyquist(found, option) {
    const traces = charts.data("nyquist");
    if (!traces) return;
    const [low, high] = content.nyquist_hz;
    const data = traces.map((trace) => {
      const { x, level, phase } = found[trace.name];
      const inside = x.flatMap((hz, k) => (hz >= low && hz <= high && level[k] !== null ? [k] : []));
      const part = (turn) => inside.map((k) => level[k] * turn((phase[k] * Math.PI) / 180));
      return { ...trace, x: part(Math.cos), y: part(Math.sin) };
    });
    charts.change("nyquist", { data }, `Nyquist plot of the inertance at ${option}.`);
  }

  function markInFrac(row) {
    const [dots, mark] = charts.data("frac") ?? [];
    if (!dots) return;
    const at = { x: [unpacked(dots.x)[row]], y: [unpacked(dots.y)[row]] };
    charts.change("frac", { data: [dots, { ...mark, ...at }] });
  }

  function say() {
    said.textContent = `Shown: ${select.options[select.selectedIndex].text}`;
  }

  function choose(index) {
    select.selectedIndex = Math.min(Math.max(index, 0), select.options.length - 1);
    show();
    say();
  }

  select.addEventListener("change", () => choose(select.selectedIndex));
  for (const button of chooser.querySelectorAll("button")) {
    button.addEventListener("click", () => choose(select.selectedIndex + Number(button.dataset.step)));
  }
  charts.onClick("frac", ({ pointNumber, curveNumber }) => {
    if (curveNumber !== 0) return;
    const distance = content.rows.map((row) => Math.abs(row - pointNumber));
    choose(distance.indexOf(Math.min(...distance)));
  });
  charts.beforeDrawing(name, show);
  say();
}

document.querySelectorAll(".chooser").forEach(mount);
