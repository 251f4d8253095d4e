"""Do refactorings leave the numbers alone? python benchmarks/same_numbers.py [--record].

Modes, ring, damping and validation of the sample campaign and of ten random tyres, compared with
`same_numbers.json`, which `--record` wrote on the commit it names. Differences are in standard
deviations of the reference; 1e-3 is the limit. `--record` is for changes that are meant to change
numbers.
"""

from __future__ import annotations

import argparse
import json
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
from tyres import BAND_HZ, measured_frf, random_tyre

import ema
import model
from ema.core.modes import ModalModel
from pipelines.process.run import process
from pipelines.process.validate import ring_orders, validate

HERE = Path(__file__).resolve().parent
REFERENCE = HERE / "same_numbers.json"
SAMPLE = HERE.parent / "sample_data" / "tyre_225_55R17"
N_TYRES, SEED = 10, 1
LARGEST = 1e-3  # standard deviations
RADIUS_M, WIDTH_M, PRESSURE_PA = 0.33, 0.19, 2.2e5

Numbers = dict[str, list[float]]  # name → value and standard deviation


def _modes(found: ModalModel) -> Numbers:
    numbers: Numbers = {"modes": [float(len(found.modes)), 0.0]}
    for k, mode in enumerate(found.modes):
        name = f"mode {k}, order {mode.order}{mode.member}"
        numbers[f"{name}, frequency_hz"] = [mode.frequency_hz, mode.frequency_std_hz]
        numbers[f"{name}, damping_ratio"] = [mode.damping_ratio, mode.damping_std]
    return numbers


def _ring(tuning: Any, damping: Any, validation: Any, orders: Any) -> Numbers:
    numbers = {
        f"ring, {name}": [value, tuning.std.get(name, 0.0)]
        for name, value in vars(tuning.ring).items()
        if value is not None
    }
    for name, value in vars(damping.damping).items():
        numbers[f"damping, {name}"] = [value, damping.std.get(name, 0.0)]
    for row, order in enumerate(orders):
        numbers[f"validation, order {order.order}"] = [
            float(validation.model_hz[row]),
            order.frequency_std_hz,
        ]
    return numbers


def sample() -> Numbers:
    """Numbers of the sample campaign."""
    result = process(SAMPLE)
    orders = ring_orders(result.modal_model)
    return _modes(result.modal_model) | _ring(
        result.tuning, result.damping, result.validation, orders
    )


def random(number: int) -> Numbers:
    """Numbers of a random tyre, its ring tuned as if it had the sample's size and pressure."""
    generator = np.random.default_rng([SEED, number])
    frf = measured_frf(random_tyre(generator), generator)
    found = ema.identify_modes(frf, BAND_HZ).model
    orders = ring_orders(found)
    tuning = model.tune_ring(
        [order.order for order in orders],
        [order.frequency_hz for order in orders],
        mean_radius_m=RADIUS_M,
        inflation_pressure_pa=PRESSURE_PA,
        belt_width_m=WIDTH_M,
        frequency_std_hz=[order.frequency_std_hz for order in orders],
    )
    damping = model.identify_damping(
        tuning.ring,
        np.array([order.order for order in orders]),
        [order.damping_ratio for order in orders],
        [order.damping_std for order in orders],
    )
    return _modes(found) | _ring(tuning, damping, validate(found, orders, tuning, damping), orders)


def measure() -> dict[str, Numbers]:
    """Numbers of all tyres."""
    return {"sample": sample(), **{f"tyre {k}": random(k) for k in range(N_TYRES)}}


def compare(reference: dict[str, Numbers], now: dict[str, Numbers]) -> list[tuple[float, str]]:
    """Differences in standard deviations, largest first; infinite for what is missing."""
    found = []
    for tyre, numbers in reference.items():
        for name in numbers.keys() | now[tyre].keys():
            if name not in numbers or name not in now[tyre]:
                found.append((float("inf"), f"{tyre}, {name}: only once there"))
                continue
            (was, std), (value, _) = numbers[name], now[tyre][name]
            # A value without σ (given, at a bound) has to agree within a millionth.
            scale = std if std and np.isfinite(std) else 1e-3 * abs(was) or 1.0
            found.append((abs(value - was) / scale, f"{tyre}, {name}: {was:.9g} → {value:.9g}"))
    return sorted(found, reverse=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--record", action="store_true", help="write the reference anew")
    asked = parser.parse_args()
    now = measure()
    if asked.record:
        commit = subprocess.run(
            ["git", "rev-parse", "HEAD"], cwd=HERE, capture_output=True, text=True, check=True
        ).stdout.strip()
        REFERENCE.write_text(json.dumps({"commit": commit, "numbers": now}, indent=1) + "\n")
        print(f"recorded at {commit}")
        return
    stored = json.loads(REFERENCE.read_text())
    differences = compare(stored["numbers"], now)
    print(f"{len(differences)} numbers against {stored['commit'][:8]}; largest differences, σ:")
    for size, text in differences[:5]:
        print(f"  {size:8.2g}  {text}")
    raise SystemExit(1 if differences[0][0] > LARGEST else 0)


if __name__ == "__main__":
    main()
