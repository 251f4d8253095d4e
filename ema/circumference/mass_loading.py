"""Mass loading by the accelerometers: compensation, or an estimate of its effect."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from ema.circumference.orders import circle_basis, highest_order, pull_on_waves, stretch_hz
from ema.circumference.sensor_pull import Mixed, between_orders, mass_push, moved, orientations
from ema.core.drift import NO_DRIFT, Drift
from ema.core.errors import InputError
from ema.core.frf import FRF, ROW_ARRAYS
from ema.core.modes import synthesise

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]
Across = Mapping[int, tuple[Complex, Complex]]  # by order, poles in rad/s and residues of ss − cc

# Passes over the inertance at the force: each leaves a tenth to a half, most of a sharp resonance.
_LIVE_PASSES = 6
# Factors of the live mass that change by less are known as well as the sensors are.
_LIVE_KNOWN = 1e-3
# Noise alone has twice its variance per quadrature; lines of less than this many have no response.
_NOISE_ONLY, _LINES_OF_LEVEL = 3.0, 9
# Orders that may have resonances near 300 Hz, some ten, and tails of such. With eight only, six
# sensors in twelve runs gave FRFs that were wrong by a half; those above answer by their stiffness.
TYRE_ORDERS = 16
# Share of an FRF that orders above the highest one resolved may hold.
_UNRESOLVED = 1e-3
# Orientation, turn and motion along the belt are found from the mean of all runs with sensors on,
# then from FRFs without sensors and what the sensors of each run make of them.
_PASSES = 2


def unloaded(
    frf: FRF,
    sensors_deg: dict[str, Real],
    mass_kg: float | dict[str, Real],
    excitation_deg: float = 0.0,
    drift: Drift = NO_DRIFT,
    live_mass_kg: float = 0.0,
    across: Across | None = None,
    mixed: Mixed | None = None,
) -> FRF:
    """FRFs of the bare tyre, without the mass of the sensors and that at the load cell.

    A sensor of mass m at θ_k pulls with −m a_k; pushing back with +m a_k bares the tyre:
    H_bare(θ_i) = H(θ_i) + m Σ_k Y(θ_i, θ_k) H(θ_k), exactly. The inertances Y between sensors
    follow from those to the shaker as far as the tyre is the same all around; where the two members
    of an order's pair differ, their orientation and what the sensors do differently from run to run
    tell the rest (`ema.circumference.mass_loading`). `mixed` has the modes of an uneven tyre, which
    couple its orders.

    The FRFs are of a closed circle, `sensors_deg` are the angles of all sensors of each run from
    `sensors_of_runs` (`InputError` if those of a run are unknown), and `mass_kg` is that of one
    sensor, or those of each run's sensors. The reference sensor's rows are corrected likewise,
    where its angle is known. `drift` has the natural frequencies of the runs against each other,
    where they are known: without it, what a drift of 0.1 % does to the compensation looks like 1 to
    2 % of damping. `live_mass_kg` is between load cell and tyre: the inertance at the force differs
    from run to run as the sensors do, and is known once these are compensated.
    """
    loading = sensors_deg, mass_kg, excitation_deg, drift, across or {}, mixed
    average = without_live_mass(frf, live_mass_kg, excitation_deg, drift)
    bare, at_force = _bared(average, *loading)
    mass_kg_of_lines = live_mass_kg * _has_response(frf)
    before: Complex | float = 0.0
    for _ in range(_LIVE_PASSES if live_mass_kg else 0):
        factors = {name: 1 + mass_kg_of_lines * own for name, own in at_force.items()}
        now = np.array(list(factors.values()))
        if np.max(np.abs(now - before)) < _LIVE_KNOWN:
            break
        before, mean = now, now.mean(axis=0)
        bare, at_force = _bared(_scaled(frf, factors, mean), *loading)
    return bare


def _bared(
    frf: FRF,
    sensors_deg: dict[str, Real],
    mass_kg: float | dict[str, Real],
    excitation_deg: float,
    drift: Drift,
    across: Across,
    mixed: Mixed | None,
) -> tuple[FRF, dict[str, Complex]]:
    """FRFs without the mass of the sensors, and the inertance at the force with it by run."""
    fixed = frf.reference
    if fixed is not None and not np.all(np.isfinite(fixed.position_deg)):
        fixed = None
    rows = frf if fixed is None else _joined(frf, fixed)
    basis, seats = _waves(frf, rows, sensors_deg, excitation_deg)
    waves = np.linalg.pinv(basis) @ rows.values
    names = list(dict.fromkeys(rows.run))
    run = np.array([names.index(name) for name in rows.run])
    noise, shift = _noise_of_lines(rows), _shifts(drift, names, rows.frequency_hz)
    soft, stiff = slice(1 + 2 * TYRE_ORDERS), slice(1 + 2 * TYRE_ORDERS, None)
    inertance = _stiff_inertances(waves[stiff], rows.frequency_hz)
    known = _between_members(across, drift, names, rows.frequency_hz)[: len(waves[soft]) // 2]
    driven = _driven_between(mixed, waves[soft].shape, rows.frequency_hz)
    beside = basis[:, stiff][:, ::2] @ inertance[::2] + basis[:, soft] @ driven
    seen, own = waves[soft] - driven, dict.fromkeys(sensors_deg, waves)
    left = rows.values - beside - basis[:, soft] @ seen
    for _ in range(_PASSES):
        # Errors of angles and gains leave more than the noise: taken for what the sensors do
        # differently from run to run, 0.5° were four times worse than no compensation at all.
        scatter = np.linalg.norm(left, axis=0) / np.sqrt(max(len(left) - len(seen), 1))
        assumed = np.maximum(noise, scatter)
        pairs = orientations(rows.frequency_hz, seen, assumed)
        stretch = stretch_hz(rows.frequency_hz, seen[0], pairs[3], assumed)
        pull = _pulls(rows, sensors_deg, mass_kg, seats, own, stretch)
        between = between_orders(mixed, pull[:, soft], rows.frequency_hz)
        taken = np.concatenate([between, inertance * pull[:, stiff]], axis=1)
        values = rows.values + _at_rows(basis, taken, run) - beside
        taken_soft, with_sensors, seen, left = mass_push(
            *(rows.frequency_hz, values, assumed, basis[:, soft], pull[:, soft], run, shift),
            *(known, seen, pairs),
        )
        for name, moving in zip(names, with_sensors + driven - between, strict=True):
            own |= {part: np.concatenate([moving, waves[stiff]]) for part in name.split("+")}
    taken[:, soft] += taken_soft
    bare = _apart(frf, fixed, rows.values + _at_rows(basis, taken, run))
    drive = np.tile(_drive_point(bare, excitation_deg), (len(names), 1, 1))
    at_force = moved(rows.frequency_hz, drive, -shift)[:, 0]
    at_force -= taken[:, :1].sum(axis=1) + taken[:, 1::2].sum(axis=1)  # only cosines move the force
    return bare, dict(zip(names, at_force, strict=True))


def _pulls(
    rows: FRF,
    sensors_deg: dict[str, Real],
    mass_kg: float | dict[str, Real],
    seats: dict[str, Real],
    own: dict[str, Complex],
    stretch: float,
) -> Complex:
    """Pull of the sensors of each run on the waves, whose motion in it is `own`."""
    pulls = {
        name: pull_on_waves(
            mass_kg[name] if isinstance(mass_kg, dict) else np.full(angles.size, mass_kg),
            seats[name],
            _at_seats(rows, name, angles, seats[name] @ own[name]),
            own[name],
            rows.frequency_hz,
            stretch,
        )
        for name, angles in sensors_deg.items()
    }
    return np.stack([_of_run(pulls, name) for name in dict.fromkeys(rows.run)])


def _driven_between(mixed: Mixed | None, shape: tuple[int, ...], frequency_hz: Real) -> Complex:
    """Waves that the force moves by those of other orders; around it, it drives the cosines."""
    force = np.zeros((1, *shape))
    force[:, 0], force[:, 1::2] = 1.0, 1.0
    return np.asarray(between_orders(mixed, force, frequency_hz)[0])


def _at_rows(basis: Real, waves: Complex, run: NDArray[np.int_]) -> Complex:
    """What waves of each run make at the rows."""
    return np.array([row @ waves[k] for row, k in zip(basis, run, strict=True)])


def _between_members(
    across: Across, drift: Drift, names: Sequence[str], frequency_hz: Real
) -> Complex:
    """Difference ss − cc of each order, between the runs; NaN where it is not known."""
    known, none = np.full((TYRE_ORDERS, frequency_hz.size), np.nan + 0j), np.zeros(1)
    parts = [part for name in names for part in name.split("+")]
    for order, (poles, each) in across.items():
        middle = np.mean([drift.poles_in(part, poles) for part in parts], axis=0)
        known[order - 1 : order] = synthesise(frequency_hz, middle, each[None], none, none)
    return known


def _joined(frf: FRF, reference: FRF) -> FRF:
    """Positions and reference sensor as rows of one."""
    arrays: dict[str, Any] = {
        name: np.concatenate([getattr(frf, name), getattr(reference, name)]) for name in ROW_ARRAYS
    }
    return replace(
        frf, run=frf.run + reference.run, channel=frf.channel + reference.channel, **arrays
    )


def _waves(
    frf: FRF, rows: FRF, sensors_deg: dict[str, Real], excitation_deg: float
) -> tuple[Real, dict[str, Real]]:
    """Waves around the shaker at all rows and at the sensors' seats of each run.

    To N sensors orders n and n ± N look alike: what is left out of a tyre's own is taken for lower
    ones, with 35 orders where 16 were known an eighth of the correction.
    """
    highest = highest_order(frf.position_deg)
    basis = circle_basis(rows.position_deg - excitation_deg, highest)
    seats = {
        name: circle_basis(angles - excitation_deg, highest) for name, angles in sensors_deg.items()
    }
    return basis, seats


def _apart(frf: FRF, fixed: FRF | None, values: Complex) -> FRF:
    """FRFs, and those of the fixed sensor, with the values of `_joined` rows."""
    bare = replace(frf, values=values[: frf.n_positions])
    if fixed is None:
        return bare
    return replace(bare, reference=replace(fixed, values=values[frf.n_positions :]))


def _at_seats(frf: FRF, run: str, angles_deg: Real, around: Complex) -> Complex:
    """Inertance at each seat as measured, or as its neighbours say where nothing was usable."""
    for number, angle in enumerate(angles_deg):
        away = np.abs((frf.position_deg - angle + 180) % 360 - 180)
        same = [row for row in np.flatnonzero(away < 1e-6) if frf.run[row] == run]
        if same:
            around[number] = frf.values[same[0]]
    return np.asarray(around)


def without_live_mass(
    frf: FRF, mass_kg: float, excitation_deg: float, drift: Drift = NO_DRIFT
) -> FRF:
    """FRFs for the force that reaches the tyre, behind a mass between load cell and tyre.

    The load cell also accelerates the mass m: H = H_measured / (1 − m H_dd), with the inertance
    H_dd at the force from the waves around the closed circle, in the state of each run where
    `drift` tells it.
    """
    names = list(dict.fromkeys(frf.run))
    shift = _shifts(drift, names, frf.frequency_hz)
    of_rows = shift[[names.index(name) for name in frf.run]]
    alike = replace(frf, values=moved(frf.frequency_hz, frf.values[:, None], of_rows)[:, 0])
    drive = _drive_point(alike, excitation_deg) * _has_response(frf)
    of_runs = moved(frf.frequency_hz, np.tile(drive, (len(names), 1, 1)), -shift)[:, 0]
    factors = {name: 1 / (1 - mass_kg * own) for name, own in zip(names, of_runs, strict=True)}
    return _scaled(frf, factors, 1 / (1 - mass_kg * drive))


def _drive_point(frf: FRF, excitation_deg: float) -> Complex:
    """Inertance at the force, (n_frequencies,)."""
    highest = highest_order(frf.position_deg)
    waves = np.linalg.pinv(circle_basis(frf.position_deg, highest)) @ frf.values
    return np.asarray((circle_basis(np.array([excitation_deg]), highest) @ waves)[0])


def _has_response(frf: FRF) -> NDArray[np.bool_]:
    """Lines that are more than noise; beyond the force's band it would be taken for a response."""
    power, noise = (np.mean(np.abs(each) ** 2, axis=0) for each in (frf.values, frf.std))
    known = noise > 0
    ratio = np.where(known, power / np.where(known, noise, 1.0), np.inf)
    return np.asarray(scipy.ndimage.median_filter(ratio, _LINES_OF_LEVEL) > _NOISE_ONLY)


