// Signing off: what was edited and why, automatic against edited, a name, and a new result folder.
import { button, dialog, el, fixed, key, refill, say, signed } from "./dom.js";
import { get, post } from "./server.js";

const MOVED_SIGMA = 3;

function table(caption, heads, rows) {
  return el("div", { className: "scroll", tabIndex: 0, role: "region", "aria-label": caption }, el("table", {}, el("caption", {}, caption),
    el("thead", {}, el("tr", {}, heads.map((name, k) => el("th", { scope: "col", className: k === heads.length - 1 ? "" : "word" }, name)))),
    el("tbody", {}, rows)));
}

const word = (text) => el("td", { className: "word" }, text);

function editRows(edits, bench) {
  return edits.map(({ text, reason }, index) => {
    const input = el("input", { value: reason, placeholder: "why", maxLength: 500, "aria-label": `Reason of: ${text}` });
    input.addEventListener("change", () => bench.giveReason(index, input.value));
    return el("tr", {}, word(text), el("td", { className: "word wide" }, input), el("td", {}, bench.changeBy(index) || "–"));
  });
}

function modeRows(modes) {
  return modes.map(({ name, automatic, signed: now, delta_sigma: moved }) => el("tr", {}, word(name), word(automatic || "–"), word(now || "–"),
    el("td", { className: Math.abs(moved ?? 0) > MOVED_SIGMA ? "moved" : "" }, moved === null ? "–" : signed(moved, 1))));
}

/** The replay command, with a button that copies it. */
function command(text) {
  return el("p", { className: "command" }, el("code", {}, text), button("Copy", () => navigator.clipboard.writeText(text), { className: "small" }));
}

export function signOff(bench) {
  const body = el("div", { className: "signing" }), box = dialog(`Sign off ${bench.state.name}`, body);
  const name = el("input", { id: "signer", value: bench.state.by ?? "", required: true, maxLength: 200 });
  const note = el("textarea", { id: "note", rows: 2, maxLength: 5000 });
  const folder = el("input", { id: "folder", required: true, maxLength: 200 });
  const trouble = el("p", { className: "warning", role: "alert", hidden: true });
  let proposal = null, shown = "";

  async function load() {
    const now = `${bench.state.revision} ${bench.state.stage}`;
    if (now === shown || !box.isConnected) return;
    shown = now;
    try {
      proposal = await get(`${bench.path}/signoff`);
    } catch (problem) {
      return refill(body, el("p", { className: "warning" }, problem.message));
    }
    if (!folder.value) folder.value = proposal.folder;
    draw();
  }

  async function sign() {
    trouble.hidden = true;
    for (const input of [name, folder]) if (!input.reportValidity()) return;
    bench.signing = null;
    bench.signedAs = folder.value;
    refill(body, el("p", { role: "status" }, "Writing the new result folder …"));
    try {
      const content = { revision: proposal.revision, by: name.value, note: note.value, folder: folder.value };
      signedOff(await post(`${bench.path}/sign`, content));
      bench.take(await get(`${bench.path}/state`), true); // without the draft, which is in the new folder now
    } catch (problem) {
      trouble.textContent = problem.message;
      trouble.hidden = false;
      bench.signing = load;
      draw();
    }
  }

  function signedOff(answer) {
    say(`Signed: ${answer.folder}`);
    const done = button("Close", () => box.close(), { className: "main" });
    refill(body, el("p", { className: "good" }, `Signed and written to ${answer.folder}, with report.`),
      el("p", {}, "The same folder again, from the recordings:"), command(answer.command),
      el("p", { className: "buttons" }, answer.id && el("a", { href: `/r/${encodeURIComponent(answer.id)}` }, "Open the signed result"), done));
    done.focus();
  }

  function draw() {
    const { edits, modes, warnings, ready, command: replay } = proposal;
    refill(body,
      el("p", {}, el("span", { className: ready ? "chip good" : "chip preview" },
        ready ? "Final fit done: nothing here is a preview" : "The final fit is running; you can sign when it is done")),
      edits.length ? table("Edits", ["edit", "reason", "what it changed"], editRows(edits, bench)) : el("p", {}, "No edits: the automatic result is signed as found."),
      table("Against the automatic result", ["mode", "automatic", "signed", "Δ in σ"], modeRows(modes)),
      warnings.map((text) => el("p", { className: "warning" }, text)), trouble,
      el("div", { className: "fields" }, el("label", { for: "signer" }, "Your name"), name, el("label", { for: "folder" }, "New folder"), folder,
        el("label", { for: "note" }, "Note"), note),
      replay && command(replay),
      el("p", { className: "buttons" }, button(["Cancel ", key("Esc")], () => box.close()),
        button("Sign and write", sign, { className: "main", disabled: !ready, id: "sign" })));
  }

  refill(body, el("p", {}, `χ² ${fixed(bench.state.chi2, 2)}, reading …`));
  load();
  bench.signing = load; // the dialog follows the state while it is open
  return box;
}
