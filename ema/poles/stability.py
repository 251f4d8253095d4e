"""The stability diagram, and the automatic selection of physical poles."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ema.circumference.orders import on_circle
from ema.core.display import band_text, counted, table
from ema.core.drawings import level_path, path_of, picture, plot, scaled
from ema.core.errors import InputError, require_type
from ema.core.frf import FRF
from ema.core.numerics import (
    ReadonlyArrays,
    end_if_stopped,
    frame_of,
    kept_with,
    one_blas_thread,
    readonly,
)
from ema.core.references import References, frfs_of
from ema.core.settings import IDENTIFICATION, IdentificationSettings
from ema.poles.estimators import (
    align_runs,
    impulse_responses,
    line_weight,
    normal_matrix,
    reduced_normal_matrix,
    useful_length,
    widened_band,
)
from ema.poles.tracking import Cluster, interpret, pole_history
from ema.signals.leakage import without_spikes

if TYPE_CHECKING:
    import pandas as pd
from collections.abc import Sequence

from numpy.typing import ArrayLike

from ema.core.errors import FitError
from ema.core.modes import Mode

#: Pole estimators.
METHODS = ("lsce", "plscf")
_MOST_ORDERS = 1000  # far above any use; time and memory grow with its square
OTHER = {"lsce": "plscf", "plscf": "lsce"}

# Model orders that show every mode of a tyre; a second look need not go further.
_ENOUGH = 40


@dataclass(frozen=True, eq=False)
class StabilityDiagram(ReadonlyArrays):
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
    participation : ndarray of complex, shape (n_poles, n_forces)
        How each of several forces drives the pole, the largest 1; empty for one force.
    cmif, mif : ndarray, shape (n_forces, n_lines)
        Indicator functions of several forces, see `References`; empty for one force.

    Examples
    --------
    >>> import numpy as np
    >>> import ringmodal as rm
    >>> frf = rm.estimate_frf(rm.read_campaign("sample_data/tyre_225_55R17"))
    >>> frf = frf.rows(np.arange(0, 72, 6))  # every 30°, to be quick
    >>> diagram = rm.build_stability(frf, band_hz=(60.0, 160.0))
    >>> [f"{c.frequency_hz:.0f} Hz" for c in diagram.clusters if c.kept and c.frequency_hz < 130]
    ['79 Hz', '100 Hz', '121 Hz']
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
    participation: NDArray[np.complex128] = field(default_factory=lambda: np.zeros((0, 0), complex))
    cmif: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 0)))
    mif: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 0)))

    @property
    def frequency_hz(self) -> NDArray[np.float64]:
        """Undamped frequencies |s|/2π of all poles."""
        return np.asarray(np.abs(self.poles) / (2 * np.pi))

    @property
    def damping_ratio(self) -> NDArray[np.float64]:
        """Damping ratios −Re(s)/|s| of all poles."""
        return np.asarray(-self.poles.real / np.abs(self.poles))

    def to_frame(self) -> pd.DataFrame:
        """Table of the poles, one row for each pole of each model order.

        Returns
        -------
        pandas.DataFrame
            ``order`` (of the model), ``frequency_hz``, ``damping_ratio``, ``stable_frequency``,
            ``stable_damping`` (true or false) and ``cluster`` (−1: none).
        """
        return frame_of(self.to_columns())

    def to_columns(self) -> dict[str, NDArray[Any]]:
        """Columns of `to_frame` by name."""
        names = "frequency_hz", "damping_ratio", "stable_frequency", "stable_damping", "cluster"
        return {"order": self.model_order, **{name: getattr(self, name) for name in names}}

    def plot(self, ax: Any = None) -> Any:
        """Draw poles over frequency and model order on axes of matplotlib, and return these."""
        return plot(self, ax)

    def __repr__(self) -> str:
        kept = sum(_verdict(cluster, self.band_hz) == "yes" for cluster in self.clusters)
        highest = int(self.model_order.max(initial=0))
        return (
            f"<StabilityDiagram: {band_text(self.band_hz)}, {counted(self.poles.size, 'pole')} up "
            f"to model order {highest}, {counted(kept, 'mode')} seen>"
        )

    def _repr_html_(self) -> str:
        rows = [
            (
                _verdict(cluster, self.band_hz),
                f"{cluster.frequency_hz:.2f}",
                f"{100 * cluster.damping_ratio:.2f}",
                str(cluster.size),
                cluster.reason,
            )
            for cluster in sorted(self.clusters, key=lambda cluster: cluster.frequency_hz)
        ]
        head = ("a mode", "frequency / Hz", "damping / %", "model orders", "why")
        title = f"Clusters of poles, {band_text(self.band_hz)}"
        return table(title, head, rows, words=(0, 4)) + self._picture()

    def _picture(self) -> str:
        """Poles in clusters over frequency and model order."""
        highest = int(self.model_order.max(initial=1))
        low, high = self.band_hz
        shown = (self.cluster >= 0) & (self.frequency_hz >= low) & (self.frequency_hz <= high)
        x = scaled(self.frequency_hz[shown], self.band_hz, 3, 477)
        y = scaled(self.model_order[shown], (0, highest), 137, 3)
        inside = (self.indicator_hz >= low) & (self.indicator_hz <= high)
        curve = level_path(self.indicator_hz[inside], self.indicator[inside], 480, 140)
        label = f"Poles in clusters up to model order {highest}, over the RMS inertance"
        return picture(label, 480, 140, [(curve, 0.6), (path_of(x, y, dots=True), 3.0)])


@one_blas_thread
def build_stability(
    frf: FRF | References,
    band_hz: tuple[float, float] = (20.0, 260.0),
    *,
    max_order: int = 60,
    method: str = "lsce",
    settings: IdentificationSettings = IDENTIFICATION,
) -> StabilityDiagram:
    """Poles of all model orders, matched from order to order, clustered and judged.

    Parameters
    ----------
    frf : FRF or References
        Of several forces, both methods are polyreference: they also tell poles apart that
        coincide, and how each force drives them. The model order then counts matrices of the
        polynomial: order p has p poles for each force.
    band_hz : tuple of float
        Band in which modes are sought. Some lines beyond it are used where their noise allows, so
        that modes just outside are seen as such.
    max_order : int
        Highest model order: the number of poles in the band.
    method : {"lsce", "plscf"}
        Least-squares complex exponentials from impulse responses, or polyreference least-squares
        complex frequency from the FRFs, weighted with their noise.
    settings : IdentificationSettings

    Raises
    ------
    InputError
        If there is no such method.
    FitError
        Where the band holds too few lines.

    Examples
    --------
    >>> import numpy as np
    >>> import ringmodal as rm
    >>> frf = rm.estimate_frf(rm.read_campaign("sample_data/tyre_225_55R17"))
    >>> frf = frf.rows(np.arange(0, 72, 6))  # every 30°, to be quick
    >>> rm.build_stability(frf, band_hz=(20.0, 260.0))
    <StabilityDiagram: 20 to 260 Hz, ... poles up to model order 60, 8 modes seen>
    """
    require_type("settings", settings, IdentificationSettings, "Leave it out")
    if str(method) not in METHODS:
        rule = f"it must be one of {', '.join(METHODS)}"
        raise InputError("poles", f"method {method!r}", rule, "Choose one")
    if not 2 <= require_type("max_order", max_order, (int, np.integer), "Write 60") <= _MOST_ORDERS:
        rule = f"it must be from 2 to {_MOST_ORDERS}"
        raise InputError("poles", f"max_order {max_order}", rule, "The usual one is 60")
    end_if_stopped()
    require_type("frf", frf, (FRF, References), "Estimate it with `estimate_frf`")
    rows = (frf,) if isinstance(frf, FRF) else frf.common_rows()
    n_forces = len(rows)
    bands = [widened_band(each, band_hz) for each in rows]
    lines = slice(max(band.start for band in bands), min(band.stop for band in bands))
    frequency_hz = rows[0].frequency_hz[lines]
    measured = [_prepared(each, lines.start, lines.stop) for each in rows]
    std = np.concatenate([each.std[:, lines] for each in rows])
    # One force must not count more than another because it is weaker where it acts.
    level = [1.0] if n_forces == 1 else [np.sqrt(np.mean(np.abs(m) ** 2)) for m in measured]
    values = measured[0] if n_forces == 1 else np.stack(measured) / np.array(level)[:, None, None]
    responses, step_s = impulse_responses(frequency_hz, values)
    max_order = max(min(2 * max_order // (n_forces + 1), responses.shape[-1] // 4), 2)
    length = useful_length(responses, shortest=3 * max_order)
    # The first sample holds the direct part of an inertance and the residual terms.
    piece = responses[..., 1:length]
    if method == "lsce":
        matrix = normal_matrix(piece, max_order)
    else:
        matrix = reduced_normal_matrix(values, max_order, line_weight(std))
    found = pole_history(matrix, piece, step_s, frequency_hz[0], settings.max_damping)
    late = not on_circle(rows[0].position_deg)
    label, clusters = interpret(found, max_order, settings, late=late)
    several = {} if n_forces == 1 else _of_several(rows, measured, lines)
    return StabilityDiagram(
        band_hz=band_hz,
        model_order=found.model_order,
        poles=found.poles,
        stable_frequency=found.step_frequency < settings.stable_frequency,
        stable_damping=found.step_damping < settings.stable_damping,
        cluster=label,
        clusters=tuple(clusters),
        indicator_hz=frequency_hz,
        indicator=np.sqrt(np.mean(np.abs(np.concatenate(measured)) ** 2, axis=0)),
        participation=found.participation * level if several else np.zeros((0, 0), complex),
        **several,
    )


@kept_with
def _prepared(frf: FRF, start: int, stop: int) -> NDArray[np.complex128]:
    """FRFs of some lines with runs aligned and tones taken out; both estimators ask for them."""
    lines = slice(start, stop)
    return readonly(without_spikes(frf, lines, align_runs(frf, lines)), complex)


def _of_several(
    rows: Sequence[FRF], values: Sequence[NDArray[np.complex128]], lines: slice
) -> dict[str, NDArray[np.float64]]:
    """Indicator functions of several forces."""
    there = [
        FRF.from_arrays(each.frequency_hz[lines], own)
        for each, own in zip(rows, values, strict=True)
    ]
    references = References(tuple(there))
    return {"cmif": references.cmif(), "mif": references.mif()}


def _verdict(cluster: Cluster, band_hz: tuple[float, float]) -> str:
    """Whether a cluster becomes a mode; beyond the band it guards the band's ends at most."""
    if not band_hz[0] <= cluster.frequency_hz <= band_hz[1]:
        return "beyond the band"
    return "yes" if cluster.kept else "no"


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
    frf: FRF | References,
    modes: Sequence[Mode],
    band_hz: tuple[float, float],
    method: str,
    max_order: int,
    settings: IdentificationSettings = IDENTIFICATION,
) -> tuple[Opinion, ...]:
    """Find the poles again with another `method` and compare them with the modes."""
    selection = _poles_of(frf, band_hz, method, min(max_order, _ENOUGH), settings)
    window = frfs_of(frf)[0].exponential_window
    if window is not None:
        selection = selection + window.decay_per_s
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
    frf: FRF | References,
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
