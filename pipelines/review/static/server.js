// Talks to the server: JSON, arrays and the stream of events, each with the token of this tab.
import { complain, inWords } from "./dom.js";

const TOKEN = "ringmodal-token";
const AGAIN_MS = 1000;
const NO_TOKEN =
  "This tab has no access. Open the page through the file that “ringmodal review” names when it starts";
const ENDED =
  "The server does not answer. Nothing is lost: start “ringmodal review” again and open the file that it names";

/** What the server refused, with its status and its answer. */
export class Refused extends Error {
  constructor(status, answer) {
    super(answer?.error ? inWords(answer.error) : `The server answered with status ${status}`);
    this.status = status;
    this.answer = answer;
  }
}

/** Keep the token that the opening file handed over, and take it out of the address. */
function takeToken() {
  const given = new URLSearchParams(location.hash.slice(1)).get("token");
  if (!given) return;
  sessionStorage.setItem(TOKEN, given);
  history.replaceState(null, "", location.pathname + location.search);
}

takeToken();

async function ask(path, options = {}) {
  const token = sessionStorage.getItem(TOKEN);
  if (!token) throw new Refused(401, { error: { where: NO_TOKEN } });
  const headers = { "X-Ringmodal-Token": token, ...options.headers };
  let answer;
  try {
    answer = await fetch(`/api/${path}`, { ...options, headers, cache: "no-store" });
  } catch {
    throw new Refused(0, { error: { where: ENDED } });
  }
  if (answer.ok) return answer;
  if (answer.status === 401) throw new Refused(401, { error: { where: NO_TOKEN } });
  throw new Refused(answer.status, await answer.json().catch(() => null));
}

export const get = async (path) => (await ask(path)).json();

export async function post(path, content) {
  const headers = { "Content-Type": "application/json" };
  return (await ask(path, { method: "POST", headers, body: JSON.stringify(content) })).json();
}

/** Arrays of 32-bit numbers behind a JSON header. */
export async function arrays(path) {
  const bytes = await (await ask(path)).arrayBuffer();
  const length = new DataView(bytes).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(bytes, 4, length)));
  const found = { ...header };
  let at = 4 + length;
  for (const { name, shape } of header.arrays) {
    const size = shape.reduce((product, n) => product * n, 1);
    found[name] = new Float32Array(bytes, at, size);
    at += 4 * size;
  }
  return found;
}

/** Hear every event of a page for as long as it is open; `again` is called after each new start. */
export async function listen(page, hear, again) {
  for (let lost = false; ; lost = true) {
    try {
      const stream = await ask(`events?page=${encodeURIComponent(page)}`);
      if (lost) {
        complain(null);
        await again();
      }
      for await (const event of lines(stream.body)) hear(event);
    } catch (problem) {
      complain(problem.message);
      if (problem.status === 401) return;
    }
    await new Promise((done) => setTimeout(done, AGAIN_MS));
  }
}

async function* lines(body) {
  const reader = body.pipeThrough(new TextDecoderStream()).getReader();
  let rest = "";
  for (;;) {
    let part;
    try {
      part = await reader.read();
    } catch {
      return; // the server has gone; the caller asks again
    }
    if (part.done) return;
    const pieces = (rest + part.value).split("\n");
    rest = pieces.pop();
    for (const piece of pieces) if (piece.trim()) yield JSON.parse(piece);
  }
}
