"""How well tyres with known modes are identified, next to sdypy-EMA on the same FRFs.

    python benchmarks/accuracy.py --tyres 100 --seed 1

Prints a Markdown table, and below it every tyre on which our own result is wrong, and how. Needs
the extra ``benchmark``.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable

import numpy as np
from peer import closest_poles
from scoring import FoundMode, Match, Score, score, true_frequencies_hz
from tyres import BAND_HZ, RandomTyre, measured_frf, random_tyre

import ema
from ema.core.errors import FitError, InputError
from ema.core.frf import FRF
from ema.core.modes import Flag

OURS = "ringmodal"
# Errors beyond these are listed one by one.
LARGE_FREQUENCY_PERCENT, LARGE_DAMPING_PERCENT = 0.5, 20.0


def identify(frf: FRF) -> list[FoundMode]:
    """Modes as the program finds them, without any help."""
    modes = ema.identify_modes(frf, BAND_HZ).model.modes
    return [
        FoundMode(
            mode.frequency_hz,
            mode.damping_ratio,
            mode.frequency_std_hz,
            mode.damping_std,
            foreign=Flag.NOT_RING_MODE in mode.flags,
        )
        for mode in modes
    ]


def scores_of(tyre: RandomTyre, frf: FRF, *, peers: bool) -> dict[str, Score]:
    """All methods on one tyre.

    Our modes are those of the first run's state; the peer knows one state only and is compared
    with the mean of the runs.
    """
    scores = {OURS: _timed(tyre, lambda: identify(frf), 0.0)}
    if peers:
        mean = float(tyre.drift.mean())
        true_hz = true_frequencies_hz(tyre, mean)
        for method in ("lscf", "lsce"):
            found = _timed(tyre, lambda m=method: closest_poles(frf, m, true_hz), mean)
            scores[f"sdypy-EMA, {method.upper()}, told the true frequencies"] = found
    return scores


def _timed(tyre: RandomTyre, find: Callable[[], list[FoundMode]], drift: float) -> Score:
    start = time.perf_counter()
    try:
        found = find()
    except (FitError, InputError, np.linalg.LinAlgError) as error:
        print(f"no result: {error}", file=sys.stderr)
        found = []
    return score(tyre, found, time.perf_counter() - start, drift)


HEADER = (
    "| method | to find | missed | invented (said to be foreign) "
    "| frequency error, %: median, 95th | "
    "damping error, %: median, 95th | 95 % intervals cover: frequency, damping | s per tyre |\n"
    "|---|---|---|---|---|---|---|---|"
)


def row(method: str, scores: list[Score], kinds: set[str]) -> str:
    """One line of the table, over the targets of some kinds; invented ones belong to none."""
    matches = [match for one in scores for match in one.matches if match.target.kind in kinds]
    missed = sum(target.kind in kinds for one in scores for target in one.missed)
    invented = [mode for one in scores for mode in one.invented]
    cells = [
        method,
        f"{len(matches) + missed}",
        f"{missed}",
        f"{len(invented)} ({sum(mode.foreign for mode in invented)})",
        _errors([match.frequency_error_percent for match in matches], 3),
        _errors([match.damping_error_percent for match in matches], 2),
        _coverage(matches),
        f"{np.median([one.seconds for one in scores]):.2f}",
    ]
    return "| " + " | ".join(cells) + " |"


def _errors(percent: list[float], digits: int) -> str:
    if not percent:
        return "–"
    return ", ".join(f"{np.percentile(np.abs(percent), p):.{digits}f}" for p in (50, 95))


def _coverage(matches: list[Match]) -> str:
    inside = np.array([[abs(m.frequency_z) < 1.96, abs(m.damping_z) < 1.96] for m in matches])
    if not matches or np.isnan(matches[0].frequency_z):
        return "–"
    return ", ".join(f"{share:.1f} %" for share in 100 * inside.mean(axis=0))


def complaints(tyre: RandomTyre, one: Score) -> list[str]:
    """What is wrong with a result, in words."""
    found = [f"missed order {t.order} ({t.kind}, {t.frequency_hz:.2f} Hz)" for t in one.missed]
    found += [
        f"invented {m.frequency_hz:.2f} Hz, {m.damping_ratio:.4f}{' (foreign)' * m.foreign}"
        for m in one.invented
    ]
    for match in one.matches:
        f, zeta = match.frequency_error_percent, match.damping_error_percent
        if abs(f) > LARGE_FREQUENCY_PERCENT or abs(zeta) > LARGE_DAMPING_PERCENT:
            target = match.target
            found.append(f"order {target.order} ({target.kind}): {f:+.2f} %, damping {zeta:+.0f} %")
    return found


def main() -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--tyres", type=int, default=100, help="how many tyres")
    parser.add_argument("--seed", type=int, default=1, help="tyre k has the seed [SEED, k]")
    parser.add_argument("--only", type=int, help="one tyre only")
    parser.add_argument("--no-peers", action="store_true", help="leave sdypy-EMA out")
    options = parser.parse_args()
    results: dict[str, list[Score]] = {}
    listed = []
    for number in range(options.tyres) if options.only is None else [options.only]:
        random = np.random.default_rng([options.seed, number])
        tyre = random_tyre(random)
        scores = scores_of(tyre, measured_frf(tyre, random), peers=not options.no_peers)
        for method, one in scores.items():
            results.setdefault(method, []).append(one)
        wrong = complaints(tyre, scores[OURS])
        if wrong:
            listed.append(f"- tyre {number}, {tyre.snr_db:.0f} dB: {'; '.join(wrong)}")
    kinds = {
        "": {"single", "unresolved", "member"},
        ", one driven member": {"single"},
        ", unresolved pairs": {"unresolved"},
        ", pairs of two modes": {"member"},
    }
    print(HEADER)
    for title, chosen in kinds.items():
        for method, scores_of_method in results.items():
            print(row(method + title, scores_of_method, chosen))
    print("\nTyres with errors:\n" + "\n".join(listed))


if __name__ == "__main__":
    main()
