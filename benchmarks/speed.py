"""Whole processes against a floor and against other packages; growth with size.

`python benchmarks/speed.py` prints Markdown tables: paper-size campaign (six runs of 14 channels,
250 s, 58b double), then growth with duration, channels and model order.
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from speed_floor import transform

import ema
from ema.io.formats import read_file
from ema.io.uff.write import write_time_series
from pipelines.simulate.campaign import simulate_campaign

HERE = Path(__file__).resolve().parent
BLOCK, STEP = 8000, 4000  # what ringmodal takes for these recordings: 4 s, half overlapping
RATE_HZ = 2000.0
STRETCH_S = 250.0


@dataclass(frozen=True)
class Cost:
    """What one process took."""

    wall_s: float
    cpu_s: float
    peak_mb: float


# The peak memory of a process includes that of the one it was forked from: this one is small.
LAUNCHER = """
import json, os, subprocess, sys, time
start = time.perf_counter()
process = subprocess.Popen(sys.argv[1:], stdout=subprocess.DEVNULL)
_, status, usage = os.wait4(process.pid, 0)
wall_s = time.perf_counter() - start
print(json.dumps([wall_s, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024]))
sys.exit(os.waitstatus_to_exitcode(status) != 0)
"""


def run(command: list[str]) -> Cost:
    """Time a process; it has to succeed."""
    launched = [sys.executable, "-S", "-E", "-c", LAUNCHER, *command]
    done = subprocess.run(launched, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"{command}: {done.stderr}")
    return Cost(*json.loads(done.stdout))


def median(costs: list[Cost]) -> Cost:
    """Median of each figure."""
    return Cost(
        *(
            statistics.median(getattr(cost, name) for cost in costs)
            for name in ("wall_s", "cpu_s", "peak_mb")
        )
    )


def compare(commands: dict[str, list[str]], repeat: int) -> dict[str, Cost]:
    """Run commands in turn, `repeat` times, so that all meet the same weather."""
    costs: dict[str, list[Cost]] = {name: [] for name in commands}
    for _ in range(repeat):
        for name, command in commands.items():
            costs[name].append(run(command))
    return {name: median(each) for name, each in costs.items()}


def write_campaign(folder: Path, single: Path, duration_s: float) -> Path:
    """The simulated campaign in double precision, repeated to the length wanted."""
    folder.mkdir()
    for name in ("campaign.toml", "truth.toml"):
        (folder / name).write_bytes((single / name).read_bytes())
    n_samples = round(duration_s * RATE_HZ)
    for path in sorted(single.glob("*.uff")):
        recording = read_file(path).recording
        assert recording is not None
        channels = [
            replace(each, samples=np.resize(np.asarray(each.samples, np.float64), n_samples))
            for each in recording.channels
        ]
        write_time_series(folder / path.name, channels, RATE_HZ, precision="double")
    return folder


@contextmanager
def campaigns() -> Iterator[Callable[[float], Path]]:
    """Campaigns of any duration, in a temporary folder."""
    with tempfile.TemporaryDirectory() as place:
        single = simulate_campaign(Path(place) / "single", duration_s=STRETCH_S)
        yield lambda duration_s: write_campaign(
            Path(place) / f"{duration_s:g}s", single, duration_s
        )


def ours(campaign: Path, order: int = 80) -> list[str]:
    """The command that processes a campaign without a report."""
    out = campaign.with_name(f"{campaign.name}_result")
    options = ["--no-report", "--force", "--quiet", "--max-order", str(order)]
    program = [sys.executable, "-m", "pipelines.cli.main", "process"]
    return [*program, str(campaign), "--out", str(out), *options]


def script(name: str, *words: str) -> list[str]:
    """A process of ours beside this file."""
    return [sys.executable, str(HERE / name), *words]


def paper_size(campaign: Path, repeat: int, *, peers: bool) -> None:
    blocks = (str(BLOCK), str(STEP))
    commands = {
        "floor: read and transform": script("speed_floor.py", str(campaign), *blocks),
        "ringmodal, LSCE to order 80": ours(campaign),
    }
    if peers:
        for method, order in (("lscf", 60), ("lsce", 30)):
            name = f"pyuff + pyFRF + sdypy-EMA, {method.upper()} to order {order}"
            commands[name] = script("speed_peer.py", str(campaign), method, *blocks)
    costs = compare(commands, repeat)
    own = costs["ringmodal, LSCE to order 80"]
    print(f"\nSix runs of 14 channels, 250 s, 58b double (336 MB); medians of {repeat}\n")
    print("| process | wall, s | CPU, s | peak, MB | wall over ours |\n|---|---:|---:|---:|---:|")
    for name, cost in costs.items():
        ratio = cost.wall_s / own.wall_s
        print(
            f"| {name} | {cost.wall_s:.2f} | {cost.cpu_s:.2f} | {cost.peak_mb:.0f} | {ratio:.2f} |"
        )
    floor = costs["floor: read and transform"]
    print(f"\nringmodal takes {own.wall_s / floor.wall_s:.2f} times the floor.")


def frf_stage(campaign: Path, repeat: int) -> None:
    """The FRF stage in one process against the same reading and FFTs there."""
    read = ema.read_campaign(campaign)
    times: dict[str, list[float]] = {"floor": [], "ringmodal": []}
    for _ in range(repeat + 1):  # the first one warms up
        start = time.perf_counter()
        transform(campaign, BLOCK, STEP)
        middle = time.perf_counter()
        ema.estimate_frf(read)
        times["floor"].append(middle - start)
        times["ringmodal"].append(time.perf_counter() - middle)
    floor, own = (statistics.median(each[1:]) for each in times.values())
    took = f"{own:.2f} s, {own / floor:.2f} times its floor {floor:.2f} s"
    print(f"\nFRF stage in one process: {took}")


def growth_with_duration(make: Callable[[float], Path], known: dict[float, Path]) -> None:
    print("\n| duration of each run, s | wall, s | CPU, s | peak, MB |\n|---:|---:|---:|---:|")
    for duration_s in (25.0, 250.0, 2500.0):
        campaign = known.get(duration_s) or make(duration_s)
        cost = run(ours(campaign, 60))
        print(f"| {duration_s:g} | {cost.wall_s:.2f} | {cost.cpu_s:.2f} | {cost.peak_mb:.0f} |")


def growth_with_order(campaign: Path) -> None:
    print("\n| model order | wall, s | CPU, s |\n|---:|---:|---:|")
    for order in (20, 40, 80, 160):
        cost = run(ours(campaign, order))
        print(f"| {order} | {cost.wall_s:.2f} | {cost.cpu_s:.2f} |")


def growth_with_channels(campaign: Path) -> None:
    """FRFs of one run whose channels stand in it several times."""
    (first, *_) = ema.read_campaign(campaign).runs
    print("\n| channels of a run | FRFs, s | s per channel |\n|---:|---:|---:|")
    for times in (1, 4, 16):
        run_of_many = replace(first, responses=first.responses * times)
        many = replace(ema.read_campaign(campaign), runs=(run_of_many,))
        start = time.perf_counter()
        ema.estimate_frf(many)
        took = time.perf_counter() - start
        n_channels = len(run_of_many.channels)
        print(f"| {n_channels} | {took:.2f} | {took / n_channels:.4f} |")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--no-peers", action="store_true")
    parser.add_argument("--no-growth", action="store_true")
    options = parser.parse_args()
    with campaigns() as make:
        paper = make(STRETCH_S)
        paper_size(paper, options.repeat, peers=not options.no_peers)
        frf_stage(paper, options.repeat)
        if not options.no_growth:
            growth_with_duration(make, {STRETCH_S: paper})
            growth_with_order(paper)
            growth_with_channels(paper)


if __name__ == "__main__":
    main()
