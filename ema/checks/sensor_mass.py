"""The mass of the sensors: what is known of it, and FRFs and modes without it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ema.circumference.mass_loading import TYRE_ORDERS, Across, unloaded, without_live_mass
from ema.circumference.orders import circle_basis, family, highest_order, on_circle
from ema.circumference.sensor_pull import Mixed
from ema.core.campaign import Campaign, Run
from ema.core.drift import NO_DRIFT, Drift
from ema.core.frf import FRF
from ema.core.modes import ModalModel, Mode
from ema.signals.leakage import has_leakage

# Mean gain and phase of the sensors are known to this (1 σ): ISO 16063-21, and 10 µs at 160 Hz.
_MASS_KNOWN = 0.01
# How a pair answers across the force is found from its FRFs along it, to a tenth (laboratory
# tyres), of which a member has more the less the force drives it.
_ACROSS_KNOWN = 0.1
# Across the force a member with the share s of the response moves (1 − s)/s times as much as is
# seen of it; so much of an order's response is of other orders that an uneven tyre mixes in.
_NOT_OWN = 0.015
_LINE_ARRAYS, _FEWEST_LINES = ("values", "coherence", "std"), 8
# Least motion of a mode at the shaker, over its rms, for what a force elsewhere does to be known.
_DRIVEN = 0.1
# A position this near the force is the drive point.
_AT_FORCE_DEG = 2.5
# The drift of the loaded tyre is lost where this share of it is no longer found.
_LOST = 0.5
# A resonance of half-width b, in lines of a Hann window, loses this share over b² of its height,
# ∫w′² T²/(4π² ∫w²), and with it the force of a mass, which is a product of two FRFs.
_BLUNTED = 1 / 3


@dataclass(frozen=True, eq=False)
class SensorMass:
    """Mass of the sensors and where they sat.

    Parameters
    ----------
    mass_kg : float
        Mass of one sensor.
    sensors_deg : dict of str to ndarray
        Angles of all sensors of each run.
    excitation_deg : float
        Angle of the force.
    live_mass_kg : float
        Mass between load cell and tyre.
    drift : Drift
        Natural frequencies of the runs against each other.
    own_kg : dict of str to ndarray
        Mass of each sensor in `sensors_deg`, where they differ.
    across : mapping
        What pairs show across the force, by order: poles and residues, see
        `ema.circumference.mass_loading.Across`.
    upper_hz : float or None
        Highest line that is compensated; None for all.
    mixed : tuple of ndarray or None
        Modes whose waves of several orders couple these, see `mixed_waves`.

    Examples
    --------
    >>> import ringmodal as rm
    >>> from ema.checks.sensor_mass import sensors_of_runs
    >>> campaign = rm.read_campaign("sample_data/tyre_225_55R17")
    >>> mass = rm.SensorMass(0.004, sensors_of_runs(campaign))
    >>> mass.sensors_deg["config_1.uff"][:3]
    array([ 0., 30., 60.])
    """

    mass_kg: float
    sensors_deg: dict[str, NDArray[np.float64]]
    excitation_deg: float = 0.0
    live_mass_kg: float = 0.0
    drift: Drift = NO_DRIFT
    own_kg: dict[str, NDArray[np.float64]] = field(default_factory=dict)
    across: Across = field(default_factory=dict)
    upper_hz: float | None = None
    mixed: Mixed | None = None

    @property
    def loads(self) -> bool:
        """Whether a sensor has a mass."""
        return bool(self.mass_kg) or any(np.any(each) for each in self.own_kg.values())


def mixed_waves(model: ModalModel, excitation_deg: float) -> Mixed:
    """Poles of modes that the force drives, and the waves of their residues around it."""
    highest = highest_order(model.position_deg)
    basis = circle_basis(model.position_deg - excitation_deg, highest)
    residues = np.array([mode.residues for mode in model.modes]).reshape(-1, len(basis))
    waves = (np.linalg.pinv(basis) @ residues.T).T[:, : 1 + 2 * min(highest, TYRE_ORDERS)]
    at_shaker = np.abs(waves[:, 0] + waves[:, 1::2].sum(axis=1))
    driven = at_shaker > _DRIVEN * np.linalg.norm(waves, axis=1)
    return np.array([mode.pole for mode in model.modes])[driven], waves[driven]


def is_drift_lost(loaded: ModalModel, bare: ModalModel) -> bool:
    """Whether runs that drift were compensated as if in one state.

    They then look like pairs: these leave more than the loaded tyre does, or, with two runs, take
    the drift for two modes of each order.
    """
    drift, left = loaded.drift, bare.drift
    if not drift.applied:
        return False
    found = left.percent if left.applied and left.run == drift.run else np.zeros(len(drift.run))
    away = np.max(np.abs(found - drift.percent))
    return bool(bare.misfit > loaded.misfit or away > _LOST * np.max(np.abs(drift.percent)))


def with_mass_std(
    model: ModalModel, loaded: ModalModel, usual: ModalModel | None = None, frf: FRF | None = None
) -> ModalModel:
    """The model of the bare tyre with what is not known of the compensation in its ±.

    The force of a mass is as wrong as gain and phase of the sensors that tell its motion: a phase
    turns a shift of frequency into damping. What is usual among shifts is that of the modes of
    `usual`, by default the same. Blocks of `frf` blunt sharp resonances. Orders that the positions
    do not tell are taken for others: their shift may be as large as that of any order.
    """
    bare_hz, loaded_hz = model.frequencies_hz, loaded.frequencies_hz
    others_hz = bare_hz if usual is None else usual.frequencies_hz
    shift, others = (
        np.min(np.abs(hz[:, None] / loaded_hz - 1), axis=1) for hz in (bare_hz, others_hz)
    )
    # A mode that only one of both shows is shifted like the others.
    blocks = frf.blocks if frf is not None and has_leakage(frf) else None
    width_lines = bare_hz * model.damping_ratios * (blocks.block_s if blocks else np.inf)
    blunted = _BLUNTED / width_lines**2
    shares = _shares(model)
    across = np.hypot(_ACROSS_KNOWN * (1 - shares), _NOT_OWN * (1 / shares - 1))
    known = np.sqrt(_MASS_KNOWN**2 + np.minimum(across, 1.0) ** 2 + blunted**2)
    unknown = known * np.minimum(shift, 2 * np.median(others))
    variance = np.stack([unknown * bare_hz, unknown], axis=1) ** 2
    left = _left_of_aliases(model, shift)
    variance += np.stack([left * bare_hz, left * model.damping_ratios], axis=1) ** 2
    modes = [
        replace(
            mode,
            frequency_std_hz=float(np.sqrt(mode.frequency_std_hz**2 + hz)),
            damping_std=float(np.sqrt(mode.damping_std**2 + ratio)),
        )
        for mode, (hz, ratio) in zip(model.modes, variance, strict=True)
    ]
    covariance = model.covariance + np.diag(variance.ravel())
    return replace(model, modes=tuple(modes), covariance=covariance)


def _left_of_aliases(model: ModalModel, shift: NDArray[np.float64]) -> NDArray[np.float64]:
    """Relative shift of modes whose order the circle does not tell, 0 of all others."""
    unknown = np.array([mode.order is None for mode in model.modes])
    unknown &= on_circle(model.position_deg)
    return np.asarray(np.max(shift[~unknown], initial=0.0) * unknown)


def _shares(model: ModalModel) -> NDArray[np.float64]:
    """Share of its order's response that each mode has; 1 where its order has no other."""
    power = np.array([np.sum(np.abs(mode.residues) ** 2) for mode in model.modes])
    order = np.array([mode.order or -1 - k for k, mode in enumerate(model.modes)])
    return np.asarray(power / np.sum(power * (order[:, None] == order), axis=1))


