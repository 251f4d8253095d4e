"""Systems with exactly known modes, as frequency responses and as recordings."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ema.core.campaign import Campaign, Processing, Response, Run
from ema.core.drift import Drift
from ema.core.frf import FRF
from ema.core.modes import synthesise
from ema.core.recording import ACCELERATION, FORCE, Channel, Recording
from pipelines.simulate.campaign import FORCE_BAND_HZ, N_RUNS, POSITIONS, REFERENCE_DEG
from pipelines.simulate.truth import modal_sum

TABLE_3_HZ = np.array([78.73, 100.31, 121.40, 145.45, 170.78, 196.52, 224.40])
TABLE_3_DAMPING = np.array([0.039, 0.033, 0.024, 0.022, 0.021, 0.020, 0.018])
BEYOND_HZ = np.array([253.1, 282.9, 313.9, 346.2])  # n = 8 … 11, outside the band of interest
BEYOND_DAMPING = np.full(4, 0.018)
MASS_KG = 4.0

LINES_HZ = np.arange(1, 701) / 2  # of blocks of 2 s
AVERAGES = 124  # of 2 s each: runs of about 250 s
NYQUIST_HZ = 1000.0


@dataclass(frozen=True, eq=False)
class Lumped:
    """Masses, dampers and springs with printed answers, and a grid of lines that shows them."""

    mass: np.ndarray
    damping: np.ndarray
    stiffness: np.ndarray
    printed_hz: tuple[float, ...]
    printed_damping: tuple[float, ...]
    digits_hz: float
    digits_damping: float
    frequency_hz: np.ndarray
    band_hz: tuple[float, float]

    @property
    def poles(self):
        """Eigenvalues of the state matrix in the upper half plane, ascending."""
        n = len(self.mass)
        inverse = np.linalg.inv(self.mass)
        state = np.block(
            [[np.zeros((n, n)), np.eye(n)], [-inverse @ self.stiffness, -inverse @ self.damping]]
        )
        values = np.linalg.eigvals(state)
        values = values[values.imag > 0]
        return values[np.argsort(np.abs(values))]

    def inertance(self, frequency_hz):
        """−ω² (K + jωC − ω²M)⁻¹, the force on the first mass."""
        omega = 2 * np.pi * np.asarray(frequency_hz)[:, None, None]
        dynamic = self.stiffness + 1j * omega * self.damping - omega**2 * self.mass
        return (-(omega**2) * np.linalg.inv(dynamic))[:, :, 0].T

    def frf(self):
        return noise_free_frf(self.frequency_hz, self.inertance(self.frequency_hz))


_COUPLED = np.array([[2.0, -1.0], [-1.0, 2.0]])
THREE_MASSES = Lumped(
    mass=np.eye(3),
    damping=40 * np.eye(3),
    stiffness=np.array([[237315.0, -161e3, 0], [-161e3, 398315.0, -161e3], [0, -161e3, 398315.0]]),
    printed_hz=(52.3528, 90.9642, 123.1862),
    printed_damping=(0.060801, 0.034993, 0.025840),
    digits_hz=0.5e-4,
    digits_damping=0.5e-6,
    frequency_hz=np.arange(1, 800) / 4,
    band_hz=(20.0, 180.0),
)
TWO_MASSES = Lumped(
    mass=np.diag([1, 0.1]),
    damping=0.1 * _COUPLED,
    stiffness=400 * _COUPLED,
    printed_hz=(3.84695, 14.42593),
    printed_damping=(0.0030214, 0.0113301),
    digits_hz=0.5e-5,
    digits_damping=0.5e-7,
    frequency_hz=np.arange(1, 8000) / 200,
    band_hz=(1.0, 30.0),
)


def noise_free_frf(frequency_hz, values, **changes):
    """FRFs at numbered nodes of any structure; nothing is known about their noise."""
    unknown = np.full(values.shape, np.nan)
    parts = {
        "frequency_hz": frequency_hz,
        "values": values,
        "coherence": unknown,
        "std": unknown,
        "node": np.arange(1, len(values) + 1),
        "position_deg": np.full(len(values), np.nan),
        "run": ("run",) * len(values),
    }
    return FRF(**(parts | changes))


def pole(frequency_hz, damping_ratio):
    omega = 2 * np.pi * np.asarray(frequency_hz)
    zeta = np.asarray(damping_ratio)
    return omega * (-zeta + 1j * np.sqrt(1 - zeta**2))


def frequency_hz_of(poles):
    return np.abs(poles) / (2 * np.pi)


def damping_of(poles):
    return -np.real(poles) / np.abs(poles)


def residue(poles, mass_kg=MASS_KG):
    """Residue of a drive point, 1/(2jω_d m), of receptance."""
    return 1 / (2j * np.imag(poles) * mass_kg)


def table_3_poles():
    return pole(np.r_[TABLE_3_HZ, BEYOND_HZ], np.r_[TABLE_3_DAMPING, BEYOND_DAMPING])


def tyre_residues(position_deg, poles=None):
    """Residues of orders 1, 2 … for a force at 0°, (n_positions, n_modes)."""
    poles = table_3_poles() if poles is None else poles
    orders = np.arange(1, len(poles) + 1)
    return np.cos(np.outer(np.deg2rad(position_deg), orders)) * residue(poles)


def inertance(frequency_hz, poles, residues):
    """Inertances of a modal sum without residual terms."""
    zero = np.zeros(len(residues))
    return synthesise(np.asarray(frequency_hz), poles, residues, zero, zero)


def tyre_frf(snr_db=np.inf, averages=100, seed=0, positions=72, frequency_hz=None):
    """FRFs of the paper's Table 3 at equidistant points, orders 8 … 11 outside the band.

    Noise is white over the lines, equal for all sensors, and known: `std` is exact.
    """
    frequency_hz = np.arange(1, 4 * 400) / 4 if frequency_hz is None else frequency_hz
    position_deg = np.arange(positions) * 360 / positions
    clean = inertance(frequency_hz, table_3_poles(), tyre_residues(position_deg))
    rng = np.random.default_rng(seed)
    band = (frequency_hz > 20) & (frequency_hz < 260)
    level = np.sqrt(np.mean(np.abs(clean[:, band]) ** 2)) * 10 ** (-snr_db / 20)
    std = np.full(clean.shape, max(level / np.sqrt(2 * averages), 1e-12))
    noise = std * (rng.standard_normal(clean.shape) + 1j * rng.standard_normal(clean.shape))
    coherence = np.abs(clean) ** 2 / (np.abs(clean) ** 2 + level**2)
    return FRF(
        frequency_hz=frequency_hz,
        values=clean + (noise if np.isfinite(snr_db) else 0),
        coherence=coherence,
        std=std,
        node=np.arange(positions),
        position_deg=position_deg,
        run=("run",) * positions,
    )


def drifting_frf(percent_per_run, snr_db=20, averages=100):
    """The tyre of `tyre_frf` in six runs of twelve sensors, a little stiffer from run to run."""
    still = tyre_frf(snr_db, averages)
    run = np.arange(72) % 6
    values = np.array(still.values)
    residues = tyre_residues(still.position_deg)
    for number in range(1, 6):
        rows = run == number
        drifted = table_3_poles() * (1 + percent_per_run / 100 * number)
        values[rows] += inertance(still.frequency_hz, drifted, residues[rows])
        values[rows] -= inertance(still.frequency_hz, table_3_poles(), residues[rows])
    return replace(still, values=values, run=tuple(f"run_{number}" for number in run))


def white(n_samples, seed, n_rows=None):
    """White noise of variance 1."""
    shape = n_samples if n_rows is None else (n_rows, n_samples)
    return np.random.default_rng(seed).standard_normal(shape)


def responses_to(force, rate_hz, poles, residues):
    """Accelerations that answer a force, one row per row of `residues`; the force is periodic."""
    lines_hz = np.fft.rfftfreq(force.size, 1 / rate_hz)
    spectrum = np.fft.rfft(force)
    return np.fft.irfft(inertance(lines_hz, poles, residues) * spectrum, force.size)


def run_of(
    force,
    responses,
    rate_hz=1000.0,
    *,
    name="run_1.uff",
    position_deg=None,
    node=None,
    reference=None,
):
    """A run whose channels are in memory, in SI."""
    sensors = [
        Channel(f"A{row + 1:02d}", ACCELERATION, "m/s^2", samples)
        for row, samples in enumerate(np.atleast_2d(responses))
    ]
    load_cell = Channel("force", FORCE, "N", np.asarray(force))
    fixed = None if reference is None else Channel("REF", ACCELERATION, "m/s^2", reference)
    channels = (load_cell, *sensors, *([fixed] if fixed else []))
    angles = [None] * len(sensors) if position_deg is None else position_deg
    nodes = range(1, len(sensors) + 1) if node is None else node
    places = tuple(
        Response(channel, int(number), None if angle is None else float(angle))
        for channel, number, angle in zip(sensors, nodes, angles, strict=True)
    )
    return Run(name, Recording(Path(name), rate_hz, channels), load_cell, places, fixed)


def campaign_of(*runs, **processing):
    """A campaign of such runs; `processing` as in `Processing`."""
    return Campaign(name="made", runs=runs, processing=Processing(**processing))


def campaign_frf(
    modes,
    snr_db=np.inf,
    *,
    seed=0,
    drift_percent=(0.0,) * N_RUNS,
    in_state=lambda mode, percent: replace(
        mode, frequency_hz=mode.frequency_hz * (1 + percent / 100)
    ),
    sensor_mass_kg=0.0,
    averages=AVERAGES,
    frequency_hz=LINES_HZ,
):
    """FRFs of a tyre with known modes: six runs of twelve sensors and the fixed reference.

    `in_state` gives a mode in the state of a run, from its drift.

    By default those of independent blocks. Noise is that of a simulated campaign of the same
    `snr_db`; as in a measurement, σ and coherence are estimates that scatter.
    """
    run = np.append(np.arange(POSITIONS) % N_RUNS, np.arange(N_RUNS))
    position_deg = np.append(np.arange(POSITIONS) * 360 / POSITIONS, np.full(N_RUNS, REFERENCE_DEG))
    clean = np.empty((run.size, frequency_hz.size), dtype=complex)
    for number, percent in enumerate(drift_percent):
        state = [in_state(mode, percent) for mode in modes]
        rows = run == number
        clean[rows] = true_inertance(state, position_deg[rows], frequency_hz, sensor_mass_kg)
    rng = np.random.default_rng(seed)
    noise = max(response_level(modes) * 10 ** (-snr_db / 20), 1e-12)
    error = rng.standard_normal((2, *clean.shape)) * noise / np.sqrt(2 * averages)
    left = noise**2 * rng.gamma(averages - 1, 1 / (averages - 1), clean.shape)
    values = clean + error[0] + 1j * error[1]
    power = np.abs(values) ** 2
    frf = FRF(
        frequency_hz=frequency_hz,
        values=values,
        coherence=power / (power + left),
        std=np.sqrt(left / (2 * averages)),
        node=np.append(np.arange(POSITIONS), np.full(N_RUNS, -1)),
        position_deg=position_deg,
        run=tuple(f"run_{number + 1}" for number in run),
        channel=tuple(f"A{k // N_RUNS + 1:02d}" for k in range(POSITIONS)) + ("REF",) * N_RUNS,
        n_effective=float(averages),
        excitation_deg=0.0,
    )
    return replace(frf.rows(np.arange(POSITIONS)), reference=frf.rows(np.arange(POSITIONS, 78)))


def common_drift(run, percent, std_percent, **other):
    """All frequencies of a run shifted alike, damping as it was."""
    nothing = [0.0] * len(run)
    return Drift(run, percent, std_percent, nothing, nothing, nothing, nothing, **other)


def seats_deg():
    """Angles of the thirteen sensors of `campaign_frf` in each run."""
    spacing = np.arange(0, POSITIONS, N_RUNS) * 360 / POSITIONS
    step = 360 / POSITIONS
    return {
        f"run_{run + 1}": np.append(spacing + step * run, REFERENCE_DEG) for run in range(N_RUNS)
    }


def edited(frf, rows, **fields):
    """The FRFs with some rows replaced."""
    changed = {}
    for name, value in fields.items():
        changed[name] = np.array(getattr(frf, name))
        changed[name][rows] = value
    return replace(frf, **changed)


def assert_modes(model, truth, *, frequency=5e-4, damping=0.02):
    """Each of the true modes is found once, within relative bounds, and none besides them."""
    expected = sorted(truth, key=lambda mode: mode.frequency_hz)
    end_hz = expected[-1].frequency_hz * 1.03
    found = [mode for mode in model.modes if mode.frequency_hz < end_hz]
    assert [mode.order for mode in found] == [mode.order for mode in expected]
    for mode, true in zip(found, expected, strict=True):
        assert abs(mode.frequency_hz / true.frequency_hz - 1) < frequency, mode.order
        assert abs(mode.damping_ratio / true.damping_ratio - 1) < damping, mode.order


def of_orders(modes, orders=range(1, 8), member=None):
    """True modes of some orders, and of one member of their pairs."""
    return [m for m in modes if m.order in orders and member in (None, m.member)]


def true_inertance(modes, position_deg, frequency_hz, sensor_mass_kg=0.0):
    """Inertances of a tyre for a force at 0°, with a sensor at each of the positions."""
    system = modal_sum(tuple(modes), position_deg, 0.0, sensor_mass_kg=sensor_mass_kg)
    omega = 2 * np.pi * frequency_hz
    return np.array([system.inertance(row, omega) for row in range(position_deg.size)])


def response_level(modes):
    """Inertance of white noise that is as strong as the responses to the shaker's band."""
    lines_hz = np.arange(*FORCE_BAND_HZ)
    power = np.abs(true_inertance(modes, np.arange(0.0, 360.0, 30.0), lines_hz)) ** 2
    return float(np.sqrt(power.sum(axis=1).mean() / NYQUIST_HZ))
