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

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import OptimizeResult, least_squares

from ema.core.settings import IDENTIFICATION, IdentificationSettings
from ema.fitting.variable_projection import Complex, Real

# Half-widths of the resonance on either side whose lines are fitted.
_REACH = 6.0
_FEWEST_LINES = 12
# Parameters: mean frequency and damping (log); half the split of the frequencies, relative, along
# the force and across; the same of the damping; direction of the force.
_MEAN, _DAMPING, _ALONG, _ACROSS, _DAMPED_ALONG, _DAMPED_ACROSS, _FORCE = range(7)
_N_PARAMETERS = 7
# Splits, in damping ratios, that the search starts from.
_STARTS = ((0.0, 0.05), (0.4, 0.3), (-0.4, 0.3), (0.0, 0.5), (0.0, -0.5), (0.0, 1.0), (0.0, -1.0))
_FIRST_LOOK, _LAST_LOOK = 6, 40  # evaluations
# Dimensions that hold every pole near the resonance to 1e-6.
_DIMENSIONS = 18
# Amplitude, E, and background of the two rows.
_N_LINEAR = 18


@dataclass(frozen=True, eq=False)
class PairFit:
    """What the FRFs of one order say about its pair.

    Parameters
    ----------
    poles : tuple of complex
        Members a and b, a the lower one, in rad/s.
    share : tuple of float
        Share of the response's power that each member has; they add up to 1.
    numbers, covariance : ndarray, shape (6,), (6, 6)
        (frequency_hz, damping_ratio) of member a, of member b, and of the mean.
    split_std : float
        Difference of the frequencies over its standard deviation.
    gain : float
        Difference in −2 log likelihood to one pole for the whole order.
    misfit : float
        Reduced χ² against the noise of the FRFs.
    residues : ndarray of complex, shape (2, 2)
        Of members a and b (rows) in cosine and sine.
    mean : complex
        Mean pole as the force drives the members, rad/s.
    parameters : ndarray, shape (7,)
        Of `PairProblem`.
    """

    poles: tuple[complex, complex]
    share: tuple[float, float]
    numbers: NDArray[np.float64]
    covariance: NDArray[np.float64]
    split_std: float
    gain: float
    misfit: float
    residues: NDArray[np.complex128]
    mean: complex
    parameters: NDArray[np.float64]


