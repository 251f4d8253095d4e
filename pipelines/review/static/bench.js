// What the review page knows: the server's state, arrays read from it, and what is in view.
// Panels watch topics and draw themselves anew when one of them is told.
import { arrays, get, listen, post } from "./server.js";
import { complain, fixed, say } from "./dom.js";

/** What a panel can watch. */
export const TOPICS = ["state", "mode", "row", "zoom", "tab", "hover", "pick", "indicator", "diagram", "frf", "fit", "shapes", "orders", "force"];

const PROGRESS = { preview: 1, final: 2, failed: 2 };

/** Whether a panel has to be drawn; plain objects of a state are compared by their content. */
function hasChanged(panel) {
  if (!panel.of) return true;
  const now = panel.of(), before = panel.drawn;
  panel.drawn = now;
  return now.length !== before.length || now.some((each, k) => each !== before[k]);
}

export class Bench {
  constructor(id) {
    this.id = id;
    this.path = `r/${encodeURIComponent(id)}`;
    this.state = null;
    this.data = {}; // blobs by name
    this.view = { mode: null, row: 0, zoom: null, tab: "frf", hover: null, pick: null, indicator: "rms", show: "all" };
    this.panels = [];
    this.told = new Set();
    this.asked = {}; // what was last asked for, by name
    this.last = Promise.resolve(); // edits go one after another
    this.signedAs = null; // the folder that is signed from this page
    this.pending = null; // what is said when its numbers are known
  }

  /** Call `draw` when one of the topics is told, and what it draws (`of`, a list) is no longer the same. */
  watch(topics, draw, of = null) {
    for (const topic of topics) if (!TOPICS.includes(topic)) throw new Error(`unknown topic ${topic}`);
    this.panels.push({ topics, draw, of, drawn: [] });
  }

  tell(...topics) {
    if (!this.told.size) queueMicrotask(() => this.redraw());
    for (const topic of topics) this.told.add(topic);
  }

  redraw() {
    const { told } = this;
    this.told = new Set();
    if (!this.state) return;
    for (const panel of this.panels) if (panel.topics.some((topic) => told.has(topic)) && hasChanged(panel)) panel.draw();
  }

  /** Change the view and tell who watches it. */
  look(changes) {
    const changed = Object.keys(changes).filter((name) => this.view[name] !== changes[name]);
    Object.assign(this.view, changes);
    if (changed.includes("show")) this.tell("indicator");
    this.tell(...changed.filter((name) => TOPICS.includes(name)));
    if (changed.includes("row")) this.readRow();
    if (changed.includes("indicator")) this.readIndicator();
    if (changed.includes("tab") && this.view.tab === "force") this.readForce();
  }

  get modes() { return this.state?.modes ?? []; }
  get mode() { return this.modes.find((mode) => mode.key === this.view.mode) ?? null; }
  /** Where several forces act; empty for one. */
  get forces() { return this.state.forces ?? []; }

  /** Number of the force whose FRFs are shown, from 1. */
  get force() { return this.channel?.force ?? 1; }

  /** Show the FRF of the same place against another force. */
  against(force) {
    const { position_deg: at, node, channel } = this.channel;
    const apart = (each) => (each.position_deg === at && each.node === node ? 0 : 2) + (each.channel === channel ? 0 : 1);
    const [same] = this.state.channels.filter((each) => each.force === force).sort((a, b) => apart(a) - apart(b));
    this.look({ row: same.row });
    this.readIndicator();
    this.tell("state");
  }

  get channel() { return this.state?.channels[this.view.row] ?? null; }
  get isPreview() { return this.state.stage !== "final"; }

  /** The channels of the force that is shown, in the order of their positions. */
  get around() {
    const { force } = this;
    return this.state.channels.filter((each) => each.force === force).sort((a, b) => (a.position_deg ?? a.node) - (b.position_deg ?? b.node));
  }

  /** Frequencies shown: those zoomed to, or the band with a little room. */
  get range() {
    const [low, high] = this.state.band_hz, room = 0.03 * (high - low);
    return this.view.zoom ?? [Math.max(0, low - room), high + room];
  }

  zoom(low, high) {
    const [first, last] = this.state.fit_band_hz, [least, most] = this.state.band_hz;
    const room = 0.1 * (most - least);
    const from = Math.max(low, Math.min(first, least) - room, 0), to = Math.min(high, Math.max(last, most) + room);
    if (to - from < 0.05) return;
    this.look({ zoom: to - from > 1.15 * (most - least) ? null : [from, to] });
  }

  async open() {
    this.take(await get(`${this.path}/state`));
    this.look({ row: (this.around.find((channel) => channel.used) ?? this.around[0])?.row ?? 0 });
    this.readRow();
    listen(this.id, (event) => this.hear(event), async () => this.take(await get(`${this.path}/state`), true));
  }

  hear(event) {
    if (event.id !== this.id) return;
    if (event.kind === "state") this.take(event.state);
    if (event.kind === "signed" && event.folder !== this.signedAs) {
      complain(`Signed in another window, as ${event.folder}. This page now shows the result without these edits`);
    }
  }

  /** Take over a state of the server, unless a newer one is here already: an event may overtake an answer. */
  take(state, isForced = false) {
    const age = ({ revision, stage }) => 3 * revision + (PROGRESS[stage] ?? 0);
    if (this.state && !isForced && age(state) < age(this.state)) return;
    const before = this.mode;
    this.state = state;
    this.view.mode = this.again(before)?.key ?? null;
    if (state.error) complain(`Not done: ${[state.error.where, state.error.found].join(": ")}. ${state.error.rule} ${state.error.remedy}`);
    this.tell("state", "mode");
    this.announce();
    this.readAll();
  }

