"""Automatic selection of physical poles, and their cross-check with a second estimator."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ema.core.arrays import ReadonlyArrays, readonly
from ema.core.errors import FitError, InputError, require_type
from ema.core.frf import FRF
from ema.core.modes import Mode
from ema.core.numerics import kept_with
from ema.core.settings import IDENTIFICATION, IdentificationSettings
from ema.poles.stability import StabilityDiagram, build_stability

OTHER = {"lsce": "plscf", "plscf": "lsce"}

# Model orders that show every mode of a tyre; a second look need not go further.
_ENOUGH = 40


@dataclass(frozen=True, eq=False)
class PoleSelection(ReadonlyArrays):
    """Poles that start a curve fit."""

    poles: NDArray[np.complex128]  # rad/s; poles outside the band guard its ends
    band_hz: tuple[float, float]  # band whose modes are wanted
    pinned: bool = False  # whether it is these poles and no others: none is added, none dropped

    @classmethod
    def around(cls, poles: ArrayLike) -> PoleSelection:
        """Select given poles and a band that reaches 20 % beyond them."""
        try:
            given = np.atleast_1d(np.asarray(poles, dtype=complex)).ravel()
        except (TypeError, ValueError):
            given = np.zeros(0, dtype=complex)
        if not given.size or not np.all(np.isfinite(given) & (given.imag > 0) & (given.real <= 0)):
            rule = "poles are complex, in rad/s: −ζω + jω√(1−ζ²), with ω > 0"
            remedy = "For frequencies write hz=[78.7, 100.3]"
            raise InputError("poles", f"{poles!r:.60}", rule, remedy)
        frequency_hz = np.abs(given) / (2 * np.pi)
        return cls(given, (0.8 * float(frequency_hz.min()), 1.2 * float(frequency_hz.max())))


def select_poles(diagram: StabilityDiagram) -> PoleSelection:
    """Choose the poles that start the curve fit, those just outside the band included.

    Parameters
    ----------
    diagram : StabilityDiagram

    Returns
    -------
    PoleSelection
        Poles ascending in frequency, with the diagram's band.

    Raises
    ------
    FitError
        Where nothing was found.

    Examples
    --------
    >>> import numpy as np
    >>> import ringmodal as rm
    >>> frf = rm.estimate_frf(rm.read_campaign("sample_data/tyre_225_55R17"))
    >>> frf = frf.rows(np.arange(0, 72, 6))  # every 30°, to be quick
    >>> chosen = rm.select_poles(rm.build_stability(frf))
    >>> [f"{hz:.0f} Hz" for hz in np.abs(chosen.poles[:2]) / (2 * np.pi)]
    ['79 Hz', '100 Hz']
    """
    require_type("diagram", diagram, StabilityDiagram, "Use build_stability")
    poles = np.array([cluster.pole for cluster in diagram.clusters if cluster.kept])
    if not poles.size:
        raise FitError(
            f"no mode found between {diagram.band_hz[0]:g} and {diagram.band_hz[1]:g} Hz: no pole "
            "is stable over the model orders. Check coherence and band, or pin frequencies."
        )
    return PoleSelection(poles[np.argsort(np.abs(poles))], diagram.band_hz)


@dataclass(frozen=True)
class Opinion:
    """What another estimator says about one mode; NaN where only one of the two sees it."""

    method: str  # the other estimator
    mode_hz: float  # frequency of the mode
    frequency_hz: float  # pole of the other estimator
    damping_ratio: float
    agrees: bool  # within `cross_check_frequency` and `cross_check_damping`


def second_opinion(
    frf: FRF,
    modes: Sequence[Mode],
    band_hz: tuple[float, float],
    method: str,
    max_order: int,
    settings: IdentificationSettings = IDENTIFICATION,
) -> tuple[Opinion, ...]:
    """Find the poles again with another `method` and compare them with the modes."""
    selection = _poles_of(frf, band_hz, method, min(max_order, _ENOUGH), settings)
    if frf.exponential_window is not None:
        selection = selection + frf.exponential_window.decay_per_s
    frequency_hz = (np.abs(selection) / (2 * np.pi)).tolist()
    damping_ratio = (-selection.real / np.abs(selection)).tolist()
    free = [k for k, f in enumerate(frequency_hz) if band_hz[0] <= f <= band_hz[1]]
    nothing, opinions = float("nan"), []
    for mode in modes:
        near = min(free, key=lambda k: abs(frequency_hz[k] - mode.frequency_hz), default=None)
        apart = np.inf if near is None else abs(frequency_hz[near] / mode.frequency_hz - 1)
        if near is None or apart > 4 * settings.cross_check_frequency:
            opinions.append(Opinion(method, mode.frequency_hz, nothing, nothing, False))
            continue
        free.remove(near)
        frequency, damping = frequency_hz[near], damping_ratio[near]
        alike = abs(damping / mode.damping_ratio - 1) < settings.cross_check_damping
        agrees = apart < settings.cross_check_frequency and alike
        opinions.append(Opinion(method, mode.frequency_hz, frequency, damping, agrees))
    opinions += [Opinion(method, nothing, frequency_hz[k], damping_ratio[k], False) for k in free]
    return tuple(opinions)


@kept_with
def _poles_of(
    frf: FRF,
    band_hz: tuple[float, float],
    method: str,
    max_order: int,
    settings: IdentificationSettings,
) -> NDArray[np.complex128]:
    """Poles that a method selects; refits ask again."""
    try:
        return select_poles(
            build_stability(frf, band_hz, max_order=max_order, method=method, settings=settings)
        ).poles
    except FitError:
        return readonly(np.zeros(0), complex)
