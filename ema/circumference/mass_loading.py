"""Mass loading by the accelerometers: compensation, or an estimate of its effect."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline

from ema.circumference.orders import circle_basis, highest_order
from ema.circumference.ring_modes import family
from ema.core.campaign import Campaign
from ema.core.drift import NO_DRIFT, Drift
from ema.core.errors import InputError
from ema.core.frf import FRF, ROW_ARRAYS
from ema.core.modes import ModalModel

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]

# Share of an FRF that orders above the highest one resolved may hold.
_UNRESOLVED = 1e-3


def sensors_of_runs(campaign: Campaign) -> dict[str, Real]:
    """Angles of all sensors that load the tyre in each run, the reference included."""
    angles = {}
    for run in campaign.runs:
        seats = [r.position_deg for r in run.responses if r.position_deg is not None]
        if run.reference is not None and campaign.reference_deg is not None:
            seats.append(campaign.reference_deg)
        angles[run.name] = np.array(seats)
    return angles


def unloaded(
    frf: FRF,
    sensors_deg: dict[str, Real],
    mass_kg: float,
    excitation_deg: float = 0.0,
    drift: Drift = NO_DRIFT,
) -> FRF:
    """FRFs of the bare tyre, without the mass of the sensors.

    A sensor of mass m at θ_k pulls with −m a_k; pushing back with +m a_k bares the tyre:
    H_bare(θ_i) = H(θ_i) + m Σ_k Y(θ_i, θ_k) H(θ_k), exactly. The inertances Y between sensors
    follow from those to the shaker as far as the tyre is the same all around; where the two members
    of an order's pair differ, their orientation and what the sensors do differently from run to run
    tell the rest (`ema.circumference.mass_loading`).

    The FRFs are of a closed circle, `sensors_deg` are the angles of all sensors of each run from
    `sensors_of_runs` (`InputError` if those of a run are unknown), and `mass_kg` is that of one
    sensor. The reference sensor's rows are corrected likewise, where its angle is known. `drift`
    has the natural frequencies of the runs against each other, where they are known: without it,
    what a drift of 0.1 % does to the compensation looks like 1 to 2 % of damping.
    """
    fixed = frf.reference
    if fixed is not None and not np.all(np.isfinite(fixed.position_deg)):
        fixed = None
    rows = frf if fixed is None else _joined(frf, fixed)
    basis, seats = _waves(frf, rows, sensors_deg, excitation_deg)
    waves = np.linalg.pinv(basis) @ rows.values
    pulls = {
        name: mass_kg
        * _pull(seats[name], _at_seats(rows, name, angles, seats[name] @ waves), waves)
        for name, angles in sensors_deg.items()
    }
    names = list(dict.fromkeys(rows.run))
    pull = np.stack([_of_run(pulls, name) for name in names])
    run = np.array([names.index(name) for name in rows.run])
    noise = _noise_of_lines(rows)
    shift = _shifts(drift, names, rows.frequency_hz)
    push = mass_push(rows.frequency_hz, rows.values, noise, basis, pull, run, shift)
    values = rows.values + push
    if fixed is None:
        return replace(frf, values=values)
    return replace(
        frf,
        values=values[: frf.n_positions],
        reference=replace(fixed, values=values[frf.n_positions :]),
    )


def loading_note(model: ModalModel, n_sensors: int, excitation_deg: float) -> str:
    """Say how large the effect of the sensors may be where their mass is not given."""
    angle = (model.position_deg - excitation_deg + 180) % 360 - 180
    drive = int(np.argmin(np.abs(angle)))
    modes = [model.modes[chosen[0]] for chosen in family(model.modes).values()]
    if abs(angle[drive]) > 2.5 or not modes:
        return "Sensor mass not given: nothing was corrected for it."
    worst = loading_percent(
        np.array([mode.frequency_hz for mode in modes]),
        np.array([mode.residues for mode in modes]),
        np.array([mode.residues[drive] for mode in modes]),
        n_sensors,
        mass_kg=1e-3,
    )
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


def loading_percent(
    frequencies_hz: Real, residues: Complex, drive_residues: Complex, n_sensors: int, mass_kg: float
) -> Real:
    """How far sensors may lower each natural frequency, in percent; the worst run.

    First order, −½ m Σ_k φ_k²/M with the modal mass M from the residue at the drive point. The
    worst run has all sensors on antinodes, where an order divides their spacing. `residues` are
    (n_modes, n_positions), `drive_residues` those at the drive point.
    """
    omega = 2 * np.pi * frequencies_hz
    # φ_i²/M = |A_i|² / |A_drive| · 2ω
    antinode = np.max(np.abs(residues), axis=1) ** 2 / np.abs(drive_residues) * 2 * omega
    return np.asarray(100 * 0.5 * mass_kg * n_sensors * antinode)


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

    To N sensors, orders n and n ± N look alike. A correction that differs from run to run shows in
    all of them; above 3N/2, where a tyre has little of its own, it must not be taken for the tyre.
    """
    n_sensors = max((angles.size for angles in sensors_deg.values()), default=0)
    highest = min(highest_order(frf.position_deg), max(3 * n_sensors // 2 - 2, 1))
    basis = circle_basis(rows.position_deg - excitation_deg, highest)
    seats = {
        name: circle_basis(angles - excitation_deg, highest) for name, angles in sensors_deg.items()
    }
    return basis, seats


def _at_seats(frf: FRF, run: str, angles_deg: Real, around: Complex) -> Complex:
    """Inertance at each seat as measured, or as its neighbours say where nothing was usable."""
    for number, angle in enumerate(angles_deg):
        away = np.abs((frf.position_deg - angle + 180) % 360 - 180)
        same = [row for row in np.flatnonzero(away < 1e-6) if frf.run[row] == run]
        if same:
            around[number] = frf.values[same[0]]
    return np.asarray(around)


def _pull(seats: Real, radial: Complex, waves: Complex) -> Complex:
    """Pull of unit masses at the seats on each wave, (n_waves, n_frequencies).

    A sensor moves along the belt too. A belt that does not stretch moves v = −w'/n² (Kim, Nam &
    Lee 2020; v' = −w): for order n the tangential pull adds about 1/n² of the radial one.
    """
    order = np.arange(1, (seats.shape[1] + 1) // 2)
    along = np.zeros_like(seats)
    along[:, 1::2], along[:, 2::2] = -seats[:, 2::2] / order, seats[:, 1::2] / order
    return np.asarray(seats.T @ radial + along.T @ (along @ waves))


def without_live_mass(frf: FRF, mass_kg: float, excitation_deg: float) -> FRF:
    """FRFs for the force that reaches the tyre, behind a mass between load cell and tyre.

    The load cell also accelerates the mass m: H = H_measured / (1 − m H_dd), with the inertance
    H_dd at the force from the waves around the closed circle.
    """
    highest = highest_order(frf.position_deg)
    waves = np.linalg.pinv(circle_basis(frf.position_deg, highest)) @ frf.values
    at_force = (circle_basis(np.array([excitation_deg]), highest) @ waves)[0]
    factor = 1 / (1 - mass_kg * at_force)

    def behind(rows: FRF) -> FRF:
        return replace(rows, values=rows.values * factor, std=rows.std * np.abs(factor))

    fixed = frf.reference
    return replace(behind(frf), reference=None if fixed is None else behind(fixed))


def _of_run(pulls: dict[str, Complex], name: str) -> Complex:
    """Pull of the sensors of a run, or their mean where a row was averaged over several runs."""
    known = [pulls[name]] if name in pulls else [pulls[p] for p in name.split("+") if p in pulls]
    if not known:
        rule = "taking off the sensors' mass needs the angles of all sensors of each run"
        remedy = "Give the positions of its sensors, or remove the mass"
        raise InputError(f"run {name!r}", "no sensors", rule, remedy)
    return np.asarray(np.mean(known, axis=0))


def _noise_of_lines(frf: FRF) -> Real:
    """Standard deviation of each line, above what orders too high to be told apart may hold."""
    size = np.sqrt(np.mean(np.abs(frf.values) ** 2, axis=0))
    floor = np.maximum(_UNRESOLVED * size, 1e-12 * size.max())
    return np.asarray(np.fmax(np.median(frf.std, axis=0), floor))


# Before the runs are asked, ss is known from the orientation of the pair to within this share of
# cc, and not at all where the pair is driven so one-sidedly that its orientation does not show.
_KNOWN, _ONE_SIDED = 0.1, 0.02
# No orientation makes ss differ from cc by more than this factor of it: such a contrast is noise.
_FARTHEST = 2.0
# Lines as clear as this share of the clearest one belong to the resonance.
_RESONANT = 0.1
_LINES_AT_ONCE = 200
# Below this share of its middle the law of a drift is not continued.
_LOWEST = 0.4


def mass_push(
    frequency_hz: Real,
    values: Complex,
    noise: Real,
    basis: Real,
    pull: Complex,
    run: NDArray[np.int_],
    shift: Real,
) -> Complex:
    """What the sensors' mass takes from the FRFs of a ring, by least squares line by line.

    Measured are H_i = Σ_n b_n(θ_i)ᵀ C_n (e₁ − p_n) with the sensors' pull p_n = m Σ_k b_n(θ_k) H_k
    in the same run; linear in cc, cs and ss of every order. Returns Σ_n b_n(θ_i)ᵀ C_n p_n, to be
    added to the inertances `values`, (n_rows, n_frequencies), of standard deviation `noise`,
    (n_frequencies,), above 0. `basis`, (n_rows, 1 + 2 n_orders), is that of
    `ema.circumference.orders.circle_basis`; `pull`, (n_runs, 1 + 2 n_orders, n_frequencies), that
    of the sensors of each run on each wave per unit force; `run`, (n_rows,), the run of each row;
    `shift`, (n_runs, n_frequencies), how far its natural frequencies are from the mean.
    """
    first = np.linalg.pinv(basis) @ values
    cosine, sine = first[1::2], first[2::2]
    contrast, spread = np.array(
        [_orientation(frequency_hz, c, s, noise) for c, s in zip(cosine, sine, strict=True)]
    ).T
    trust = noise / np.maximum(spread[:, None] * np.abs(cosine), 1e-6 * noise)
    shaken = np.pad(basis, ((0, 0), (0, contrast.size)))
    parts = [slice(k, k + _LINES_AT_ONCE) for k in range(0, noise.size, _LINES_AT_ONCE)]

    def taken(lines: slice, pull: Complex) -> Complex:
        return _taken(basis, np.moveaxis(pull[:, :, lines], 2, 0)[:, run])

    # All in the state between the runs: what a drift does must not be taken for the sensors' doing.
    alike = _moved(frequency_hz, pull, shift)
    middle = _moved(frequency_hz, values[:, None], shift[run])[:, 0]
    found = np.empty((noise.size, shaken.shape[1]), dtype=complex)
    for lines in parts:
        system = np.concatenate(
            [shaken - taken(lines, alike), _prior(contrast, trust[:, lines].T)], axis=1
        )
        right = np.pad(middle[:, lines].T, ((0, 0), (0, contrast.size)))
        adjoint = system.conj().transpose(0, 2, 1)
        found[lines] = np.linalg.solve(adjoint @ system, adjoint @ right[:, :, None])[:, :, 0]
    states = _moved(frequency_hz, np.broadcast_to(found.T, (len(shift), *found.T.shape)), -shift)
    push = np.empty_like(values)
    for lines in parts:
        push[:, lines] = np.einsum("fru,ruf->rf", taken(lines, pull), states[:, :, lines][run])
    return push


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
    known = drift.at(np.maximum(frequency_hz, _LOWEST * drift.middle_hz)[:, None]).T / 100
    known -= known.mean(axis=0)
    for own, name in zip(shift, names, strict=True):
        runs = [drift.run.index(part) for part in (name, *name.split("+")) if part in drift.run]
        own += known[runs].mean(axis=0) if runs else 0.0
    return shift


def _taken(basis: Real, pull: Complex) -> Complex:
    """Factors of (c_0, cc and cs of each order …, ss of each order) in the push of each row."""
    cosine, sine = basis[:, 1::2], basis[:, 2::2]
    pull_cosine, pull_sine = pull[:, :, 1::2], pull[:, :, 2::2]
    both = np.empty(pull.shape, dtype=complex)
    both[:, :, 0] = basis[:, 0] * pull[:, :, 0]
    both[:, :, 1::2] = cosine * pull_cosine
    both[:, :, 2::2] = cosine * pull_sine + sine * pull_cosine
    return np.concatenate([both, sine * pull_sine], axis=2)


def _prior(contrast: Real, trust: Real) -> Complex:
    """Rows that say ss = cc − contrast · cs, (n_frequencies, n_orders, n_unknowns)."""
    order = np.arange(contrast.size)
    rows = np.zeros((trust.shape[0], order.size, 1 + 3 * order.size), dtype=complex)
    rows[:, order, 1 + 2 * order] = -trust
    rows[:, order, 2 + 2 * order] = trust * contrast
    rows[:, order, 1 + 2 * order.size + order] = trust
    return rows


def _orientation(
    frequency_hz: Real, cosine: Complex, sine: Complex, noise: Real
) -> tuple[float, float]:
    """Contrast (cc − ss)/cs of an order, the same on all lines, and how far ss is unknown then.

    From (M ω² − K − jωD) (cc, cs)ᵀ = ω² e₁ by least squares, with K and D symmetric and one modal
    mass M for both members: the contrast of C is that of K.
    """
    clear = np.hypot(np.abs(cosine), np.abs(sine)) / noise
    near = (frequency_hz > 0) & (clear > _RESONANT * clear.max())
    if not np.any(near):
        return 0.0, 1.0
    ratio = frequency_hz[near].max() / frequency_hz[near]
    weight, cc, cs, none = clear[near], cosine[near], sine[near], np.zeros(ratio.size)
    stiff, damped = -(ratio**2), -1j * ratio
    rows = [
        [cc, stiff * cc, stiff * cs, none, damped * cc, damped * cs, none],
        [cs, none, stiff * cc, stiff * cs, none, damped * cc, damped * cs],
    ]
    system = (np.array(rows) * weight).transpose(0, 2, 1).reshape(-1, 7)
    right = np.concatenate([weight, none, none, none])
    parts = np.concatenate([system.real, system.imag])
    _, k11, k12, k22, *_ = np.linalg.lstsq(parts, right, rcond=None)[0]
    share = float(np.linalg.norm(weight * cs) / np.linalg.norm(weight * cc))
    contrast = float((k11 - k22) / k12) if k12 else 0.0
    spread = float(np.clip(_ONE_SIDED / share, _KNOWN, 1.0)) if share > 0 else 1.0
    return (contrast if abs(contrast) * share < _FARTHEST else 0.0), spread
