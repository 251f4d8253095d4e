"""What an earlier version got wrong without a word, rebuilt with exact modes, in several seeds.

    python benchmarks/earlier_failures.py --seeds 3 --only "several bands" "hits by hand"

Each case is a campaign in a folder, as ``ringmodal simulate campaign`` writes it, processed as by
``ringmodal process``. It comes out right (nothing missed, invented, mislabelled or touched, no row
beyond 3 σ), or is refused, or a finding names what is wrong with the test. Anything else is silent
and wrong; then the exit code is 1.
"""

from __future__ import annotations

import argparse
import itertools
import sys
import tempfile
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import earlier_failures_files as files
import numpy as np
from laboratory_scoring import Row, Score, orders_of, score

from ema.core.campaign import Processing
from ema.core.errors import FitError, InputError
from ema.core.finding import Check
from pipelines.process.run import process
from pipelines.results.options import Options
from pipelines.results.result import Result
from pipelines.simulate.laboratory_effects import Effects

LARGE_Z = 3.0
DEFAULT_BAND_HZ = (20.0, 300.0)
# The same tyre in all of them; which modes each band contains follows from the exact modes.
BANDS_HZ = (DEFAULT_BAND_HZ, (60.0, 150.0), (90.0, 130.0), (100.0, 260.0))
# Splits of 0.1 to 0.2 % of the frequencies.
UNEVEN = {"splice": 0.001, "stiffness_variation": 0.003, "mass_variation": 0.001}
MINUTE = {**UNEVEN, "duration_s": 60.0, "snr_db": 40.0}
HALF = {**UNEVEN, "duration_s": 30.0, "snr_db": 40.0}
HAMMER = {**HALF, "excitation": "hammer", "hits": 10}  # every 0.9 to 5 s
HALF_CIRCLE = {"circle_deg": (0.0, 165.0), "runs": 1}


@dataclass(frozen=True)
class Case:
    """A row of the table: what it was, how it is made, what may be said of it."""

    was: str
    options: dict[str, Any]
    make: Callable[[Path, Effects], files.Modes] = files.laboratory
    bands_hz: tuple[tuple[float, float], ...] = ()  # none: the default band
    names: Check | None = None  # the finding that names the fault of the test
    has_to: bool = False  # whether it has to, even if all rows are right
    seeds: int = 0  # more than asked for
    needs_ring: bool = True


CASES = {
    "split 0.1 %, clean, 100 s": Case(
        "one mode invented (114.3 Hz, 7.6 %), damping beside it off by 4 %",
        {"duration_s": 100.0, "snr_db": 60.0},
        files.split_sample,
    ),
    "several bands": Case(
        "667.11 ± 0.08, 667.27 ± 0.04, 667.341 ± 0.003 Hz",
        HALF,
        bands_hz=BANDS_HZ,
        needs_ring=False,
    ),
    "FRFs with coherence": Case(
        "thrown away, then said to be unknown", HALF, files.frfs_with_coherence
    ),
    "FRFs alone": Case("(for comparison)", HALF, files.frfs_alone),
    "six turned runs, tables, no manifest": Case(
        "averaged as if nothing had been turned", HALF, files.tables_without_manifest
    ),
    "temperature +0.6 %": Case(
        "54–71 of 72 healthy sensors changed", {**MINUTE, "temperature_drift": 0.006}
    ),
    "temperature +0.9 %, damping −6 %": Case(
        "the same", {**MINUTE, "temperature_drift": 0.009, "temperature_damping": -0.06}
    ),
    "pressure +0.5 %": Case("the same", {**MINUTE, "pressure_drift": 0.005}),
    "half circle": Case(
        "orders 1, 0, 1, 1; 9 of 12 sensors rescaled", {**HALF, **HALF_CIRCLE}, needs_ring=False
    ),
    "hits by hand": Case("8 modes for 5; damping +1 to +2.6 %", HAMMER),
    "bursts at uneven distances": Case("damping +0.1 to +0.5 %", {**HALF, "excitation": "burst"}),
    "exponential window, stated": Case(
        "damping too high, nowhere to state it", HAMMER, files.hits_behind_a_stated_window
    ),
    "exponential window, not stated": Case(
        "damping too high", HAMMER, files.hits_behind_a_window, names=Check.WINDOW
    ),
    "exponential window, FRFs, stated": Case(
        "damping too high, nowhere to state it", HAMMER, files.frfs_behind_a_stated_window
    ),
    "8 s, one run, 70 dB": Case(
        "3 of 8 lose a mode or have 0.79 ± 0.13 for 1.2 %",
        {"duration_s": 8.0, "runs": 1, "snr_db": 70.0},
        seeds=10,
        needs_ring=False,
    ),
    "turned the other way": Case(
        "4 of 7 orders wrong", {**HALF, "mirrored_step": True}, names=Check.POSITIONS, has_to=True
    ),
    "sensors counted the other way": Case(
        "4 of 7 orders wrong",
        {**HALF, "reversed_sequence": True},
        names=Check.POSITIONS,
        has_to=True,
    ),
    "run 2 off by 5°": Case(
        "no word", {**HALF, "offset_deg": 5.0}, names=Check.POSITIONS, has_to=True
    ),
    "all runs off by 5°": Case(
        "no word",
        {**HALF, "offset_deg": 5.0, "offset_run": 0},
        names=Check.DRIVE_POINT,
        has_to=True,
    ),
    "lateral modes": Case(
        "131 Hz off by 8 σ", {**HALF, "lateral_hz": (48.0, 131.0), "cavity_coupling": 0.1}
    ),
    "stiff tyre": Case("order 7 at 268 Hz not listed", {**HALF, "stiffness": 1.44}),
    "softening 1 %": Case(
        "damping +1.3 %, no word", {**HALF, "softening": 0.01}, names=Check.LEVEL_DEPENDENCE
    ),
    "drift 1 % within a run": Case(
        "damping +1.0 %, no word", {**HALF, "drift_within": 0.01}, names=Check.WITHIN_RUN
    ),
}


