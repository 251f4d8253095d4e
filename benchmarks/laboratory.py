"""How well the modes of a laboratory tyre are identified, effect by effect.

    python benchmarks/laboratory.py --seeds 3 --only "shaker interaction" "12 bits"

Prints one row of a Markdown table for each effect: the identification, and beside it one pole per
order picked at the true frequency, from sdypy-EMA (LSCF, order 60) where the extra ``benchmark`` is
installed, otherwise from the program's own p-LSCF.
"""

from __future__ import annotations

import argparse
import itertools
import sys
import time
import warnings
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from laboratory_scoring import Match, Order, Row, Score, orders_of, score

import ema
from ema.checks.sensor_mass import sensors_of_runs, without_mass
from ema.checks.steady_runs import without_changes_within_runs
from ema.core.campaign import Campaign
from ema.core.errors import FitError, InputError
from ema.core.frf import FRF
from ema.signals.leakage import without_left_out_lines
from ema.signals.steadiness import steadiness_of
from pipelines.simulate.laboratory import Laboratory, LaboratoryMode
from pipelines.simulate.laboratory_effects import Effects

BAND_HZ = (20.0, 260.0)
LARGE_Z = 5.0
# Reach around the true frequency of the toolbox's poles, and shares up to which they agree.
COLUMN, STABLE_FREQUENCY, STABLE_DAMPING = 0.006, 0.001, 0.05
UNCHANGED = 1e-6  # relative change of a row that is no change

UNEVEN = {"splice": 0.002, "stiffness_variation": 0.005, "mass_variation": 0.003}
PAIRED = {**UNEVEN, "snr_db": 40.0}

#: The table of effects; every set of options on top of `PAIRED`, unless it says otherwise.
EFFECTS: dict[str, dict[str, Any]] = {
    "ideal tyre and test": dict.fromkeys(UNEVEN, 0.0) | {"snr_db": 60.0},
    "uneven tyre": {},
    "very uneven tyre": {"splice": 0.01, "stiffness_variation": 0.03, "mass_variation": 0.01},
    "complex modes": {"damping_variation": 0.3},
    "shaker interaction": {"shaker": True},
    "force noise 30 dB": {"force_snr_db": 30.0},
    "response noise 20 dB": {"snr_db": 20.0},
    "low-frequency noise, hum": {"floor": 0.03, "hum": 0.1},
    "angles ±0.5°": {"angle_error_deg": 0.5},
    "tilt 3°": {"tilt_deg": 3.0},
    "gains 2 %, delays 20 µs": {"gain_error": 0.02, "delay_us": 20.0},
    "12 bits": {"bits": 12},
    "clipped at 5 rms": {"clip": 5.0},
    "4 g sensors, declared": {"sensor_mass_kg": 0.004},
    "4 g sensors, not declared": {"sensor_mass_kg": 0.004, "declare_mass": False},
    "10 g live mass": {"live_mass_kg": 0.01},
    "rim on its fixture": {"rim_hz": (42.0, 60.0)},
    "rim on a stiff fixture": {"rim_hz": (80.0, 65.0)},
    "rim, force between its axes": {"rim_hz": (57.0, 139.0), "force_deg": 30.0},
    "lateral modes and cavity": {"lateral_hz": (48.0, 131.0), "cavity_coupling": 0.1},
    "pressure +0.5 %": {"pressure_drift": 0.005},
    "pressure +2 %": {"pressure_drift": 0.02},
    "temperature +0.6 %": {"temperature_drift": 0.006},
    "temperature +0.9 %, damping −6 %": {"temperature_drift": 0.009, "temperature_damping": -0.06},
    "drift 1 % within a run": {"drift_within": 0.01},
    "pressure 2 % within a run": {"pressure_drift_within": 0.02},
    "softening 1 %": {"softening": 0.01},
    "level +10 dB, softening 0.5 %": {"softening": 0.005, "level_step_db": 10.0},
    "pink force": {"excitation": "pink"},
    "bursts": {"excitation": "burst"},
    "sweeps": {"excitation": "sweep"},
    "hammer, hit every 2 s": {"excitation": "hammer", "hits": 15},
    "hammer, hit every 5 s": {"excitation": "hammer", "hits": 6},
    "hammer with double hits": {"excitation": "hammer", "hits": 15, "double_hits": 0.2},
    "half circle": {"circle_deg": (0.0, 165.0), "runs": 1},
    "a dead sensor": {"dead_sensor": 4},
    "a sensor of wrong sign": {"flipped_sensor": 4},
    "a sensor that reads half": {"scaled_sensor": 4},
    "two sensors swapped": {"swapped_sensor": 4},
    "turned the other way": {"mirrored_step": True},
    "sensors counted the other way": {"reversed_sequence": True},
    "run 2 off by 5°": {"offset_deg": 5.0},
    "force off by 5°": {"force_offset_deg": 5.0},
    "8 s, one run": {"duration_s": 8.0, "runs": 1, "snr_db": 70.0},
    "stiff tyre, rate 1024 Hz": {"stiffness": 1.44, "sampling_rate_hz": 1024.0},
    "many at once": {
        "splice": 0.004, "stiffness_variation": 0.01, "damping_variation": 0.3,
        "mass_variation": 0.005, "lateral_hz": (48.0, 131.0), "cavity_coupling": 0.1,
        "sensor_mass_kg": 0.003, "live_mass_kg": 0.01, "shaker": True, "angle_error_deg": 0.5,
        "tilt_deg": 2.0, "gain_error": 0.02, "delay_us": 10.0, "bits": 16, "snr_db": 36.0,
        "force_snr_db": 40.0, "hum": 0.1, "floor": 0.03, "temperature_drift": 0.002,
    },
}  # fmt: skip

