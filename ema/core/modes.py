"""Modes: poles, residues and residual terms fitted to FRFs, with their uncertainty."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ema.core.campaign import Direction
from ema.core.display import band_text, counted, number, table, value_with_std
from ema.core.drawings import plot, shapes_picture
from ema.core.drift import NO_DRIFT, Drift
from ema.core.mac import mpc, mpd_deg
from ema.core.numerics import ReadonlyArrays, columns_of, frame_of
from ema.core.recording import ExponentialWindow

if TYPE_CHECKING:
    import pandas as pd

#: Columns of `ModalModel.to_frame`, and the attributes of a `Mode` they hold.
MODE_COLUMNS = {
    "order": "order",
    "member": "member",
    "frequency_hz": "frequency_hz",
    "frequency_std_hz": "frequency_std_hz",
    "damping_ratio": "damping_ratio",
    "damping_ratio_std": "damping_std",
    "mpc": "mpc",
    "mpd_deg": "mpd_deg",
    "order_purity": "order_purity",
    "status": "status",
    "pair": "pair",
    "chosen": "chosen",
    "frequency_band_shift_hz": "frequency_band_shift_hz",
    "damping_ratio_band_shift": "damping_band_shift",
    "name": "common_name",
}
MASS_COLUMNS = ("modal_mass_kg", "modal_mass_std_kg", "modal_mass_spread")  # of several forces
#: Names of modes of low order, by direction (SAE J2710 for those against the rim).
COMMON_NAMES = {
    (Direction.RADIAL, 0): "breathing",
    (Direction.RADIAL, 1): "vertical and fore-aft translation",
    (Direction.TANGENTIAL, 0): "torsion",
    (Direction.TANGENTIAL, 1): "vertical and fore-aft translation",
    (Direction.AXIAL, 0): "lateral translation",
    (Direction.AXIAL, 1): "yaw and camber",
}


class Pair(StrEnum):
    """What is known of the second mode of an order n ≥ 1."""

    RESOLVED = "resolved"
    ONE_SEEN = "one member seen"
    NOT_SEPARABLE = "not separable"
    SINGLE = "single"
    UNKNOWN = ""


class Flag(StrEnum):
    """What the reader of a mode must know; a mode without flags is ``"ok"``."""

    NOT_RING_MODE = "not a ring mode"
    ORDER_UNKNOWN = "order unknown"
    NO_CLEAR_PEAK = "no clear peak"
    AT_BOUND = "at bound"


class Chosen(StrEnum):
    """Who put a mode on the list."""

    AUTOMATIC = "automatic"
    KEPT = "kept"  # by hand, a mode of the automatic fit
    PICKED = "picked"  # by hand, from the stability diagram or as the second mode of its order


@dataclass(frozen=True, eq=False)
class Mode(ReadonlyArrays):
    """One mode of vibration.

    Parameters
    ----------
    pole : complex
        s = −ζω + jω√(1−ζ²) in rad/s, upper half plane.
    frequency_std_hz, damping_std : float
        Standard deviations of `frequency_hz` and `damping_ratio`; NaN where unknown.
    residues : ndarray of complex, shape (n_positions,)
        A_i in H_i = −ω² Σ_r [A_ir/(jω−s_r) + A*_ir/(jω−s*_r)] + L_i − ω² U_i.
    residues_std : ndarray, shape (n_positions,)
        Standard deviation of their real and of their imaginary part.
    order : int or None
        Circumferential order n; None where there is no circle of sensors.
    member : str
        ``"a"`` or ``"b"`` for the two modes of a resolved pair, otherwise empty.
    order_purity : float
        Share of the shape's power in its circumferential order; NaN without a circle.
    pair : Pair
        Which members of its order's pair are seen.
    flags, remark : tuple of Flag, str
        What its reader must know, and why; empty where nothing is wrong.
    frequency_band_shift_hz, damping_band_shift : float
        Largest change when the band loses lines at either end, no part of the ±; NaN next to it.
    chosen : Chosen
        Who put it on the list.
    modal_mass_kg, modal_mass_std_kg, modal_mass_spread : float
        Mass of the shape with a largest part of 1, its ±, and how far several driving points are
        apart (relative, weighted RMS); NaN where unknown.

    Examples
    --------
    >>> import numpy as np
    >>> import ringmodal as rm
    >>> angle = np.radians(np.arange(0.0, 360.0, 30.0))
    >>> mode = rm.Mode(
    ...     pole=2 * np.pi * 100.0 * complex(-0.02, 0.9998),
    ...     frequency_std_hz=0.01,
    ...     damping_std=1e-4,
    ...     residues=0.3j * np.cos(2 * angle),
    ...     residues_std=np.full(12, 0.001),
    ...     order=2,
    ... )
    >>> f"{mode.frequency_hz:.2f} Hz, {100 * mode.damping_ratio:.2f} %, MPC {mode.mpc:.1f}"
    '100.00 Hz, 2.00 %, MPC 1.0'
    """

    pole: complex
    frequency_std_hz: float
    damping_std: float
    residues: NDArray[np.complex128]
    residues_std: NDArray[np.float64]
    order: int | None = None
    member: str = ""
    order_purity: float = float("nan")
    pair: Pair = Pair.UNKNOWN
    flags: tuple[Flag, ...] = ()
    remark: str = ""
    frequency_band_shift_hz: float = float("nan")
    damping_band_shift: float = float("nan")
    chosen: Chosen = Chosen.AUTOMATIC
    modal_mass_kg: float = float("nan")
    modal_mass_std_kg: float = float("nan")
    modal_mass_spread: float = float("nan")

    @property
    def frequency_hz(self) -> float:
        """Undamped frequency |s|/2π."""
        return float(abs(self.pole) / (2 * np.pi))

    @property
    def damping_ratio(self) -> float:
        """Damping ratio −Re(s)/|s|."""
        return float(-self.pole.real / abs(self.pole))

    @property
    def status(self) -> str:
        """``"ok"``, or the flags separated by semicolons."""
        return "; ".join(self.flags) or "ok"

    @property
    def is_ring_mode(self) -> bool:
        """Whether the order is that of the ring's dispersion curve."""
        return self.order is not None and Flag.NOT_RING_MODE not in self.flags

    @property
    def common_name(self) -> str:
        """Name of a radial mode of low order; empty for others."""
        known = self.order is not None and self.is_ring_mode
        return COMMON_NAMES.get((Direction.RADIAL, self.order or 0), "") if known else ""

    @property
    def doubtful(self) -> bool:
        """Whether the mode is not one of the ring, has no clear peak, or is at a bound."""
        return any(flag is not Flag.ORDER_UNKNOWN for flag in self.flags)

    @property
    def shape(self) -> NDArray[np.complex128]:
        """Residues turned to be as real as they can be and scaled to a largest part of 1."""
        turned = self.residues * np.exp(-0.5j * np.angle(np.sum(self.residues**2)))
        peak = turned[np.argmax(np.abs(turned))]
        return np.asarray(turned / (np.abs(peak) * (np.sign(peak.real) or 1.0)))

    @property
    def mpc(self) -> float:
        """Modal phase collinearity, 1 for a real mode."""
        return mpc(self.residues)

    @property
    def mpd_deg(self) -> float:
        """Mean phase deviation in degrees, 0 for a real mode."""
        return mpd_deg(self.residues)

    def __repr__(self) -> str:
        order = "" if self.order is None else f"order {self.order}{self.member}, "
        frequency = value_with_std(self.frequency_hz, self.frequency_std_hz)
        return f"<Mode: {order}{frequency} Hz, {_damping(self)} %, {self.status}>"


