"""The stability diagram, and the automatic selection of physical poles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import isnan
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ema.circumference.orders import on_circle
from ema.core.display import band_text, counted, table
from ema.core.drawings import plot, poles_picture
from ema.core.errors import FitError, InputError, require_type
from ema.core.frf import FRF
from ema.core.modes import ModalModel, Mode, Pair
from ema.core.numerics import (
    ReadonlyArrays,
    end_if_stopped,
    frame_of,
    kept_with,
    one_blas_thread,
    readonly,
)
from ema.core.references import References, cmif_of, frfs_of, mif_of
from ema.core.settings import IDENTIFICATION, IdentificationSettings
from ema.poles.estimators import (
    impulse_responses,
    line_weight,
    normal_matrix,
    prepared,
    reduced_normal_matrix,
    useful_length,
    widened_band,
)
from ema.poles.tracking import Cluster, PoleSelection, interpret, pole_history

if TYPE_CHECKING:
    import pandas as pd

#: Pole estimators, and how they are written.
METHOD_NAMES = {"lsce": "LSCE", "plscf": "p-LSCF"}
METHODS = tuple(METHOD_NAMES)
_MOST_ORDERS = 1000  # far above any use; time and memory grow with its square
OTHER = {"lsce": "plscf", "plscf": "lsce"}

# Model orders that show every mode of a tyre; a second look need not go further.
_ENOUGH = 40
# A pole may belong to a mode within so many times `cross_check_frequency`; both agree within so
# many standard deviations; so many draws of the noise show what the estimator makes of the modes.
_REACH, _STDS, _DRAWS = 4, 3, 4


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
        """Poles in clusters over frequency and model order, before the RMS inertance."""
        shown = self.cluster >= 0
        given = self.frequency_hz[shown], self.model_order[shown], self.indicator_hz, self.indicator
        return poles_picture(self.band_hz, *given)


@one_blas_thread
def build_stability(
    frf: FRF | References,
    band_hz: tuple[float, float] | None = None,
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
    band_hz : tuple of float, optional
        Band in which modes are sought; default: `FRF.default_band_hz`. Some lines beyond it are
        used where their noise allows, so that modes just outside are seen as such.
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
    band_hz = band_hz or rows[0].default_band_hz()
    bands = [widened_band(each, band_hz) for each in rows]
    lines = slice(max(band.start for band in bands), min(band.stop for band in bands))
    frequency_hz = rows[0].frequency_hz[lines]
    measured = [prepared(each, lines.start, lines.stop) for each in rows]
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
    several = {} if n_forces == 1 else _of_several(measured)
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


def _of_several(values: Sequence[NDArray[np.complex128]]) -> dict[str, NDArray[np.float64]]:
    """Indicator functions of several forces."""
    by_line = np.stack([each.T for each in values], axis=2)
    return {"cmif": cmif_of(by_line), "mif": mif_of(by_line)}


def _verdict(cluster: Cluster, band_hz: tuple[float, float]) -> str:
    """Whether a cluster becomes a mode; beyond the band it guards the band's ends at most."""
    if not band_hz[0] <= cluster.frequency_hz <= band_hz[1]:
        return "beyond the band"
    return "yes" if cluster.kept else "no"


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
    agrees: bool  # with the mode, or with what it makes of the modes' own FRFs


def second_opinion(
    frf: FRF | References,
    modes: Sequence[Mode],
    band_hz: tuple[float, float],
    method: str,
    max_order: int,
    settings: IdentificationSettings = IDENTIFICATION,
    *,
    models: Sequence[ModalModel] = (),
) -> tuple[Opinion, ...]:
    """Find the poles again with another `method` and compare them with the modes.

    Every estimator errs where pairs are close, modes weak or noise is large. Where it differs from
    the modes, it is asked about FRFs of the `models` (of each force) with noise like that of the
    measured ones: a pole that it finds there too, or misses there too, does not contradict them.
    """
    asked = band_hz, method, min(max_order, _ENOUGH), settings
    seen = _poles_of(frf, *asked)
    free = [pole for pole in seen.tolist() if band_hz[0] <= abs(pole) / (2 * np.pi) <= band_hz[1]]
    std = [(mode.frequency_std_hz, mode.damping_std) for mode in modes]
    places = [_Place.of(m.pole, settings, own) for m, own in zip(modes, std, strict=True)]
    own, nothing = _matched(places, free), float("nan")
    opinions = []
    for k, mode in enumerate(modes):
        pole = own.get(k, complex(nothing, nothing))
        agrees = places[k].apart(pole) < 1
        opinions.append(Opinion(method, mode.frequency_hz, *_measures(pole), agrees))
    free = [pole for pole in free if pole not in own.values()]
    opinions += [Opinion(method, nothing, *_measures(pole), False) for pole in free]
    places += [_Place.of(pole, settings) for pole in free]
    fits = [frf.n_positions for frf in frfs_of(frf)] == [len(m.position_deg) for m in models]
    for draw in range(_DRAWS if fits else 0):
        opinions = _with_partners(opinions, modes)
        if all(opinion.agrees for opinion in opinions[: len(modes)]):
            break
        expected = _expected_poles(models[0], tuple(models[1:]), frf, draw, *asked)
        opinions = [
            replace(one, agrees=one.agrees or place.is_alike(seen, expected))
            for one, place in zip(opinions, places, strict=True)
        ]
    return tuple(_with_partners(opinions, modes))


