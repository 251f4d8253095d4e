"""What a refit costs against processing the recordings: CPU of whole processes, as ratios.

`python benchmarks/refit.py` simulates a paper-size campaign (six runs of 14 channels, 250 s, 58b
single precision), processes it once, and times refits of the result and a replay from recordings.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path

from speed import STRETCH_S, Cost, compare

TARGET = 0.6  # CPU of a refit over that of `process`
PROGRAM = [sys.executable, "-m", "pipelines.cli.main"]
REFITS = {
    "refit, a mode set aside": ["--set-aside", "121.4"],
    "refit, a channel out": ["--channel-out", "A07@config_3.uff"],
    "refit, a run out": ["--run-out", "config_6.uff"],
    "refit --try": ["--set-aside", "121.4", "--try"],
}


def main() -> None:
    """Print a Markdown table of the medians."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--duration", type=float, default=STRETCH_S, help="seconds of a run")
    options = parser.parse_args()
    # Loads the packages, which the processes that are timed load for themselves.
    from pipelines.simulate.campaign import simulate_campaign

    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        campaign = simulate_campaign(folder / "campaign", duration_s=options.duration)
        costs, bytes_of = timed(campaign, folder, options.repeat)
    whole = costs["process"]
    print(f"\nSix runs of 14 channels, {options.duration:g} s; medians of {options.repeat}\n")
    print("| process | CPU, s | CPU over process | peak, MB |\n|---|---:|---:|---:|")
    for name, cost in costs.items():
        print(
            f"| {name} | {cost.cpu_s:.2f} | {cost.cpu_s / whole.cpu_s:.2f} | {cost.peak_mb:.0f} |"
        )
    total = sum(bytes_of.values())
    print(f"\nResult folder {total / 1e6:.1f} MB, of which for refits only: ", end="")
    print(f"force.parquet {bytes_of['force.parquet'] / 1e6:.1f} MB")
    slow = [name for name in REFITS if costs[name].cpu_s > TARGET * whole.cpu_s]
    print(json.dumps({"target": TARGET, "missed": slow}))


def timed(campaign: Path, folder: Path, repeat: int) -> tuple[dict[str, Cost], dict[str, int]]:
    """CPU and memory of each process, and the size of each file of the result."""
    result, out = folder / "result", ["--no-report", "--force", "--quiet", "--out"]
    process = [*PROGRAM, "process", str(campaign), *out, str(result)]
    first = compare({"process": process}, 1)
    del first  # fills the caches of the system
    sizes = {path.name: path.stat().st_size for path in result.iterdir()}
    commands = {"process": [*process[:-1], str(folder / "again")]}
    for name, words in REFITS.items():
        ending = "-".join(words).strip("-")
        commands[name] = [*PROGRAM, "refit", str(result), *words, *out, str(folder / ending)]
    edits = folder / "edits.toml"
    edits.write_text('[[edit]]\nkind = "set_aside"\npole = { frequency_hz = 121.4 }\n')
    commands["process --edits"] = [*commands["process"][:-1], str(folder / "replay")]
    commands["process --edits"] += ["--edits", str(edits)]
    return compare(commands, repeat), sizes


if __name__ == "__main__":
    main()
