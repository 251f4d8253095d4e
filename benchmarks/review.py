"""What the page of `ringmodal review` costs, in a real browser and over HTTP.

    git worktree add /tmp/old 7c94cb8
    python benchmarks/review.py --old /tmp/old

Prints ratios within one run: an edit until it is painted over the fit of all modes of an older
version, start to a usable page over import and load, memory over 500 edits over that of `process`,
the import of the server, and the size of the scripts. Needs what the tests in a browser need.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "tests"))

from browser import Browser, chromium  # noqa: E402 - from the tests
from reviewing import served, token_in, until  # noqa: E402
from speed import run  # noqa: E402

from pipelines.process.run import process  # noqa: E402
from pipelines.report.write import save  # noqa: E402
from pipelines.results.store import load  # noqa: E402
from pipelines.simulate.campaign import simulate_campaign  # noqa: E402

SECONDS = {"sample": 20.0, "paper size": 250.0}  # of each of six runs
TARGETS = {"edit": 0.4, "start": 1.3, "memory": 1.5, "import": 0.15, "scripts, kB": 150.0}
READY = "return document.documentElement?.dataset.ready !== undefined"
FINAL = "return window.ringmodalBench?.state?.stage === 'final'"
# From the key to the frame that has the new numbers and the new fit.
PAINTED = """
const done = arguments[0], bench = window.ringmodalBench, before = bench.state.revision;
window.paintedAfter ??= (bench.watch(["fit"], () => window.paintedFit?.()), true);
const start = performance.now();
window.paintedFit = () => {
  const { revision, stage } = bench.state;
  if (revision === before || !["preview", "final"].includes(stage)) return;
  window.paintedFit = null;
  requestAnimationFrame(() => setTimeout(() => done(performance.now() - start)));
};
document.body.dispatchEvent(new KeyboardEvent("keydown", { key: "Enter", bubbles: true }));
"""
# Waits for a line, fits, and prints the seconds that took.
OLD_FIT = """
import json, sys, time
import ema
frf = ema.estimate_frf(ema.read_campaign(sys.argv[1]))
found = ema.identify_modes(frf, tuple(json.loads(sys.argv[2])))
poles = ema.select_poles(found.diagram)
print("ready", flush=True)
for _ in sys.stdin:
    start = time.perf_counter()
    ema.fit_modes(found.frf, poles)
    print(time.perf_counter() - start, flush=True)
"""
LOAD = "import sys; from pipelines.results.store import load; load(sys.argv[1])"
IMPORTS = """
import time
import ringmodal
start = time.process_time()
for name in ringmodal.__all__:
    getattr(ringmodal, name)