class PairProblem:
    """Least-squares problem of one order's pair, everything linear eliminated.

    Parameters
    ----------
    frequency_hz : ndarray, shape (n_lines,)
    values : ndarray of complex, shape (2, n_lines)
        Amplitudes of cos n(θ − θ_force) and sin n(θ − θ_force), other modes subtracted.
    std : ndarray, shape (2,)
        Noise per quadrature of each row.
    start : complex
        Pole of the order as one mode.
    force_std_rad : float
        Standard deviation of η: how well n times the angle of the force is known.
    correlation : float
        Lines that share the information of one.
    settings : IdentificationSettings
    """

    def __init__(
        self,
        frequency_hz: Real,
        values: Complex,
        std: Real,
        start: complex,
        force_std_rad: float,
        correlation: float,
        settings: IdentificationSettings = IDENTIFICATION,
    ) -> None:
        self.omega = 2 * np.pi * frequency_hz
        self.size, self.ratio = abs(start), -start.real / abs(start)
        self.settings = settings
        self.std = std * np.sqrt(correlation)
        self.n_independent = 4 * frequency_hz.size / correlation
        self.priors = np.array(
            [
                settings.pair_split,
                settings.pair_split,
                settings.pair_damping_likeness,
                settings.pair_damping_likeness,
                force_std_rad,
            ]
        )
        self.basis = self._span()
        self.inside = values @ self.basis.conj()
        outside = np.sum(np.abs(values) ** 2, axis=1) - np.sum(np.abs(self.inside) ** 2, axis=1)
        self.outside = np.maximum(outside, 0.0)
        ground = np.array([np.ones_like(self.omega), (self.omega / self.size) ** 2], dtype=complex)
        ground = ground @ self.basis.conj()
        self.background = np.stack([ground[0], 1j * ground[0], ground[1], 1j * ground[1]])
        self.scale = 1.0
        self.amplitude = 0.0

    def _span(self) -> Complex:
        """Orthonormal functions of the lines that hold every pole near the resonance."""
        frequencies = self.size * (1 + self.ratio * np.linspace(-2.5, 2.5, 9))
        widths = np.array([0.4, 0.7, 1.0, 1.5, 2.2])
        poles = np.array([f * (-self.ratio * w + 1j) for f in frequencies for w in widths])
        direct = 1 / (
            (1j * self.omega - poles[:, None]) * (1j * self.omega - poles.conj()[:, None])
        )
        background = np.array([np.ones_like(self.omega), (self.omega / self.size) ** 2])
        functions = np.concatenate([-(self.omega**2) * direct, background])
        functions /= np.linalg.norm(functions, axis=1, keepdims=True)
        _, _, span = np.linalg.svd(functions, full_matrices=False)
        return np.asarray(span[:_DIMENSIONS].T)

    def _states(self, x: Real) -> tuple[Complex, Complex, Complex]:
        """Pole s and coupling δ_c, δ_s of many parameter sets, (n_sets,) each."""
        size = self.size * np.exp(x[:, _MEAN])
        ratio = np.minimum(self.ratio * np.exp(x[:, _DAMPING]), 0.9)
        mean = size * (-ratio + 1j * np.sqrt(1 - ratio**2))
        along = size * (1j * x[:, _ALONG] - ratio * x[:, _DAMPED_ALONG])
        across = size * (1j * x[:, _ACROSS] - ratio * x[:, _DAMPED_ACROSS])
        return mean - along, along, across

    def residuals(self, x: Real) -> Real:
        """Weighted residuals of many parameter sets, those of the priors included."""
        return self._solved(x)[0]

    def _solved(self, x: Real) -> tuple[Real, Complex]:
        """Residuals, (n_sets, n_residuals), and amplitudes 1/M, (n_sets,)."""
        waves = self._waves(x) @ self.basis.conj()  # (set, cosine or sine, function)
        n_sets, _, n = waves.shape
        columns = np.zeros((n_sets, _N_LINEAR, 2, n), dtype=complex)
        columns[:, 0], columns[:, 1] = waves, 1j * waves
        for row in (0, 1):
            for wave in (0, 1):
                first = 2 + 4 * row + 2 * wave
                columns[:, first, row] = waves[:, wave]
                columns[:, first + 1, row] = 1j * waves[:, wave]
            columns[:, 10 + 4 * row : 14 + 4 * row, row] = self.background
        weight = 1 / (self.std * np.sqrt(self.scale))
        data = (self.inside * weight[:, None]).ravel()
        design = (columns * weight[:, None]).reshape(n_sets, _N_LINEAR, -1).transpose(0, 2, 1)
        prior = np.zeros((n_sets, 8, _N_LINEAR))
        allowed = max(self.settings.wave_deviation * self.amplitude, 1e-300)
        prior[:, np.arange(8), np.arange(2, 10)] = 1 / allowed
        matrix = np.concatenate([design.real, design.imag, prior], axis=1)
        right = np.concatenate([data.real, data.imag, np.zeros(8)])
        size = np.linalg.norm(matrix, axis=1)
        orthonormal, triangle = np.linalg.qr(matrix / size[:, None])
        seen = np.einsum("krc,r->kc", orthonormal, right)
        left = right - np.einsum("krc,kc->kr", orthonormal, seen)
        linear = np.linalg.solve(triangle, seen[:, :, None])[:, :, 0] / size
        residuals = np.concatenate([left, x[:, _ALONG:] / self.priors], axis=1)
        return residuals, linear[:, 0] + 1j * linear[:, 1]

    def _waves(self, x: Real) -> Complex:
        """FRFs of cosine and sine for unit amplitude, (n_sets, 2, n_lines)."""
        pole, along, across = (each[:, None] for each in self._states(x))
        force = np.array([np.cos(x[:, _FORCE]), np.sin(x[:, _FORCE])])[:, :, None]
        shown = []
        for s, c, d in ((pole, along, across), (pole.conj(), along.conj(), across.conj())):
            away = 1j * self.omega - s
            below = away**2 - c**2 - d**2
            shown.append(((away + c) / below, d / below, (away - c) / below))
        (a11, a12, a22), (b11, b12, b22) = shown
        cc, ss = a11 * b11 + a12 * b12, a12 * b12 + a22 * b22
        cs = 0.5 * (a11 * b12 + a12 * b22 + b11 * a12 + b12 * a22)
        waves = np.stack([cc * force[0] + cs * force[1], cs * force[0] + ss * force[1]], axis=1)
        return np.asarray(-(self.omega**2) * waves)

    def solve(self) -> PairFit:
        """Best pair, with what the data say against one pole."""
        single = np.zeros(_N_PARAMETERS)
        self.amplitude = 1e-12  # no mixing at first, to see the size of the wave
        self.amplitude = abs(complex(self._solved(single[None])[1][0]))
        best = self._best()
        outside = float(np.sum(self.outside / self.std**2))
        misfit = (2 * best.cost + outside) / max(self.n_independent - 20, 1)
        self.scale = max(misfit, 1e-12)
        best = self._minimum(best.x, most=_LAST_LOOK)
        one = self._minimum(single, free=(_MEAN, _DAMPING), most=_LAST_LOOK)
        return self._fit(best, 2 * (one.cost - best.cost), misfit)

    def _best(self) -> OptimizeResult:
        starts = np.zeros((len(_STARTS), _N_PARAMETERS))
        starts[:, [_ALONG, _ACROSS]] = self.ratio * np.array(_STARTS)
        looks = [self._minimum(each, most=_FIRST_LOOK) for each in starts]
        looks.sort(key=lambda each: float(each.cost))
        found = [self._minimum(each.x, most=_LAST_LOOK) for each in looks[:2]]
        return min(found, key=lambda each: float(each.cost))

    def _minimum(
        self, start: Real, *, free: tuple[int, ...] = tuple(range(_N_PARAMETERS)), most: int
    ) -> OptimizeResult:
        reach = np.array([2 * self.ratio, 1.5, 3 * self.ratio, 3 * self.ratio, 0.5, 0.5, 0.8])
        tenth = 0.1 * self.ratio
        scale = np.array([tenth, 0.1, tenth, tenth, 0.1, 0.1, 0.02])
        chosen = np.array(free)
        steps = np.zeros((chosen.size, _N_PARAMETERS))
        steps[np.arange(chosen.size), chosen] = 1e-6 * scale[chosen]

        def whole(values: Real) -> Real:
            x = start.copy()
            x[chosen] = values
            return x

        def slope(values: Real) -> Real:
            x = whole(values)
            both = self.residuals(np.concatenate([x + steps, x - steps]))
            ahead, behind = both[: chosen.size], both[chosen.size :]
            return np.asarray(((ahead - behind) / (2e-6 * scale[chosen])[:, None]).T)

        inside = np.clip(start, -reach * (1 - 1e-9), reach * (1 - 1e-9))[chosen]
        found = least_squares(
            lambda values: self.residuals(whole(values)[None])[0],
            inside,
            slope,
            bounds=(-reach[chosen], reach[chosen]),
            x_scale=scale[chosen],
            max_nfev=most,
        )
        found.x = whole(found.x)
        return found

    def near(self, x: Real) -> tuple[Real, Real]:
        """Numbers of the minimum next to some parameters, and their covariance."""
        found = self._minimum(x, most=_LAST_LOOK)
        return self._numbers(found.x), self._covariance(found)

    def _covariance(self, found: OptimizeResult) -> Real:
        inner = np.linalg.pinv(found.jac.T @ found.jac, rcond=1e-14, hermitian=True)
        steps = 1e-7 * np.eye(_N_PARAMETERS)
        ends = [self._numbers(found.x + h) - self._numbers(found.x - h) for h in steps]
        slope = np.array(ends).T / 2e-7
        return np.asarray(slope @ inner @ slope.T)

    def _fit(self, best: OptimizeResult, gain: float, misfit: float) -> PairFit:
        numbers, covariance = self._numbers(best.x), self._covariance(best)
        poles, residues = self._members(best.x)
        power = np.sum(np.abs(residues) ** 2, axis=1)
        apart = np.array([-1.0, 0.0, 1.0, 0.0, 0.0, 0.0])
        split_std = float(np.sqrt(apart @ covariance @ apart))
        pole, along, _ = (complex(each[0]) for each in self._states(best.x[None]))
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
            parameters=best.x,
        )

    def _members(self, x: Real) -> tuple[tuple[complex, complex], Complex]:
        """Poles of a and b, and their residues in cosine and sine, (2, 2)."""
        pole, along, across = (complex(each[0]) for each in self._states(x[None]))
        half = np.sqrt(complex(along**2 + across**2))
        half = half if half.imag >= 0 else -half
        amplitude = complex(self._solved(x[None])[1][0])
        force = np.array([np.cos(x[_FORCE]), np.sin(x[_FORCE])])
        turned = np.array([[along, across], [across, -along]]) / (half or 1.0)
        poles = pole - half, pole + half
        residues = [
            amplitude * (force + sign * turned @ force) / 2 / (2j * each.imag)
            for sign, each in zip((-1, 1), poles, strict=True)
        ]
        return poles, np.array(residues)

    def _numbers(self, x: Real) -> Real:
        """(frequency_hz, damping_ratio) of a, of b and of the mean."""
        pole, along, across = (complex(each[0]) for each in self._states(x[None]))
        half = np.sqrt(complex(along**2 + across**2))
        half = half if half.imag >= 0 else -half
        three = np.array([pole - half, pole + half, pole + along])
        return np.ravel(np.column_stack([np.abs(three) / (2 * np.pi), -three.real / np.abs(three)]))


