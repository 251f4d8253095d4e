// Charts of the page: drawn when they come near the view, in the page's colours, for print in
// those of paper. Other scripts reach them through `window.ringmodal.charts`.
const page = document.documentElement;
const paper = document.getElementById("on-paper");
const charts = new Map();
const WIDE_IN_PRINT = 680, NARROW_IN_PRINT = 325; // CSS pixels: A4 without its margins, and half
const HEIGHT_IN_PRINT = 0.65; // of the height on the screen, so that more fits on a sheet
const TOUCHED = matchMedia("(pointer: coarse)").matches;
let printing = false;

window.ringmodalCharts = [];

for (const plot of document.querySelectorAll(".plot")) {
  const specification = JSON.parse(document.getElementById(`${plot.id}-data`).textContent);
  const name = plot.id.replace("chart-", "");
  const height = plot.style.height;
  charts.set(name, { name, plot, height, ...specification, drawn: false, prepare: null, onClick: null });
}

/** The value with each colour's name, such as "--ring", replaced by the colour. */
function coloured(value, style) {
  if (typeof value === "string") {
    return /^--[a-z0-9-]+$/.test(value) ? style.getPropertyValue(value).trim() : value;
  }
  if (Array.isArray(value)) return value.map((each) => coloured(each, style));
  if (value === null || typeof value !== "object" || ArrayBuffer.isView(value)) return value;
  return Object.fromEntries(
    Object.entries(value).map(([key, each]) => [key, coloured(each, style)]),
  );
}

/** What every chart shares; what the chart itself says comes first. */
function layoutOf(chart, style, width) {
  const narrow = (width ?? chart.plot.clientWidth) < 480;
  const axis = {
    gridcolor: "--line", linecolor: "--soft", tickcolor: "--soft", zerolinecolor: "--line",
    automargin: true, ticks: "outside", ticklen: 4, showline: true,
  };
  const { legend, ...own } = chart.layout;
  const shared = {
    font: { family: getComputedStyle(document.body).fontFamily, size: narrow ? 11 : 12.5, color: "--ink" },
    paper_bgcolor: "rgba(0,0,0,0)",
    plot_bgcolor: "rgba(0,0,0,0)",
    margin: { l: narrow ? 48 : 60, r: narrow ? 12 : 18, t: 12, b: 46 },
    hoverlabel: { bgcolor: "--card", bordercolor: "--soft", font: { color: "--ink" } },
    modebar: { bgcolor: "rgba(0,0,0,0)", color: "--soft", activecolor: "--accent" },
    legend: {
      bgcolor: "rgba(0,0,0,0)", orientation: "h", x: 0, yref: "container", y: 1, yanchor: "top", ...legend,
    },
    dragmode: TOUCHED ? false : "zoom", // a finger scrolls the page
    uirevision: "kept", // a redrawing keeps what was zoomed or switched off
    autosize: width === undefined,
    ...own,
  };
  if (width !== undefined) Object.assign(shared, { width, height: chart.plot.clientHeight });
  for (const key of Object.keys(own)) {
    if (!/^[xy]axis\d*$/.test(key)) continue;
    shared[key] = { ...axis, ...own[key], title: { standoff: 9, ...own[key].title } };
  }
  return coloured(shared, style);
}

/** Buttons that save a chart as it would be printed, so that it can be read on white. */
function saving(chart, format, icon) {
  return {
    name: `Download as ${format.toUpperCase()}`,
    icon,
    click: () => {
      const style = getComputedStyle(paper);
      const layout = { ...layoutOf(chart, style, 900), paper_bgcolor: "#ffffff" };
      const figure = { data: coloured(chart.data, style), layout };
      const height = chart.plot.clientHeight;
      Plotly.downloadImage(figure, { format, filename: chart.name, width: 900, height, scale: 2 });
    },
  };
}

function configuration(chart) {
  return {
    responsive: true,
    displaylogo: false,
    displayModeBar: "hover",
    showTips: false,
    modeBarButtons: [
      TOUCHED ? ["zoomIn2d", "zoomOut2d", "resetScale2d"] : ["zoom2d", "pan2d", "resetScale2d"],
      [saving(chart, "svg", Plotly.Icons.disk), saving(chart, "png", Plotly.Icons.camera)],
    ],
  };
}

/** The text alternative tells what a chart shows; its lines and icons one by one tell nothing. */
function hideFromReaders(plot) {
  const drawn = [...plot.querySelectorAll("svg"), document.getElementById("js-plotly-tester")];
  for (const each of drawn) each?.setAttribute("aria-hidden", "true");
}

function draw(chart) {
  const { prepare } = chart;
  chart.prepare = null;
  prepare?.();
  const beside = chart.plot.closest(".beside") !== null;
  chart.plot.style.height = printing ? `calc(${HEIGHT_IN_PRINT} * ${chart.height})` : chart.height;
  const width = printing ? (beside ? NARROW_IN_PRINT : WIDE_IN_PRINT) : undefined;
  const style = getComputedStyle(printing ? paper : page);
  const data = coloured(chart.data, style);
  Plotly.react(chart.plot, data, layoutOf(chart, style, width), configuration(chart));
  hideFromReaders(chart.plot);
  if (chart.drawn) return;
  chart.drawn = true;
  window.ringmodalCharts.push(chart.name);
  chart.plot.on("plotly_click", (event) => chart.onClick?.(event.points[0]));
}

function drawAll() {
  charts.forEach(draw);
}

function redraw() {
  charts.forEach((chart) => chart.drawn && draw(chart));
}

function print(starts) {
  if (printing === starts) return;
  printing = starts;
  if (starts) drawAll();
  else redraw();
}

/** Numbers packed as base64; a plain array as it is. */
function unpacked(values) {
  if (Array.isArray(values)) return values;
  const bytes = Uint8Array.from(atob(values.bdata), (letter) => letter.charCodeAt(0));
  return new { f4: Float32Array, i2: Int16Array }[values.dtype](bytes.buffer);
}

window.ringmodal = {
  unpacked,
  charts: {
    /** Change traces, layout or text alternative of a chart. */
    change(name, changes, alternative) {
      const chart = charts.get(name);
      Object.assign(chart, changes);
      if (alternative) chart.plot.setAttribute("aria-label", alternative);
      if (chart.drawn) draw(chart);
    },
    /** Call `respond` with the point of a chart that is clicked. */
    onClick(name, respond) {
      if (charts.has(name)) charts.get(name).onClick = respond;
    },
    /** Call `prepare` once, when the chart is about to be drawn for the first time. */
    beforeDrawing(name, prepare) {
      charts.get(name).prepare = prepare;
    },
    data: (name) => charts.get(name)?.data,
  },
};

const near = new IntersectionObserver(
  (entries) => {
    for (const entry of entries) {
      if (!entry.isIntersecting) continue;
      near.unobserve(entry.target);
      draw(charts.get(entry.target.id.replace("chart-", "")));
    }
    page.dataset.ready = "charts";
  },
  { rootMargin: "300px" },
);
charts.forEach((chart) => near.observe(chart.plot));

matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
matchMedia("print").addEventListener("change", (change) => print(change.matches));
addEventListener("beforeprint", () => print(true));
addEventListener("afterprint", () => print(false));
