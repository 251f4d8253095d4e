// At the rig: what the runs measured so far are like, and what to do next.
import { button, complain, el, find, fixed, refill, say, short } from "./dom.js";
import { get, listen, post } from "./server.js";

const id = decodeURIComponent(location.pathname.split("/")[2]);
const word = (...content) => el("td", { className: "word" }, content);
const HEADS = [
  ["run"], ["state"], ["length / s"], ["force / N", "rms without the mean, of each force"], ["sensors", "rms without the mean, of the least and of the most moved sensor"],
  ["coherence", "median of all sensors in the band"], ["clipped / %", "of the samples, at most of a sensor"], ["coherent / Hz", "from where to where the coherence is good"],
  ["drift / %", "of all frequencies at the reference sensor, against the first run"], ["remarks"],
];
const WORDS = ["run", "state", "remarks"];
const KINDS = { ok: "good", warning: "warning", wait: "preview" };
const STATES = { measured: "good", "being written": "preview", missing: "", unreadable: "warning" };
let last = "";

function runRow({ run, state, repeat, seconds, force_n: force, sensors, unit, coherence, clipped, coherent_from_hz: from, coherent_to_hz: to, reference_drift_percent: drift, lines = [], error }) {
  const notes = [...lines.map(({ text }) => el("p", { className: "warning" }, text)), error && el("p", { className: "warning" }, error)];
  return el("tr", {}, el("th", { scope: "row" }, run), word(el("span", { className: `chip ${repeat ? "warning" : STATES[state] ?? ""}` }, repeat ? "repeat" : state)),
    el("td", {}, fixed(seconds, 1)), el("td", {}, force?.map(short).join(", ") ?? "–"), el("td", {}, sensors ? `${sensors.map(short).join(" – ")} ${unit}` : "–"), el("td", {}, fixed(coherence, 3)), el("td", {}, clipped == null ? "–" : `${fixed(100 * clipped, 2)}`),
    el("td", {}, from == null ? "–" : `${fixed(from, 0)} – ${fixed(to, 0)}`), el("td", {}, fixed(drift, 2)), word(notes));
}

async function process() {
  try {
    await post("home/process", { id });
    location.assign("/");
  } catch (problem) {
    complain(problem.message);
  }
}

async function show() {
  try {
    const { name, folder, runs_expected: expected, advice, runs } = await get(`w/${encodeURIComponent(id)}`);
    const measured = runs.filter(({ state }) => state === "measured").length;
    document.title = `${name} · ringmodal review`;
    refill(find("#what"), [name, folder].filter(Boolean).join(" · "));
    refill(find("main"),
      el("section", { "aria-label": "What to do next", className: `advice ${KINDS[advice.verdict] ?? ""}` }, el("h2", {}, "What to do now"), el("p", {}, advice.text)),
      el("section", { "aria-label": "Runs" }, el("div", { className: "bar" }, el("h2", {}, `Runs: ${measured} measured${expected ? ` of ${expected}` : ""}`), el("span", { className: "grow" }),
        button("Process what is there", process, { disabled: measured === 0, "data-focus": "process" })),
      el("div", { className: "scroll", tabIndex: 0, role: "region", "aria-label": "Table of runs" }, el("table", {}, el("thead", {}, el("tr", {},
        HEADS.map(([text, title]) => el("th", { scope: "col", className: WORDS.includes(text) ? "word" : "", title }, text)))),
      el("tbody", {}, runs.map(runRow))))));
    if (advice.text !== last) say(advice.text);
    last = advice.text;
    complain(null);
    document.documentElement.dataset.ready = "";
  } catch (problem) {
    complain(problem.message);
  }
}

find("footer").className = "hidden"; // the advice is on the page; the line is for screen readers
await show();
if (last) listen(id, (event) => event.kind === "watch" && event.id === id && show(), show);
