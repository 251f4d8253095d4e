"""Virtual campaigns: recordings of a tyre whose modes are known."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import scipy
import tomlkit

from ema.core.errors import InputError
from ema.core.recording import ACCELERATION, FORCE, Channel
from ema.io.text.csv import write_csv
from ema.io.uff.write import write_time_series
from model.parameters import DESIGNATION, TABLE_4_RING, RingParameters
from pipelines.simulate.truth import (
    HIGHEST_ORDER,
    Complexes,
    Floats,
    ModalSum,
    TruthMode,
    modal_sum,
    truth_modes,
)
from pipelines.storage.atomic import written_whole
from pipelines.storage.checksums import sha256

POSITIONS = 72
N_RUNS = 6
N_SENSORS = 12
REFERENCE, REFERENCE_DEG, REFERENCE_NODE = "REF", 2.5, 999

FORCE_RMS_N = 10.0
FORCE_BAND_HZ = (10.0, 900.0)
PRELOAD_N = 50.0
FORCE_NOISE_DB = 60.0
HUM_HZ = 50.0
HUM_OVER_NOISE = 0.3
OFFSET_M_S2 = 0.2
_SETTLING_S = 2.0
# Ranges far beyond any tyre, sensor and noise.
_LIMITS = {
    **{"seed": (0, math.inf), "snr_db": (-300.0, math.inf), "split_percent": (-50.0, 50.0)},
    **{"shaker_between": (0.0, 1.0), "sensor_mass_kg": (0.0, 1.0), "drift_percent": (-10.0, 10.0)},
    "sampling_rate_hz": (2.0 * FORCE_BAND_HZ[1] + 1.0, math.inf),
}
MOST_SAMPLES = 10_000_000  # 80 minutes at 2 kHz; a run is made in memory
SAMPLE = Path("sample_data") / "tyre_225_55R17"

_Random = np.random.Generator


@dataclass(frozen=True)
class Setup:
    """How a simulated campaign is measured.

    Parameters
    ----------
    seed : int
        Of the random numbers.
    duration_s, sampling_rate_hz : float
        Length of each run and sampling rate.
    snr_db : float
        Mean response over the noise of each sensor, rms, dB; all sensors have the same noise.
    split_percent, shaker_between : float
        Split of each order and the shaker's place in it, see `truth_modes`.
    sensor_mass_kg : float
        Mass of each accelerometer, kg.
    drift_percent : float
        Rise of all natural frequencies from one run to the next, percent.
    force_deg : tuple of float
        Where forces act: one after the other in six runs each, or `at_once` in all of them.
    at_once : bool
        Whether they act at the same time, each with a noise of its own.
    """

    seed: int = 1
    duration_s: float = 20.0
    sampling_rate_hz: float = 2000.0
    snr_db: float = 34.0
    split_percent: float = 0.0
    shaker_between: float = 0.5
    sensor_mass_kg: float = 0.0
    drift_percent: float = 0.0
    force_deg: tuple[float, ...] = (0.0,)
    at_once: bool = False

    def __post_init__(self) -> None:
        for name, (least, most) in _LIMITS.items():
            value = getattr(self, name)
            if not least <= value <= most:
                rule = f"must be {least:g} to {most:g}"
                raise InputError(name, f"{value:g}", rule, "Correct the value")
        turned = [angle % 360.0 for angle in self.force_deg]  # NaN and infinity stay different
        if not turned or len(set(turned)) < len(turned) or not np.all(np.isfinite(turned)):
            rule = "forces need different angles in degrees"
            raise InputError("force_deg", f"{self.force_deg}", rule, "Write e.g. 0 and 22.5")
        samples = self.duration_s * self.sampling_rate_hz
        if not 1 <= samples <= MOST_SAMPLES:
            found = f"{self.duration_s:g} s at {self.sampling_rate_hz:g} Hz, {samples:.3g} samples"
            rule = f"a run has 1 to {MOST_SAMPLES} samples of each channel"
            raise InputError("duration_s", found, rule, "Change the length of the runs or the rate")

    @property
    def n_samples(self) -> int:
        """Samples per channel."""
        return round(self.duration_s * self.sampling_rate_hz)

    @property
    def forces_of_runs(self) -> list[dict[str, float]]:
        """Angle of each force by its channel, run by run."""
        if not self.at_once:
            return [{FORCE: angle} for angle in self.force_deg for _ in range(N_RUNS)]
        numbered = enumerate(self.force_deg, start=1)
        return [{f"{FORCE}_{number}": angle for number, angle in numbered}] * N_RUNS

    @property
    def options(self) -> dict[str, Any]:
        """What was chosen; forces only where they are not one at 0 degrees."""
        told = asdict(self)
        if self.force_deg == (0.0,) and not self.at_once:
            del told["force_deg"], told["at_once"]
        return told


def simulate_campaign(
    folder: Path | str,
    *,
    seed: int = 1,
    duration_s: float = 20.0,
    sampling_rate_hz: float = 2000.0,
    snr_db: float = 34.0,
    file_format: Literal["uff", "csv"] = "uff",
    split_percent: float = 0.0,
    shaker_between: float = 0.5,
    sensor_mass_kg: float = 0.0,
    drift_percent: float = 0.0,
    force_deg: Sequence[float] = (0.0,),
    at_once: bool = False,
) -> Path:
    """Write a campaign of six runs for each force on a tyre with known modes and return its folder.

    Twelve sensors at 30° spacing are turned by 5° from run to run, so that the runs cover 72
    positions; a thirteenth stays at 2.5°. A random force with a preload acts at 0°, or several at
    `force_deg`, one after the other or `at_once`. Responses are the force times the exact inertance
    in the frequency domain, over a period longer than the recording, so there is neither time
    stepping nor a transient. Noise, hum and offsets are added.

    Parameters
    ----------
    folder : Path or str
        New or empty folder. Gets ``config_1`` … ``config_6``, ``campaign.toml``, ``README.md`` and
        ``truth.toml``, which the processing never reads; written atomically.
    seed : int
        The same seed and options give the same bytes.
    file_format : {"uff", "csv"}
        Universal file 58b in single precision, or a table of text.
    duration_s, sampling_rate_hz, snr_db, split_percent, shaker_between, drift_percent : float
        As in `Setup`.
    force_deg, at_once : sequence of float, bool
        As in `Setup`.
    sensor_mass_kg : float
        Mass of each sensor, which loads the tyre; written to the manifest.

    Raises
    ------
    InputError
        If the folder is not empty or cannot be written, or an option is out of range.

    Examples
    --------
    >>> import ringmodal as rm
    >>> folder = rm.simulate_campaign("virtual_tyre", duration_s=2.0, snr_db=40.0)
    >>> rm.read_campaign(folder)
    <Campaign virtual_tyre: 6 runs with 72 responses, tyre 225/55R17>
    """
    folder = Path(folder)
    pair = split_percent, shaker_between
    forces = tuple(map(float, force_deg)), at_once
    noise = seed, duration_s, sampling_rate_hz, snr_db
    setup = Setup(*noise, *pair, sensor_mass_kg, drift_percent, *forces)
    if file_format not in ("uff", "csv"):
        rule = "must be uff or csv"
        raise InputError("file_format", repr(file_format), rule, "Choose one of them")
    both = setup.force_deg != (0.0,)
    modes = truth_modes(split_percent=split_percent, shaker_between=shaker_between, both=both)
    write = write_time_series if file_format == "uff" else write_csv
    with written_whole(folder, marker=None) as partial:
        forces_of_runs = setup.forces_of_runs
        names = [f"config_{run + 1}.{file_format}" for run in range(len(forces_of_runs))]
        for name, channels in zip(names, simulate_runs(modes, setup), strict=True):
            write(partial / name, channels, sampling_rate_hz)
        places = {name: _positions_deg(run) for run, name in enumerate(names)}
        manifest = manifest_text(
            DESIGNATION,
            TABLE_4_RING,
            sampling_rate_hz,
            places,
            forces_deg=dict(zip(names, forces_of_runs, strict=True)),
            sensor_mass_kg=sensor_mass_kg,
        )
        truth = {"schema": 1, "setup": setup.options, "modes": [asdict(mode) for mode in modes]}
        write_text(partial / "campaign.toml", manifest)
        write_text(partial / "truth.toml", tomlkit.dumps(truth))
        write_text(partial / "README.md", _readme(partial, names, setup))
    return folder


def simulate_runs(modes: tuple[TruthMode, ...], setup: Setup) -> Iterator[list[Channel]]:
    """Channels run by run: the forces, the turned sensors, the reference."""
    for run, forces_deg in enumerate(setup.forces_of_runs):
        random = np.random.default_rng([setup.seed, run])
        factor = 1.0 + setup.drift_percent / 100.0 * run
        drifted = tuple(replace(mode, frequency_hz=factor * mode.frequency_hz) for mode in modes)
        yield _simulate_run(drifted, _positions_deg(run), forces_deg, setup, random)


def _positions_deg(run: int) -> dict[str, float]:
    """Angle of each sensor in a run; they are turned again for each force."""
    run %= N_RUNS
    step = 360.0 / POSITIONS
    spacing = 360.0 / N_SENSORS
    turned = {f"A{k + 1:02d}": spacing * k + step * run for k in range(N_SENSORS)}
    return turned | {REFERENCE: REFERENCE_DEG}


def _simulate_run(
    modes: tuple[TruthMode, ...],
    positions_deg: dict[str, float],
    forces_deg: dict[str, float],
    setup: Setup,
    random: _Random,
) -> list[Channel]:
    rate, kept = setup.sampling_rate_hz, setup.n_samples
    period = scipy.fft.next_fast_len(kept + round(_SETTLING_S * rate), real=True)
    omega = 2.0 * np.pi * np.arange(period // 2 + 1) * rate / period
    angles = np.array(list(positions_deg.values()))
    forces: dict[str, Floats] = {}
    driven: list[tuple[Complexes, ModalSum]] = []
    for name, force_deg in forces_deg.items():
        spectrum = scaled(noise_spectrum(omega, FORCE_BAND_HZ, random), FORCE_RMS_N, period)
        force = scipy.fft.irfft(spectrum, period)[-kept:] + PRELOAD_N
        force += FORCE_RMS_N * 10.0 ** (-FORCE_NOISE_DB / 20.0) * random.standard_normal(kept)
        forces[name] = force
        system = modal_sum(modes, angles, force_deg, sensor_mass_kg=setup.sensor_mass_kg)
        driven.append((spectrum, system))
    responses = (
        sum(spectrum * system.inertance(row, omega) for spectrum, system in driven)
        for row in range(angles.size)
    )
    clean = [scipy.fft.irfft(each, period)[-kept:].astype(np.float32) for each in responses]
    noise = float(np.mean([np.std(signal, dtype=float) for signal in clean]))
    noise *= 10.0 ** (-setup.snr_db / 20.0)
    signals = [signal + _disturbance(noise, kept, rate, random) for signal in clean]
    return channels_of(forces, signals, positions_deg)


def channels_of(
    forces: Mapping[str, Floats], signals: Iterable[Floats], positions_deg: Mapping[str, float]
) -> list[Channel]:
    """Forces and accelerations at declared angles in single precision."""
    channels = [
        Channel(name, FORCE, "N", force.astype(np.float32)) for name, force in forces.items()
    ]
    for (name, angle), signal in zip(positions_deg.items(), signals, strict=True):
        node = REFERENCE_NODE if name == REFERENCE else round(angle * POSITIONS / 360.0)
        samples = signal.astype(np.float32)
        channels.append(Channel(name, ACCELERATION, "m/s^2", samples, node=node))
    return channels


def noise_spectrum(omega: Floats, band_hz: tuple[float, float], random: _Random) -> Complexes:
    """Gaussian noise within the band, zero outside."""
    low, high = (2.0 * np.pi * limit for limit in band_hz)
    inside = (omega >= low) & (omega <= high)
    spectrum = np.zeros(omega.size, dtype=complex)
    spectrum[inside] = random.standard_normal((np.count_nonzero(inside), 2)) @ [1.0, 1j]
    return spectrum


def scaled(spectrum: Complexes, rms: float, period: int) -> Complexes:
    """A spectrum of `period` samples, scaled to the given rms over time."""
    factor = rms * period / np.sqrt(2.0 * np.sum(np.abs(spectrum) ** 2))
    return np.asarray(factor * spectrum)


def _disturbance(noise: float, n_samples: int, rate: float, random: _Random) -> Floats:
    """Sensor noise, mains hum and offset of one sensor, m/s²."""
    phase = random.uniform(0.0, 2.0 * np.pi)
    offset = OFFSET_M_S2 * random.standard_normal()
    time = np.arange(n_samples) / rate
    hum = np.sqrt(2.0) * HUM_OVER_NOISE * noise * np.sin(2.0 * np.pi * HUM_HZ * time + phase)
    return np.asarray(noise * random.standard_normal(n_samples) + hum + offset)


def write_text(path: Path, text: str) -> None:
    """Write UTF-8 with the line ends of every system alike."""
    path.write_text(text, encoding="utf-8", newline="\n")


def manifest_text(
    designation: str,
    ring: RingParameters,
    sampling_rate_hz: float,
    positions_deg: Mapping[str, Mapping[str, float]],
    *,
    forces_deg: Mapping[str, Mapping[str, float]],
    sensor_mass_kg: float = 0.0,
) -> str:
    """Manifest of simulated recordings with the angles of sensors and forces, by file and channel.

    Channels of forces are the same in all runs.
    """
    names = ("inflation_pressure_pa", "mean_radius_m", "belt_width_m")
    tyre = {"designation": designation, **{name: getattr(ring, name) for name in names}}
    sensors = {"sensors": {"mass_kg": sensor_mass_kg}} if sensor_mass_kg else {}
    usual = next(iter(forces_deg.values()))
    excitation: list[dict[str, Any]] = [
        {"channel": channel, "position_deg": angle, "direction": "radial"}
        for channel, angle in usual.items()
    ]
    runs = []
    for name, places in positions_deg.items():
        run = {"file": name, "reference": REFERENCE, "positions_deg": _inline(places)}
        if forces_deg[name] != usual:
            run["excitation"] = _inline({"position_deg": forces_deg[name][FORCE]})
        runs.append(run)
    content = {
        "schema": 1,
        "tyre": {**tyre, "origin": "simulated, see README.md"},
        "acquisition": {"sampling_rate_hz": sampling_rate_hz},
        **sensors,
        "grid": {"positions": POSITIONS},
        "excitation": excitation if len(excitation) > 1 else excitation[0],
        "runs": runs,
    }
    return tomlkit.dumps(content)


def _inline(values: Mapping[str, float]) -> Any:
    table = tomlkit.inline_table()
    table.update(values)
    return table


def _readme(folder: Path, names: list[str], setup: Setup) -> str:
    listed = [*names, "campaign.toml", "truth.toml"]
    sums = "\n".join(f"{sha256(folder / name)}  {name}" for name in listed)
    options = "\n".join(f"- `{name}`: {_told(value)}" for name, value in setup.options.items())
    places = " and ".join(f"{angle:g}°" for angle in setup.force_deg)
    n_runs = len(setup.forces_of_runs)
    way = ", at the same time" if setup.at_once else ", one after the other"
    at = places + (way if len(setup.force_deg) > 1 else "")
    return f"""# Simulated campaign on a tyre {DESIGNATION}

