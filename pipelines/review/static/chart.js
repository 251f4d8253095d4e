// A chart on a canvas: axes, lines and points, hover, zoom by dragging and by the wheel.
import { colour, el, onScheme } from "./dom.js";

const LEFT = 54, RIGHT = 10, TOP = 8, BOTTOM = 36, BOTTOM_BARE = 20; // px; bare: without a label
const DRAGGED_PX = 4; // less is a click
const WHEEL = 1.25; // change of range per step
const NAME_PX = 11; // height of a name beside a curve
const FONT = '11px system-ui, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif';

/** Round values between two limits, about `count` of them. */
export function ticks(low, high, count, whole = false) {
  const rough = (high - low) / Math.max(1, count);
  if (!(rough > 0)) return { values: [], decimals: 0 };
  const power = 10 ** Math.floor(Math.log10(rough));
  const round = power * ([1, 2, 5].find((each) => each * power >= rough) ?? 10), step = whole ? Math.max(1, round) : round;
  const first = Math.ceil(low / step - 1e-9);
  const n = Math.floor(high / step + 1e-9) - first + 1;
  const values = Array.from({ length: Math.max(0, n) }, (_, k) => (first + k) * step);
  return { values, decimals: Math.max(0, -Math.floor(Math.log10(step) + 1e-9)) };
}

function logTicks(low, high) {
  const decades = high - low, values = [], minor = [];
  const steps = decades > 2.5 ? [1] : [1, 2, 5];
  for (let power = Math.floor(low); power <= high; power += 1) {
    for (let digit = 1; digit < 10; digit += 1) {
      const value = power + Math.log10(digit);
      if (value < low || value > high) continue;
      (steps.includes(digit) ? values : minor).push(value);
    }
  }
  return { values, minor };
}

export class Chart {
  /**
   * `compose(chart)` sets the axes `x` and `y` (label, min, max, log) and answers with layers:
   * functions (pen, chart) that draw within the axes. `onHover(place | null)`, `onClick(place)` and
   * `onZoom(low, high)` are called by what the hand does.
   */
  constructor(host, { label, compose, onHover, onClick, onZoom, equal = false }) {
    const axis = { label: "", min: 0, max: 1 };
    Object.assign(this, { host, compose, equal, onHover, onClick, onZoom, drag: null, x: axis, y: { ...axis }, width: 0, height: 0 });
    this.canvas = el("canvas", { role: "img", "aria-label": label });
    this.tip = el("div", { className: "tip", hidden: true, "aria-hidden": "true" });
    host.classList.add("chart");
    host.append(this.canvas, this.tip);
    this.pen = this.canvas.getContext("2d");
    this.listen();
    const again = () => this.drawn && this.draw();
    new ResizeObserver(again).observe(host);
    onScheme(again);
  }

  get inner() {
    return { left: LEFT, top: TOP, width: Math.max(1, this.width - LEFT - RIGHT), height: Math.max(1, this.height - TOP - (this.x.label ? BOTTOM : BOTTOM_BARE)) };
  }

  toX(value) {
    return LEFT + (this.inner.width * (value - this.x.min)) / (this.x.max - this.x.min);
  }

  toY(value) {
    const place = this.y.log ? Math.log10(value) : value;
    return TOP + this.inner.height * (1 - (place - this.low) / (this.high - this.low));
  }

  get low() { return this.y.log ? Math.log10(this.y.min) : this.y.min; }
  get high() { return this.y.log ? Math.log10(this.y.max) : this.y.max; }

  /** Frequency or value under a place on the canvas. */
  atX(pixel) {
    return this.x.min + ((pixel - LEFT) / this.inner.width) * (this.x.max - this.x.min);
  }

