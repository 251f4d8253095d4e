// The landing page of a folder: a running batch, results sorted by what needs a look, campaigns
// without a result, and parameter libraries.
import { button, complain, el, find, fixed, refill, say } from "./dom.js";
import { get, listen, post } from "./server.js";

const word = (...content) => el("td", { className: "word" }, content);
const number = (text) => el("td", {}, text);
const chip = (text, kind) => el("span", { className: `chip ${kind}` }, text);

function section(title, heads, rows, empty) {
  const words = new Set(["result", "tyre", "doubts", "reviewed", "campaign", "files", "manifest", "state", "library", "approved", "verdict"]);
  const table = el("table", {}, el("thead", {}, el("tr", {}, heads.map((name) => el("th", { scope: "col", className: words.has(name) ? "word" : "" },
    name === "χ²" ? el("span", { title: "of the fit, over its degrees of freedom: 1 is noise alone" }, name) : name || el("span", { className: "hidden" }, "open"))))), el("tbody", {}, rows));
  return el("section", { "aria-label": title }, el("h2", {}, `${title} (${rows.length})`), rows.length ? table : el("p", { className: "soft" }, empty));
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
  return el("tr", {},
    el("th", { scope: "row" }, el("a", { href: `/r/${encodeURIComponent(id)}` }, name)), word([campaign, tyre].filter(Boolean).join(" · ")),
    number(modes), number(pairs), number(fixed(chi2, 2)),
    word(doubts.length ? doubts.map((text) => [chip(text, "warning"), " "]) : el("span", { className: "soft" }, "none")),
    word(reviewed ? chip(reviewed, draft ? "preview" : "good") : "–"),
    el("td", {}, el("a", { className: look ? "button main" : "button", href: `/r/${encodeURIComponent(id)}`, "aria-label": `${draft ? "Continue" : look ? "Review" : "Open"} ${name}` },
      draft ? "Continue" : look ? "Review" : "Open")));
}

/** Results in groups that belong together are compared by ticking them. */
function comparison(results) {
  const boxes = results.map(({ id, name }) => el("label", {}, el("input", { type: "checkbox", value: id, onchange: update }), ` ${name}`));
  const go = button("Compare", () => location.assign(`/compare?ids=${chosen().map(encodeURIComponent).join(",")}`), { disabled: true });
  const chosen = () => boxes.map((each) => find("input", each)).filter((input) => input.checked).map((input) => input.value);
  function update() {
    go.disabled = chosen().length < 2;
  }
  return el("details", {}, el("summary", {}, "Compare results"), el("div", { className: "choices" }, boxes), el("p", {}, go));
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
    const home = await get("home"), open = find("details")?.open;
    document.title = "Results and campaigns · ringmodal review";
    refill(find("#what"), home.folder);
    refill(find("main"),
      home.batch && batchOf(home.batch),
      section("Results, those that need a look first", ["result", "tyre", "modes", "pairs", "χ²", "doubts", "reviewed", ""], home.results.map(resultRow), "No result yet."),
      home.results.length > 1 && comparison(home.results),
      section("Campaigns without a result", ["campaign", "files", "manifest", "state", ""], home.campaigns.map(campaignRow), "None."),
      home.libraries.length ? section("Parameter libraries", ["library", "tyre", "versions", "verdict", "approved"], home.libraries.flatMap(libraryRows), "") : null);
    if (open && find("details")) find("details").open = true;
    complain(null);
    document.documentElement.dataset.ready = "";
  } catch (problem) {
    complain(problem.message);
  }
}

await show();
if (find("main").childElementCount) listen("home", (event) => event.kind === "home" && show(), show);