These recordings were not measured: `ringmodal simulate campaign` computed them from known modes.

**Truth.** Orders 1 to 7 have the natural frequencies and damping ratios of Table 3 of the paper
that ringmodal implements; orders 8 to {HIGHEST_ORDER} and the breathing mode are those of
its ring (Table 4, 2.2 bar, belt width 0.19 m) with damping refitted to Table 3. Modal masses are
those of the ring. `truth.toml` lists every mode; the processing never reads it.

**Set-up.** {n_runs} runs of {setup.duration_s:g} s at {setup.sampling_rate_hz:g} Hz. `force`: a
random force of {FORCE_RMS_N:g} N rms in {FORCE_BAND_HZ[0]:g}–{FORCE_BAND_HZ[1]:g} Hz at {at}, on a
preload of {PRELOAD_N:g} N, in N. `A01` … `A{N_SENSORS}`: radial acceleration in m/s², 30° apart,
turned by 5° from run to run. `REF`: the sensor that stays at {REFERENCE_DEG}°, in m/s². Responses
carry noise, {HUM_HZ:g} Hz hum ({HUM_OVER_NOISE:g} of the noise, rms) and an offset; the load cell
carries noise {FORCE_NOISE_DB:g} dB below the force.

{options}

**Files.** In universal files (58b, single precision) node k lies at 5k degrees and the reference
has node {REFERENCE_NODE}. SHA-256:

```
{sums}
```
"""


def _told(value: Any) -> str:
    return ", ".join(f"{each:g}" for each in value) if isinstance(value, tuple) else f"{value:g}"


def sample_campaign(folder: Path | str = "sample_campaign") -> Path:
    """The sample campaign of the project's folder; simulated into `folder` if that is missing.

    Examples
    --------
    >>> import ringmodal as rm
    >>> (rm.sample_campaign() / "campaign.toml").is_file()
    True
    """
    folder = Path(folder)
    for root in (Path.cwd(), Path(__file__).resolve().parents[2]):
        if (root / SAMPLE / "campaign.toml").is_file():
            return root / SAMPLE
    if not (folder / "campaign.toml").is_file():
        simulate_campaign(folder)
    return folder