def _scaled(frf: FRF, factors: dict[str, Complex], others: Complex) -> FRF:
    """FRFs times the factor of their run."""
    factor, fixed = np.array([factors.get(name, others) for name in frf.run]), frf.reference
    return replace(
        frf,
        values=frf.values * factor,
        std=frf.std * np.abs(factor),
        reference=None if fixed is None else _scaled(fixed, factors, others),
    )


def _of_run(pulls: dict[str, Complex], name: str) -> Complex:
    """Pull of the sensors of a run, or their mean where a row was averaged over several runs."""
    known = [pulls[name]] if name in pulls else [pulls[p] for p in name.split("+") if p in pulls]
    if not known:
        rule = "taking off the sensors' mass needs the angles of all sensors of each run"
        remedy = "Give the positions of its sensors, or remove the mass"
        raise InputError(f"run {name!r}", "no sensors", rule, remedy)
    return np.asarray(np.mean(known, axis=0))


def _stiff_inertances(waves: Complex, frequency_hz: Real) -> Real:
    """Inertances of orders far below their resonances, twice each, (n_waves, n_frequencies).

    They go with ω² and are alike all around. The median over the lines leaves out what sensors that
    differ from run to run make of the resonances of lower orders.
    """
    omega_squared = (2 * np.pi * frequency_hz) ** 2
    lines = omega_squared > 0
    per_square = np.median(waves[::2, lines].real / omega_squared[lines], axis=1)
    return np.asarray(np.repeat(per_square, 2)[:, None] * omega_squared)


def _noise_of_lines(frf: FRF) -> Real:
    """Standard deviation of each line, above what orders too high to be told apart may hold."""
    size = np.sqrt(np.mean(np.abs(frf.values) ** 2, axis=0))
    floor = np.maximum(_UNRESOLVED * size, 1e-12 * size.max())
    return np.asarray(np.fmax(np.median(frf.std, axis=0), floor))


def _shifts(drift: Drift, names: Sequence[str], frequency_hz: Real) -> Real:
    """How far the natural frequencies of each run are from the mean, (n_runs, n_frequencies)."""
    shift = np.zeros((len(names), frequency_hz.size))
    if not drift.applied:
        return shift
    known = drift.at(frequency_hz[:, None]).T / 100
    known -= known.mean(axis=0)
    for own, name in zip(shift, names, strict=True):
        runs = [drift.run.index(part) for part in (name, *name.split("+")) if part in drift.run]
        own += known[runs].mean(axis=0) if runs else 0.0
    return shift