@dataclass(frozen=True, eq=False)
class ResidualTerms(ReadonlyArrays):
    """What the modes outside the band add to each FRF, (n_positions,): L_i − ω² U_i."""

    lower: NDArray[np.float64]  # L in (m/s²)/N, the modes below the band (1/mass)
    upper: NDArray[np.float64]  # U in m/N, the modes above the band (1/stiffness)


@dataclass(frozen=True, eq=False)
class ModalModel(ReadonlyArrays):
    """The modes of a band and everything needed to draw the FRFs from them.

    Parameters
    ----------
    modes : tuple of Mode
        Modes inside the band, ascending in frequency.
    guard_modes : tuple of Mode
        Modes just outside the band; part of the fit, not of the result.
    residual_terms : ResidualTerms
        Everything farther away.
    band_hz, fit_band_hz : tuple of float
        Band of the result, and of the lines that were fitted.
    covariance : ndarray, shape (2 n_modes, 2 n_modes)
        Covariance of (frequency_hz, damping_ratio) of `modes`, mode by mode.
    frac : ndarray, shape (n_positions,)
        Frequency response assurance criterion over the fitted lines.
    misfit : float
        Reduced χ² of the fit, 1 for noise alone.
    node, position_deg, axis, excitation_deg : ndarray, shape (n_positions,), and float
        Where the rows and the force are, as in `FRF`.
    drift : Drift
        Drift over the runs; the modes are those of the first run's state.
    orders : tuple of OrderReport
        Verdict on the pair of each order of the ring, and what the order says by itself.
    exponential_window : ExponentialWindow or None
        That of the analyser, whose damping the modes do not have.
    widened_per_s : ndarray, shape (n_modes,)
        Decay rates that changes within the runs add to what is seen of `modes`; else empty.
    notes : tuple of str
        What was assumed or dropped, in words.

    Examples
    --------
    >>> import numpy as np
    >>> import ringmodal as rm
    >>> frf = rm.estimate_frf(rm.read_campaign("sample_data/tyre_225_55R17"))
    >>> frf = frf.rows(np.arange(0, 72, 6))  # every 30°, to be quick
    >>> model = rm.fit_modes(frf, rm.select_poles(rm.build_stability(frf)))
    >>> model
    <ModalModel: 9 modes, 20 to 300 Hz>
    >>> fitted = model.synthesise(frf.frequency_hz[80:1200])
    >>> bool(rm.frac(frf.values[:, 80:1200], fitted).min() > 0.99)
    True
    """

    modes: tuple[Mode, ...]
    guard_modes: tuple[Mode, ...]
    residual_terms: ResidualTerms
    band_hz: tuple[float, float]
    fit_band_hz: tuple[float, float]
    covariance: NDArray[np.float64]
    frac: NDArray[np.float64]
    misfit: float
    node: NDArray[np.int_]
    position_deg: NDArray[np.float64]
    drift: Drift = NO_DRIFT
    orders: tuple[OrderReport, ...] = ()
    exponential_window: ExponentialWindow | None = None
    widened_per_s: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    notes: tuple[str, ...] = ()
    axis: NDArray[np.int_] = field(default_factory=lambda: np.zeros(0, dtype=int))
    excitation_deg: float = float("nan")

    @property
    def frequencies_hz(self) -> NDArray[np.float64]:
        """Undamped frequencies of the modes."""
        return np.array([mode.frequency_hz for mode in self.modes])

    @property
    def damping_ratios(self) -> NDArray[np.float64]:
        """Damping ratios of the modes."""
        return np.array([mode.damping_ratio for mode in self.modes])

    def synthesise(
        self,
        frequency_hz: NDArray[np.float64],
        run: Sequence[str] | None = None,
        rows: slice = slice(None),
    ) -> NDArray[np.complex128]:
        """Inertances of all positions, or of some, (n_positions, n_frequencies).

        Parameters
        ----------
        frequency_hz : ndarray, shape (n_frequencies,)
        run : sequence of str, optional
            Run of each position, to see each as it was measured, in the state of its run. Without
            it, all in that of the first run.
        rows : slice, optional
            Positions that are wanted.
        """
        poles, residues = self.poles_and_residues(as_measured=run is not None)
        names = np.array(list(run or [""] * len(residues)))[rows]
        parts = residues[rows], self.residual_terms.lower[rows], self.residual_terms.upper[rows]
        values = np.empty((names.size, np.size(frequency_hz)), dtype=complex)
        for name in np.unique(names):
            own, seen = names == name, self.drift.poles_in(str(name), poles)
            values[own] = synthesise(frequency_hz, seen, *(part[own] for part in parts))
        return values

    def poles_and_residues(
        self, *, as_measured: bool = False
    ) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        """Poles and residues, (n_positions, n_modes); as measured with all damping that is seen."""
        everything = self.modes + self.guard_modes
        poles = np.array([mode.pole for mode in everything])
        residues = np.stack([mode.residues for mode in everything], axis=1)
        if not as_measured:
            return poles, residues
        seen = poles - np.pad(self.widened_per_s, (0, poles.size - self.widened_per_s.size))
        if self.exponential_window is None:
            return seen, residues
        windowed = np.asarray(seen - self.exponential_window.decay_per_s, dtype=complex)
        return windowed, residues * (seen / windowed) ** 2

    @property
    def columns(self) -> dict[str, str]:
        """Columns of the table, and the attributes of a `Mode` that they hold."""
        known = any(np.isfinite(mode.modal_mass_kg) for mode in self.modes)
        return MODE_COLUMNS | ({name: name for name in MASS_COLUMNS} if known else {})

    def to_frame(self) -> pd.DataFrame:
        """Table of the modes, one row for each.

        Returns
        -------
        pandas.DataFrame
            ``mode`` (from 1), ``order`` (missing without a circle), ``member``, ``frequency_hz``,
            ``frequency_std_hz``, ``damping_ratio``, ``damping_ratio_std``, ``mpc``, ``mpd_deg``
            (degrees), ``order_purity``, ``status``, ``pair``, ``chosen``,
            ``frequency_band_shift_hz``, ``damping_ratio_band_shift``, with several forces also
            ``modal_mass_kg``, ``modal_mass_std_kg``, ``modal_mass_spread``; NaN where unknown.

        Examples
        --------
        >>> import ema
        >>> campaign = ema.read_campaign("sample_data/tyre_225_55R17")
        >>> found = ema.identify_modes(ema.estimate_frf(campaign), band_hz=(20, 260))
        >>> table = found.model.to_frame()
        >>> table["frequency_hz"].round().head(2).to_list()
        [79.0, 100.0]
        """
        return frame_of(self.to_columns(), whole=("order",))

    def to_columns(self) -> dict[str, list[Any]]:
        """Columns of `to_frame` by name, without pandas."""
        return {"mode": [*range(1, len(self.modes) + 1)], **columns_of(self.modes, self.columns)}

    def plot(self, ax: Any = None, *, mode: int | None = None) -> Any:
        """Draw the shapes of all modes, or of one, on axes of matplotlib; return these.

        Parameters
        ----------
        ax : Axes or array of Axes, optional
            Default: those of a new figure of pyplot, one for each mode.
        mode : int, optional
            Number in the table, from 1.
        """
        return plot(self, ax, mode=mode)

    def __repr__(self) -> str:
        return f"<ModalModel: {counted(len(self.modes), 'mode')}, {band_text(self.band_hz)}>"

    def _repr_html_(self) -> str:
        return model_html(self)


