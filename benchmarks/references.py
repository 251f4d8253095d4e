"""Several forces on structures with known modes: python benchmarks/references.py [--seeds 8].

Rings with forces at 0° and 13°, as a ring and as a structure of which nobody says that it is one; a
square plate, whose roots are repeated; a model of an aircraft with a pair 0.3 % apart; plates that
are nearly square; two forces at once; the virtual laboratory. Errors against the truth, what the ±
cover, the worst plane of coinciding modes and what the noise allows of it, modal masses, and the
time over that of each force by itself.
"""

from __future__ import annotations

import argparse
import tempfile
import time
import tomllib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from ring_bound import ring_bound
from scipy.linalg import subspace_angles
from scipy.stats import norm

import ringmodal as rm
from ema.checks.sensor_mass import sensors_of_runs
from ema.core.frf import FRF
from ema.core.modes import Mode
from ema.core.references import References
from pipelines.simulate.laboratory import Laboratory
from pipelines.simulate.laboratory_effects import Effects
from pipelines.simulate.truth import TruthMode, modal_sum

Real = NDArray[np.float64]
SNR_DB = (40.0, 30.0, 20.0)
SPLITS = (0.0, 0.001, 0.003, 0.01, 0.03)
NEAR = 0.1  # of a half-width: closer ones are compared by their plane
RING_DEG, RING_FORCES_DEG = np.arange(24) * 15.0, (0.0, 13.0)
WITHIN = np.array([2e-4, 0.01])  # asked for of frequency and damping ratio


@dataclass(frozen=True)
class Truth:
    """Modes of a structure: modal masses are those of the shapes as they are."""

    frequency_hz: Real
    damping_ratio: Real
    shapes: Real  # (n_modes, n_positions)
    mass_kg: Real

    def frfs(self, forces: tuple[int, ...], lines_hz: Real, snr_db: float, seed: int) -> References:
        """FRFs against forces at some positions, with noise."""
        rng, omega, found = np.random.default_rng(seed), 2 * np.pi * lines_hz, []
        own = 2 * np.pi * self.frequency_hz[:, None]
        answers = -(omega**2) / (own**2 - omega**2 + 2j * self.damping_ratio[:, None] * own * omega)
        for at in forces:
            exact = (self.shapes * (self.shapes[:, at] / self.mass_kg)[:, None]).T @ answers
            std = np.sqrt(np.mean(np.abs(exact) ** 2)) * 10 ** (-snr_db / 20) / np.sqrt(2)
            noise = std * rng.standard_normal((2, *exact.shape))
            values, known = exact + noise[0] + 1j * noise[1], np.full(exact.shape, std)
            nodes = np.arange(1, len(exact) + 1)
            frf = rm.FRF.from_arrays(lines_hz, values, nodes=nodes, std=known)
            found.append(replace(frf, force_node=at + 1))
        return References(tuple(found))

    def plane_bound(self, frfs: References, group: list[int]) -> float:
        """What noise leaves of the plane of coinciding modes where all else is known (Cramér–Rao).

        The residues of m such modes at n positions are a matrix of rank m; its least singular value
        against their noise tells how far the plane turns.
        """
        omega, own = 2 * np.pi * frfs.frequency_hz, 2 * np.pi * self.frequency_hz[:, None]
        apart = np.array([k for k in range(own.size) if k not in group[1:]])
        answers = -(omega**2) / (own**2 - omega**2 + 2j * self.damping_ratio[:, None] * own * omega)
        columns = np.concatenate([answers[apart].real, answers[apart].imag], axis=1)
        noise = np.linalg.pinv(columns @ columns.T)[apart == group[0], apart == group[0]][0]
        forces = [frf.force_node - 1 for frf in frfs]
        std = np.array([float(frf.std[0, 0]) for frf in frfs])
        driven = self.shapes[group][:, forces] / self.mass_kg[group][:, None] / std
        least = np.linalg.svd(self.shapes[group].T @ driven, compute_uv=False)[len(group) - 1]
        return float(1 - (self.shapes.shape[1] - len(group)) * noise / least**2)


def plate(seed: int, split: float) -> Truth:
    """Simply supported plate on a grid, of sides that differ by half the split."""
    rng, x = np.random.default_rng(seed), (np.arange(8) + 0.5) / 8
    numbers = [(a, b) for a in (1, 2, 3, 4) for b in (1, 2, 3, 4) if a * a + b * b < 26]
    hz = np.array([4.5 * (a * a + b * b * (1 + 2 * split)) for a, b in numbers])
    waves = np.sin(np.pi * np.outer(np.arange(1, 5), x))
    shapes = np.array([np.outer(waves[a - 1], waves[b - 1]).ravel() for a, b in numbers])
    order = np.argsort(hz)
    ratio = rng.uniform(0.004, 0.02, 8)[np.array([a * b for a, b in numbers])[order] % 8]
    return Truth(hz[order], ratio, shapes[order], np.full(hz.size, 2.0))