#: Name under which `random_options` joins the table.
RANDOM = "random campaigns"

# Sensors that these effects damage are not healthy.
DAMAGED = ("clip",)


@dataclass
class Result:
    """Both methods on one campaign."""

    ours: Score
    toolbox: Score
    touched: int = 0
    faulty: int = 0
    named: int = 0
    warnings: int = 0
    seconds: float = float("nan")
    error: str = ""
    listed: list[str] = field(default_factory=list)


def random_options(seed: int) -> dict[str, Any]:
    """A realistic campaign with several effects at once."""
    random = np.random.default_rng([seed, 99])

    def maybe(share: float, value: Any) -> Any:
        return value if random.uniform() < share else type(value)()

    drawn = {
        "splice": maybe(0.7, random.uniform(0, 0.01)),
        "stiffness_variation": float(np.exp(random.uniform(np.log(0.001), np.log(0.03)))),
        "mass_variation": maybe(0.7, random.uniform(0, 0.01)),
        "damping_variation": maybe(0.7, random.uniform(0, 0.3)),
        "rim_hz": maybe(0.2, (random.uniform(35, 50), random.uniform(50, 65))),
        "lateral_hz": maybe(0.3, (random.uniform(40, 55), random.uniform(120, 140))),
        "cavity_coupling": maybe(0.3, random.uniform(0.02, 0.12)),
        "temperature_drift": maybe(0.3, random.normal(0, 0.003)),
        "pressure_drift": maybe(0.3, random.normal(0, 0.005)),
        "excitation": random.choice(["random", "pink", "burst", "hammer"], p=[0.7, 0.1, 0.1, 0.1]),
        "hits": int(random.integers(8, 20)),
        "shaker": maybe(0.5, True),
        "sensor_mass_kg": maybe(0.5, random.uniform(0.001, 0.005)),
        "angle_error_deg": maybe(0.5, random.uniform(0, 0.5)),
        "tilt_deg": maybe(0.5, random.uniform(0, 3)),
        "gain_error": maybe(0.5, random.uniform(0, 0.02)),
        "delay_us": maybe(0.5, random.uniform(0, 20)),
        "snr_db": random.uniform(20, 55),
        "force_snr_db": random.uniform(30, 80),
        "floor": maybe(0.5, random.uniform(0, 0.05)),
        "hum": maybe(0.5, random.uniform(0, 0.1)),
        "bits": int(random.choice([12, 16, 24])),
    }
    fixture = np.random.default_rng([seed, 100])
    if drawn["rim_hz"] and fixture.uniform() < 0.5:  # stiffer, and driven between its axes
        drawn["rim_hz"] = (fixture.uniform(35, 150), fixture.uniform(35, 150))
        drawn["force_deg"] = float(fixture.choice([0.0, 15.0, 30.0, 45.0]))
    return drawn | ({"shaker": False} if drawn["excitation"] == "hammer" else {})


def measure(options: dict[str, Any], seed: int, duration_s: float, *, toolbox: bool) -> Result:
    """Simulate one seed of an effect and identify it."""
    effects = Effects(**{"duration_s": duration_s, **PAIRED, **options, "seed": seed})
    laboratory = Laboratory(effects)
    campaign = laboratory.campaign()
    frf = ema.estimate_frf(campaign)
    truth = laboratory.truth.modes
    result = Result(Score(), Score())
    faulty = {f"A{number:02d}" for number in effects.faulty_sensors}
    start = time.perf_counter()
    try:
        found = ema.identify_modes(frf, BAND_HZ, sensor_mass=_sensor_mass(campaign))
    except (FitError, InputError) as error:
        result.error = str(error)
    else:
        result.seconds = time.perf_counter() - start
        steadiness = steadiness_of(campaign.runs, found.frf, found.model)
        model = without_changes_within_runs(found.model, steadiness)
        rows = [Row.of(mode) for mode in model.modes]
        result.ours = score(truth, rows, BAND_HZ)
        result.warnings = sum(not finding.is_ok for finding in found.findings)
        if not any(getattr(effects, name) for name in DAMAGED):
            result.touched = touched(campaign, frf, found, faulty)
        named = {finding.channel for finding in found.findings if not finding.is_ok}
        result.faulty, result.named = len(faulty), len(faulty & named)
    result.listed = complaints(result.ours)
    if toolbox:
        mean = mean_modes(laboratory)
        result.toolbox = _picked(frf, orders_of(mean, BAND_HZ))
    return result


