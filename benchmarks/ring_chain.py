"""From recordings of a ring under a follower load to the torsion in a .tir file, and back.

python benchmarks/ring_chain.py --tyres 10 --tangential
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np
from ring_coverage import random_tyre
from scipy.fft import irfft, next_fast_len

import model
from ema.core.campaign import Processing
from ema.core.recording import ACCELERATION, FORCE, Channel
from ema.io.uff.write import write_time_series
from model.coefficients import harmonics
from pipelines.export.tir_file import tir_of
from pipelines.export.tir_update import plan_update
from pipelines.library.library import read_source
from pipelines.process.run import process
from pipelines.report.write import save
from pipelines.results.options import Options
from pipelines.simulate.campaign import noise_spectrum, scaled
from pipelines.simulate.truth import solve

ORDERS = np.arange(17)
RATE_HZ, DURATION_S, SETTLING_S = 2000.0, 30.0, 4.0
SNR_DB, HIGHEST_HZ = 40.0, 780.0
KEYS = ("FREQ_LONG", "FREQ_WINDUP", "BELT_MASS")
TIR = b"[UNITS]\nLENGTH = 'meter'\nFORCE = 'newton'\nMASS = 'kg'\nTIME = 'second'\n[INERTIA]\n"
TIR += b"BELT_MASS = 7.1\n[STRUCTURAL]\nFREQ_LONG = 75.5\nFREQ_WINDUP = 60.5\n"


def system(ring, damping, tangential: bool):
    """Both branches of every order as coordinates: radial and tangential, cosine and sine."""
    area = ring.mean_radius_m * ring.belt_width_m
    size = 4 * ORDERS.size
    mass, damp, stiff = (np.zeros((size, size)) for _ in range(3))
    for n in ORDERS.tolist():
        terms = harmonics(ring, [n], pressure_load="follower")
        m11, m22, c = (float(each[0]) for each in (terms.m11, terms.m22, terms.c))
        norm = (2.0 if n == 0 else 1.0) * np.pi * area
        for sine, sign in ((0, 1.0), (1, -1.0)):  # w cos with v sin, w sin with v cos
            w, v = 4 * n + sine, 4 * n + 3 - sine
            mass[w, w] = mass[v, v] = ring.mass_per_area_kg_m2 * norm
            damp[w, w] = damping.radial_n_s_m3 * norm
            damp[v, v] = damping.circumferential_n_s_m3 * norm
            stiff[w, w], stiff[v, v] = m11 * norm, m22 * norm
            stiff[w, v] = stiff[v, w] = sign * c * norm
    keep = np.array([k for k in range(size) if k not in (1, 3)])  # sin 0 is nothing
    parts = (each[np.ix_(keep, keep)] for each in (mass, damp, stiff))
    at = motion(np.zeros(1), tangential)[0]
    return solve(*parts, at)


def motion(angles_deg, tangential: bool):
    """What a sensor at each angle sees of the coordinates."""
    angles = np.deg2rad(angles_deg)[:, None] * ORDERS
    rows = np.zeros((len(angles_deg), ORDERS.size, 4))
    first = 2 if tangential else 0
    rows[:, :, first], rows[:, :, first + 1] = np.cos(angles), np.sin(angles)
    rows = rows.reshape(len(angles_deg), -1)
    return np.delete(rows, (1, 3), axis=1)


def campaign(folder: Path, ring, damping, seed: int, tangential: bool) -> None:
    """Six runs of twelve radial sensors, and one of tangential ones under a tangential force."""
    random = np.random.default_rng([7, seed])
    kept = round(DURATION_S * RATE_HZ)
    period = next_fast_len(kept + round(SETTLING_S * RATE_HZ), real=True)
    omega = 2.0 * np.pi * np.arange(period // 2 + 1) * RATE_HZ / period
    runs = [(f"config_{k + 1}", 5.0 * k, False) for k in range(6)]
    text = [
        f"schema = 1\n[tyre]\ndesignation = 'ring {seed}'",
        f"inflation_pressure_pa = {ring.inflation_pressure_pa!r}",
        f"mean_radius_m = {ring.mean_radius_m!r}\nbelt_width_m = {ring.belt_width_m!r}",
        "[grid]\npositions = 72\n[excitation]\nposition_deg = 0.0",
    ]
    for name, first_deg, along in runs + [("torsion", 0.0, True)] * tangential:
        own = system(ring, damping, along)
        angles = first_deg + 30.0 * np.arange(12)
        spectrum = scaled(noise_spectrum(omega, (10.0, 900.0), random), 10.0, period)
        channels = [Channel(FORCE, FORCE, "N", irfft(spectrum, period)[-kept:].astype(np.float32))]
        seen = irfft(spectrum * own.inertance(motion(angles, along), omega), period)[:, -kept:]
        noise = 10.0 ** (-SNR_DB / 20.0) * np.sqrt(np.mean(seen**2))
        for k, row in enumerate(seen + noise * random.standard_normal(seen.shape)):
            channels.append(Channel(f"A{k + 1:02d}", ACCELERATION, "m/s^2", row.astype(np.float32)))
        write_time_series(folder / f"{name}.uff", channels, RATE_HZ)
        places = ", ".join(f"A{k + 1:02d} = {angle}" for k, angle in enumerate(angles))
        text += ["[[runs]]", f"file = '{name}.uff'", f"positions_deg = {{ {places} }}"]
        if along:
            ways = ", ".join(f"A{k + 1:02d} = 'tangential'" for k in range(12))
            text += ["excitation = { position_deg = 0.0, direction = 'tangential' }"]
            text += [f"directions = {{ {ways} }}"]
    (folder / "campaign.toml").write_text("\n".join(text), encoding="utf-8")


def truth_of(ring) -> dict[str, float]:
    """What the keys of the .tir file are, from the follower load."""
    belt = 2.0 * np.pi * ring.mean_radius_m * ring.mass_per_area_kg_m2 * ring.belt_width_m
    first = model.natural_frequencies_hz(ring, [1], pressure_load="follower")[0]
    torsion = model.torsion_frequency_hz(ring, pressure_load="follower")
    return dict(zip(KEYS, (first, torsion, belt), strict=True))


def compared(seed: int, tangential: bool, load: str) -> None:
    """Print what is written to the .tir file beside the truth."""
    ring, damping = random_tyre(np.random.default_rng(seed))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        campaign(folder, ring, damping, seed, tangential)
        top = model.natural_frequencies_hz(ring, [8], pressure_load="follower")[0]
        band = Processing(band_hz=(20.0, min(1.04 * top, HIGHEST_HZ)))
        options = Options(band, tuning={"pressure_load": load} if load else {})
        result = process(folder, options)
        save(result, folder / "result")
        parameters = read_source(folder / "result")
    update = plan_update(tir_of(TIR, "ring.tir"), parameters, accept_warnings=True)
    true = truth_of(ring)
    told = []
    for change in update.changes:
        if change.key in true:
            off = change.new / true[change.key] - 1
            sigmas = (change.new - true[change.key]) / (change.std or np.nan)
            std = 100 * (change.std or np.nan) / change.new
            told.append(f"{change.key} {100 * off:+.2f} ± {std:.2f} % ({sigmas:+.1f} σ)")
    load = f"{result.tuning.pressure_load} load{'' if load else ', by itself'}"
    print(f"ring {seed} {load}: {'; '.join(told)}; verdict {result.tuning.verdict.state}")


def main() -> None:
    """Campaigns of random rings with a follower load, tuned with either load."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tyres", type=int, default=10)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--tangential", action="store_true", help="measure the torsion as well")
    chosen = parser.parse_args()
    for seed in range(chosen.first, chosen.first + chosen.tyres):
        for load in ("", "follower"):
            compared(seed, chosen.tangential, load)


if __name__ == "__main__":
    main()
