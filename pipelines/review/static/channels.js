// The channels: how well the fit agrees with each (FRAC), and what can be done with it.
import { ask, button, el, find, fixed, follow, key, numberField, refill } from "./dom.js";

const POOR_FRAC = 0.9; // worth a look

/** What a channel's line says beside its name. */
function verdict({ used, sign, gain, frac }) {
  if (!used) return "out";
  const changed = [sign < 0 ? "−" : "", gain === 1 ? "" : `×${fixed(gain, 2)}`].join("");
  return `${changed} ${fixed(frac, 3)}`.trim();
}

/** A file name without its ending. */
export const stem = (name) => name.replace(/\.[^.]+$/, "") || name;

/** With how many letters all names begin. */
function sharedStart([first = "", ...others]) {
  let n = 0;
  while (others.length && n < first.length && others.every((name) => name[n] === first[n])) n += 1;
  return n;
}

/** Multiply a channel: calibration or gain that was set wrongly. */
export function scale(bench, channel) {
  const now = channel.gain === 1 ? "" : ` It is multiplied with ${fixed(channel.gain, 4)} now.`;
  ask(`Gain of ${channel.channel} ${stem(channel.run)}`, `The FRF of this channel is multiplied with the factor.${now}`, { factor: numberField(1, { min: "1e-9" }) },
    ({ factor: { value } }) => bench.onChannel("gain", channel, { value: Number(value) }));
}

export const outOrIn = (bench, channel) => bench.onChannel(channel.used ? "channel_out" : "channel_in", channel);

export function mount(host, bench) {
  const bar = find(".bar", host), list = find(".list", host);
  let poorestFirst = false, common = 0; // letters with which the names of all runs begin

  function line(channel) {
    const { row, position_deg: at, node, run, channel: name, used, frac } = channel;
    const place = at === null ? `node ${node}` : `${fixed(at, at % 1 ? 1 : 0)}°`, who = `${name} ${stem(run)}`;
    const chosen = row === bench.view.row, tabIndex = chosen ? 0 : -1; // the others: arrow keys
    const doubt = !used || frac < POOR_FRAC || channel.sign < 0 || channel.gain !== 1;
    return el("li", { className: [chosen && "chosen", !used && "aside"].filter(Boolean).join(" ") },
      button([el("span", { className: "at" }, place), ` ${name} `, el("span", { className: "common" }, stem(run).slice(0, common)), stem(run).slice(common)], () => bench.look({ row }), {
        className: "name", tabIndex, "aria-pressed": String(chosen), "data-focus": `row ${row}`, title: channel.why || who,
      }),
      el("span", { className: doubt ? "moved" : "" }, verdict(channel)),
      button(used ? "×" : "+", () => outOrIn(bench, channel), { className: "small", tabIndex, label: `${used ? "Leave out" : "Use"} ${who}`, "data-focus": `out ${row}` }),
      button("±", () => bench.onChannel("flip", channel), { className: "small", tabIndex, label: `Flip the sign of ${who}`, "data-focus": `flip ${row}` }),
      chosen && el("span", { className: "more" }, button(["Gain… ", key("G")], () => scale(bench, channel), { className: "small", title: `Gain of ${who}`, "data-focus": `gain ${row}` }),
        bench.forces.length ? button(used ? "× all" : "+ all", () => bench.everywhere(used ? "channel_out" : "channel_in", channel), {
          className: "small", label: `${used ? "Leave out" : "Use"} ${name} in all runs, against all forces`, "data-focus": `all ${row}`,
        }) : null));
  }

  function draw() {
    const channels = poorestFirst ? bench.around.sort((a, b) => (a.frac ?? -1) - (b.frac ?? -1)) : bench.around;
    const out = channels.filter((channel) => !channel.used).length;
    const runs = [...new Set(channels.map((channel) => channel.run))];
    common = sharedStart(runs.map(stem));
    const runOut = el("select", { className: "small", "aria-label": "Leave out a whole run", "data-focus": "run out", onchange: () => {
      if (runOut.value) bench.edit({ kind: "run_out", run: runOut.value });
      runOut.value = "";
    } }, el("option", { value: "" }, "run"), runs.map((run) => el("option", { value: run }, stem(run))));
    refill(bar, el("h2", {}, `Channels ${channels.length - out}${out ? `/${channels.length}` : ""}`), el("span", { className: "grow" }),
      runs.length > 1 ? runOut : null,
      button("FRAC", () => {
        poorestFirst = !poorestFirst;
        draw();
      }, { className: "small", "aria-pressed": String(poorestFirst), label: "FRAC: poorest first", "data-focus": "sort" }));
    refill(list, channels.map(line));
    list.querySelector(".chosen")?.scrollIntoView({ block: "nearest" });
    follow(list, ".chosen", bench.view.row);
  }

  bench.watch(["state", "row"], draw, () => [bench.view.row, JSON.stringify(bench.around.map((channel) => [channel.row, channel.why, channel.gain, verdict(channel)]))]);
}