def touched(campaign: Campaign, frf: FRF, found: ema.Identification, faulty: set[str]) -> int:
    """Healthy channels whose FRF is absent from the result or is not the measured one."""
    expected = without_mass(without_left_out_lines(frf), found.sensor_mass)
    angles = {float(angle): row for row, angle in enumerate(found.frf.position_deg)}
    healthy = [row for row, name in enumerate(frf.channel) if name not in faulty]
    places = [(row, angles.get(float(expected.position_deg[row]))) for row in healthy]
    return sum(
        place is None or not _is_same(expected.values[row], found.frf.values[place])
        for row, place in places
    )


def _is_same(first: np.ndarray, second: np.ndarray) -> bool:
    gain = np.vdot(first, second) / np.vdot(first, first)
    return bool(abs(gain - 1) < UNCHANGED)


def _sensor_mass(campaign: Campaign) -> ema.SensorMass | None:
    if campaign.sensor_mass_kg is None:
        return None
    return ema.SensorMass(
        campaign.sensor_mass_kg, sensors_of_runs(campaign), campaign.excitation_deg or 0.0
    )


def mean_modes(laboratory: Laboratory) -> tuple[LaboratoryMode, ...]:
    """Modes with the poles of all runs averaged: what one state for all runs can be at best."""
    truth = laboratory.truth.modes
    runs = [laboratory.bare_modes(run) for run in range(laboratory.effects.runs)]
    if any(len(modes) != len(truth) for modes in runs):
        return truth
    poles = np.array([[mode.pole for mode in modes] for modes in runs]).mean(axis=0)
    return tuple(
        replace(
            mode,
            frequency_hz=float(abs(pole) / (2 * np.pi)),
            damping_ratio=float(-pole.real / abs(pole)),
        )
        for mode, pole in zip(truth, poles, strict=True)
    )


