"""Batches: 200 campaigns of which 10 are broken, a second run, and two workers against one.

Run with ``python benchmarks/batch.py [--campaigns N] [--jobs N]``; prints Markdown. With
``--memory N``, only the memory of two workers over N small campaigns (Linux).
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from pipelines.simulate.campaign import simulate_campaign

SHARED = 16  # campaigns for two workers against one
LONG_S, SHORT_S = 20.0, 4.0
WARM = 10  # campaigns of two workers until every library has loaded


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--campaigns", type=int, default=200)
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--no-comparison", action="store_true")
    parser.add_argument("--memory", type=int, default=0, metavar="N")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        if arguments.memory:
            source = simulate_campaign(Path(scratch) / "short", duration_s=SHORT_S)
            watch_memory(one_run_of(source), Path(scratch), arguments.memory)
            return
        if not arguments.no_comparison:
            source = simulate_campaign(Path(scratch) / "long", duration_s=LONG_S)
            compare_workers(source, Path(scratch))
        if arguments.campaigns:
            source = simulate_campaign(Path(scratch) / "short", duration_s=SHORT_S)
            many(source, Path(scratch), arguments.campaigns, arguments.jobs)


def compare_workers(source: Path, scratch: Path) -> None:
    """Wall time of one worker over that of two, whole processes with start-up."""
    root = fleet(source, scratch / "shared", SHARED)
    seconds = {}
    print(f"\n{SHARED} campaigns of six runs of {LONG_S:g} s, whole processes:\n")
    print("| workers | wall / s | CPU / s |\n|---:|---:|---:|")
    for workers in (1, 2):
        before_s = cpu_s()
        seconds[workers], content = batch(root, scratch / f"shared_{workers}", workers)
        require(content["done"] == SHARED, "all campaigns done")
        print(f"| {workers} | {seconds[workers]:.1f} | {cpu_s() - before_s:.1f} |", flush=True)
    print(f"\nOne worker over two: {seconds[1] / seconds[2]:.2f} (at least 1.7).")
    if hasattr(os, "getloadavg"):
        print(f"Load of the machine at the end, two of it ours: {os.getloadavg()[0]:.1f}.")


def watch_memory(source: Path, scratch: Path, count: int) -> None:
    """Resident memory of each of two workers over many small campaigns.

    The start is where every library has loaded and every cache has filled for the first time.
    """
    root, out = fleet(source, scratch / "small", count), scratch / "small_out"
    command = [sys.executable, "-m", "pipelines.cli.main", "batch", str(root), "--out", str(out)]
    started = subprocess.Popen(
        [*command, "--jobs", "2", "--max-order", "20", "--quiet"],
        env={**os.environ, "OMP_NUM_THREADS": "1"},
    )
    series: dict[int, list[tuple[int, float]]] = {}
    while started.poll() is None:
        n_done = sum(1 for _ in (out / "records").rglob("record.json"))
        for worker in workers_of(started.pid):
            series.setdefault(worker, []).append((n_done, resident_mb(worker)))
        time.sleep(1.0)
    require(started.returncode == 0, "the batch ends well")
    print(f"\nResident memory of two workers over {count} small campaigns, MB:\n")
    print("| campaigns done |", " | ".join(f"worker {k + 1}" for k in range(len(series))), "|")
    print("|---:|" + "---:|" * len(series))
    for share in range(21):
        done = max(WARM, count * share // 20)
        cells = (f"{at(samples, done):.1f}" for samples in series.values())
        print(f"| {done} |", " | ".join(cells), "|")
    for number, samples in enumerate(series.values(), 1):
        start = at(samples, WARM)
        most = max(mb for n_done, mb in samples if n_done >= WARM)
        print(f"\nWorker {number}: at most {most / start:.3f} of its {start:.1f} MB at the start.")


def one_run_of(source: Path) -> Path:
    """The campaign with its first run only."""
    manifest = source / "campaign.toml"
    head, first, *_ = manifest.read_text().split("[[runs]]")
    manifest.write_text(f"{head}[[runs]]{first}")
    for recording in source.glob("config_*.uff"):
        if recording.name != "config_1.uff":
            recording.unlink()
    return source


def workers_of(process: int) -> list[int]:
    """Children of a process that serve its batch."""
    lists = Path(f"/proc/{process}/task").glob("*/children")  # of each of its threads
    children = sorted(child for path in lists for child in path.read_text().split())
    return [int(each) for each in children if "spawn_main" in command_line(each)]


def command_line(process: str) -> str:
    try:
        return Path(f"/proc/{process}/cmdline").read_text()
    except OSError:  # it has ended
        return ""


def resident_mb(process: int) -> float:
    try:
        pages = int(Path(f"/proc/{process}/statm").read_text().split()[1])
    except OSError:  # it has ended
        return 0.0
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def at(samples: list[tuple[int, float]], done: int) -> float:
    """Memory when so many campaigns were done."""
    return next((mb for n_done, mb in samples if n_done >= done), samples[-1][1])


def cpu_s() -> float:
    """CPU time of all processes that were waited for, with their children."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def many(source: Path, scratch: Path, count: int, jobs: int) -> None:
    """Results and rows of many campaigns, ten of them broken; then the same once more."""
    root = fleet(source, scratch / "many", count)
    broken = break_some(root)
    first_s, first = batch(root, scratch / "out", jobs)
    second_s, second = batch(root, scratch / "out", jobs)
    failed = {row["campaign"]: row for row in first["campaigns"] if row["status"] == "failed"}
    for name in set(failed) ^ broken:
        message = failed[name]["message"] if name in failed else "it did not fail"
        require(False, f"the broken campaigns fail, and no other; {name}: {message}")
    require(second["done"] + second["failed"] == 0, "nothing done by the second run")
    print(f"\n{count} campaigns, {len(broken)} of them broken, {jobs} workers:\n")
    print("| run | done | failed | already done | failed before | wall / s |")
    print("|---|---:|---:|---:|---:|---:|")
    for name, content, seconds in (("first", first, first_s), ("second", second, second_s)):
        keys = ("done", "failed", "already_done", "failed_before")
        counts = " | ".join(str(content[key]) for key in keys)
        print(f"| {name} | {counts} | {seconds:.1f} |")
    print("\n| broken campaign | message |\n|---|---|")
    for name, row in failed.items():
        print(f"| {name} | {row['message']} |")


