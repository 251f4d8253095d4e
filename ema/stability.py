"""The stability diagram: poles over model order, their clusters, and which clusters are modes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ema import _show
from ema._arrays import readonly
from ema.drift import align_runs
from ema.errors import FitError, InputError
from ema.frf import FRF
from ema.interpretation import interpret
from ema.lsce import impulse_responses, normal_matrix, useful_length
from ema.noise import without_spikes
from ema.plscf import line_weight, reduced_normal_matrix
from ema.pole_history import pole_history
from ema.threads import one_blas_thread

STABLE_FREQUENCY = 0.01
STABLE_DAMPING = 0.05
# Beyond the band, lines are used up to this share of its width, for modes just outside it …
_MARGIN = 0.25
# … as long as they are not noisier than the noisiest part of the band by more than this factor.
_MARGIN_NOISE = 2.0
_FEWEST_LINES = 32


@dataclass(frozen=True)
class Cluster:
    """Poles of many model orders that belong together.

    Parameters
    ----------
    label : int
        Number used in `StabilityDiagram.cluster`.
    pole : complex
        Representative pole in rad/s.
    size : int
        Number of model orders that contain it.
    kept : bool
        Whether it is taken for a mode.
    reason : str
        Why it was kept or dropped, in words.
    """

    label: int
    pole: complex
    size: int
    kept: bool
    reason: str

    @property
    def frequency_hz(self) -> float:
        """Undamped frequency |s|/2π."""
        return abs(self.pole) / (2 * np.pi)

    @property
    def damping_ratio(self) -> float:
        """Damping ratio −Re(s)/|s|."""
        return -self.pole.real / abs(self.pole)


@dataclass(frozen=True, eq=False)
class StabilityDiagram:
    """Every pole of every model order, with what is stable from one order to the next.

    Parameters
    ----------
    band_hz : tuple of float
        Band in which modes are sought.
    model_order : ndarray of int, shape (n_poles,)
        Model order each pole comes from.
    poles : ndarray of complex, shape (n_poles,)
        Poles in rad/s, upper half plane.
    stable_frequency, stable_damping : ndarray of bool, shape (n_poles,)
        Whether the previous order has the pole within 1 % of frequency, 5 % of damping.
    cluster : ndarray of int, shape (n_poles,)
        Cluster label; −1 where the pole belongs to none.
    clusters : tuple of Cluster
        All clusters, kept or not.
    indicator_hz, indicator : ndarray
        Mode indicator function drawn behind the poles: RMS inertance over all positions.
    """

    band_hz: tuple[float, float]
    model_order: NDArray[np.int_]
    poles: NDArray[np.complex128]
    stable_frequency: NDArray[np.bool_]
    stable_damping: NDArray[np.bool_]
    cluster: NDArray[np.int_]
    clusters: tuple[Cluster, ...]
    indicator_hz: NDArray[np.float64]
    indicator: NDArray[np.float64]

    def __post_init__(self) -> None:
        for name, dtype in (
            ("model_order", int),
            ("poles", complex),
            ("stable_frequency", bool),
            ("stable_damping", bool),
            ("cluster", int),
            ("indicator_hz", float),
            ("indicator", float),
        ):
            object.__setattr__(self, name, readonly(getattr(self, name), dtype))

    @property
    def frequency_hz(self) -> NDArray[np.float64]:
        """Undamped frequencies |s|/2π of all poles."""
        return np.asarray(np.abs(self.poles) / (2 * np.pi))

    @property
    def damping_ratio(self) -> NDArray[np.float64]:
        """Damping ratios −Re(s)/|s| of all poles."""
        return np.asarray(-self.poles.real / np.abs(self.poles))

    def __repr__(self) -> str:
        return _show.diagram_line(self)

    def _repr_html_(self) -> str:
        return _show.diagram_html(self)


@one_blas_thread
def build_stability(
    frf: FRF,
    band_hz: tuple[float, float] = (20.0, 260.0),
    *,
    max_order: int = 60,
    max_damping: float = 0.2,
    method: str = "lsce",
) -> StabilityDiagram:
    """Poles of all model orders, matched from order to order, clustered and judged.

    Parameters
    ----------
    frf : FRF
    band_hz : tuple of float
        Band in which modes are sought. Some lines beyond it are used where their noise allows, so
        that modes just outside are seen as such.
    max_order : int
        Highest model order: the number of poles in the band.
    max_damping : float
        Poles with a larger damping ratio are not taken for modes.
    method : {"lsce", "plscf"}
        Least-squares complex exponentials from impulse responses, or polyreference least-squares
        complex frequency from the FRFs, weighted with their noise.

    Returns
    -------
    StabilityDiagram

    Raises
    ------
    InputError
        If there is no such method.
    FitError
        Where the band holds too few lines.
    """
    if method not in METHODS:
        raise InputError(
            "poles", f"method {method!r}", f"known are {', '.join(METHODS)}", "Choose one"
        )
    lines = widened_band(frf, band_hz)
    frequency_hz, values = frf.frequency_hz[lines], align_runs(frf, lines)
    values = without_spikes(frf, lines, values)
    responses, step_s = impulse_responses(frequency_hz, values)
    max_order = max(min(max_order, responses.shape[1] // 4), 2)
    length = useful_length(responses, shortest=3 * max_order)
    # The first sample holds the direct part of an inertance and the residual terms.
    piece = responses[:, 1:length]
    matrix = METHODS[method](piece, values, frf.std[:, lines], max_order)
    found = pole_history(matrix, piece, step_s, frequency_hz[0], max_damping)
    label, verdicts = interpret(found, max_order)
    return StabilityDiagram(
        band_hz=band_hz,
        model_order=found.model_order,
        poles=found.poles,
        stable_frequency=found.step_frequency < STABLE_FREQUENCY,
        stable_damping=found.step_damping < STABLE_DAMPING,
        cluster=label,
        clusters=tuple(
            Cluster(number, verdict.pole, verdict.size, verdict.kept, verdict.reason)
            for number, verdict in enumerate(verdicts)
        ),
        indicator_hz=frequency_hz,
        indicator=np.sqrt(np.mean(np.abs(values) ** 2, axis=0)),
    )


def widened_band(frf: FRF, band_hz: tuple[float, float]) -> slice:
    """Lines of the band and, where their noise allows, of a margin on both sides.

    Raises
    ------
    FitError
        Where the band holds too few lines to identify anything.
    """
    frequency_hz = frf.frequency_hz
    low, high = np.searchsorted(frequency_hz, band_hz, side="left")
    high = int(np.searchsorted(frequency_hz, band_hz[1], side="right"))
    if high - low < _FEWEST_LINES:
        raise FitError(
            f"only {max(high - low, 0)} frequency lines between {band_hz[0]:g} and "
            f"{band_hz[1]:g} Hz; at least {_FEWEST_LINES} are needed, and the FRFs end at "
            f"{frequency_hz[-1]:g} Hz. Widen the band, use longer blocks or correct the sampling "
            "rate."
        )
    margin = int(_MARGIN * (high - low))
    first, last = max(int(low) - margin, 0), min(high + margin, frequency_hz.size)
    noise = np.median(frf.std[:, first:last], axis=0)
    # FRFs without σ get no verdict on their noise: the margin stays whole.
    allowed = _MARGIN_NOISE * np.max(noise[low - first : high - first])
    barred = first + np.flatnonzero((noise > allowed) | (frequency_hz[first:last] <= 0))
    below, above = barred[barred < low], barred[barred >= high]
    return slice(
        int(below.max()) + 1 if below.size else first, int(above.min()) if above.size else last
    )


def _lsce(
    piece: NDArray[np.complex128],
    values: NDArray[np.complex128],
    std: NDArray[np.float64],
    max_order: int,
) -> NDArray[np.complex128]:
    return normal_matrix(piece, max_order)


def _plscf(
    piece: NDArray[np.complex128],
    values: NDArray[np.complex128],
    std: NDArray[np.float64],
    max_order: int,
) -> NDArray[np.complex128]:
    return reduced_normal_matrix(values, max_order, line_weight(std))


#: Normal matrix whose leading blocks give the poles of every order, from (impulse responses,
#: FRFs, their σ, highest order).
METHODS: dict[str, Callable[..., NDArray[np.complex128]]] = {"lsce": _lsce, "plscf": _plscf}