def _picked(frf: FRF, orders: list[Order]) -> Score:
    """One pole per order: nearest to the true frequency of those that model orders agree on."""
    try:
        from peer import poles_of_orders
    except ImportError:
        diagram = ema.build_stability(frf, BAND_HZ, max_order=60, method="plscf")
        poles = [diagram.poles[diagram.model_order == n] for n in np.unique(diagram.model_order)]
    else:
        poles = poles_of_orders(frf, "lscf")
    poles = poles[len(poles) // 2 :]  # low orders are biased
    stable = np.concatenate(
        [now[_agreeing(now, before) > 0] for before, now in itertools.pairwise(poles)]
    )
    pairs = []
    for target in [one.main for one in orders]:
        off = np.abs(np.abs(stable) / (2 * np.pi * target.frequency_hz) - 1)
        column = stable[off < COLUMN]
        if column.size:
            support = _agreeing(column, column)
            column = column[support >= 0.8 * support.max()]
            pole = column[np.argmin(np.abs(np.abs(column) / (2 * np.pi) - target.frequency_hz))]
            pairs.append(Match(target, Row(abs(pole) / (2 * np.pi), -pole.real / abs(pole))))
    return Score(pairs)


def _agreeing(poles: np.ndarray, others: np.ndarray) -> np.ndarray:
    """For each pole, how many others agree with it."""
    size, ratio = np.abs(poles)[:, None], (-poles.real / np.abs(poles))[:, None]
    near = np.abs(np.abs(others) / size - 1) < STABLE_FREQUENCY
    alike = np.abs(-others.real / np.abs(others) / ratio - 1) < STABLE_DAMPING
    return np.count_nonzero(near & alike & (ratio > 0), axis=1)


HEADER = (
    "| effect | missed | invented (doubted) | mislabelled | healthy channels touched "
    "| faulty named | warnings "
    "| frequency error, %: worst, median | toolbox | damping error, %: worst, median | toolbox "
    "| other rows: frequency, damping | 95 % cover: f, ζ "
    "| largest error/σ: main, other rows | s |\n" + "|---" * 15 + "|"
)


def table_row(name: str, results: list[Result]) -> str:
    """One effect over its seeds."""
    matches = [match for result in results for match in result.ours.matches]
    invented = [row for result in results for row in result.ours.invented]
    main = [match for match in matches if match.is_main]
    other = [match for match in matches if not match.is_main]
    z = np.abs([match.z for match in matches]).reshape(-1, 2)
    refused = sum(bool(result.error) for result in results)
    cells = [
        name + (f" ({refused} refused)" if refused else ""),
        str(sum(len(result.ours.missed) for result in results)),
        f"{len(invented)} ({sum(row.doubtful for row in invented)})",
        str(sum(match.is_mislabelled for match in matches)),
        str(sum(result.touched for result in results)),
        f"{sum(result.named for result in results)} of {sum(result.faulty for result in results)}",
        str(sum(result.warnings for result in results)),
        *compared_errors(results),
        ", ".join(_worst(_errors(other))),
        ", ".join(f"{np.mean(part[np.isfinite(part)] < 1.96):.0%}" for part in z.T)
        if len(z)
        else "–",
        f"{_largest_z(main)}, {_largest_z(other)}",
        f"{np.mean([result.seconds for result in results]):.1f}",
    ]
    return "| " + " | ".join(cells) + " |"


def compared_errors(results: list[Result]) -> list[str]:
    """Worst and median errors of frequency and damping, ours and the toolbox's of the same modes.

    The toolbox lists one mode for each order; where it has none, or none with one damping, the
    order is not compared. Without the toolbox all orders count.
    """
    ours, theirs = [], []
    for result in results:
        picked = {match.target.order: match for match in result.toolbox.matches}
        for match in (match for match in result.ours.matches if match.is_main):
            peer = picked.get(match.target.order)
            if peer is not None or not picked:
                ours.append(match.errors_percent)
                theirs.append(peer.errors_percent if peer else (np.nan, np.nan))
    mine, peers = np.abs(ours).reshape(-1, 2), np.abs(theirs).reshape(-1, 2)
    if np.isfinite(peers).any():
        mine[np.isnan(peers)] = np.nan
    cells = []
    for part, digits in enumerate((3, 2)):
        for errors in (mine[:, part], peers[:, part]):
            known = errors[np.isfinite(errors)]
            text = f"{known.max():.{digits}f}, {np.median(known):.{digits}f}" if known.size else "–"
            cells.append(text)
    return cells


def _errors(matches: list[Match]) -> np.ndarray:
    return np.abs([match.errors_percent for match in matches]).reshape(-1, 2)


def _worst(errors: np.ndarray) -> list[str]:
    if not np.isfinite(errors).any():
        return ["–"]
    return [f"{np.nanmax(part):.{digits}f}" for part, digits in zip(errors.T, (3, 2), strict=True)]


def _largest_z(matches: list[Match]) -> str:
    z = np.abs([match.z for match in matches])
    return f"{np.nanmax(z):.1f}" if np.isfinite(z).any() else "–"


def complaints(found: Score) -> list[str]:
    """What is wrong with a result."""
    lines = [f"missed {target.name} ({target.frequency_hz:.2f} Hz)" for target in found.missed]
    lines += [
        f"invented {row.frequency_hz:.2f} Hz, {row.damping_ratio:.4f}{' (doubted)' * row.doubtful}"
        for row in found.invented
    ]
    for match in found.matches:
        worst = np.nanmax(np.abs([*match.z, 0.0]))
        if match.is_mislabelled or worst > LARGE_Z:
            f, zeta = match.errors_percent
            label = f" labelled {match.row.order}" if match.is_mislabelled else ""
            lines.append(
                f"{match.target.name}{label}: {f:+.3f} %, damping {zeta:+.1f} %, {worst:.0f} σ"
            )
    return lines


def main() -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=3, help="seeds of each effect")
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--duration-s", type=float, default=30.0, help="length of each run")
    parser.add_argument(
        "--only", nargs="+", choices=[*EFFECTS, RANDOM], metavar="EFFECT", help="effects"
    )
    parser.add_argument("--no-toolbox", action="store_true", help="leave the toolbox out")
    parser.add_argument("--list", action="store_true", help="list every error below the table")
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    print(HEADER, flush=True)
    listed = []
    for name in options.only or [*EFFECTS, RANDOM]:
        results = []
        for seed in range(options.first_seed, options.first_seed + options.seeds):
            chosen = random_options(seed) if name == RANDOM else EFFECTS[name]
            result = measure(chosen, seed, options.duration_s, toolbox=not options.no_toolbox)
            results.append(result)
            if result.error:
                print(f"{name}, seed {seed}: {result.error}", file=sys.stderr)
            listed += [f"- {name}, seed {seed}: {line}" for line in result.listed]
        print(table_row(name, results), flush=True)
    if options.list:
        print("\n" + "\n".join(listed))


if __name__ == "__main__":
    main()
