// The landing page of a folder: a running batch, results sorted by what needs a look, campaigns
// without a result, and parameter libraries.
import { button, complain, el, find, fixed, refill, say } from "./dom.js";
import { get, listen, post } from "./server.js";

const AGAIN_MS = 3000, REST = 20; // times as long as a look takes
const HIDDEN = ["tick", "open"]; // heads of columns that need none to be seen
const ticked = new Set();
let shown = "";
const word = (...content) => el("td", { className: "word" }, content);
const number = (text) => el("td", {}, text);
const chip = (text, kind) => el("span", { className: `chip ${kind}` }, text);

function section(title, heads, rows, empty, act = null) {
  const words = new Set(["result", "tyre", "doubts", "reviewed", "campaign", "files", "manifest", "state", "library", "approved", "verdict"]);
  const table = el("table", {}, el("thead", {}, el("tr", {}, heads.map((name) => el("th", { scope: "col", className: words.has(name) ? "word" : "" },
    name === "χ²" ? el("span", { title: "of the fit, over its degrees of freedom: 1 is noise alone" }, name) : HIDDEN.includes(name) ? el("span", { className: "hidden" }, name) : name)))), el("tbody", {}, rows));
  return el("section", { "aria-label": title }, el("div", { className: "bar" }, el("h2", {}, `${title} (${rows.length})`), el("span", { className: "grow" }), act), rows.length ? table : el("p", { className: "soft" }, empty));
}

function batchOf({ name, done, total, failed, now = [], running, per_minute: pace, failures = [] }) {
  const left = running && pace ? `, about ${Math.ceil((total - done) / pace)} min left` : "";
  const speed = running && pace ? `, ${fixed(pace, 1)} campaigns/min` : "";
  return el("section", { "aria-label": "Batch" },
    el("h2", {}, `Batch ${name}: ${running ? "running" : "ended"}`),
    el("progress", { max: total, value: done, "aria-label": `${done} of ${total} done` }),
    el("p", {}, `${done} of ${total}, ${failed} failed${speed}${left}`),
    now.length ? el("p", { className: "soft" }, `Now: ${now.join(", ")}`) : null,
    failures.length ? el("ul", {}, failures.map(({ name: which, why }) => el("li", {}, `${which}: ${why}`))) : null);
}

function resultRow({ id, name, campaign, tyre, modes, pairs, chi2, doubts, needs_look: look, reviewed }) {
  const draft = reviewed.startsWith("draft");
  const tick = el("input", { type: "checkbox", checked: ticked.has(id), "aria-label": `Compare ${name}`, "data-focus": `tick ${id}`, onchange: () => {
    ticked[tick.checked ? "add" : "delete"](id);
    find("#compare").disabled = ticked.size < 2;
  } });
  return el("tr", {}, el("td", {}, tick),
    el("th", { scope: "row" }, el("a", { href: `/r/${encodeURIComponent(id)}` }, name)), word([campaign, tyre].filter(Boolean).join(" · ")),
    number(modes), number(pairs), number(fixed(chi2, 2)),
    word(doubts.length ? doubts.map((text) => [chip(text, "warning"), " "]) : el("span", { className: "soft" }, "none")),
    word(reviewed ? chip(reviewed, draft ? "preview" : "good") : "–"),
    el("td", {}, el("a", { className: look ? "button main" : "button", href: `/r/${encodeURIComponent(id)}`, "aria-label": `${draft ? "Continue" : look ? "Review" : "Open"} ${name}` },
      draft ? "Continue" : look ? "Review" : "Open")));
}

/** Results that are ticked are compared, in the order of the list. */
function compareTicked(results) {
  const ids = () => results.map(({ id }) => id).filter((id) => ticked.has(id));
  return button("Compare the ticked ones", () => location.assign(`/compare?ids=${ids().map(encodeURIComponent).join(",")}`), { id: "compare", title: "Tick two to twelve results", disabled: ids().length < 2, "data-focus": "compare" });
}

function campaignRow({ id, name, files, manifest, job, measuring }) {
  const start = async () => {
    try {
      await post("home/process", { id });
      say(`Processing ${name}`);
      show();
    } catch (problem) {
      complain(problem.message);
    }
  };
  const busy = job?.state === "running", ready = manifest === "ready";
  return el("tr", {}, el("th", { scope: "row" }, name), word(files), word(chip(ready ? "ready" : manifest === "none" ? "no manifest" : manifest, ready ? "good" : "warning")),
    word(job ? chip(job.text || job.state, job.state === "failed" ? "warning" : job.state === "done" ? "good" : "preview") : measuring ? chip("being measured", "preview") : ""),
    el("td", {}, el("a", { className: "button", href: `/w/${encodeURIComponent(id)}`, "aria-label": `Watch ${name}` }, "Watch"), " ",
      button("Process", start, { disabled: busy || !ready, "data-focus": `process ${id}`, label: `Process ${name}` })));
}

const libraryRows = ({ name, sets }) => sets.map(({ tyre, versions, approved, verdict }) => el("tr", {},
  el("th", { scope: "row" }, name), word(tyre), number(versions), word(verdict ?? ""), word(approved || "–")));

async function show() {
  try {
    const home = await get("home"), told = JSON.stringify(home);
    if (told === shown) return;
    complain(null);
    shown = told;
    document.title = "Results and campaigns · ringmodal review";
    refill(find("#what"), home.folder);
    refill(find("main"),
      home.batch && batchOf(home.batch),
      section("Results, those that need a look first", ["tick", "result", "tyre", "modes", "pairs", "χ²", "doubts", "reviewed", "open"], home.results.map(resultRow), "No result yet.", home.results.length > 0 && compareTicked(home.results)),
      section("Campaigns without a result", ["campaign", "files", "manifest", "state", "open"], home.campaigns.map(campaignRow), "None."),
      home.libraries.length ? section("Parameter libraries", ["library", "tyre", "versions", "verdict", "approved"], home.libraries.flatMap(libraryRows), "") : null);
    document.documentElement.dataset.ready = "";
  } catch (problem) {
    complain(problem.message);
  }
}

/** Look again for what other programs write, batches among them: seldom where a look takes long. */
async function follow() {
  for (let took = 0; ; ) {
    await new Promise((done) => setTimeout(done, Math.max(AGAIN_MS, REST * took)));
    const start = performance.now();
    if (!document.hidden) await show();
    took = performance.now() - start;
  }
}

await show();
if (find("main").childElementCount) {
  listen("home", (event) => event.kind === "home" && show(), show);
  follow();
}
