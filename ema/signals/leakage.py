"""Leakage: what blocks and windows make of the response of a mode (docs/theory/frf.md).

With φ(ω) = −ω²/(jω−s) = jω + s + s²/(jω−s), only the decaying part s²e^{sτ} is touched: computed
with the force as recorded where that is at hand, and elsewhere as the mean over random forces.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.fft import fft, ifft, irfft, rfft

from ema.core.block_plan import BlockPlan
from ema.core.frf import FRF, ForceRecord

# Samples × poles × runs up to which the force as recorded is used for steady noise; beyond that,
# many averages leave little more than the mean that the window's autocorrelation gives.
_MOST_WORK = 4_000_000
# Rate that the force is reduced to, over the highest line: room for the window's side lobes.
_ROOM = 1.2


def has_leakage(frf: FRF) -> bool:
    """Whether blocks were averaged whose ends cut the response."""
    plan = frf.blocks
    return plan is not None and plan.n_blocks > 1 and not plan.is_one_period


def leakage_bias(
    frf: FRF,
    frequency_hz: NDArray[np.float64],
    poles: Mapping[str, NDArray[np.complex128]],
    residues: NDArray[np.complex128],
) -> NDArray[np.complex128]:
    """Error of estimated inertances of given modes, to be subtracted: (n_positions, n_frequencies).

    `frequency_hz` are some lines of `frf`, which has blocks; `poles`, (n_modes,), are in the state
    of each run; `residues` are (n_positions, n_modes).
    """
    return leakage_of(frf, frequency_hz, poles)(residues)


def leakage_of(
    frf: FRF, frequency_hz: NDArray[np.float64], poles: Mapping[str, NDArray[np.complex128]]
) -> Callable[[NDArray[np.complex128]], NDArray[np.complex128]]:
    """`leakage_bias` of given poles as a function of the residues; the poles are what costs."""
    plan = frf.blocks
    assert plan is not None
    lines = np.round(frequency_hz * plan.block_s).astype(int)
    exact = _rows_with_force(frf)
    records = [frf.exact_forces[name] for name in exact]
    n_modes = max((own.size for own in poles.values()), default=0)
    work = n_modes * sum(each.plan.n_blocks * each.plan.step_samples for each in records)
    if work > _MOST_WORK and all(each.is_steady for each in records):
        exact = {}
    of_force = {name: _of_force(frf.exact_forces[name], lines, poles[name]) for name in exact}
    of_noise: dict[bytes, NDArray[np.complex128]] = {}  # runs in the same state share it
    for own in poles.values() if not plan.event_starts else ():
        if own.tobytes() not in of_noise:
            of_noise[own.tobytes()] = _of_noise(plan, own)
    run = np.array(frf.run)

    def bias_of(residues: NDArray[np.complex128]) -> NDArray[np.complex128]:
        bias = np.zeros((frf.n_positions, frequency_hz.size), dtype=complex)
        for name, own in poles.items():
            rows, force_rows = run == name, exact.get(name)
            if plan.event_starts:  # blocks in which the response rings out
                if force_rows is not None:
                    bias[force_rows] = residues[force_rows] @ of_force[name]
                continue
            around = of_noise[own.tobytes()]
            direct, mirrored = around[:, lines], around[:, -lines].conj()
            bias[rows] = residues[rows] @ direct + residues[rows].conj() @ mirrored
            if force_rows is not None:
                bias[force_rows] += residues[force_rows] @ (of_force[name] - direct)
        return bias

    return bias_of


def _rows_with_force(frf: FRF) -> dict[str, NDArray[np.int_]]:
    """Rows of each run whose force is known and whose blocks were all used."""
    run = np.array(frf.run)
    whole = frf.missing == 0 if frf.missing.size else np.ones(frf.n_positions, dtype=bool)
    found = {name: np.flatnonzero((run == name) & whole) for name in frf.exact_forces}
    return {name: rows for name, rows in found.items() if rows.size}


def _of_force(
    record: ForceRecord, lines: NDArray[np.int_], poles: NDArray[np.complex128]
) -> NDArray[np.complex128]:
    """Error of each pole for the force as recorded, (n_poles, n_lines).

    Only positive frequencies up to the highest line are computed, at the rate that they need. What
    came before the recording is taken to resemble its end; it has rung out within the first block.
    """
    plan = record.plan
    step = _decimation(plan, int(lines.max()))
    n_samples = plan.starts[-1] + plan.block_samples
    n_block = plan.block_samples // step
    force = record.force.block(0, n_samples)
    spectrum = fft(force - force.mean())[: n_samples // step]
    turn = np.exp(-2j * np.pi * np.arange(spectrum.size) / n_samples)
    own_turn = np.exp(-2j * np.pi * lines / plan.block_samples)
    starts = np.array(plan.starts) // step
    place = starts[:, None] + np.arange(n_block)
    taper = plan.taper[::step]

    def blocks(through: NDArray[np.complex128]) -> NDArray[np.complex128]:
        return np.asarray(fft(ifft(through)[place] * taper, overwrite_x=True)[:, lines])

    of_force = blocks(spectrum)
    power = np.sum(np.abs(of_force) ** 2, axis=0)
    weight = of_force.conj() / np.maximum(power, np.finfo(float).tiny)
    error = np.empty((poles.size, lines.size), dtype=complex)
    step_s = 1 / plan.sampling_rate_hz
    for row, pole in enumerate(poles):
        decay = np.exp(pole * step_s)
        # Steady response to sampled forces: Σ e^{s k Δt} e^{−jω k Δt} Δt.
        through = blocks(step_s * spectrum / (1 - decay * turn))
        seen = np.sum(weight * through, axis=0)
        error[row] = pole**2 * (seen - step_s / (1 - decay * own_turn))
    return error


def _decimation(plan: BlockPlan, highest_line: int) -> int:
    """Largest divisor of block and step that keeps the lines; 1 for windows with hard ends."""
    if plan.window == "boxcar":
        return 1
    common = np.gcd(plan.block_samples, plan.step_samples)
    most = max(int(plan.block_samples / (_ROOM * highest_line)), 1)
    return int(max(step for step in range(1, most + 1) if common % step == 0))


def _of_noise(plan: BlockPlan, poles: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Δφ on all lines of a block, (n_modes, block_samples)."""
    n, step_s = plan.block_samples, 1 / plan.sampling_rate_hz
    correlation = irfft(np.abs(rfft(plan.taper, 2 * n)) ** 2)[:n] / n
    decay = np.vander(np.exp(poles * step_s), n, increasing=True)
    inside = fft((correlation - 1) * decay) * step_s
    # Beyond one block r is zero: there the whole response is missing. e^{−jωT} = 1 on the lines.
    turn = np.exp(-2j * np.pi * np.arange(n) / n)
    beyond = np.exp(poles * n * step_s)[:, None] / (1 - np.exp(poles * step_s)[:, None] * turn)
    return np.asarray(poles[:, None] ** 2 * (inside - beyond * step_s))