HEADER = (
    "| case | it was | right | refused | named | silent | largest error/σ |\n" + "|---" * 7 + "|"
)


class Outcome(NamedTuple):
    """What became of one seed."""

    word: str
    details: tuple[str, ...] = ()
    worst_z: float = float("nan")


def outcome(case: Case, seed: int) -> Outcome:
    """Make a campaign, process it and compare it with its modes."""
    effects = Effects(seed=seed, **case.options)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "campaign"
        truth = case.make(folder, effects)
        try:
            results = [process(folder, _options(band)) for band in case.bands_hz or (None,)]
        except (FitError, InputError) as error:
            return Outcome("refused", (str(error),))
    faulty = {f"A{number:02d}" for number in effects.faulty_sensors}
    complaints: list[str] = []
    worst = 0.0
    for result, band_hz in zip(results, case.bands_hz or (DEFAULT_BAND_HZ,), strict=True):
        found = score(truth, _rows(result), band_hz)
        worst = max([worst, *(_largest_z(found))])
        complaints += [*_complaints(found), *_touched(result, faulty)]
        if case.needs_ring and result.tuning is None:
            complaints.append("no ring")
    complaints += _apart(truth, results, case.bands_hz)
    of_fault = [f for r in results for f in r.findings if f.check == case.names]
    if any(not finding.is_ok for finding in of_fault):
        return Outcome("named", (*(f.detail for f in of_fault), *complaints), worst)
    silent = complaints or case.has_to
    return Outcome("SILENT" if silent else "right", tuple(complaints), worst)


def _options(band_hz: tuple[float, float] | None) -> Options:
    return Options() if band_hz is None else Options(processing=Processing(band_hz=band_hz))


def _rows(result: Result) -> list[Row]:
    return [Row.of(mode) for mode in result.modal_model.modes]


def _largest_z(found: Score) -> list[float]:
    return [float(np.nanmax(np.abs([*match.z, 0.0]))) for match in found.matches]


def _complaints(found: Score) -> list[str]:
    """Modes missed, invented, with another order or beyond 3 σ."""
    lines = [f"missed {target.name} ({target.frequency_hz:.2f} Hz)" for target in found.missed]
    lines += [f"invented {r.frequency_hz:.2f} Hz" for r in found.invented if not r.doubtful]
    for match, z in zip(found.matches, _largest_z(found), strict=True):
        if match.is_mislabelled:
            lines.append(f"{match.target.name} is listed as order {match.row.order}")
        if z > LARGE_Z:
            f, damping = match.errors_percent
            lines.append(f"{match.target.name}: {f:+.3f} %, damping {damping:+.1f} %, {z:.1f} σ")
    return lines


def _touched(result: Result, faulty: set[str]) -> list[str]:
    healthy = [each for each in result.corrections if each.channel not in faulty]
    return [f"{each.run} {each.channel}: {each.check}" for each in healthy if not each.is_none]


def _apart(truth: files.Modes, results: list[Result], bands_hz: Any) -> list[str]:
    """Orders that two bands contain, with rows farther apart than the larger ± of both."""
    listed = []
    for (first, one_hz), (second, other_hz) in itertools.combinations(
        zip(results, bands_hz, strict=False), 2
    ):
        shared = max(one_hz[0], other_hz[0]), min(one_hz[1], other_hz[1])
        for order in orders_of(truth, shared):
            number = order.members[0].order
            pair = [
                [m for m in r.modal_model.modes if m.order == number and not m.doubtful]
                for r in (first, second)
            ]
            if any(len(modes) != 1 for modes in pair):
                continue
            a, b = pair[0][0], pair[1][0]
            shift = abs(a.frequency_hz - b.frequency_hz)
            change = abs(a.damping_ratio - b.damping_ratio)
            z = max(
                shift / max(a.frequency_std_hz, b.frequency_std_hz),
                change / max(a.damping_std, b.damping_std),
            )
            if z > 2:
                listed.append(f"order {number}: {one_hz} and {other_hz} Hz are {z:.1f} σ apart")
    return listed


def main() -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=3, help="seeds of each case")
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--only", nargs="+", choices=CASES, metavar="CASE", help="cases")
    parser.add_argument("--list", action="store_true", help="list what is wrong or said")
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    print(HEADER, flush=True)
    silent = 0
    for name in options.only or CASES:
        case = CASES[name]
        last = options.first_seed + max(options.seeds, case.seeds)
        found = {seed: outcome(case, seed) for seed in range(options.first_seed, last)}
        words = [each.word for each in found.values()]
        counts = [str(words.count(word)) for word in ("right", "refused", "named", "SILENT")]
        silent += words.count("SILENT")
        worst = np.nanmax([0.0, *(each.worst_z for each in found.values())])
        print(f"| {name} | {case.was} | {' | '.join(counts)} | {worst:.1f} |", flush=True)
        if options.list:
            for seed, each in found.items():
                for line in each.details:
                    print(f"    seed {seed}, {each.word}: {line}", flush=True)
    sys.exit(silent > 0)


if __name__ == "__main__":
    main()