def without_mass(frf: FRF, sensor_mass: SensorMass | None) -> FRF:
    """FRFs without the mass of the sensors, where it is known and the positions are a circle."""
    if sensor_mass is None or not on_circle(frf.position_deg):
        return frf
    upper_hz = frf.frequency_hz[-1] if sensor_mass.upper_hz is None else sensor_mass.upper_hz
    lines = slice(0, max(int(np.searchsorted(frf.frequency_hz, upper_hz, "right")), _FEWEST_LINES))
    if not sensor_mass.loads:
        about = sensor_mass.live_mass_kg, sensor_mass.excitation_deg, sensor_mass.drift
        return _with_lines(frf, lines, without_live_mass(_lines(frf, lines), *about))
    bare = unloaded(
        _lines(frf, lines),
        sensor_mass.sensors_deg,
        sensor_mass.own_kg or sensor_mass.mass_kg,
        sensor_mass.excitation_deg,
        sensor_mass.drift,
        sensor_mass.live_mass_kg,
        sensor_mass.across,
        sensor_mass.mixed,
    )
    return _with_lines(frf, lines, bare)


def _lines(frf: FRF, lines: slice) -> FRF:
    """Some lines of FRFs."""
    of_lines = {name: getattr(frf, name)[:, lines] for name in _LINE_ARRAYS}
    fixed = frf.reference and _lines(frf.reference, lines)
    return replace(frf, frequency_hz=frf.frequency_hz[lines], reference=fixed, **of_lines)


def _with_lines(frf: FRF, lines: slice, some: FRF) -> FRF:
    """FRFs with what `_lines` of them have become."""
    arrays = {name: getattr(frf, name).copy() for name in _LINE_ARRAYS}
    for name, whole in arrays.items():
        whole[:, lines] = getattr(some, name)
    own, fixed = frf.reference, some.reference
    joined = None if own is None or fixed is None else _with_lines(own, lines, fixed)
    return replace(frf, reference=joined, **arrays)