def aircraft(seed: int, split: float) -> Truth:
    """74 points on wings and body; the seventh and eighth mode are a pair."""
    rng = np.random.default_rng(seed)
    wing, body = np.linspace(-1, 1, 50), np.linspace(-1, 1, 24)
    hz = np.array([18.3, 31.2, 44.9, 61.7, 78.4, 96.3, 125.21, 125.21, 143.0, 161.3, 172.2, 188.8])
    hz[7] *= 1 + split
    shapes = []
    for k in range(hz.size):
        n, even = k // 2 + 1, k % 2 == 0
        bend = np.cos(n * np.pi * np.abs(wing) + 0.3 * k) * np.abs(wing) ** 0.7
        along = np.cos(n * np.pi * body / 2 + k) * (0.4 if even else 0.06)
        shapes.append(np.concatenate([bend * (1 if even else np.sign(wing)), along]))
    ratio = rng.uniform(0.003, 0.008, hz.size)
    return Truth(hz, ratio, np.array(shapes), rng.uniform(0.5, 3.0, hz.size))


def ring(seed: int, split: float) -> tuple[TruthMode, ...]:
    """Both members of orders 1 to 9 with random directions."""
    rng = np.random.default_rng(seed)
    hz = np.array([79.0, 100.0, 121.0, 145.0, 170.0, 196.0, 223.0, 252.0, 282.0])
    ratio, psi = rng.uniform(0.02, 0.03, hz.size), rng.uniform(0, 180, hz.size)
    return tuple(
        TruthMode(n, member, hz[n - 1] * (1 + sign * split / 2), ratio[n - 1], 4.0, turned)
        for n in range(1, hz.size + 1)
        for member, sign, turned in (("a", -1, psi[n - 1] / n), ("b", 1, (psi[n - 1] + 90.0) / n))
    )


def ring_frfs(modes: tuple[TruthMode, ...], snr_db: float, seed: int) -> tuple[FRF, FRF]:
    """FRFs of 24 sensors against forces at 0° and 13°."""
    rng, lines_hz, found = np.random.default_rng(seed), np.arange(1, 1201) / 4, []
    for force_deg in RING_FORCES_DEG:
        system = modal_sum(modes, RING_DEG, force_deg)
        omega = 2 * np.pi * lines_hz
        exact = np.array([system.inertance(row, omega) for row in range(RING_DEG.size)])
        std = np.sqrt(np.mean(np.abs(exact) ** 2)) * 10 ** (-snr_db / 20) / np.sqrt(2)
        noise = std * rng.standard_normal((2, *exact.shape))
        values, known = exact + noise[0] + 1j * noise[1], np.full(exact.shape, std)
        frf = rm.FRF.from_arrays(lines_hz, values, angles_deg=RING_DEG, std=known)
        found.append(replace(frf, excitation_deg=force_deg))
    return found[0], found[1]