def synthesise(
    frequency_hz: NDArray[np.float64],
    poles: NDArray[np.complex128],
    residues: NDArray[np.complex128],
    lower: NDArray[np.float64],
    upper: NDArray[np.float64],
) -> NDArray[np.complex128]:
    """Inertances from poles, residues and residual terms.

    H_i = −ω² Σ_r [A_ir/(jω−s_r) + A*_ir/(jω−s*_r)] + L_i − ω² U_i (Ewins 2000, eq. 4.29, as
    inertance): (n_positions, n_frequencies) in (m/s²)/N of poles in rad/s, residues, (n_positions,
    n_modes), and the residual terms `lower`, L in (m/s²)/N, and `upper`, U in m/N.
    """
    omega = 2 * np.pi * np.asarray(frequency_hz)
    direct = 1 / (1j * omega - poles[:, None])
    mirrored = 1 / (1j * omega - poles[:, None].conj())
    modal = residues @ direct + residues.conj() @ mirrored
    return np.asarray(-(omega**2) * (modal + upper[:, None]) + lower[:, None])


def model_html(model: ModalModel) -> str:
    """The table of modes, and their shapes where these are on a circle."""
    shown = modes_html(model.modes, f"Modes, {band_text(model.band_hz)}")
    if not model.modes or not np.all(np.isfinite(model.position_deg)):
        return shown
    shapes = [mode.shape.real for mode in model.modes]
    return shown + shapes_picture(model.position_deg, shapes)


