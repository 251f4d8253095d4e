"""What a refit costs, and how far a preview is from the end: within one process, and as processes.

    python benchmarks/refits.py --seconds 20 --before ../ringmodal_0.1.0
    python benchmarks/refits.py --processes
    python benchmarks/refits.py --splits 20

The first prints one row of a Markdown table for each campaign and edit: CPU time of both stages
over that of `fit_modes`, of this version or of another one whose sources lie in `--before`, and the
largest difference of the preview in standard deviations; then what is true of all. The second times
whole processes on six runs of 14 channels. The third sets every mode aside alone, and pins the
whole list, in that many campaigns of each split.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from speed import STRETCH_S, Cost, compare

import ema
from ema import ChannelName, Edit, EditKind, PoleName, edit_cost, refit_modes
from ema.core.errors import FitError
from ema.core.frf import FRF
from ema.core.modes import Chosen, Mode
from ema.identify import Identification
from pipelines.simulate.campaign import simulate_campaign

BAND_HZ = (20.0, 260.0)
#: Options of `simulate_campaign`.
CAMPAIGNS: dict[str, dict[str, Any]] = {
    "plain": {},
    "noise 10 dB": {"snr_db": 10.0},
    "split 0.7 %": {"split_percent": 0.7},
    "split 1.5 %": {"split_percent": 1.5},
    "split 1 %, drift 0.3 %": {"split_percent": 1.0, "drift_percent": 0.3},
}
_REPEAT = 3  # the quickest counts: other processes only make a call slower
Answer = TypeVar("Answer")


def timed(call: Callable[[], Answer]) -> tuple[float, Answer]:
    """Least CPU seconds of a call, and its answer."""
    taken = list[float]()
    for _ in range(_REPEAT):
        start = time.process_time()
        answer = call()
        taken.append(time.process_time() - start)
    return min(taken), answer


# Runs in a process of its own, on the sources of another version.
_FIT_ALONE = f"""
import sys, time, ema
band_hz = {BAND_HZ}
frf = ema.estimate_frf(ema.read_campaign(sys.argv[1]))
poles = ema.select_poles(ema.build_stability(frf, band_hz))
taken = []
for _ in range({_REPEAT + 1}):
    start = time.process_time()
    ema.fit_modes(frf, poles)
    taken.append(time.process_time() - start)