class Score:
    """Errors of one kind of structure, gathered."""

    def __init__(self, name: str) -> None:
        self.name, self.missed, self.wanted, self.invented = name, 0, 0, 0
        self.errors, self.masses = list[Real](), list[float]()
        self.planes = list[tuple[float, float]]()  # as found, and at best
        self.bounds = list[Real]()  # of the errors, where known
        self.times = list[float]()

    def add(
        self,
        found: list[Mode],
        hz: Real,
        ratio: Real,
        shapes: Real,
        mass: Real,
        bound: Callable[[list[int]], float] = lambda group: np.nan,
        bounds: Real | None = None,
    ) -> None:
        """Compare modes with the truth, each taken once."""
        rest = list(range(len(found)))
        groups: dict[int, list[int]] = {}
        for k in range(hz.size):
            first = next((g for g in groups if abs(hz[g] / hz[k] - 1) < NEAR * ratio[k]), k)
            groups.setdefault(first, []).append(k)
        for group in groups.values():
            own = []
            for k in group:
                self.wanted += 1
                pole = 2 * np.pi * hz[k] * (-ratio[k] + 1j * np.sqrt(1 - ratio[k] ** 2))
                away = [abs(found[j].pole - pole) for j in rest]
                near = rest[int(np.argmin(away))] if rest else None
                if near is None or min(away) > 0.5 * -pole.real:
                    self.missed += 1
                    continue
                rest.remove(near)
                own.append(found[near])
                self._number(found[near], hz[k], ratio[k])
                self.bounds += [] if bounds is None else [bounds[k]]
                if len(group) == 1 and shapes.size and np.isfinite(found[near].modal_mass_kg):
                    mode, size = found[near], np.sum(shapes[k] ** 2)
                    truth = mass[k] * float(mode.shape.real @ shapes[k] / size) ** 2
                    self.masses.append((mode.modal_mass_kg - truth) / mode.modal_mass_std_kg)
            if own and len(own) == len(group) and shapes.size:
                seen, true = np.array([mode.shape.real for mode in own]).T, shapes[group].T
                plane = float(np.cos(subspace_angles(seen, true)[0]) ** 2)
                self.planes.append((plane, bound(group)))
        self.invented += len(rest)

    def _number(self, mode: Mode, hz: float, ratio: float) -> None:
        off = mode.frequency_hz - hz, mode.damping_ratio - ratio
        std = mode.frequency_std_hz, mode.damping_std
        self.errors.append(
            np.array([off[0] / hz, off[1] / ratio, off[0] / std[0], off[1] / std[1]])
        )

    def beside_bounds(self) -> str:
        """Errors beside what noise allows at best, where that is known."""
        if not self.bounds:
            return ""
        errors, best = np.abs(self.errors)[:, :2], np.array(self.bounds)
        asked = " ".join(f"{100 * each:g} %" for each in WITHIN)
        outside, expected = (
            np.sum(errors > WITHIN, axis=0),
            np.sum(2 * norm.sf(WITHIN / best), axis=0),
        )
        times = np.median(errors / best, axis=0) / norm.ppf(0.75)
        return (
            f"\n{'':30s} beyond {asked}: {outside[0]} {outside[1]}; of estimates at the bound of "
            f"Cramér and Rao {expected[0]:.1f} {expected[1]:.1f}; errors over it {times[0]:.1f} "
            f"{times[1]:.1f}"
        )

    def line(self) -> str:
        """One line of the table, and a second one where bounds are known."""
        if not self.errors:
            return f"{self.name:30s} nothing found, {self.missed} missed"
        f, z, f_std, z_std = np.abs(self.errors).T
        masses = np.abs(self.masses)
        within = f"{100 * np.mean(masses < 1.96):3.0f} %" if masses.size else "   –"
        plane = "{:.5f} ({:.5f})".format(*min(self.planes)) if self.planes else "–"
        return (
            f"{self.name:30s} {self.wanted:4d} {self.missed:4d} {self.invented:4d}  "
            f"{100 * np.median(f):.4f} {100 * f.max():.4f}  {100 * np.median(z):.3f} "
            f"{100 * z.max():.2f}  {100 * np.mean(f_std < 1.96):3.0f} "
            f"{100 * np.mean(z_std < 1.96):3.0f}  {max(f_std.max(), z_std.max()):5.1f}  "
            f"{plane}  {within}  {np.median(self.times):.2f}{self.beside_bounds()}"
        )


def timed(
    score: Score, frfs: References, band_hz: tuple[float, float], mass: rm.SensorMass | None = None
) -> list[Mode]:
    """Modes of all forces, and the time over that of each by itself."""
    start = time.process_time()
    found = rm.identify_modes(frfs, band_hz, sensor_mass=mass)
    both = time.process_time() - start
    start = time.process_time()
    for frf in frfs:
        rm.identify_modes(replace(frf), band_hz, sensor_mass=mass)
    score.times.append(both / (time.process_time() - start))
    return list(found.model.modes)


def structures(name: str, seeds: int) -> Iterator[Score]:
    """Plates or aircraft of several splits."""
    lines_hz = np.arange(1, 1601) / 8
    make, forces, band_hz = {
        "plate": (plate, (10, 29), (5.0, 105.0)),
        "aircraft": (aircraft, (1, 45, 60), (10.0, 180.0)),
    }[name]
    for split in (0.0, 0.0005, 0.003, 0.01):
        score = Score(f"{name}, {len(forces)} forces, {100 * split:g} % split")
        for seed in range(seeds):
            truth = make(seed, split)
            frfs = truth.frfs(forces, lines_hz, SNR_DB[seed % len(SNR_DB)], seed)
            inside = (truth.frequency_hz > band_hz[0]) & (truth.frequency_hz < band_hz[1])
            seen = Truth(*(part[inside] for part in vars(truth).values()))
            bound = partial(seen.plane_bound, frfs)
            score.add(timed(score, frfs, band_hz), *vars(seen).values(), bound)
        yield score