def modes_html(modes: Sequence[Mode], caption: str) -> str:
    """Frequency and damping with one standard deviation, mode by mode."""
    head = ("mode", "order", "frequency / Hz", "damping / %", "MPC", "purity", "pair", "status")
    rows = [
        (
            *(str(number_of_mode), "–" if mode.order is None else f"{mode.order}{mode.member}"),
            *(value_with_std(mode.frequency_hz, mode.frequency_std_hz), _damping(mode)),
            *(f"{mode.mpc:.3f}", number(mode.order_purity), mode.pair, mode.status),
        )
        for number_of_mode, mode in enumerate(modes, start=1)
    ]
    return table(caption, head, rows, words=(6, 7))


def _damping(mode: Mode) -> str:
    return value_with_std(100 * mode.damping_ratio, 100 * mode.damping_std)


@dataclass(frozen=True)
class PairVerdict:
    """Whether an order shows one mode of its pair or both, and on what evidence."""

    order: int
    verdict: Pair
    chance: float  # that noise alone makes a second pole fit that much better; NaN if not tested
    evidence: str  # in words


@dataclass(frozen=True)
class OrderReport:
    """What one circumferential order shows, by its own FRFs alone; NaN where that failed."""

    pair: PairVerdict
    frequency_hz: float = float("nan")  # of the main mode, as all that follows
    frequency_std_hz: float = float("nan")
    damping_ratio: float = float("nan")
    damping_std: float = float("nan")
    antinode_deg: float = float("nan")  # of member a, from 0 to 180°/n, where several forces tell
    antinode_std_deg: float = float("nan")

    @property
    def order(self) -> int:
        """Circumferential order."""
        return self.pair.order