print(min(taken[1:]))
"""


def fit_alone(campaign: Path, sources: Path) -> float:
    """CPU seconds of `fit_modes` of another version."""
    environment = {**os.environ, "PYTHONPATH": str(sources)}
    command = [sys.executable, "-c", _FIT_ALONE, str(campaign)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    return float(done.stdout)


def edits_of(found: Identification) -> Iterator[tuple[str, Edit]]:
    """An edit of each kind that can be made."""
    modes, frf = found.model.modes, found.measured
    named = [PoleName(mode.frequency_hz, mode.damping_ratio) for mode in modes]
    channel = ChannelName(frf.channel[5], frf.run[5])
    yield "set aside", Edit(EditKind.SET_ASIDE, named[1])
    yield "no partners", Edit(EditKind.NO_PARTNERS)
    for mode, name in zip(modes, named, strict=True):
        if mode.order and not mode.member:
            yield "lock", Edit(EditKind.LOCK, name)
            moved = PoleName(1.002 * mode.frequency_hz, mode.damping_ratio)
            yield "start", Edit(EditKind.START, moved)
            yield from _picks(found, mode)
            break
    yield "channel out", Edit(EditKind.CHANNEL_OUT, channel=channel)
    yield "run out", Edit(EditKind.RUN_OUT, run=frf.run_names[2])


def _picks(found: Identification, mode: Mode) -> Iterator[tuple[str, Edit]]:
    """A pole near a mode, and one far from all."""
    diagram, modes_hz = found.diagram, found.model.frequencies_hz
    hz, highest = diagram.frequency_hz, diagram.model_order == diagram.model_order.max()
    beside = np.min(np.abs(hz[:, None] / modes_hz - 1), axis=1)
    near = (np.abs(hz / mode.frequency_hz - 1) < 0.02) & (beside > 0.003)
    far = highest & (beside > 0.03) & (hz > 1.2 * BAND_HZ[0]) & (hz < 0.95 * BAND_HZ[1])
    for label, chosen in ("pick near", near), ("pick far", far):
        for row in np.flatnonzero(chosen)[:1]:
            place = float(hz[row]), float(diagram.damping_ratio[row])
            name = PoleName(*place, None, int(diagram.model_order[row]))
            yield label, Edit(EditKind.PICK, name)


def away(preview: Identification, final: Identification) -> float:
    """Largest difference of the modes but picked ones, in standard deviations; inf: other rows."""
    shown, there = (
        [mode for mode in found.model.modes if mode.chosen is not Chosen.PICKED]
        for found in (preview, final)
    )
    if [(m.order, m.member) for m in shown] != [(m.order, m.member) for m in there]:
        return float("inf")
    apart = [0.0]
    for a, b in zip(shown, there, strict=True):
        apart.append(abs(a.frequency_hz - b.frequency_hz) / b.frequency_std_hz)
        apart.append(abs(a.damping_ratio - b.damping_ratio) / b.damping_std)
    return float(np.nanmax(apart))  # a locked pole has no standard deviation


def in_process(seconds: float, before: Path | None) -> None:
    """Print the table of edits, and what holds for all of them."""
    print(
        "| campaign | edit | live | rest | both | in one | live, before | both, before | σ | try |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|")
    rows = list[dict[str, float]]()
    with tempfile.TemporaryDirectory() as folder:
        for name, options in CAMPAIGNS.items():
            path = simulate_campaign(
                Path(folder) / name.replace("%", ""), duration_s=seconds, **options
            )
            earlier = float("nan") if before is None else fit_alone(path, before)
            for label, row in _rows(ema.estimate_frf(ema.read_campaign(path)), earlier):
                told = row if isinstance(row, str) else " | ".join(f"{v:.2f}" for v in row.values())
                print(f"| {name} | {label} | {told} |", flush=True)
                if isinstance(row, dict):
                    rows.append(row)
    print()
    for key in rows[0]:
        every = [row[key] for row in rows]
        print(f"{key}: median {np.median(every):.2f}, p95 {np.quantile(every, 0.95):.2f}")


def _rows(frf: FRF, earlier: float) -> Iterator[tuple[str, dict[str, float] | str]]:
    """What each edit costs, or why it cannot be made."""
    found = ema.identify_modes(frf, BAND_HZ)
    poles = ema.select_poles(found.diagram)
    whole, _ = timed(lambda: ema.fit_modes(found.frf, poles))
    for label, edit in edits_of(found):
        try:
            yield label, _row(found, edit, whole, earlier)
        except FitError as error:
            yield label, str(error)


def _row(found: Identification, edit: Edit, whole: float, earlier: float) -> dict[str, float]:
    """One edit: live stage, rest, both and all in one over `fit_modes`; preview against the end."""
    live, preview = timed(lambda: refit_modes(found, [edit], live=True))
    rest, final = timed(lambda: refit_modes(preview, [edit]))
    one, _ = timed(lambda: refit_modes(found, [edit]))
    cost, _ = timed(lambda: edit_cost(found, [edit]))
    both = live + rest
    return {
        **{"live": live / whole, "rest": rest / whole, "both": both / whole},
        **{"in one": one / whole, "live, before": live / earlier, "both, before": both / earlier},
        **{"σ": away(preview, final), "try": cost / whole},
    }


SPLITS_PERCENT = 0.2, 0.5, 1.0, 2.0
SAME_STD = 1e-6  # a pinned list gives the same modes within so many standard deviations


def of_splits(n_seeds: int, seconds: float) -> None:
    """Print how many decisions on modes of split tyres did what they say."""
    print(
        "| split, % | modes | set aside | others stay | partner relabelled | lists pinned "
        "| elsewhere the same | refused | another |\n|---|---|---|---|---|---|---|---|---|"
    )
    for percent in SPLITS_PERCENT:
        counts, elsewhere = np.zeros(6, dtype=int), np.zeros(3, dtype=int)
        before = list[Mode]()
        for seed in range(n_seeds):
            with tempfile.TemporaryDirectory() as folder:
                how = {"duration_s": seconds, "split_percent": percent, "seed": seed}
                path = simulate_campaign(Path(folder) / "campaign", **how)
                found = ema.identify_modes(ema.estimate_frf(ema.read_campaign(path)), BAND_HZ)
            counts += _decided(found)
            elsewhere += _elsewhere(before, found)
            before = list(found.model.modes)
        modes, aside, stay, partners, relabelled, pinned = counts
        print(
            f"| {percent:g} | {modes} | {aside} | {stay} | {relabelled} of {partners} "
            f"| {pinned} of {2 * n_seeds} | {' | '.join(map(str, elsewhere))} |",
            flush=True,
        )


def _decided(found: Identification) -> list[int]:
    """Modes; those set aside, and with all others as they were; partners, relabelled; lists."""
    modes = found.model.modes
    aside = stay = partners = relabelled = 0
    for k, mode in enumerate(modes):
        name = PoleName(mode.frequency_hz, mode.damping_ratio)
        left = refit_modes(found, [Edit(EditKind.SET_ASIDE, name)]).model.modes
        rest = [*modes[:k], *modes[k + 1 :]]
        aside += mode.pole not in [other.pole for other in left]
        stay += [other.pole for other in left] == [other.pole for other in rest]
        if mode.member:
            partners += 1
            relabelled += [o.member for o in left if o.order == mode.order and o.is_ring_mode] == [
                ""
            ]
    named = [PoleName(mode.frequency_hz, mode.damping_ratio) for mode in modes]
    by_hz = [PoleName(mode.frequency_hz) for mode in modes]
    only = Edit(EditKind.ONLY_KEPT)
    lists = [[*(Edit(EditKind.KEEP, each) for each in names), only] for names in (named, by_hz)]
    pinned = sum(away(refit_modes(found, edits), found) < SAME_STD for edits in lists)
    return [len(modes), aside, stay, partners, relabelled, pinned]


def _elsewhere(modes: Sequence[Mode], found: Identification) -> list[int]:
    """Modes of other recordings set aside here: the same mode, refused, another mode."""
    counts, listed = [0, 0, 0], found.model.modes
    for mode in modes:
        name = PoleName(mode.frequency_hz, mode.damping_ratio)
        try:
            left = refit_modes(found, [Edit(EditKind.SET_ASIDE, name)]).model.modes
        except FitError:
            counts[1] += 1
            continue
        gone = {other.pole for other in listed} - {other.pole for other in left}
        same = [(m.order, m.member) == (mode.order, mode.member) for m in listed if m.pole in gone]
        counts[0 if same == [True] else 2] += 1
    return counts


TARGET = 0.6  # CPU of a refit over that of `process`
PROGRAM = [sys.executable, "-m", "pipelines.cli.main"]
REFITS = {
    "refit, a mode set aside": ["--set-aside", "121.4"],
    "refit, a channel out": ["--channel-out", "A07@config_3.uff"],
    "refit, a run out": ["--run-out", "config_6.uff"],
    "refit --try": ["--set-aside", "121.4", "--try"],
}


def as_processes(seconds: float, repeat: int) -> None:
    """Print CPU and memory of whole processes, and the size of the result."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        campaign = simulate_campaign(folder / "campaign", duration_s=seconds)
        costs, bytes_of = _processes(campaign, folder, repeat)
    whole = costs["process"]
    print(f"\nSix runs of 14 channels, {seconds:g} s; medians of {repeat}\n")
    print("| process | CPU, s | CPU over process | peak, MB |\n|---|---:|---:|---:|")
    for name, cost in costs.items():
        share = cost.cpu_s / whole.cpu_s
        print(f"| {name} | {cost.cpu_s:.2f} | {share:.2f} | {cost.peak_mb:.0f} |")
    total, force = sum(bytes_of.values()), bytes_of["force.parquet"]
    print(f"\nResult folder {total / 1e6:.1f} MB, of which for refits only {force / 1e6:.1f} MB")
    slow = [name for name in REFITS if costs[name].cpu_s > TARGET * whole.cpu_s]
    print(json.dumps({"target": TARGET, "missed": slow}))


def _processes(
    campaign: Path, folder: Path, repeat: int
) -> tuple[dict[str, Cost], Mapping[str, int]]:
    """Cost of each process, and the size of each file of the result."""
    result, out = folder / "result", ["--no-report", "--force", "--quiet", "--out"]
    process = [*PROGRAM, "process", str(campaign), *out, str(result)]
    compare({"process": process}, 1)  # fills the caches of the system
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


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, help="duration of a run")
    parser.add_argument("--before", type=Path, help="sources of an earlier version")
    parser.add_argument("--processes", action="store_true", help="time whole processes")
    parser.add_argument("--splits", type=int, metavar="SEEDS", help="decisions on split tyres")
    parser.add_argument("--repeat", type=int, default=3, help="with --processes")
    options = parser.parse_args()
    if options.splits:
        of_splits(options.splits, options.seconds or 10.0)
    elif options.processes:
        as_processes(options.seconds or STRETCH_S, options.repeat)
    else:
        in_process(options.seconds or 20.0, options.before)


if __name__ == "__main__":
    main()