def fit_pair(
    frequency_hz: Real,
    values: Complex,
    std: Real,
    start: complex,
    force_std_rad: float,
    correlation: float,
    settings: IdentificationSettings = IDENTIFICATION,
) -> PairFit | None:
    """Fit the pair of one order around its resonance; None where too few lines lie there.

    Parameters
    ----------
    frequency_hz : ndarray, shape (n_lines,)
    values : ndarray of complex, shape (2, n_lines)
    std : ndarray, shape (2, n_lines)
    start, force_std_rad, correlation, settings
        As for `PairProblem`.
    """
    known = force_std_rad, correlation, settings
    wide = _problem(frequency_hz, values, std, start, _REACH, *known)
    if wide is None:
        return None
    pair = wide.solve()
    narrow = _problem(frequency_hz, values, std, start, _REACH / 2, *known)
    return pair if narrow is None else _with_window(pair, wide, narrow)


def _problem(
    frequency_hz: Real,
    values: Complex,
    std: Real,
    start: complex,
    reach: float,
    force_std_rad: float,
    correlation: float,
    settings: IdentificationSettings,
) -> PairProblem | None:
    width_hz = -start.real / (2 * np.pi)
    near = np.abs(frequency_hz - abs(start) / (2 * np.pi)) < reach * width_hz
    if np.count_nonzero(near) < _FEWEST_LINES:
        return None
    level = np.sqrt(np.mean(std[:, near] ** 2, axis=1))
    known = bool(np.all(np.isfinite(level)) and np.all(level > 0))
    noise = level if known else np.full(2, np.sqrt(np.mean(np.abs(values[:, near]) ** 2)))
    return PairProblem(
        frequency_hz[near], values[:, near], noise, start, force_std_rad, correlation, settings
    )


def _with_window(pair: PairFit, wide: PairProblem, narrow: PairProblem) -> PairFit:
    """The pair with what half the lines would change in its covariance.

    A model that is not quite right shows here: the two estimates differ by more than the variances
    do (Hausman 1978).
    """
    narrow.amplitude, narrow.scale = wide.amplitude, wide.scale
    numbers, covariance = narrow.near(pair.parameters)
    change = (numbers - pair.numbers) ** 2
    expected = np.maximum(np.diag(covariance) - np.diag(pair.covariance), 0.0)
    return replace(pair, covariance=pair.covariance + np.diag(np.maximum(change - expected, 0.0)))
