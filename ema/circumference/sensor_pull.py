"""What sensors take from the waves of a ring, by least squares line by line."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]
Mixed = tuple[Complex, Complex]  # of modes, poles in rad/s and residues by wave around the force

# How far other orders turn the force in the plane of an order's waves (1 σ, tangent): a tyre whose
# stiffness varies by 1 % around it, benchmarks/laboratory.py.
_TURNED = 0.05
# No orientation makes ss differ from cc by more than this factor of it: such a contrast is noise.
_FARTHEST = 2.0
# … nor does k12 tell it within so many standard deviations of 0 (lines are not independent).
_COUPLED = 10.0
# Lines as clear as this share of the clearest one belong to the resonance.
_RESONANT = 0.1
_RUNS_AND_LINES = 1200  # of the products that are in memory at once
# Before the runs are asked, ss is known from the orientation of a pair to this share of cc (1 σ).
_KNOWN = 0.1
# It is not known where the weaker member has less than this share: its orientation does not show.
_ONE_SIDED = 0.02
# As `_KNOWN`, where both members of a pair are known.
_SEEN_WHOLE = 0.03
# How the cosine and sine of a wave (rows) of a force (u, v) (columns) make the columns of cc, cs
# and ss: H = b_c (cc u + cs v) + b_s (cs u + ss v).
_COLUMNS = np.array([[[1, 0], [0, 0]], [[0, 1], [1, 0]], [[0, 0], [0, 1]]])


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
        What they show of each order, see `orientations`.

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
    alike = moved(frequency_hz, pull, shift)
    middle = moved(frequency_hz, values[:, None], shift[run])[:, 0]
    contrast, spread = np.where(given, [[0.0], [_SEEN_WHOLE]], pairs[:2])
    turned, size = pairs[2], np.abs(seen[1::2]) + np.abs(apart)
    trust = noise / np.maximum(spread[:, None] * size, 1e-6 * noise)
    force = np.append(1.0, np.stack([np.ones(turned.size), turned], axis=1).ravel())[:, None]
    acting, expected = force - alike, trust**2 * apart
    found = _solved(basis, run, acting, middle, contrast, trust**2, expected)
    states = moved(frequency_hz, np.broadcast_to(found, (len(shift), *found.shape)), -shift)
    taken = np.array([_answer(own, each) for own, each in zip(pull, states, strict=True)])
    with_sensors = np.array([_answer(force, each) for each in states]) - taken
    explained = np.array([_answer(each, found) for each in acting])
    left = np.empty_like(middle)
    for number in range(len(acting)):
        left[run == number] = middle[run == number] - basis[run == number] @ explained[number]
    return taken, with_sensors, _answer(force, found), left


def between_orders(mixed: Mixed | None, force: Complex | Real, frequency_hz: Real) -> Complex:
    """Inertances of waves to forces on waves of other orders, (n_forces, n_waves, n_frequencies).

    A mode of an uneven tyre has waves of several orders: with its residues A, what moves θ_i for a
    force at θ_k is A(θ_i) A(θ_k)/A(shaker). What it is within an order `mass_push` finds. `force`
    are those on each wave, of the same shape; nothing moves where no modes are known.
    """
    moving = np.zeros(force.shape, dtype=complex)
    order = (np.arange(force.shape[1]) + 1) // 2
    s = 2j * np.pi * frequency_hz
    for pole, waves in zip(*mixed, strict=True) if mixed is not None else ():
        at_shaker = waves[0] + waves[1::2].sum()
        coupled = np.outer(waves, waves) / at_shaker * (order[:, None] != order)
        moving += (coupled @ force) * (s**2 / (s - pole))
        moving += (coupled.conj() @ force) * (s**2 / (s - pole.conj()))
    return moving


def moved(frequency_hz: Real, values: Complex, shift: Real) -> Complex:
    """FRFs, (n, any, n_lines), of states whose frequencies are higher by `shift`, (n, n_lines)."""
    if not np.any(shift):
        return values
    at_hz = np.clip(frequency_hz * (1 + shift), *frequency_hz[[0, -1]])
    splines = [scipy.interpolate.make_interp_spline(frequency_hz, own.T) for own in values]
    return np.asarray([spline(hz).T for spline, hz in zip(splines, at_hz, strict=True)])


def _solved(
    basis: Real,
    run: NDArray[np.int_],
    acting: Complex,
    values: Complex,
    contrast: Real,
    known: Real,
    expected: Real,
) -> Complex:
    """Best cc, cs and ss of all orders from the rows, (n_unknowns, n_frequencies).

    An order's columns hold two numbers per run and line, what acts on its cosine and its sine:
    their products with those of other orders need no rows, half the time for 72 of them.

    Parameters
    ----------
    acting : ndarray, shape (n_runs, n_waves, n_frequencies)
        Force less pull.
    contrast : ndarray, shape (n_orders,)
    known, expected : ndarray, shape (n_orders, n_frequencies)
        Weight of ss − (cc − contrast · cs) = 0, and weight times what it is instead.
    """
    n_waves, n_runs = basis.shape[1], len(acting)
    waves, acts = _by_order(basis.T), _by_order(acting.swapaxes(0, 1))  # orders, two, rows or runs
    of_run = [waves[:, :, run == number] for number in range(n_runs)]
    seen = [own @ values[run == number] for number, own in enumerate(of_run)]
    first, second = np.triu_indices(len(waves))
    grams = np.array([np.einsum("nxi,myi->nmxy", own, own)[first, second] for own in of_run])
    shares = np.einsum("cxa,dyb,rpxy->pcdrab", _COLUMNS, _COLUMNS, grams)
    shares = shares.reshape(len(first), 9, 4 * n_runs)
    order = np.arange(1, len(waves))
    place = np.array([2 * order - 1, 2 * order, n_waves - 1 + order]).T
    place = np.concatenate([[[0, -1, -1]], place])  # order 0 has no sine
    rows, columns = np.broadcast_arrays(place[first][:, :, None], place[second][:, None, :])
    there = (rows >= 0) & (columns >= 0)
    rows, columns = rows[there], columns[there]
    own = np.stack([-np.ones(order.size), contrast, np.ones(order.size)], axis=1)
    inside = place[1:, :, None], place[1:, None, :]
    outer = own[:, :, None] * own[:, None, :]
    right = np.einsum("cxa,narl,rnxl->ncl", _COLUMNS, acts.conj(), np.array(seen))
    right[1:] += own[:, :, None] * expected[:, None]
    found = np.empty((place.max() + 1, values.shape[1]), dtype=complex)
    told = np.empty_like(found)
    told[place[place >= 0]] = right[place >= 0]
    at_once = max(_RUNS_AND_LINES // n_runs, 1)
    for lines in (slice(k, k + at_once) for k in range(0, values.shape[1], at_once)):
        here = acts[..., lines].transpose(0, 2, 1, 3)  # orders, runs, two, lines
        pairs = here.conj()[first][:, :, :, None] * here[second][:, :, None]
        flat = pairs.reshape(len(first), 4 * n_runs, -1)
        blocks = (shares @ flat.view(float)).view(complex).reshape(len(first), 3, 3, -1)[there]
        normal = np.zeros((len(found), len(found), flat.shape[2]), dtype=complex)
        normal[rows, columns], normal[columns, rows] = blocks, blocks.conj()
        normal[inside] += outer[..., None] * known[:, None, None, lines]
        solved = np.linalg.solve(np.moveaxis(normal, 2, 0), told[:, lines].T[:, :, None])
        found[:, lines] = solved[:, :, 0].T
    return found


def _by_order(waves: Complex | Real) -> Any:
    """Waves, (n_waves, …), as cosine and sine of each order, (n_orders + 1, 2, …)."""
    none = np.zeros_like(waves[:1])
    return np.concatenate([waves[:1], none, waves[1:]]).reshape(-1, 2, *waves.shape[1:])


def _answer(pull: Complex, found: Complex) -> Complex:
    """Waves C_n p_n that a pull moves, (n_waves, n_frequencies)."""
    waves, ss = np.split(found, [pull.shape[0]])
    cc, cs, (cosine, sine) = waves[1::2], waves[2::2], (pull[1::2], pull[2::2])
    moved = waves * pull
    moved[1::2], moved[2::2] = cc * cosine + cs * sine, cs * cosine + ss * sine
    return np.asarray(moved)


def orientations(frequency_hz: Real, waves: Complex, noise: Real) -> Real:
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
