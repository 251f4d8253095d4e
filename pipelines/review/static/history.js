// All edits in their order, with reasons; those undone can be redone.
import { ask, button, el, find, refill } from "./dom.js";

export function mount(host, bench) {
  const bar = find(".bar", host), list = find(".list", host);
  let writing = null; // index of the edit whose reason is being written

  function reason({ reason: given }, index) {
    if (writing !== index) {
      return button(given ? `“${given}”` : "add a reason", () => {
        writing = index;
        draw();
        find("input", list)?.focus();
      }, { className: "reason", "data-focus": `reason ${index}` });
    }
    const input = el("input", { value: given, maxLength: 500, "aria-label": "Reason of this edit", "data-focus": `writing ${index}` });
    let done = false;
    const keep = (kept) => {
      if (done) return;
      done = true;
      writing = null;
      if (kept && input.value !== given) bench.giveReason(index, input.value);
      draw();
      find(`[data-focus="reason ${index}"]`, list)?.focus();
    };
    input.addEventListener("keydown", (event) => {
      if (event.key !== "Enter" && event.key !== "Escape") return;
      event.preventDefault(); // else the button that has the focus next is pressed too
      keep(event.key === "Enter");
    });
    input.addEventListener("blur", () => keep(true));
    return input;
  }

  function item(edit, index) {
    const { cursor } = bench.state, inForce = index < cursor;
    const changed = bench.changeBy(index);
    return el("li", { className: [!inForce && "undone", index === cursor - 1 && "now"].filter(Boolean).join(" ") },
      button(edit.text, () => bench.moveTo(index + 1), {
        className: "name", "data-focus": `edit ${index}`, title: `${edit.by} ${edit.at}`, label: inForce ? `Go back to: ${edit.text}` : `Redo up to: ${edit.text}`,
      }),
      changed && el("span", { className: "soft" }, changed),
      inForce && reason(edit, index));
  }

  const note = () => ask("Note", "It goes into the record of edits and into the report.", { note: el("textarea", { rows: 3, maxLength: 500, required: true }) },
    ({ note: { value } }) => bench.edit({ kind: "note", reason: value }));

  function draw() {
    const { edits, cursor, modes } = bench.state;
    if (writing !== null && document.activeElement?.dataset.focus === `writing ${writing}`) return;
    const found = modes.filter((mode) => mode.automatic_hz !== null).length;
    refill(bar, el("h2", {}, "History"), el("span", { className: "grow" }), button("Note…", note, { className: "small", title: "Add a remark to the record", "data-focus": "note" }));
    refill(list,
      el("li", { className: cursor === 0 ? "now" : "" }, button(`Automatic: ${found} modes`, () => bench.moveTo(0), { className: "name", "data-focus": "edit none" })),
      edits.map(item));
    list.querySelector(".now")?.scrollIntoView({ block: "nearest" });
  }

  bench.watch(["state"], draw);
}