middle = time.process_time()
import pipelines.review.server
print((time.process_time() - middle) / (middle - start))
"""


@contextmanager
def old_fits(old: Path, campaign: Path, band_hz: tuple[float, float]) -> Iterator[Any]:
    """Yield a function that fits all modes with an older version and returns the seconds."""
    command = [sys.executable, "-c", OLD_FIT, str(campaign), json.dumps(band_hz)]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, env={**os.environ, "PYTHONPATH": str(old)}, **pipes) as child:
        assert child.stdin is not None
        assert child.stdout is not None
        child.stdout.readline()

        def fit() -> float:
            child.stdin.write("\n")
            child.stdin.flush()
            return float(child.stdout.readline())

        try:
            yield fit
        finally:
            child.stdin.close()


def edits(browser: Browser, result: Path, fit: Any, repeat: int) -> None:
    """Modes set aside one after the other, each beside a fit of the older version."""
    ratios, seconds = [], []
    with served(result) as (_, _, file):
        browser.driver.get(file.as_uri())
        for number in range(repeat):
            browser.wait(FINAL)
            browser.js(
                "ringmodalBench.look({mode: ringmodalBench.modes.filter(m => m.listed)"
                "[arguments[0]].key})",
                number % 5,
            )
            old = fit()
            painted = browser.js_later(PAINTED) / 1000
            seconds.append((painted, old))
            ratios.append(painted / old)
            browser.wait(FINAL)
            browser.find("#undo").click()
            browser.wait("return ringmodalBench.state.cursor === 0")
        scripts = browser.js(
            "return performance.getEntriesByType('resource').filter(each => "
            "each.name.endsWith('.js')).reduce((sum, each) => sum + each.decodedBodySize, 0)"
        )
        browser.driver.get("about:blank")
    shown = [min(each) for each in zip(*seconds, strict=True)]
    row("edit to paint, median", statistics.median(ratios), TARGETS["edit"])
    row("edit to paint, fastest of each", shown[0] / shown[1], TARGETS["edit"])
    print(f"| (fastest: {shown[0]:.3f} s painted, {shown[1]:.3f} s for the old fit) | | |")
    row("scripts of the page, kB", scripts / 1000, TARGETS["scripts, kB"])


def starts(browser: Browser, result: Path, repeat: int) -> None:
    """From the command to the page that can be used, over a process that imports and loads.

    Wall time, for which the machine has to be idle; CPU of the server includes the first fit,
    which has begun by then.
    """
    loads, pages = [], []
    for _ in range(repeat):
        loads.append(run([sys.executable, "-c", LOAD, str(result)]))
        start = time.perf_counter()
        with served(result) as (server, _, file):
            browser.driver.get(file.as_uri())
            browser.wait(READY)
            pages.append((time.perf_counter() - start, cpu_s(server.pid)))
            browser.driver.get("about:blank")
    wall_s, used_s = (min(each) for each in zip(*pages, strict=True))
    row("start to usable page, wall", wall_s / min(each.wall_s for each in loads), TARGETS["start"])
    ratio = used_s / min(each.cpu_s for each in loads)
    print(f"| (CPU of the server over that of loading: {ratio:.3g}) | | |")


def cpu_s(process: int) -> float:
    """CPU that a process has used until now."""
    fields = Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


class Client:
    """Asks a server as its page does."""

    def __init__(self, address: str, file: Path) -> None:
        self.origin, self.place = address.split("/r/")
        self.token = token_in(file)

    def ask(self, what: str, **content: Any) -> Any:
        """Answer to a request, a POST where there is content: JSON, or bytes of arrays."""
        headers = {"X-Ringmodal-Token": self.token, "Content-Type": "application/json"}
        headers["Origin"] = self.origin
        data = json.dumps(content).encode() if content else None
        url = f"{self.origin}/api/r/{self.place}/{what}"
        with urllib.request.urlopen(urllib.request.Request(url, data, headers)) as answer:
            body = answer.read()
        return json.loads(body) if body[:1] == b"{" else body

    def settled(self, *stages: str) -> Any:
        """The state once it is of one of the stages."""
        return until(lambda: self.ask("state"), lambda state: state["stage"] in stages)


def memory(campaign: Path, result: Path, n_edits: int) -> None:
    """Peak memory of a server over many edits of all kinds, over that of `process`."""
    out = ["--no-report", "--force", "--quiet", "--out", str(result.with_name("again"))]
    words = ["-m", "pipelines.cli.main", "process", str(campaign), *out]
    whole = run([sys.executable, *words]).peak_mb
    with served(result) as (server, address, file):
        client = Client(address, file)
        client.settled("final")
        at = {}
        for number in range(n_edits):
            edit(client, number)
            if number + 1 in (n_edits // 10, n_edits):
                at[number + 1] = peak_mb(server.pid)
    first, last = at.values()
    row(f"memory after {n_edits // 10} edits over process", first / whole, TARGETS["memory"])
    row(f"memory after {n_edits} edits over process", last / whole, TARGETS["memory"])
    print(f"| (process {whole:.0f} MB, server {first:.0f} and {last:.0f} MB at most) | | |")


def edit(client: Client, number: int) -> None:
    """One edit, of another kind each time; every curve is asked for, as by the page."""
    state = client.settled("preview", "final", "failed")
    modes = [mode for mode in state["modes"] if mode["listed"]]
    pole = modes[number % len(modes)]["pole"]
    row_of = state["channels"][number % len(state["channels"])]
    channel = {"channel": row_of["channel"], "run": row_of["run"]}
    made = [
        {"kind": "set_aside", "pole": pole},
        None,  # undone
        {"kind": "flip", **channel},
        {"kind": "flip", **channel},
        {"kind": "channel_out" if row_of["used"] else "channel_in", **channel},
        {"kind": "lock", "pole": pole},
    ][number % 6]
    if made is None:
        client.ask("cursor", revision=state["revision"], cursor=state["cursor"] - 1)
    else:
        client.ask("edit", revision=state["revision"], edit=made)
    client.settled("preview", "final", "failed")
    for what in ("fit?row=0", "frf?row=0", "diagram", "shapes", "orders"):
        client.ask(what)


def peak_mb(process: int) -> float:
    """Highest resident memory of a process until now."""
    lines = Path(f"/proc/{process}/status").read_text().splitlines()
    (text,) = [line for line in lines if line.startswith("VmHWM")]
    return float(text.split()[1]) / 1024


def imports(repeat: int) -> None:
    """The server's own modules over everything that `ringmodal` offers."""
    command = [sys.executable, "-c", IMPORTS]
    ratios = [float(subprocess.check_output(command, text=True)) for _ in range(repeat)]
    row("import of the server", min(ratios), TARGETS["import"])


def row(name: str, ratio: float, target: float) -> None:
    verdict = "" if ratio <= target else ", missed"
    print(f"| {name} | {ratio:.3g} | ≤ {target:g}{verdict} |", flush=True)


def main() -> None:
    """Print Markdown tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--old", type=Path, required=True, help="checkout of the older version")
    parser.add_argument("--repeat", type=int, default=9)
    parser.add_argument("--edits", type=int, default=500)
    parser.add_argument("--only", choices=SECONDS)
    options = parser.parse_args()
    imports(options.repeat)
    for name, seconds in SECONDS.items():
        if options.only not in (None, name):
            continue
        print(f"\n| {name}, {seconds:g} s | ratio | target |\n|---|---:|---:|", flush=True)
        with tempfile.TemporaryDirectory() as place, chromium() as browser:
            campaign = simulate_campaign(Path(place) / "tyre", duration_s=seconds)
            result = Path(place) / "result"
            save(process(campaign), result, report=False)
            band_hz = load(result).modal_model.band_hz
            starts(browser, result, options.repeat)
            with old_fits(options.old, campaign, band_hz) as fit:
                edits(browser, result, fit, options.repeat)
            memory(campaign, result, options.edits)


if __name__ == "__main__":
    main()