  /** The mode that was chosen before, in a new state. */
  again(before) {
    if (!before) return this.modes.find((mode) => mode.listed) ?? this.modes[0];
    const same = this.modes.find((mode) => mode.key === before.key);
    const apart = (mode) => Math.abs(mode.frequency_hz - before.frequency_hz) + (mode.name === before.name ? 0 : 0.2);
    return same ?? [...this.modes].sort((a, b) => apart(a) - apart(b))[0];
  }

  /** "χ² 1.02 → 4.61" of an edit, where both fits are known. */
  changeBy(index) {
    const { misfits, edits } = this.state, before = misfits[index], after = misfits[index + 1];
    return before === null || after === null || edits[index].kind === "note" ? "" : `χ² ${fixed(before, 2)} → ${fixed(after, 2)}`;
  }

  announce() {
    const { pending, state } = this, stage = state.stage;
    if (!pending || state.revision <= pending.revision || pending.stage === stage) return;
    pending.stage = stage;
    const text = pending.said(state), change = `χ² ${fixed(pending.chi2, 2)} → ${fixed(state.chi2, 2)}`;
    if (!(stage in PROGRESS)) return say(`${text} …`);
    say(stage === "failed" ? `${text}: the fit failed` : `${text}, ${change}, ${stage}`);
    if (stage !== "preview") this.pending = null;
  }

  /** What has to be read anew when it changes. */
  fitKey() { return `${this.state.revision} ${this.state.stage === "fitting" ? "" : this.state.stage}`; }
  diagramKey() {
    const { settings, channels, band_hz: band } = this.state;
    return JSON.stringify([settings, band, channels.map(({ used, sign, gain }) => (used ? sign * gain : 0))]);
  }

  readAll() {
    if (this.state.stage === "fitting") return; // numbers follow
    const key = this.fitKey();
    this.read("shapes", "shapes", key);
    this.readIndicator();
    this.readRow();
  }

  readIndicator() {
    const { force } = this;
    this.read("diagram", `diagram?force=${force}`, `${this.diagramKey()} ${this.isPreview} ${force}`);
    if (this.view.indicator === "orders") this.read("orders", `orders?force=${force}`, `${this.diagramKey()} ${force}`);
  }

  readRow() {
    const row = this.view.row;
    const { used, sign, gain } = this.channel ?? {};
    this.read("frf", `frf?row=${row}`, JSON.stringify([row, used, sign, gain, this.state.settings]));
    this.read("fit", `fit?row=${row}`, `${row} ${this.fitKey()}`);
  }

  readForce() {
    const run = this.channel?.run ?? "";
    this.read("force", `force?run=${encodeURIComponent(run)}`, run);
  }

  /** Read arrays unless those of this key are here or on their way; the newest wins. */
  async read(name, path, wanted) {
    if (this.asked[name] === wanted) return;
    this.asked[name] = wanted;
    try {
      const found = await arrays(`${this.path}/${path}`);
      if (this.asked[name] !== wanted) return;
      this.data[name] = found;
    } catch (problem) {
      if (this.asked[name] !== wanted) return;
      this.asked[name] = null;
      this.data[name] = null;
      if (problem.status !== 404) complain(problem.message);
    }
    this.tell(name);
  }

  /** Send an edit or a move in the history; those asked for meanwhile wait for its answer. */
  change(path, content, said) {
    this.last = this.last.then(async () => {
      const before = this.state;
      if (said) this.pending = { said, chi2: before.chi2, revision: before.revision, stage: null };
      try {
        const state = await post(`${this.path}/${path}`, { revision: before.revision, ...content });
        complain(null);
        this.take(state);
      } catch (problem) {
        this.pending = null;
        if (problem.status !== 409 || !problem.answer?.state) return complain(problem.message);
        this.take(problem.answer.state, true);
        complain("Changed meanwhile in another window, so nothing was done here. This page now shows the newest state");
      }
    });
    return this.last;
  }

  edit(edit) {
    return this.change("edit", { edit: { reason: "", ...edit } }, (state) => state.edits[state.cursor - 1]?.text ?? "Done");
  }

  moveTo(cursor) {
    const { edits, cursor: now } = this.state;
    if (cursor < 0 || cursor > edits.length || cursor === now) return this.last;
    const text = cursor < now ? `Undone: ${edits[cursor].text}` : `Redone: ${edits[cursor - 1].text}`;
    return this.change("cursor", { cursor }, () => text);
  }

  undo() { return this.last.then(() => this.moveTo(this.state.cursor - 1)); }
  redo() { return this.last.then(() => this.moveTo(this.state.cursor + 1)); }

  giveReason(index, reason) { return this.change("reason", { index, reason }); }

  /** Set a listed mode aside, or keep one that is not listed. */
  toggle(mode) {
    if (!mode) return;
    this.edit({ kind: mode.listed ? "set_aside" : "keep", pole: mode.pole });
  }

  /** Decide on a channel: against its force, where there are several. */
  onChannel(kind, { channel, run, force }, more = {}) {
    const reference = this.forces.length ? { reference: force } : {};
    return this.edit({ kind, channel, run, ...reference, ...more });
  }

  /** Decide on a channel in all runs, against all forces. */
  everywhere(kind, { channel }) { return this.edit({ kind, channel }); }
}