def rings(seeds: int, *, known: bool) -> Score:
    """Rings with forces at 0° and 13°, as such or with nodes in the place of angles."""
    score, band_hz = (
        Score(f"ring, 0° and 13°{'' if known else ', as any structure'}"),
        (60.0, 240.0),
    )
    for seed in range(seeds):
        modes = ring(seed, SPLITS[seed % len(SPLITS)])
        frfs = ring_frfs(modes, SNR_DB[seed % len(SNR_DB)], seed)
        if not known:
            nodes, nowhere = np.arange(1, 25), np.full(24, np.nan)
            frfs = tuple(
                replace(frf, node=nodes, position_deg=nowhere, excitation_deg=np.nan)
                for frf in frfs
            )
        hz = np.array([mode.frequency_hz for mode in modes])
        ratio = np.array([mode.damping_ratio for mode in modes])
        inside = (hz > band_hz[0]) & (hz < band_hz[1])
        noise = [float(frf.std[0, 0]) for frf in frfs]
        bounds = ring_bound(modes, frfs[0].frequency_hz, RING_DEG, RING_FORCES_DEG, noise)[inside]
        truth = hz[inside], ratio[inside], np.zeros(0), np.full(inside.sum(), np.nan)
        score.add(timed(score, References(frfs), band_hz), *truth, bounds=bounds)
    return score


def at_once(seeds: int) -> Score:
    """Recordings of two random forces at the same time on a tyre."""
    score, band_hz = Score("ring, two forces at once"), (60.0, 200.0)
    for seed in range(seeds):
        with tempfile.TemporaryDirectory() as place:
            folder = rm.simulate_campaign(
                Path(place) / "campaign",
                seed=seed,
                duration_s=30.0,
                split_percent=(0.5, 1.0, 2.0)[seed % 3],
                force_deg=(0.0, 22.5),
                at_once=True,
            )
            frfs = rm.estimate_frf(rm.read_campaign(folder))
            truth = tomllib.loads((folder / "truth.toml").read_text())["modes"]
        inside = [each for each in truth if band_hz[0] < each["frequency_hz"] < band_hz[1]]
        hz, ratio = (
            np.array([each[name] for each in inside]) for name in ("frequency_hz", "damping_ratio")
        )
        found = timed(score, frfs, band_hz)
        score.add(found, hz, ratio, np.zeros(0), np.full(hz.size, np.nan))
    return score


def laboratory(seeds: int) -> Score:
    """Uneven tyres, sensors off their places and gains, with and without mass, and a drift."""
    score, band_hz = Score("laboratory, 0° and 13°"), (50.0, 250.0)
    for seed in range(seeds):
        rng = np.random.default_rng([seed, 777])
        effects = Effects(
            seed=400 + seed,
            duration_s=30.0,
            further_forces_deg=(13.0,),
            splice=rng.uniform(0, 0.01),
            stiffness_variation=float(np.exp(rng.uniform(np.log(0.001), np.log(0.03)))),
            mass_variation=rng.uniform(0, 0.006),
            damping_variation=rng.uniform(0, 0.2),
            temperature_drift=rng.normal(0, 0.003),
            sensor_mass_kg=rng.uniform(0.001, 0.005) * (seed % 2),
            angle_error_deg=rng.uniform(0, 0.5),
            gain_error=rng.uniform(0, 0.02),
            tilt_deg=rng.uniform(0, 2),
            snr_db=rng.uniform(25, 50),
            force_snr_db=60.0,
        )
        tyre = Laboratory(effects)
        campaign, mass = tyre.campaign(), None
        if campaign.sensor_mass_kg is not None:
            mass = rm.SensorMass(campaign.sensor_mass_kg, sensors_of_runs(campaign), 0.0)
        frfs = rm.estimate_frf(campaign)
        ring = [mode for mode in tyre.truth.modes if mode.kind == "ring" and mode.order > 0]
        inside = [mode for mode in ring if band_hz[0] < mode.frequency_hz < band_hz[1]]
        hz = np.array([mode.frequency_hz for mode in inside])
        ratio = np.array([mode.damping_ratio for mode in inside])
        found = [m for m in timed(score, frfs, band_hz, mass) if m.member]
        score.add(found, hz, ratio, np.zeros(0), np.full(hz.size, np.nan))
    return score


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=6)
    parser.add_argument("--only", default="", help="plate, aircraft, ring, any, once or lab")
    asked = parser.parse_args()
    print(
        f"{'':30s} true miss  inv  f % med    max  ζ % med   max  covered  worst  plane  mass  time"
    )
    for name in ("plate", "aircraft"):
        if asked.only in ("", name):
            for score in structures(name, asked.seeds):
                print(score.line(), flush=True)
    if asked.only in ("", "any"):
        print(rings(asked.seeds, known=False).line(), flush=True)
    if asked.only in ("", "ring"):
        print(rings(asked.seeds, known=True).line(), flush=True)
    if asked.only in ("", "once"):
        print(at_once(min(asked.seeds, 3)).line(), flush=True)
    if asked.only in ("", "lab"):
        print(laboratory(asked.seeds).line(), flush=True)


if __name__ == "__main__":
    main()
