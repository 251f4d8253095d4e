"""The accelerometers' own mass: taken off the FRFs, or at least told how much it may do."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ema.circumference import circle_basis, highest_order
from ema.frf import FRF
from ema.modes import ModalModel
from ema.recording import Campaign

# The correction is a few percent of the FRFs; each round leaves a few percent of its error.
_ROUNDS = 4


def sensors_of_runs(campaign: Campaign) -> dict[str, NDArray[np.float64]]:
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
    sensors_deg: dict[str, NDArray[np.float64]],
    mass_kg: float,
    excitation_deg: float = 0.0,
) -> FRF:
    """FRFs of the bare tyre, without the mass of the sensors.

    A sensor of mass m at θ_k pulls with −m a_k; pushing back with +m a_k bares the tyre:
    H_bare(θ_i) = H(θ_i) + m Σ_k Y(θ_i, θ_k) H(θ_k), exactly. The transfer inertances Y between
    sensors follow from those to the shaker, Y(θ_i, θ_k) = H_bare(θ_i − θ_k), as the tyre is the
    same all around; H_bare on both sides is found by repetition. Run by run, so that orders which
    divide the sensors' spacing get each run's own correction. Whether both members of a pair answer
    to the sensors, or only the driven one, is taken from the FRFs: what differs from run to run
    afterwards was corrected wrongly.

    Parameters
    ----------
    frf : FRF
        Of a closed circle of positions, one run per row.
    sensors_deg : dict of str to ndarray
        Angles of all sensors of each run, from `sensors_of_runs`.
    mass_kg : float
        Mass of one sensor.
    excitation_deg : float
        Angle of the force.

    Returns
    -------
    FRF
        With the reference sensor's rows corrected likewise.
    """
    transfers = [
        _repeated(frf, sensors_deg, mass_kg, excitation_deg, split=split) for split in (False, True)
    ]
    spilled = [_spilled_power(bare, sensors_deg) for bare in transfers]
    return transfers[int(np.argmin(spilled))]


def loading_note(model: ModalModel, n_sensors: int, excitation_deg: float) -> str:
    """Say how large the effect of the sensors may be where their mass is not given."""
    angle = (model.position_deg - excitation_deg + 180) % 360 - 180
    drive = int(np.argmin(np.abs(angle)))
    if abs(angle[drive]) > 2.5 or not model.modes:
        return "Sensor mass not given: nothing was corrected for it."
    residues = np.array([mode.residues for mode in model.modes])
    worst = loading_percent(
        model.frequencies_hz, residues, residues[:, drive], n_sensors, mass_kg=1e-3
    )
    order = model.modes[int(np.argmax(worst))].order
    return (
        f"Sensor mass not given, nothing was corrected for it: each gram per sensor lowers the "
        f"natural frequencies by about {np.median(worst) / 2:.2f} %, at most {worst.max():.2f} % "
        f"(order {order}, all sensors on antinodes)."
    )


def _repeated(
    frf: FRF,
    sensors_deg: dict[str, NDArray[np.float64]],
    mass_kg: float,
    excitation_deg: float,
    *,
    split: bool,
) -> FRF:
    order = highest_order(frf.position_deg)
    basis = circle_basis(frf.position_deg - excitation_deg, order)
    inverse = np.linalg.pinv(basis)
    bare = frf
    for _ in range(_ROUNDS):
        amplitude = inverse @ bare.values
        # Even orders c_n of H(θ) = Σ c_n cos nθ + s_n sin nθ about the force.
        even = np.concatenate([amplitude[:1], amplitude[1::2]])
        values = np.array(frf.values)
        fixed = None if frf.reference is None else np.array(frf.reference.values)
        for run, seats in sensors_deg.items():
            pull = mass_kg * _pull(frf, run, seats, bare.values)
            rows = np.flatnonzero([name == run for name in frf.run])
            push = _Push(even, seats - excitation_deg, pull, split)
            values[rows] += push.at(frf.position_deg[rows] - excitation_deg)
            if frf.reference is not None and fixed is not None and run in frf.reference.run:
                seat = [frf.reference.run.index(run)]
                fixed[seat] += push.at(frf.reference.position_deg[seat] - excitation_deg)
        bare = replace(frf, values=values)
        if frf.reference is not None and fixed is not None:
            bare = replace(bare, reference=replace(frf.reference, values=fixed))
    return bare


def loading_percent(
    frequencies_hz: NDArray[np.float64],
    residues: NDArray[np.complex128],
    drive_residues: NDArray[np.complex128],
    n_sensors: int,
    mass_kg: float,
) -> NDArray[np.float64]:
    """How far sensors may lower each natural frequency, in percent; the worst run.

    First order, −½ m Σ_k φ_k²/M with the modal mass M from the residue at the drive point. The
    worst run has all sensors on antinodes, where an order divides their spacing.

    Parameters
    ----------
    frequencies_hz : ndarray, shape (n_modes,)
    residues : ndarray of complex, shape (n_modes, n_positions)
    drive_residues : ndarray of complex, shape (n_modes,)
        Residues at the drive point.
    n_sensors : int
    mass_kg : float
    """
    omega = 2 * np.pi * frequencies_hz
    # φ_i²/M = |A_i|² / |A_drive| · 2ω
    antinode = np.max(np.abs(residues), axis=1) ** 2 / np.abs(drive_residues) * 2 * omega
    return np.asarray(100 * 0.5 * mass_kg * n_sensors * antinode)


def _spilled_power(frf: FRF, sensors_deg: dict[str, NDArray[np.float64]]) -> float:
    """Power in orders that a correction which differs wrongly from run to run spills into.

    With N sensors a run, an error in order n shows in N ± n too; above 3N/2 a tyre has little else.
    """
    n_sensors = max(seats.size for seats in sensors_deg.values())
    highest = highest_order(frf.position_deg)
    amplitude = np.linalg.pinv(circle_basis(frf.position_deg, highest)) @ frf.values
    first = min(3 * n_sensors // 2 - 1, highest)
    power = np.sum(np.abs(amplitude[2 * first :]) ** 2, axis=0)
    noise = np.nan_to_num(np.median(frf.std, axis=0) ** 2, nan=1.0)
    return float(np.sum(np.divide(power, noise, out=np.zeros_like(power), where=noise > 0)))


def _pull(
    frf: FRF, run: str, seats: NDArray[np.float64], bare: NDArray[np.complex128]
) -> NDArray[np.complex128]:
    """Acceleration at each seat as measured, or of the nearest position where none was usable."""
    there = np.full((seats.size, frf.frequency_hz.size), np.nan, dtype=complex)
    for number, seat in enumerate(seats):
        distance = np.abs((frf.position_deg - seat + 180) % 360 - 180)
        same = [row for row in np.flatnonzero(distance < 1e-6) if frf.run[row] == run]
        if same:
            there[number] = frf.values[same[0]]
        elif frf.reference is not None and run in frf.reference.run and _is_seat(frf, seat):
            there[number] = frf.reference.values[frf.reference.run.index(run)]
        else:
            there[number] = bare[np.argmin(distance)]
    return there


def _is_seat(frf: FRF, seat: float) -> bool:
    return frf.reference is not None and bool(np.all(frf.reference.position_deg == seat))


@dataclass(frozen=True, eq=False)
class _Push:
    """Forces at the sensors' seats and the response of the ring to them.

    With c_n the inertance of order n, a force at θ_k answers at θ_i with c_n cos n(θ_i − θ_k)
    where both members of a pair respond alike, and with c_n cos nθ_i cos nθ_k where the pair is so
    far split that only the member which the shaker drives does.
    """

    even: NDArray[np.complex128]
    seats_deg: NDArray[np.float64]
    force: NDArray[np.complex128]
    split: bool

    def at(self, angle_deg: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Response at some angles, (n_angles, n_frequencies)."""
        highest = self.even.shape[0] - 1
        orders = np.concatenate([self.even[:1], np.repeat(self.even[1:], 2, axis=0)])
        if self.split:
            orders[2::2] = 0
        seats = circle_basis(self.seats_deg, highest)
        return np.asarray(circle_basis(angle_deg, highest) @ (orders * (seats.T @ self.force)))
