"""Automatic selection of physical poles, and their cross-check with a second estimator."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ema.core.arrays import ReadonlyArrays
from ema.core.errors import FitError
from ema.core.frf import FRF
from ema.core.modes import Mode
from ema.core.settings import IDENTIFICATION, IdentificationSettings
from ema.poles.stability import StabilityDiagram, build_stability

OTHER = {"lsce": "plscf", "plscf": "lsce"}

# Model orders that show every mode of a tyre; a second look need not go further.
_ENOUGH = 40


@dataclass(frozen=True, eq=False)
class PoleSelection(ReadonlyArrays):
    """Poles that start a curve fit.

    Those in `aside` show in the diagram and the user does not want them: they are fitted, so that
    their response is not pressed into the others, and are no part of the result.
    """

    poles: NDArray[np.complex128]  # rad/s; poles outside the band guard its ends
    band_hz: tuple[float, float]  # band whose modes are wanted
    pinned: bool = False  # whether the user chose them: then none is added and none dropped
    aside: NDArray[np.complex128] = field(default_factory=lambda: np.zeros(0, dtype=complex))

    @property
    def fitted(self) -> NDArray[np.complex128]:
        """Poles to fit, those set aside included; ascending in frequency."""
        both = np.append(self.poles, self.aside)
        return np.asarray(both[np.argsort(np.abs(both))])

    def is_aside(self, poles: NDArray[np.complex128]) -> NDArray[np.bool_]:
        """Which fitted poles go back to one that was set aside."""
        if self.aside.size == 0:
            return np.zeros(poles.size, dtype=bool)
        wanted, aside = (
            np.min(np.abs(poles[:, None] - each[None, :]), axis=1, initial=np.inf)
            for each in (self.poles, self.aside)
        )
        return np.asarray(aside < wanted)

    @classmethod
    def around(cls, poles: ArrayLike) -> PoleSelection:
        """Select given poles and a band that reaches 20 % beyond them."""
        given = np.atleast_1d(np.asarray(poles, dtype=complex))
        frequency_hz = np.abs(given) / (2 * np.pi)
        return cls(given, (0.8 * float(frequency_hz.min()), 1.2 * float(frequency_hz.max())))


def select_poles(
    diagram: StabilityDiagram,
    pinned_hz: Sequence[float] | None = None,
    excluded_hz: Sequence[float] = (),
    settings: IdentificationSettings = IDENTIFICATION,
) -> PoleSelection:
    """Choose the poles that start the curve fit, those just outside the band included.

    Parameters
    ----------
    diagram : StabilityDiagram
    pinned_hz : sequence of float, optional
        Take one pole next to each of these frequencies instead of the automatic selection.
    excluded_hz : sequence of float
        Leave out the mode nearest to each of these frequencies (within `exclude_reach`).
    settings : IdentificationSettings

    What the diagram shows beside the pinned ones, and what is excluded, is set aside: fitted, but
    no part of the result.

    Returns
    -------
    PoleSelection
        Poles ascending in frequency, with the diagram's band.

    Raises
    ------
    FitError
        Where nothing was found, nothing within 5 % of a pinned frequency, one pole for two, or one
        that is excluded too.

    Examples
    --------
    >>> import numpy as np
    >>> import ringmodal as rm
    >>> frf = rm.estimate_frf(rm.read_campaign("sample_data/tyre_225_55R17"))
    >>> frf = frf.rows(np.arange(0, 72, 6))  # every 30°, to be quick
    >>> diagram = rm.build_stability(frf)
    >>> rm.select_poles(diagram).pinned
    False
    >>> pinned = rm.select_poles(diagram, pinned_hz=[78.7, 100.3])
    >>> bool(pinned.aside.size)  # what is not wanted is fitted, but not part of the result
    True
    """
    excluded = {_excluded(diagram, wanted, settings.exclude_reach) for wanted in excluded_hz}
    kept = [cluster for cluster in diagram.clusters if cluster.kept]
    wanted = [cluster.pole for cluster in kept if cluster.label not in excluded]
    aside = [cluster.pole for cluster in kept if cluster.label in excluded]
    if pinned_hz is not None:
        pins = _pinned_poles(diagram, pinned_hz, aside, settings.pin_reach)
        near = settings.exclude_reach
        others = [p for p in wanted if all(abs(abs(p) / abs(pin) - 1) >= near for pin in pins)]
        low, high = 2 * np.pi * np.array(diagram.band_hz)
        guards = [pole for pole in others if not low <= abs(pole) <= high]
        wanted = pins + guards
        aside += [pole for pole in others if pole not in guards]
    if not wanted:
        raise FitError(
            f"no mode found between {diagram.band_hz[0]:g} and {diagram.band_hz[1]:g} Hz: no pole "
            "is stable over the model orders. Check coherence and band, or pin frequencies."
        )
    poles = np.array(wanted)
    return PoleSelection(
        poles[np.argsort(np.abs(poles))], diagram.band_hz, pinned_hz is not None, np.array(aside)
    )


def _pinned_poles(
    diagram: StabilityDiagram, pinned_hz: Sequence[float], excluded: Sequence[complex], reach: float
) -> list[complex]:
    """One pole for each frequency; the same pole twice would leave the curve fit without answer."""
    wanted_at: dict[complex, float] = {}
    for wanted in pinned_hz:
        pole = _pinned_pole(diagram, wanted, reach)
        if pole in excluded:
            raise FitError(f"the pinned {wanted:g} Hz is excluded too. Leave out one of the two.")
        if pole in wanted_at:
            raise FitError(
                f"the pinned {wanted_at[pole]:g} and {wanted:g} Hz lead to the same pole at "
                f"{abs(pole) / (2 * np.pi):.2f} Hz. Leave one of them out."
            )
        wanted_at[pole] = wanted
    return list(wanted_at)


def _excluded(diagram: StabilityDiagram, wanted_hz: float, reach: float) -> int:
    """Label of the kept cluster nearest to a frequency that the user wants left out."""
    kept = [cluster for cluster in diagram.clusters if cluster.kept]
    near = min(kept, key=lambda c: abs(c.frequency_hz - wanted_hz), default=None)
    if near is None or abs(near.frequency_hz / wanted_hz - 1) > reach:
        raise FitError(
            f"no mode within {100 * reach:g} % of the excluded {wanted_hz:g} Hz. "
            "Leave it out or correct the frequency."
        )
    return near.label


def _pinned_pole(diagram: StabilityDiagram, wanted_hz: float, reach: float) -> complex:
    """Pole of the nearest cluster within reach of a frequency, or else the nearest single pole."""
    if not wanted_hz > 0:
        raise FitError(f"the pinned {wanted_hz:g} Hz must be > 0. Correct it or leave it out.")
    for within in (reach / 5, reach):
        near = [c for c in diagram.clusters if abs(c.frequency_hz / wanted_hz - 1) < within]
        if near:  # modes of the automatic selection before others
            return min(near, key=lambda c: (not c.kept, abs(c.frequency_hz - wanted_hz))).pole
    distance = np.abs(diagram.frequency_hz / wanted_hz - 1)
    if distance.size == 0 or distance.min() > reach:
        raise FitError(
            f"no pole within {100 * reach:g} % of the pinned {wanted_hz:g} Hz at any model "
            "order. Leave it out or widen the band."
        )
    return complex(diagram.poles[np.argmin(distance)])


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
    highest = min(max_order, _ENOUGH)
    try:
        selection = select_poles(
            build_stability(frf, band_hz, max_order=highest, method=method, settings=settings)
        ).poles
    except FitError:
        selection = np.zeros(0, dtype=complex)
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
