"""How often 95 % intervals hold the truth, over noise realisations of one tyre.

    python benchmarks/coverage.py --realisations 200

Prints a Markdown table, order by order, for the tyre of the paper without a split and without
drift. 200 realisations show a coverage of 95 % to within 1.5 % (one standard deviation) an order,
and to within 0.6 % over all orders.
"""

from __future__ import annotations

import argparse

import numpy as np
from numpy.typing import NDArray
from tyres import BAND_HZ, ORDERS, RandomTyre, measured_frf

import ema
from pipelines.simulate.campaign import N_RUNS
from pipelines.simulate.truth import truth_modes

SNR_DB = (40.0, 20.0, 10.0)
TYRE = RandomTyre(truth_modes(), 0.0, np.zeros(N_RUNS), np.zeros(0, dtype=int))


def deviations(snr_db: float, seed: int) -> NDArray[np.float64]:
    """Errors of frequency and damping in standard deviations, (n_orders, 2); NaN where missed."""
    random = np.random.default_rng([seed, round(10 * snr_db)])
    tyre = RandomTyre(TYRE.modes, snr_db, TYRE.drift, TYRE.lost)
    modes = ema.identify_modes(measured_frf(tyre, random), BAND_HZ).model.modes
    truth = {mode.order: mode for mode in tyre.modes}
    found = np.full((len(ORDERS), 2), np.nan)
    for mode in modes:
        if mode.order in ORDERS:
            true = truth[mode.order]
            found[mode.order - ORDERS[0]] = (
                (mode.frequency_hz - true.frequency_hz) / mode.frequency_std_hz,
                (mode.damping_ratio - true.damping_ratio) / mode.damping_std,
            )
    return found


def coverage(scores: NDArray[np.float64]) -> str:
    """Share of scores within the 95 % interval; missed modes are not counted."""
    known = scores[np.isfinite(scores)]
    return f"{100 * np.mean(np.abs(known) < 1.96):.1f} %" if known.size else "–"


def main() -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--realisations", type=int, default=200, help="how many for each noise")
    count = parser.parse_args().realisations
    print(f"| SNR | interval of | order {' | '.join(map(str, ORDERS))} | all | missed |")
    print("|---" * (len(ORDERS) + 4) + "|")
    for snr_db in SNR_DB:
        scores = np.array([deviations(snr_db, seed) for seed in range(count)])
        for column, name in enumerate(("frequency", "damping")):
            part = scores[:, :, column]
            cells = [coverage(order) for order in part.T]
            missed = np.count_nonzero(np.isnan(part))
            row = [f"{snr_db:g} dB", name, *cells, coverage(part), f"{missed}"]
            print("| " + " | ".join(row) + " |", flush=True)


if __name__ == "__main__":
    main()
