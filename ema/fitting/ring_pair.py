"""The pair of one order of a ring: two poles, one modal mass, two coupled waves.

An order n ≥ 1 of a ring has two degrees of freedom, the amplitudes of cos n(θ − θ_f) and
sin n(θ − θ_f), θ_f being the angle of the force. With mass M for both, symmetric stiffness and
symmetric damping, whose axes need not agree, the FRFs of the order are

    H = −ω²/M [(jω − Λ)(jω − Λ*)]⁻¹ u,   Λ = s I + [[δ_c, δ_s], [δ_s, −δ_c]],   u = (cos η, sin η).

The poles are s ± √(δ_c² + δ_s²). The imaginary parts of δ are what stiffness and mass make of the
pair, the real parts what the damping does (complex modes). s + δ_c is the mean of both poles as the
force drives them; it is known even where the poles are not. Places and gains of the sensors mix the
two waves a little, H → (1 + E) H: E has to pay for itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
import scipy

from ema.core.numerics import end_if_stopped
from ema.core.settings import IDENTIFICATION, IdentificationSettings
from ema.fitting.pair import PairFit
from ema.fitting.variable_projection import Complex, Real, above_ground, alone, near_pole

# Parameters: mean frequency and damping (log); half the split of the frequencies, relative, along
# the force and across; the same of the damping; direction of the force.
_N_PARAMETERS = 7
_MEAN, _DAMPING, _ALONG, _ACROSS, _DAMPED_ALONG, _DAMPED_ACROSS, _FORCE = range(_N_PARAMETERS)
# Searches start from a small split, or from the likeliest of larger ones: damping that one pole
# for both has too much (log), half the splits along and across in damping ratios.
_SMALL = np.array([0.0, 0.0, 0.0, 0.05, 0.0, 0.0, 0.0])
_LARGE = tuple(product((0.0, -0.1, -0.3), (-1.0, -0.4, 0.0, 0.4, 1.0), (-0.8, -0.3, 0.3, 0.8)))
_MOST_LOOKS, _FIRST_LOOK, _LAST_LOOK = 3, 15, 40  # starts, evaluations from each
_ENOUGH, _FLAT = 1e-6, 1e-8  # relative gain not worth another step, and slope
_N_LINEAR = 5  # amplitude and E, complex; the background of the two rows is not in the basis


@dataclass(frozen=True)
class Known:
    """What is known of an order beforehand.

    Parameters
    ----------
    force_std_rad : float
        Standard deviation of η: how well n times the angle of the force is known.
    wave_std : float
        Standard deviation of E.
    correlation : float
        Lines that share the information of one.
    settings : IdentificationSettings
    beside, beside_size : tuple of complex, tuple of float
        Other poles, and how much of each the FRFs of this order may hold (1 σ).
    near : ndarray, optional
        Parameters of `PairProblem` near which the pair is.
    drive_std : float
        What waves of other orders change in what drives it (1 σ, relative).
    """

    force_std_rad: float
    wave_std: float
    correlation: float
    settings: IdentificationSettings = IDENTIFICATION
    beside: tuple[complex, ...] = ()
    beside_size: tuple[float, ...] = ()
    near: Real | None = None
    drive_std: float = 0.0


@dataclass(frozen=True, eq=False)
class _Linear:
    """What is linear at some parameters."""

    left: Complex  # weighted residuals, (n_rows,)
    orthonormal: Complex  # (n_rows, _N_LINEAR)
    amplitude: complex  # 1/M
    mixing: Complex  # E times the amplitude, (2, 2)


class PairProblem:
    """Least-squares problem of one order's pair, everything linear eliminated.

    Parameters
    ----------
    frequency_hz : ndarray, shape (n_lines,)
    values : ndarray of complex, shape (2, n_lines)
        Amplitudes of cos n(θ − θ_force) and sin n(θ − θ_force).
    std : ndarray, shape (2,)
        Noise per quadrature of each row.
    start : complex
        Pole of the order as one mode.
    known : Known
    noise_known : bool
        Whether `std` was measured.
    """

    def __init__(
        self,
        frequency_hz: Real,
        values: Complex,
        std: Real,
        start: complex,
        known: Known,
        *,
        noise_known: bool = True,
    ) -> None:
        self.noise_known = noise_known
        self.wave_std, self.drive_std = known.wave_std, known.drive_std
        settings, self.near = known.settings, known.near
        self.omega, self.values = 2 * np.pi * frequency_hz, values
        self.size, self.ratio, self.settings = abs(start), -start.real / abs(start), settings
        self.std = std * np.sqrt(known.correlation)
        self.n_independent = 4 * frequency_hz.size / known.correlation
        alike = settings.pair_split, settings.pair_damping_likeness
        self.priors = np.array([*np.repeat(alike, 2), known.force_std_rad])
        self.ground, span = near_pole(frequency_hz.tobytes(), start)
        # What the rows may hold of other poles counts less.
        self.held, self.held_share = np.zeros((0, self.omega.size), dtype=complex), np.zeros(0)
        allowed = np.array(known.beside_size)[:, None] / np.sqrt(np.mean(self.std**2))
        beside = alone(self.omega, np.array(known.beside, dtype=complex)) * allowed
        _, size, self.held = np.linalg.svd(self._above_ground(beside), full_matrices=False)
        self.held_share = 1 - 1 / np.hypot(1, size)
        self.basis = np.linalg.qr(self._less_held(span).T)[0]
        to_basis = self.basis.conj()
        self.to_basis = to_basis - (self.held.conj().T * self.held_share) @ (self.held @ to_basis)
        self.inside = values @ self.to_basis
        outside = self._above_ground(values) - self.inside @ self.basis.T
        self.outside = np.sum(np.abs(outside) ** 2, axis=1)
        self.sizes = np.array([self.ratio, 1.0, self.ratio, self.ratio, 1.0, 1.0, 0.2]) / 10
        self.steps = 1e-6 * np.diag(self.sizes)
        self.scale, self.amplitude = 1.0, 1e-12  # no mixing at first, to see the wave's size
        self._solved: tuple[tuple[float, ...], _Linear] | None = None

    def _above_ground(self, values: Complex) -> Complex:
        return self._less_held(above_ground(self.ground, values))

    def _less_held(self, above: Complex) -> Complex:
        return np.asarray(above - ((above @ self.held.conj().T) * self.held_share) @ self.held)

    def _states(self, x: Real) -> tuple[Complex, Complex, Complex]:
        """Pole s and coupling δ_c, δ_s of many parameter sets, (n_sets,) each."""
        size = self.size * np.exp(x[:, _MEAN])
        ratio = np.minimum(self.ratio * np.exp(x[:, _DAMPING]), 0.9)
        mean = size * (-ratio + 1j * np.sqrt(1 - ratio**2))
        along = size * (1j * x[:, _ALONG] - ratio * x[:, _DAMPED_ALONG])
        across = size * (1j * x[:, _ACROSS] - ratio * x[:, _DAMPED_ACROSS])
        return mean - along, along, across

    def residuals(self, x: Real) -> Real:
        """Weighted residuals at some parameters, those of the priors included."""
        return np.concatenate([self._linear(x).left.view(float), x[_ALONG:] / self.priors])

    def jacobian(self, x: Real, steps: Real) -> Real:
        """Slopes of the residuals to the parameters that `steps` moves, (n_residuals, n_steps).

        Those of Kaufman (1975): gradient and normal matrix are exact with them.
        """
        linear = self._linear(x)
        ahead, behind = np.split(self.inside_waves(np.concatenate([x + steps, x - steps])), 2)
        size = np.linalg.norm(steps, axis=1)
        slopes = (ahead - behind) / (2 * size[:, None, None])
        slopes = linear.amplitude * slopes + linear.mixing @ slopes
        rows = np.zeros((size.size, len(linear.left)), dtype=complex)
        rows[:, : -_N_LINEAR + 1] = (slopes * self.weight[:, None]).reshape(size.size, -1)
        rows -= (rows @ linear.orthonormal.conj()) @ linear.orthonormal.T
        priors = steps[:, _ALONG:] / size[:, None] / self.priors
        return np.concatenate([-rows.view(float), priors], axis=1).T

    def parameters_of(self, coupled: Complex) -> Real:
        """Parameters of a matrix Λ, but for the direction of the force."""
        along, across = (coupled[0, 0] - coupled[1, 1]) / 2, (coupled[0, 1] + coupled[1, 0]) / 2
        mean = (coupled[0, 0] + coupled[1, 1]) / 2 + along
        size, ratio = abs(mean), -mean.real / abs(mean)
        halves = [along.imag / size, across.imag / size]
        damped = [-along.real / (size * ratio), -across.real / (size * ratio)]
        return np.array([np.log(size / self.size), np.log(ratio / self.ratio), *halves, *damped])

    @property
    def weight(self) -> Real:
        """What the rows are multiplied by."""
        return np.asarray(1 / (self.std * np.sqrt(self.scale)))

    def _linear(self, x: Real) -> _Linear:
        """Best amplitude and mixing at some parameters; the last is kept."""
        key = (*x, self.scale, self.amplitude)
        if self._solved is None or self._solved[0] != key:
            self._solved = key, self._eliminated(self.inside_waves(x[None])[0])
        return self._solved[1]

    def _eliminated(self, waves: Complex) -> _Linear:
        columns = np.zeros((_N_LINEAR, waves.size + _N_LINEAR - 1), dtype=complex)
        design = columns[:, : waves.size].reshape(_N_LINEAR, *waves.shape)
        design[0] = waves * self.weight[:, None]
        design[1:3, 0] = waves * self.weight[0]
        design[3:5, 1] = waves * self.weight[1]
        allowed = max(self.wave_std * self.amplitude, 1e-300)
        np.fill_diagonal(columns[1:, waves.size :], 1 / allowed)
        right = np.zeros(columns.shape[1], dtype=complex)
        right[: waves.size] = (self.inside * self.weight[:, None]).ravel()
        size = np.linalg.norm(columns, axis=1)
        lapack = scipy.linalg.lapack  # faster than numpy's qr
        factors, scales, _, _ = lapack.zgeqrf((columns / size[:, None]).T)
        orthonormal = lapack.zungqr(factors, scales)[0]
        seen = orthonormal.conj().T @ right
        found = lapack.ztrtrs(factors[:_N_LINEAR], seen)[0] / size
        left = right - orthonormal @ seen
        return _Linear(left, orthonormal, complex(found[0]), found[1:].reshape(2, 2))

    def inside_waves(self, x: Real) -> Complex:
        """FRFs of cosine and sine for unit amplitude in the basis, for many sets of parameters.

        (n_sets, 2, n_dimensions).
        """
        pole, along, across = self._states(x)
        first, second = np.cos(x[:, _FORCE]), np.sin(x[:, _FORCE])
        force, by_along, by_across = (
            np.stack(each, axis=1)[:, :, None]
            for each in ((first, second), (first, -second), (second, first))
        )
        # Beside (jω − s)(jω − s*), the inverse of Λ's has a constant and a part linear in jω.
        size, omega = np.abs(pole)[:, None], self.omega
        both = (size - omega) * (size + omega) - 2j * pole.real[:, None] * omega
        coupling = along**2 + across**2
        inert = 2 * coupling.real
        still = np.abs(coupling) ** 2 - 2 * (coupling * pole.conj() ** 2).real
        lossy = 4 * (coupling * pole.conj()).real
        below = both**2 + (
            inert[:, None] * omega**2 + still[:, None] + 1j * (lossy[:, None] * omega)
        )
        inverse = -(omega**2) / below
        parts = np.concatenate([inverse * both, inverse, 1j * omega * inverse]) @ self.to_basis
        of_both, of_one, of_speed = parts.reshape(3, len(x), 1, -1)
        pole, along, across = (each[:, None, None] for each in (pole, along, across))
        constant = (np.abs(along) ** 2 + np.abs(across) ** 2) * force
        constant = constant - 2 * (pole * along.conj()).real * by_along
        constant = constant - 2 * (pole * across.conj()).real * by_across
        linear = 2 * (along.real * by_along + across.real * by_across)
        return np.asarray(force * of_both + constant * of_one + linear * of_speed)

    def solve(self) -> PairFit:
        """Best pair, with what the data say against one pole."""
        single = np.zeros(_N_PARAMETERS)
        self.amplitude = abs(self._linear(single).amplitude)
        one = self.minimum(single, free=(_MEAN, _DAMPING))
        small = one.x + _SMALL * self.ratio
        if self.near is None and self._explains(one):  # no larger split can be significant
            self.scale = self._misfit(one)
            best = self.minimum(small)
        else:
            near = self.minimum(small if self.near is None else self.near)
            best = near if self.near is not None else self._best(one.x, near)
            self.scale = self._misfit(best)
            best = self.minimum(best.x)
        one = self.minimum(one.x, free=(_MEAN, _DAMPING))
        if one.cost < best.cost:  # the search from a split ended early
            best = self.minimum(one.x)
        misfit = self.scale * self._misfit(best)
        return self.pair_of(best.x, self.covariance(best), misfit, 2 * (one.cost - best.cost))

    def solve_near(self, before: PairFit) -> PairFit:
        """The pair where it is known from much the same FRFs; what is known of it stays."""
        self.amplitude = abs(self._linear(np.zeros(_N_PARAMETERS)).amplitude)
        self.scale = before.misfit
        given = before.covariance, before.misfit, before.gain
        return self.pair_of(self.minimum(before.parameters).x, *given)

    def _misfit(self, found: scipy.optimize.OptimizeResult) -> float:
        """Reduced χ², in terms of the scale."""
        outside = float(np.sum(self.outside / self.std**2)) / self.scale
        return max(float(2 * found.cost + outside) / max(self.n_independent - 20, 1), 1e-12)

    def _explains(self, one: scipy.optimize.OptimizeResult) -> bool:
        """Whether one pole leaves no more than the noise, given or seen outside the basis."""
        n_inside = 2 * self.inside.size * self.n_independent / (4 * self.omega.size)
        free = max(n_inside - _N_LINEAR, 1.0)
        outside = float(np.sum(self.outside / self.std**2))
        noise = max(outside / max(self.n_independent - n_inside, 1.0), float(self.noise_known))
        return bool(2 * one.cost < noise * (free + 2 * np.sqrt(2 * free)))

    def _best(
        self, one: Real, near: scipy.optimize.OptimizeResult
    ) -> scipy.optimize.OptimizeResult:
        """Best of the search from a small split and that from the likeliest larger one."""
        starts = np.tile(one, (len(_LARGE), 1))
        starts[:, [_DAMPING, _ALONG, _ACROSS]] += np.array(_LARGE) * [1, self.ratio, self.ratio]
        left = [np.linalg.norm(self._eliminated(each).left) for each in self.inside_waves(starts)]
        likeliest = starts[np.argsort(left)[:_MOST_LOOKS]]
        looks = [self.minimum(each, most=_FIRST_LOOK) for each in likeliest]
        far = min(looks, key=lambda each: float(each.cost))
        return near if far.cost > near.cost else self.minimum(far.x)

    def minimum(
        self,
        start: Real,
        *,
        free: tuple[int, ...] = tuple(range(_N_PARAMETERS)),
        most: int = _LAST_LOOK,
    ) -> scipy.optimize.OptimizeResult:
        """Search for the minimum from `start`, inside what a pair can be."""
        end_if_stopped()
        reach = np.array([2 * self.ratio, 1.5, 3 * self.ratio, 3 * self.ratio, 0.5, 0.5, 0.8])
        chosen = np.array(free)
        limit, scale, steps = reach[chosen], self.sizes[chosen], self.steps[chosen]

        def whole(values: Real) -> Real:
            x = start.copy()
            x[chosen] = values
            return x

        def residuals(values: Real) -> Real:
            return self.residuals(whole(values))

        def slopes(values: Real) -> Real:
            return self.jacobian(whole(values), steps)

        inside = np.clip(start[chosen], -limit * (1 - 1e-9), limit * (1 - 1e-9))
        enough = {"ftol": _ENOUGH, "xtol": _ENOUGH, "gtol": _FLAT}
        # The same MINPACK as least_squares, which evaluates start and end once more.
        found = scipy.optimize.leastsq(
            residuals, inside, (), slopes, True, diag=1 / scale, maxfev=most, **enough
        )[0]
        if np.any(np.abs(found) > limit):
            bounds = -limit, limit
            found = scipy.optimize.least_squares(
                residuals, inside, slopes, bounds, x_scale=scale, max_nfev=most, **enough
            ).x
        return scipy.optimize.OptimizeResult(
            x=whole(found), cost=0.5 * float(np.sum(residuals(found) ** 2))
        )

    def covariance(self, found: scipy.optimize.OptimizeResult) -> Real:
        """Covariance of the numbers at a minimum, (6, 6)."""
        step = 1e-7 * np.eye(_N_PARAMETERS)
        slope = (self.numbers(found.x + step) - self.numbers(found.x - step)).T / 2e-7
        return np.asarray(slope @ self.spread(found.x) @ slope.T)

    def spread(self, x: Real) -> Real:
        """Covariance of the parameters at a minimum."""
        slopes = self.jacobian(x, self.steps)
        return np.asarray(np.linalg.pinv(slopes.T @ slopes, rcond=1e-14, hermitian=True))

    def pair_of(
        self, x: Real, covariance: Real, misfit: float, gain: float = 0.0, amplitude: complex = 0.0
    ) -> PairFit:
        """The pair of some parameters (and amplitude), whose `numbers` have this covariance."""
        numbers = self.numbers(x)
        poles, residues = self._members(x, amplitude or self._linear(x).amplitude)
        power = np.sum(np.abs(residues) ** 2, axis=1)
        apart = np.array([-1.0, 0.0, 1.0, 0.0, 0.0, 0.0])
        split_std = float(np.sqrt(max(apart @ covariance @ apart, 0.0)))
        pole, along, *_ = self._split(x)
        return PairFit(
            poles=poles,
            share=(float(power[0] / power.sum()), float(power[1] / power.sum())),
            numbers=numbers,
            covariance=covariance,
            split_std=float(apart @ numbers / split_std) if split_std else np.inf,
            gain=gain,
            misfit=misfit,
            residues=residues,
            mean=pole + along,
            parameters=x,
        )

    def _split(self, x: Real) -> tuple[complex, complex, complex, complex]:
        """Pole s, coupling δ_c and δ_s, half the distance of the members."""
        pole, along, across = (complex(each[0]) for each in self._states(x[None]))
        half = np.sqrt(complex(along**2 + across**2))
        return pole, along, across, half if half.imag >= 0 else -half

    def _members(self, x: Real, amplitude: complex) -> tuple[tuple[complex, complex], Complex]:
        """Poles of a and b, and their residues in cosine and sine, (2, 2)."""
        pole, along, across, half = self._split(x)
        force = np.array([np.cos(x[_FORCE]), np.sin(x[_FORCE])])
        turned = np.array([[along, across], [across, -along]]) / (half or 1.0)
        poles = pole - half, pole + half
        residues = [
            amplitude * (force + sign * turned @ force) / 2 / (2j * each.imag)
            for sign, each in zip((-1, 1), poles, strict=True)
        ]
        return poles, np.array(residues)

    def numbers(self, x: Real) -> Real:
        """(frequency_hz, damping_ratio) of a, of b and of the mean, perhaps of many sets."""
        pole, along, across = self._states(x.reshape(-1, _N_PARAMETERS))
        half = np.sqrt(along**2 + across**2)
        half = np.where(half.imag >= 0, half, -half)
        poles = np.stack([pole - half, pole + half, pole + along], axis=1)
        found = np.stack([np.abs(poles) / (2 * np.pi), -poles.real / np.abs(poles)], axis=2)
        return found.reshape(*x.shape[:-1], -1)