  /** Draw everything again, once in the next frame however often it is asked for. */
  draw() {
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => {
      this.waiting = false;
      this.paint();
    });
  }

  paint() {
    const { host: { clientWidth: width, clientHeight: height }, pen, canvas } = this, sharp = window.devicePixelRatio || 1;
    Object.assign(this, { width, height }); // asking the page for every point would take longer than drawing
    if (!width || !height) return;
    if (canvas.width !== Math.round(width * sharp) || canvas.height !== Math.round(height * sharp)) {
      canvas.width = Math.round(width * sharp);
      canvas.height = Math.round(height * sharp);
    }
    pen.setTransform(sharp, 0, 0, sharp, 0, 0);
    pen.clearRect(0, 0, width, height);
    this.drawn = true;
    const layers = this.compose(this);
    if (this.equal) this.makeEqual();
    this.axes();
    pen.save();
    pen.beginPath();
    const { left, top, width: wide, height: high } = this.inner;
    pen.rect(left, top, wide, high);
    pen.clip();
    for (const layer of layers) layer(pen, this);
    if (this.drag?.moved) {
      pen.fillStyle = colour("--accent");
      pen.globalAlpha = 0.2;
      pen.fillRect(Math.min(this.drag.from, this.drag.to), top, Math.abs(this.drag.to - this.drag.from), high);
      pen.globalAlpha = 1;
    }
    pen.restore();
  }

  /** The same scale on both axes: a circle is round. */
  makeEqual() {
    const { x, y, inner } = this;
    const scale = Math.max((x.max - x.min) / inner.width, (y.max - y.min) / inner.height);
    for (const [axis, size] of [[x, inner.width], [y, inner.height]]) {
      const middle = (axis.min + axis.max) / 2;
      [axis.min, axis.max] = [middle - (scale * size) / 2, middle + (scale * size) / 2];
    }
  }

  axes() {
    const { pen, inner } = this, bottom = inner.top + inner.height, right = inner.left + inner.width;
    pen.font = FONT;
    pen.lineWidth = 1;
    pen.strokeStyle = colour("--line");
    pen.fillStyle = colour("--soft");
    pen.textBaseline = "top";
    pen.textAlign = "center";
    const across = ticks(this.x.min, this.x.max, inner.width / 70, this.x.whole);
    for (const value of across.values) {
      const at = Math.round(this.toX(value)) + 0.5;
      stroke(pen, at, inner.top, at, bottom);
      pen.fillText(text(value, across.decimals), at, bottom + 5);
    }
    pen.fillText(this.x.label, inner.left + inner.width / 2, bottom + 19);
    pen.textAlign = "right";
    pen.textBaseline = "middle";
    const up = this.y.log ? logTicks(this.low, this.high) : ticks(this.low, this.high, inner.height / 32);
    for (const value of up.minor ?? []) {
      pen.globalAlpha = 0.4;
      const at = Math.round(this.toY(10 ** value)) + 0.5;
      stroke(pen, inner.left, at, right, at);
      pen.globalAlpha = 1;
    }
    for (const value of up.values) {
      const shown = this.y.log ? 10 ** value : value;
      const at = Math.round(this.toY(shown)) + 0.5;
      stroke(pen, inner.left, at, right, at);
      const said = this.y.log ? text(shown, Math.max(0, Math.ceil(-value - 1e-9))) : text(shown, up.decimals);
      pen.fillText(said, inner.left - 6, at);
    }
    pen.strokeStyle = colour("--soft");
    pen.strokeRect(inner.left + 0.5, inner.top + 0.5, inner.width - 1, inner.height - 1);
    pen.save();
    pen.translate(11, inner.top + inner.height / 2);
    pen.rotate(-Math.PI / 2);
    pen.textAlign = "center";
    pen.fillText(this.y.label, 0, 0);
    pen.restore();
  }

  listen() {
    const { canvas } = this;
    const place = (event) => {
      const box = canvas.getBoundingClientRect();
      const px = event.clientX - box.left, py = event.clientY - box.top;
      return { px, py, x: this.atX(px), event };
    };
    canvas.addEventListener("pointerdown", (event) => {
      if (event.button !== 0) return;
      const { px } = place(event);
      this.drag = { from: px, to: px, moved: false };
      canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener("pointermove", (event) => {
      const where = place(event);
      if (this.drag && this.onZoom) {
        this.drag.to = where.px;
        this.drag.moved ||= Math.abs(where.px - this.drag.from) > DRAGGED_PX;
        if (this.drag.moved) return this.draw();
      }
      this.onHover?.(where);
    });
    canvas.addEventListener("pointerup", (event) => {
      const { drag } = this;
      this.drag = null;
      if (!drag) return;
      if (!drag.moved) return this.onClick?.(place(event));
      this.onZoom(...[this.atX(drag.from), this.atX(drag.to)].sort((a, b) => a - b));
    });
    canvas.addEventListener("pointercancel", () => (this.drag = null));
    canvas.addEventListener("pointerleave", () => this.onHover?.(null));
    canvas.addEventListener("wheel", (event) => {
      if (!this.onZoom) return;
      event.preventDefault();
      const { x } = place(event), factor = event.deltaY > 0 ? WHEEL : 1 / WHEEL;
      this.onZoom(x - (x - this.x.min) * factor, x + (this.x.max - x) * factor);
    }, { passive: false });
  }

  /** Text beside a place; null hides it. */
  hint(said, px, py) {
    this.tip.hidden = !said;
    if (!said) return;
    this.tip.textContent = said;
    const wide = this.tip.offsetWidth;
    this.tip.style.left = `${px + 14 + wide > this.width ? px - 14 - wide : px + 14}px`;
    this.tip.style.top = `${Math.max(0, Math.min(py - 10, this.height - this.tip.offsetHeight))}px`;
  }
}

const text = (value, decimals) => value.toFixed(decimals).replace("-", "−");

function stroke(pen, x0, y0, x1, y1) {
  pen.beginPath();
  pen.moveTo(x0, y0);
  pen.lineTo(x1, y1);
  pen.stroke();
}

/** A layer: a line through points; unknown values leave a gap. */
export function line(xs, ys, stroked, width = 1.5, dash = []) {
  return (pen, chart) => {
    pen.strokeStyle = stroked;
    pen.lineWidth = width;
    pen.setLineDash(dash);
    pen.beginPath();
    let down = false;
    for (let k = 0; k < xs.length; k += 1) {
      const y = chart.toY(ys[k]);
      if (Number.isFinite(y)) {
        if (down) pen.lineTo(chart.toX(xs[k]), y);
        else pen.moveTo(chart.toX(xs[k]), y);
      }
      down = Number.isFinite(y);
    }
    pen.stroke();
    pen.setLineDash([]);
  };
}

/** A layer: points. */
export function dots(xs, ys, filled, size = 2.5) {
  return (pen, chart) => {
    pen.fillStyle = filled;
    for (let k = 0; k < xs.length; k += 1) {
      pen.fillRect(chart.toX(xs[k]) - size / 2, chart.toY(ys[k]) - size / 2, size, size);
    }
  };
}

/** A layer: a name beside each of several places, moved apart where they would lie on each other. */
export function namesBeside(places) {
  return (pen, chart) => {
    const { top, height } = chart.inner, sorted = places.filter(({ y }) => Number.isFinite(y)).sort((a, b) => b.y - a.y);
    const apart = Math.min(NAME_PX, height / Math.max(1, sorted.length)), at = sorted.map(({ y }) => chart.toY(y));
    for (let k = 0; k < at.length; k += 1) at[k] = Math.max(at[k], k ? at[k - 1] + apart : top + apart / 2);
    for (let k = at.length - 1; k >= 0; k -= 1) at[k] = Math.min(at[k], k + 1 < at.length ? at[k + 1] - apart : top + height - apart / 2);
    pen.font = FONT;
    pen.textAlign = "left";
    pen.textBaseline = "middle";
    pen.lineWidth = 0.5;
    sorted.forEach(({ x, y, name, stroked }, k) => {
      const from = chart.toX(x);
      pen.strokeStyle = pen.fillStyle = stroked;
      stroke(pen, from + 3, chart.toY(y), from + 13, at[k]);
      pen.strokeStyle = colour("--paper"); // legible over other curves
      pen.lineWidth = 3;
      pen.strokeText(name, from + 15, at[k]);
      pen.fillText(name, from + 15, at[k]);
      pen.lineWidth = 0.5;
    });
  };
}

/** A layer: standard deviations, as lines through points. */
export function deviations(xs, ys, stds, stroked) {
  return (pen, chart) => {
    pen.strokeStyle = stroked;
    pen.lineWidth = 1;
    for (let k = 0; k < xs.length; k += 1) {
      if (Number.isFinite(ys[k]) && Number.isFinite(stds[k])) stroke(pen, chart.toX(xs[k]), chart.toY(ys[k] - stds[k]), chart.toX(xs[k]), chart.toY(ys[k] + stds[k]));
    }
  };
}

/** A layer: vertical lines. */
export function verticals(places) {
  return (pen, chart) => {
    for (const { x, stroked, width = 1, dash = [3, 3] } of places) {
      pen.strokeStyle = stroked;
      pen.lineWidth = width;
      pen.setLineDash(dash);
      const at = chart.toX(x);
      stroke(pen, at, chart.inner.top, at, chart.inner.top + chart.inner.height);
    }
    pen.setLineDash([]);
  };
}

/** Limits of those values whose x is shown, with some room; on a log axis the smallest are left out. */
export function limits(xs, lists, [low, high], log = false) {
  let least = Infinity, most = -Infinity;
  for (const values of lists) {
    for (let k = 0; k < xs.length; k += 1) {
      const value = values[k];
      if (xs[k] < low || xs[k] > high || !Number.isFinite(value) || (log && value <= 0)) continue;
      least = Math.min(least, value);
      most = Math.max(most, value);
    }
  }
  if (!(most >= least)) return log ? [0.1, 1] : [0, 1];
  if (log) return [Math.max(least, most * 1e-5) / 1.3, most * 1.3];
  const room = 0.05 * (most - least || Math.abs(most) || 1);
  return [least - room, most + room];
}
