"""Mass loading by the accelerometers: compensation, or an estimate of its effect."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline

from ema.circumference.orders import circle_basis, highest_order, pull_on_waves, stretch_hz
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
# Orders that may have resonances near 300 Hz, some ten, and tails of such. With eight only, six
# sensors in twelve runs gave FRFs that were wrong by a half; those above answer by their stiffness.
_TYRE_ORDERS = 16
# Share of an FRF that orders above the highest one resolved may hold.
_UNRESOLVED = 1e-3
# How far other orders turn the force in the plane of an order's waves (1 σ, tangent): a tyre whose
# stiffness varies by 1 % around it, benchmarks/laboratory.py.
_TURNED = 0.05
# Orientation, turn and motion along the belt are found from the mean of all runs with sensors on,
# then from FRFs without sensors and what the sensors of each run make of them.
_PASSES = 2
# No orientation makes ss differ from cc by more than this factor of it: such a contrast is noise.
_FARTHEST = 2.0
# … nor does k12 tell it within so many standard deviations of 0 (lines are not independent).
_COUPLED = 10.0
# Lines as clear as this share of the clearest one belong to the resonance.
_RESONANT = 0.1
_LINES_AT_ONCE = 200
# Before the runs are asked, ss is known from the orientation of a pair to this share of cc (1 σ).
_KNOWN = 0.1
# It is not known where the weaker member has less than this share: its orientation does not show.
_ONE_SIDED = 0.02
# As `_KNOWN`, where both members of a pair are known.
_SEEN_WHOLE = 0.03


def unloaded(
    frf: FRF,
    sensors_deg: dict[str, Real],
    mass_kg: float | dict[str, Real],
    excitation_deg: float = 0.0,
    drift: Drift = NO_DRIFT,
    live_mass_kg: float = 0.0,
    across: Across | None = None,
) -> FRF:
    """FRFs of the bare tyre, without the mass of the sensors and that at the load cell.

    A sensor of mass m at θ_k pulls with −m a_k; pushing back with +m a_k bares the tyre:
    H_bare(θ_i) = H(θ_i) + m Σ_k Y(θ_i, θ_k) H(θ_k), exactly. The inertances Y between sensors
    follow from those to the shaker as far as the tyre is the same all around; where the two members
    of an order's pair differ, their orientation and what the sensors do differently from run to run
    tell the rest (`ema.circumference.mass_loading`).

    The FRFs are of a closed circle, `sensors_deg` are the angles of all sensors of each run from
    `sensors_of_runs` (`InputError` if those of a run are unknown), and `mass_kg` is that of one
    sensor, or those of each run's sensors. The reference sensor's rows are corrected likewise,
    where its angle is known. `drift` has the natural frequencies of the runs against each other,
    where they are known: without it, what a drift of 0.1 % does to the compensation looks like 1 to
    2 % of damping. `live_mass_kg` is between load cell and tyre: the inertance at the force differs
    from run to run as the sensors do, and is known once these are compensated.
    """
    loading = sensors_deg, mass_kg, excitation_deg, drift, across or {}
    average = without_live_mass(frf, live_mass_kg, excitation_deg, drift)
    bare, at_force = _bared(average, *loading)
    before: Complex | float = 0.0
    for _ in range(_LIVE_PASSES if live_mass_kg else 0):
        factors = {name: 1 + live_mass_kg * own for name, own in at_force.items()}
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
    soft, stiff = slice(1 + 2 * _TYRE_ORDERS), slice(1 + 2 * _TYRE_ORDERS, None)
    inertance = _stiff_inertances(waves[stiff], rows.frequency_hz)
    along_force = basis[:, stiff][:, ::2] @ inertance[::2]
    known = _between_members(across, drift, names, rows.frequency_hz)[: len(waves[soft]) // 2]
    seen, own = waves[soft], dict.fromkeys(sensors_deg, waves)
    left = rows.values - along_force - basis[:, soft] @ seen
    for _ in range(_PASSES):
        # Errors of angles and gains leave more than the noise: taken for what the sensors do
        # differently from run to run, 0.5° were four times worse than no compensation at all.
        scatter = np.linalg.norm(left, axis=0) / np.sqrt(max(len(left) - len(seen), 1))
        assumed = np.maximum(noise, scatter)
        pairs = _pairs(rows.frequency_hz, seen, assumed)
        stretch = stretch_hz(rows.frequency_hz, seen[0], pairs[3], assumed)
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
        pull = np.stack([_of_run(pulls, name) for name in names])
        taken = inertance * pull[:, stiff]
        push = np.array([row @ taken[k] for row, k in zip(basis[:, stiff], run, strict=True)])
        values = rows.values + push - along_force
        taken_soft, with_sensors, seen, left = mass_push(
            *(rows.frequency_hz, values, assumed, basis[:, soft], pull[:, soft], run, shift),
            *(known, seen, pairs),
        )
        for name, moving in zip(names, with_sensors, strict=True):
            own |= {part: np.concatenate([moving, waves[stiff]]) for part in name.split("+")}
    taken = np.concatenate([taken_soft, taken], axis=1)
    values = rows.values + np.array([row @ taken[k] for row, k in zip(basis, run, strict=True)])
    bare = _apart(frf, fixed, values)
    drive = np.tile(_drive_point(bare, excitation_deg), (len(names), 1, 1))
    at_force = _moved(rows.frequency_hz, drive, -shift)[:, 0]
    at_force -= taken[:, :1].sum(axis=1) + taken[:, 1::2].sum(axis=1)  # only cosines move the force
    return bare, dict(zip(names, at_force, strict=True))


def _between_members(
    across: Across, drift: Drift, names: Sequence[str], frequency_hz: Real
) -> Complex:
    """Difference ss − cc of each order, between the runs; NaN where it is not known."""
    known, none = np.full((_TYRE_ORDERS, frequency_hz.size), np.nan + 0j), np.zeros(1)
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
    alike = replace(frf, values=_moved(frf.frequency_hz, frf.values[:, None], of_rows)[:, 0])
    drive = _drive_point(alike, excitation_deg)
    of_runs = _moved(frf.frequency_hz, np.tile(drive, (len(names), 1, 1)), -shift)[:, 0]
    factors = {name: 1 / (1 - mass_kg * own) for name, own in zip(names, of_runs, strict=True)}
    return _scaled(frf, factors, 1 / (1 - mass_kg * drive))


def _drive_point(frf: FRF, excitation_deg: float) -> Complex:
    """Inertance at the force, (n_frequencies,)."""
    highest = highest_order(frf.position_deg)
    waves = np.linalg.pinv(circle_basis(frf.position_deg, highest)) @ frf.values
    return np.asarray((circle_basis(np.array([excitation_deg]), highest) @ waves)[0])


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


def mass_push(
    frequency_hz: Real,
    values: Complex,
    noise: Real,
    basis: Real,
    pull: Complex,
    run: NDArray[np.int_],
    shift: Real,
    across: Complex,
    seen: Complex,
    pairs: Real,
) -> tuple[Complex, Complex, Complex, Complex]:
    """What the sensors' mass takes from the waves of a ring, by least squares line by line.

    Measured are H_i = Σ_n b_n(θ_i)ᵀ C_n (u_n − p_n) with the sensors' pull p_n = m Σ_k b_n(θ_k) H_k
    in the same run; linear in cc, cs and ss of every order. The force drives u_n = (1, t_n): other
    orders in the modes of an uneven tyre turn it.

    Parameters
    ----------
    values : ndarray, shape (n_rows, n_frequencies)
        Inertances, with standard deviation `noise`, above 0, of each line.
    basis : ndarray, shape (n_rows, n_waves)
        That of `ema.circumference.orders.circle_basis`.
    pull : ndarray, shape (n_runs, n_waves, n_frequencies)
        Pull of the sensors of each run on each wave per unit force.
    run : ndarray, shape (n_rows,)
        Run of each row.
    shift : ndarray, shape (n_runs, n_frequencies)
        How far its natural frequencies are from the mean.
    across : ndarray, shape (n_orders, n_frequencies)
        ss − cc, or NaN.
    seen : ndarray, shape (n_waves, n_frequencies)
        Waves as far as they are known.
    pairs : ndarray, shape (4, n_orders)
        What they show of each order, see `_orientation`.

    Returns
    -------
    taken, with_sensors : ndarray, shape (n_runs, n_waves, n_frequencies)
        C_n p_n, and waves that are left.
    bare : ndarray, shape (n_waves, n_frequencies)
        Waves without sensors.
    left : ndarray, shape (n_rows, n_frequencies)
        What these waves and the sensors do not explain.
    """
    given, apart = np.all(np.isfinite(across), axis=1), np.nan_to_num(across)
    # All in the state between the runs: what a drift does must not be taken for the sensors' doing.
    alike = _moved(frequency_hz, pull, shift)
    middle = _moved(frequency_hz, values[:, None], shift[run])[:, 0]
    contrast, spread = np.where(given, [[0.0], [_SEEN_WHOLE]], pairs[:2])
    turned, size = pairs[2], np.abs(seen[1::2]) + np.abs(apart)
    trust = noise / np.maximum(spread[:, None] * size, 1e-6 * noise)
    driven = _taken(np.eye(basis.shape[1]), _force(turned))
    shaken = basis @ driven
    found, left = np.empty((noise.size, shaken.shape[1]), dtype=complex), np.empty_like(middle)
    parts = [slice(k, k + _LINES_AT_ONCE) for k in range(0, noise.size, _LINES_AT_ONCE)]
    for lines in parts:
        of_rows = np.moveaxis(alike[:, :, lines], 2, 0)[:, run]
        prior = _prior(contrast, trust[:, lines].T)
        system = np.concatenate([shaken - _taken(basis, of_rows), prior], axis=1)
        told = (trust[:, lines] * apart[:, lines]).T
        right = np.concatenate([middle[:, lines].T, told], axis=1)
        adjoint = system.conj().transpose(0, 2, 1)
        solved = np.linalg.solve(adjoint @ system, adjoint @ right[:, :, None])
        found[lines] = solved[:, :, 0]
        left[:, lines] = (right[:, :, None] - system @ solved)[:, : len(values), 0].T
    states = _moved(frequency_hz, np.broadcast_to(found.T, (len(shift), *found.T.shape)), -shift)
    taken = np.array([_answer(own, each) for own, each in zip(pull, states, strict=True)])
    return taken, driven @ states - taken, driven @ found.T, left


def _force(turned: Real) -> Real:
    """Waves that the force drives, (n_waves,)."""
    return np.append(1.0, np.stack([np.ones(turned.size), turned], axis=1).ravel())


def _moved(frequency_hz: Real, values: Complex, shift: Real) -> Complex:
    """FRFs, (n, any, n_lines), of states whose frequencies are higher by `shift`, (n, n_lines)."""
    if not np.any(shift):
        return values
    return np.asarray(
        [
            make_interp_spline(frequency_hz, own.T)(frequency_hz * (1 + by)).T
            for own, by in zip(values, shift, strict=True)
        ]
    )


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


def _taken(basis: Real, pull: Complex | Real) -> Any:
    """Factors of (c_0, cc and cs of each order …, ss of each order) in the push of each row."""
    cosine, sine = basis[:, 1::2], basis[:, 2::2]
    pull_cosine, pull_sine = pull[..., 1::2], pull[..., 2::2]
    both = basis * pull
    both[..., 1::2] = cosine * pull_cosine
    both[..., 2::2] = cosine * pull_sine + sine * pull_cosine
    return np.concatenate([both, sine * pull_sine], axis=-1)


def _answer(pull: Complex, found: Complex) -> Complex:
    """Waves C_n p_n that a pull moves, (n_waves, n_frequencies)."""
    waves, ss = np.split(found, [pull.shape[0]])
    cc, cs, (cosine, sine) = waves[1::2], waves[2::2], (pull[1::2], pull[2::2])
    moved = waves * pull
    moved[1::2], moved[2::2] = cc * cosine + cs * sine, cs * cosine + ss * sine
    return np.asarray(moved)


def _prior(contrast: Real, trust: Real) -> Complex:
    """Rows that give ss − (cc − contrast · cs), (n_frequencies, n_orders, n_unknowns)."""
    order = np.arange(contrast.size)
    rows = np.zeros((trust.shape[0], order.size, 1 + 3 * order.size), dtype=complex)
    rows[:, order, 1 + 2 * order] = -trust
    rows[:, order, 2 + 2 * order] = trust * contrast
    rows[:, order, 1 + 2 * order.size + order] = trust
    return rows


def _pairs(frequency_hz: Real, waves: Complex, noise: Real) -> Real:
    """What the waves show of each order, see `_orientation`, (4, n_orders)."""
    both = zip(waves[1::2], waves[2::2], strict=True)
    return np.array([_orientation(frequency_hz, *order, noise) for order in both]).T


def _orientation(
    frequency_hz: Real, cosine: Complex, sine: Complex, noise: Real
) -> tuple[float, float, float, float]:
    """Contrast (cc − ss)/cs of an order on all lines, how far ss is unknown then, t and M.

    From (M ω² − K − jωD) C (1, t)ᵀ = ω² (1, t)ᵀ by least squares, with K and D symmetric and one
    modal mass M for both members: the contrast of C is that of K. t of the force is near zero.
    """
    clear = np.hypot(np.abs(cosine), np.abs(sine)) / noise
    near = (frequency_hz > 0) & (clear > _RESONANT * clear.max())
    if not np.any(near):
        return 0.0, 1.0, 0.0, 0.0
    ratio = frequency_hz[near].max() / frequency_hz[near]
    weight, cc, cs, none = clear[near], cosine[near], sine[near], np.zeros(ratio.size)
    stiff, damped = -(ratio**2), -1j * ratio
    rows = [
        [cc, stiff * cc, stiff * cs, none, damped * cc, damped * cs, none, none],
        [cs, none, stiff * cc, stiff * cs, none, damped * cc, damped * cs, none - 1.0],
    ]
    system = (np.array(rows) * weight).transpose(0, 2, 1).reshape(-1, 8)
    expected = np.pad([[1 / _TURNED]], ((0, 0), (7, 0)))
    right = np.concatenate([weight, none, none, none, [0.0]])
    parts = np.concatenate([system.real, system.imag, expected])
    solved, left, *_ = np.linalg.lstsq(parts, right, rcond=None)
    mass_kg, k11, k12, k22, *_, turned = solved
    variance = np.linalg.pinv(parts.T @ parts)[2, 2] * float(np.sum(left)) / len(right)
    apart = cs - turned * cc
    share = float(np.linalg.norm(weight * apart) / np.linalg.norm(weight * cc))
    clear_of_noise = np.sqrt(np.mean(np.abs(apart / noise[near]) ** 2))
    contrast = float((k11 - k22) / k12) if k12 else 0.0
    spread = float(np.clip(_ONE_SIDED / share, _KNOWN, 1.0)) if share > 0 else 1.0
    shows = clear_of_noise > 1 and k12**2 > _COUPLED**2 * variance
    shows &= abs(contrast) * share < _FARTHEST
    return (contrast if shows else 0.0), spread, float(turned), float(mass_kg)