def sensors_of_runs(campaign: Campaign) -> dict[str, NDArray[np.float64]]:
    """Angles of all sensors that load the tyre in each run, the reference included."""
    return {
        run.name: np.array([angle for angle, _ in _seats(campaign, run)]) for run in campaign.runs
    }


def masses_of_runs(campaign: Campaign) -> dict[str, NDArray[np.float64]]:
    """Masses in kg of the sensors of `sensors_of_runs`; 0 where none is given."""
    return {
        run.name: np.array([campaign.mass_of(name) or 0.0 for _, name in _seats(campaign, run)])
        for run in campaign.runs
    }


def _seats(campaign: Campaign, run: Run) -> Iterator[tuple[float, str]]:
    """Angle and channel of each sensor of a run; one that measures several directions once."""
    seen = set()
    for each in (*run.responses, *run.others):
        if each.position_deg is not None and each.position_deg not in seen:
            yield each.position_deg, each.channel.name
            seen.add(each.position_deg)
    if run.reference is not None and campaign.reference_deg is not None:
        yield campaign.reference_deg, run.reference.name


def loading_note(model: ModalModel, n_sensors: int, excitation_deg: float) -> str:
    """Say how large the effect of the sensors may be where their mass is not given."""
    modes, worst = _per_gram(model, n_sensors, excitation_deg)
    if not modes:
        return "Sensor mass not given: nothing was corrected for it."
    text = (
        "Sensor mass not given, nothing was corrected for it: each gram per sensor lowers the "
        f"natural frequencies by about {np.median(worst) / 2:.2f} %"
    )
    # Equidistant sensors can all sit on antinodes only where 2n waves divide their number.
    seats = max(n_sensors - n_sensors % 2, 1)
    aligned = [k for k, mode in enumerate(modes) if (2 * (mode.order or 0)) % seats == 0]
    if not aligned:
        return text + "."
    most = max(aligned, key=lambda k: worst[k])
    return (
        f"{text}, that of order {modes[most].order} by up to {worst[most]:.2f} % in the run with "
        "all sensors on antinodes."
    )


def percent_per_gram(model: ModalModel, n_sensors: int, excitation_deg: float) -> float:
    """How far each gram per sensor lowers the natural frequencies; NaN where that is unknown."""
    modes, worst = _per_gram(model, n_sensors, excitation_deg)
    return float(np.median(worst) / 2) if modes else float("nan")


def _per_gram(
    model: ModalModel, n_sensors: int, excitation_deg: float
) -> tuple[list[Mode], NDArray[np.float64]]:
    """A mode of each order, and what a gram per sensor does to it in the worst run, in percent."""
    modes, drive = _driven(model, excitation_deg)
    if not modes:
        return [], np.zeros(0)
    residues = np.array([mode.residues for mode in modes])
    frequency_hz = np.array([mode.frequency_hz for mode in modes])
    return modes, loading_percent(
        frequency_hz, residues, residues[:, drive], n_sensors, mass_kg=1e-3
    )


def live_mass_note(model: ModalModel, excitation_deg: float) -> str:
    """Say how large the effect of a mass before the load cell may be where it is not given."""
    modes, drive = _driven(model, excitation_deg)
    if not modes:
        return "Live mass at the load cell not given: nothing was corrected for it."
    at_force = np.array([mode.residues[drive] for mode in modes])
    frequency_hz = np.array([mode.frequency_hz for mode in modes])
    worst = loading_percent(frequency_hz, at_force[:, None], at_force, 1, mass_kg=0.01)
    return (
        "Live mass at the load cell not given, nothing was corrected for it: each 10 g lowers the "
        f"natural frequencies by {worst.min():.2f} to {worst.max():.2f} %."
    )


def _driven(model: ModalModel, excitation_deg: float) -> tuple[list[Mode], int]:
    """A mode of each order and the position at the force; no modes where none is at the force."""
    away = np.abs((model.position_deg - excitation_deg + 180) % 360 - 180)
    modes = [model.modes[chosen[0]] for chosen in family(model.modes).values()]
    drive = int(np.argmin(away))
    return (modes if away[drive] <= _AT_FORCE_DEG else []), drive


def loading_percent(
    frequencies_hz: NDArray[np.float64],
    residues: NDArray[np.complex128],
    drive_residues: NDArray[np.complex128],
    n_sensors: int,
    mass_kg: float,
) -> NDArray[np.float64]:
    """How far sensors may lower each natural frequency, in percent; the worst run.

    First order, −½ m Σ_k φ_k²/M with the modal mass M from the residue at the drive point. The
    worst run has all sensors on antinodes, where an order divides their spacing. `residues` are
    (n_modes, n_positions), `drive_residues` those at the drive point.
    """
    omega = 2 * np.pi * frequencies_hz
    # φ_i²/M = |A_i|² / |A_drive| · 2ω
    antinode = np.max(np.abs(residues), axis=1) ** 2 / np.abs(drive_residues) * 2 * omega
    return np.asarray(100 * 0.5 * mass_kg * n_sensors * antinode)
