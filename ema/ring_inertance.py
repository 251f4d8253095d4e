"""How a ring answers forces all around, from what it answers to one shaker and its sensors' mass.

Order n of a ring answers with a symmetric 2×2 inertance C_n between cos nθ and sin nθ, θ counted
from the shaker. The shaker alone shows the first column, (cc, cs); what the sensors' mass does to
the FRFs of each run tells of ss as much as it depends on it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]

# Before the runs are asked, ss is known from the orientation of the pair to within this share of
# cc, and not at all where the pair is driven so one-sidedly that its orientation does not show.
_KNOWN, _ONE_SIDED = 0.1, 0.02
# No orientation makes ss differ from cc by more than this factor of it: such a contrast is noise.
_FARTHEST = 2.0
# Lines as clear as this share of the clearest one belong to the resonance.
_RESONANT = 0.1
_LINES_AT_ONCE = 200


def mass_push(
    frequency_hz: Real,
    values: Complex,
    noise: Real,
    basis: Real,
    pull: Complex,
    run: NDArray[np.int_],
) -> Complex:
    """What the sensors' mass takes from the FRFs of a ring, by least squares line by line.

    Measured are H_i = Σ_n b_n(θ_i)ᵀ C_n (e₁ − p_n) with the sensors' pull p_n = m Σ_k b_n(θ_k) H_k
    in the same run; linear in cc, cs and ss of every order.

    Parameters
    ----------
    frequency_hz : ndarray, shape (n_frequencies,)
    values : ndarray of complex, shape (n_rows, n_frequencies)
        Inertances as measured.
    noise : ndarray, shape (n_frequencies,)
        Their standard deviation, above 0.
    basis : ndarray, shape (n_rows, 1 + 2 n_orders)
        cos nθ and sin nθ at each row's position, from `ema.circumference.circle_basis`.
    pull : ndarray of complex, shape (n_runs, 1 + 2 n_orders, n_frequencies)
        Pull of the sensors of each run on each wave, per unit force.
    run : ndarray of int, shape (n_rows,)
        Run of each row.

    Returns
    -------
    ndarray of complex, shape (n_rows, n_frequencies)
        Σ_n b_n(θ_i)ᵀ C_n p_n, to be added to the inertances.
    """
    first = np.linalg.pinv(basis) @ values
    cosine, sine = first[1::2], first[2::2]
    contrast, spread = np.array(
        [_orientation(frequency_hz, c, s, noise) for c, s in zip(cosine, sine, strict=True)]
    ).T
    trust = noise / np.maximum(spread[:, None] * np.abs(cosine), 1e-6 * noise)
    push = np.empty_like(values)
    for start in range(0, noise.size, _LINES_AT_ONCE):
        lines = slice(start, start + _LINES_AT_ONCE)
        taken = _taken(basis, np.moveaxis(pull[:, :, lines], 2, 0)[:, run])
        shaken = np.pad(basis, ((0, 0), (0, contrast.size)))
        prior = _prior(contrast, trust[:, lines].T)
        system = np.concatenate([shaken - taken, prior], axis=1)
        right = np.pad(values[:, lines].T, ((0, 0), (0, contrast.size)))
        adjoint = system.conj().transpose(0, 2, 1)
        found = np.linalg.solve(adjoint @ system, adjoint @ right[:, :, None])
        push[:, lines] = (taken @ found)[:, :, 0].T
    return push


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
