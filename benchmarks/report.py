"""The report against an empty page of its size: building it, and opening it in a browser.

`python benchmarks/report.py` prints a Markdown table. The sample campaign is processed once; each
build is a process of its own, as a user meets it, timed from the result to the written page.
"""

from __future__ import annotations

import argparse
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

from browser import Browser, chromium  # noqa: E402

from pipelines.process.run import process  # noqa: E402
from pipelines.report.write import save  # noqa: E402
from pipelines.simulate.campaign import sample_campaign  # noqa: E402

BUILD = """
import sys, time
from pathlib import Path
from pipelines.results.store import load
result, page, n_bytes = load(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3])
start = time.perf_counter()
if n_bytes:
    from pipelines.report.write import render_page
    from pipelines.report.page import Section
    empty = render_page("Floor", "Empty page", (Section("empty", "Empty", ()),))
    page.write_text(f"{empty}<!--{'x' * (n_bytes - len(empty))}-->", encoding="utf-8")
else:
    from pipelines.report.write import write_report
    write_report(result, page)
print(time.perf_counter() - start)
"""
# Notes when the page says that it can be used; pages without charts can be when they are loaded.
WATCH = """
window.usableAfter = null;
const usable = () => { window.usableAfter ??= performance.now(); };
new MutationObserver(() => {
  if (document.documentElement?.dataset.ready) usable();
}).observe(document, {subtree: true, attributes: true, attributeFilter: ['data-ready']});
addEventListener('load', () => { if (!document.querySelector('.plot')) usable(); });
"""


def build(result: Path, page: Path, n_bytes: int = 0) -> float:
    """Seconds to write the report, or an empty page of `n_bytes`."""
    command = [sys.executable, "-c", BUILD, str(result), str(page), str(n_bytes)]
    return float(subprocess.run(command, check=True, capture_output=True, cwd=ROOT).stdout)


def usable(browser: Browser, page: Path) -> float:
    """Seconds from the start of the navigation until the page can be used."""
    browser.driver.get("about:blank")
    browser.driver.get(page.as_uri())
    return float(browser.wait("return window.usableAfter")) / 1e3


def medians(repeat: int, *stages: Callable[[], float]) -> list[float]:
    """Median of each stage; they take turns, so that all meet the same weather."""
    for stage in stages:  # the first one warms up
        stage()
    rounds = [[stage() for stage in stages] for _ in range(repeat)]
    return [statistics.median(times) for times in zip(*rounds, strict=True)]


def row(what: str, own: float, floor: float) -> None:
    print(f"| {what} | {own:.2f} | {floor:.2f} | {own / floor:.1f} |")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeat", type=int, default=5)
    repeat = parser.parse_args().repeat

    with tempfile.TemporaryDirectory() as folder:
        result = Path(folder) / "result"
        save(process(sample_campaign(Path(folder) / "campaign")), result)
        own, floor = Path(folder) / "report.html", Path(folder) / "floor.html"
        build(result, own)
        n_bytes = own.stat().st_size
        built = medians(repeat, lambda: build(result, own), lambda: build(result, floor, n_bytes))
        with chromium() as browser:
            browser.cdp("Page.addScriptToEvaluateOnNewDocument", source=WATCH)
            opened = medians(repeat, lambda: usable(browser, own), lambda: usable(browser, floor))
    print(f"The report has {n_bytes / 1e6:.2f} MB; medians of {repeat}.\n")
    print("| | report, s | empty page of its size, s | ratio |\n|---|---:|---:|---:|")
    row("build, import included", *built)
    row("open until usable", *opened)


if __name__ == "__main__":
    main()