def batch(root: Path, out: Path, jobs: int) -> tuple[float, dict[str, Any]]:
    """Wall time and rows of a batch in a process of its own, one thread a worker."""
    command = [sys.executable, "-m", "pipelines.cli.main", "batch", str(root), "--out", str(out)]
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    start = time.perf_counter()
    finished = subprocess.run(
        [*command, "--jobs", str(jobs), "--json", "--quiet"],
        check=True,
        capture_output=True,
        text=True,
        env=environment,
    )
    return time.perf_counter() - start, json.loads(finished.stdout)


def fleet(source: Path, root: Path, count: int) -> Path:
    """The same campaign many times; recordings are linked where the system can."""
    for number in range(count):
        folder = root / f"batch_{number // 50}" / f"tyre_{number:03}"
        shutil.copytree(source, folder, copy_function=link_or_copy)
        manifest = folder / "campaign.toml"
        text = manifest.read_text()
        manifest.unlink()  # a link would change all others
        manifest.write_text(text)
    return root


def link_or_copy(source: str, target: str) -> None:
    try:
        os.link(source, target)
    except OSError:
        shutil.copy(source, target)


def break_some(root: Path) -> set[str]:
    """Break a campaign in each of these ways; returns their names."""
    breaks = (
        lambda folder: (folder / "campaign.toml").unlink(),
        lambda folder: edit(folder, "schema = 1", "schema = "),
        lambda folder: edit(folder, "positions = 72", "positions = 72\nspacing = 5"),
        lambda folder: edit(folder, "inflation_pressure_pa = 220000.0\n", ""),
        lambda folder: edit(folder, 'channel = "force"', 'channel = "Force1"'),
        lambda folder: edit(folder, "rate_hz = 2000.0", "rate_hz = 2048.0"),
        lambda folder: (folder / "config_3.uff").unlink(),
        lambda folder: rewrite(folder / "config_3.uff", lambda content: content[:200_000]),
        lambda folder: rewrite(folder / "config_3.uff", lambda content: b""),
        lambda folder: edit(folder, "[grid]", "[processing]\nblock_seconds = 60.0\n\n[grid]"),
    )
    folders = sorted(path.parent for path in root.rglob("campaign.toml"))
    chosen = folders[:: max(1, len(folders) // len(breaks))][: len(breaks)]
    for folder, damage in zip(chosen, breaks, strict=True):
        damage(folder)
    return {folder.relative_to(root).as_posix() for folder in chosen}


def edit(folder: Path, old: str, new: str) -> None:
    manifest = folder / "campaign.toml"
    text = manifest.read_text()
    require(old in text, f"{old!r} in the manifest")
    manifest.write_text(text.replace(old, new))


def rewrite(path: Path, change: Any) -> None:
    content = path.read_bytes()
    path.unlink()  # a link would change all others
    path.write_bytes(change(content))


def require(holds: bool, what: str) -> None:
    if not holds:
        raise SystemExit(f"Not as it should be: {what}.")


if __name__ == "__main__":
    main()