def _with_partners(opinions: list[Opinion], modes: Sequence[Mode]) -> list[Opinion]:
    """One pole for both members of a resolved pair is no disagreement: few estimators tell two."""
    there = [(k, m.order) for k, m in enumerate(modes) if m.pair is Pair.RESOLVED]
    confirmed = {order for k, order in there if opinions[k].agrees}
    alone = {k for k, n in there if n in confirmed and isnan(opinions[k].frequency_hz)}
    return [replace(o, agrees=True) if k in alone else o for k, o in enumerate(opinions)]


def _matched(places: Sequence[_Place], poles: Sequence[complex]) -> dict[int, complex]:
    """Poles of places, one to one, the closest first."""
    near = [(place.apart(p), k, p) for k, place in enumerate(places) for p in place.among(poles)]
    own = dict[int, complex]()
    for _, k, pole in sorted(near, key=lambda each: each[0]):
        own |= {} if k in own or pole in own.values() else {k: pole}
    return own


@dataclass(frozen=True)
class _Place:
    """A pole, and how far others may be from it, as shares of its frequency and damping ratio."""

    pole: complex
    frequency: float
    damping: float
    reach: float  # share of the frequency within which a pole may belong to it

    @classmethod
    def of(
        cls, pole: complex, settings: IdentificationSettings, std: tuple[float, float] = (0.0, 0.0)
    ) -> _Place:
        """Place of a pole, by its ± where that is larger than what is asked for."""
        asked = settings.cross_check_frequency, settings.cross_check_damping
        frequency, damping = np.fmax(asked, _STDS * np.array(std) / _measures(pole)).tolist()
        return cls(pole, frequency, damping, max(_REACH * asked[0], frequency))

    def apart(self, pole: complex, own: complex | None = None) -> float:
        """Distance of a pole from this one, or from `own`: 1 where they just do not agree."""
        (f, ratio), (own_f, own_ratio) = _measures(pole), _measures(own or self.pole)
        return max(abs(f / own_f - 1) / self.frequency, abs(ratio / own_ratio - 1) / self.damping)

    def among(self, poles: Sequence[complex]) -> list[complex]:
        """Poles that may belong here."""
        return [pole for pole in poles if abs(abs(pole) / abs(self.pole) - 1) < self.reach]

    def is_alike(self, seen: NDArray[np.complex128], expected: NDArray[np.complex128]) -> bool:
        """Whether two sets of poles have the same here, or both have nothing."""
        there = self.among(seen.tolist()), self.among(expected.tolist())
        first, second = (min(poles, key=self.apart, default=None) for poles in there)
        if first is None or second is None:
            return first is second
        return self.apart(first, second) < 1


def _measures(pole: complex) -> tuple[float, float]:
    """Natural frequency in Hz and damping ratio."""
    return abs(pole) / (2 * np.pi), -pole.real / abs(pole)


@kept_with
def _expected_poles(
    model: ModalModel, others: tuple[ModalModel, ...], frf: FRF | References, draw: int, *asked: Any
) -> NDArray[np.complex128]:
    """Poles that a method selects where the modes are exact, and the noise that of the FRFs."""
    random, rows = np.random.default_rng(draw), list[FRF]()
    for own, each in zip((model, *others), frfs_of(frf), strict=True):
        noise = random.standard_normal((2, *each.std.shape)) * np.nan_to_num(each.std)
        exact = own.synthesise(each.frequency_hz, each.run)
        rows.append(replace(each, values=exact + noise[0] + 1j * noise[1]))
    return _poles_of(rows[0] if isinstance(frf, FRF) else References(tuple(rows)), *asked)


@kept_with
def _poles_of(
    frf: FRF | References,
    band_hz: tuple[float, float],
    method: str,
    max_order: int,
    settings: IdentificationSettings,
) -> NDArray[np.complex128]:
    """Poles that a method selects, without the window of an analyser; refits ask again."""
    window = frfs_of(frf)[0].exponential_window
    try:
        diagram = build_stability(
            frf, band_hz, max_order=max_order, method=method, settings=settings
        )
        poles = select_poles(diagram).poles
    except FitError:
        return readonly(np.zeros(0), complex)
    return poles if window is None else readonly(poles + window.decay_per_s, complex)
