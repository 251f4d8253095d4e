"""Frequency response functions of all positions against one force."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from importlib import import_module
from typing import TYPE_CHECKING, Any, Literal, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ema.core.display import band_text, counted, facts
from ema.core.drawings import level_path, picture, plot
from ema.core.errors import InputError
from ema.core.finding import Check, Finding, Verdict
from ema.core.frf_arrays import (
    band_of,
    beside,
    coherent_lines,
    inertances_of,
    lines_of,
    one_angle,
    places_of,
    require_shapes,
)
from ema.core.numerics import ReadonlyArrays, frame_of, readonly
from ema.core.recording import BlockPlan, Channel, ExponentialWindow
from ema.core.settings import CHECKS

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

#: Where a tyre has the modes of its ring.
TYRE_BAND_HZ = (20.0, 300.0)
#: Arrays of an `FRF` with one row for each position.
ROW_ARRAYS = (
    *("values", "coherence", "std", "node", "position_deg", "axis"),
    *("clipped", "force_clipped", "missing", "disagreement"),
)


@dataclass(frozen=True, eq=False)
class ForceRecord:
    """Force of one run as recorded, read when needed."""

    force: Channel
    plan: BlockPlan  # blocks of this run


@dataclass(frozen=True, eq=False)
class FRF(ReadonlyArrays):
    """Inertances of all positions against one force, e^{+jωt}, H = X/F.

    Parameters
    ----------
    frequency_hz : ndarray, shape (n_frequencies,)
        Frequency lines, equidistant.
    values : ndarray of complex, shape (n_positions, n_frequencies)
        Inertance in (m/s²)/N.
    coherence : ndarray, shape (n_positions, n_frequencies)
        Ordinary coherence; NaN where unknown.
    std : ndarray, shape (n_positions, n_frequencies)
        Standard deviation of the real and of the imaginary part; NaN where unknown.
    node : ndarray of int, shape (n_positions,)
        Node numbers; −1 where there are none.
    position_deg : ndarray, shape (n_positions,)
        Angles counter-clockwise from the excitation's zero; NaN where there is no circle.
    axis : ndarray of int, shape (n_positions,)
        Axis of each response in the file: 1 to 3 for X, Y, Z; 0 where it states none.
    force_node, force_axis : int
        Node of the force and its axis in the file; 0 where it states none.
    run : tuple of str
        The run each row was measured in; several names joined by "+" where rows were averaged.
    channel : tuple of str
        Name of the channel each row was measured with; empty where unknown.
    blocks : BlockPlan or None
        How the recordings were cut; None for FRFs from a file.
    n_effective : float
        Independent averages; NaN where unknown.
    reference : FRF or None
        The fixed reference sensor, one row per run.
    clipped, force_clipped : ndarray, shape (n_positions,)
        Share of samples of the sensor and of its run's force that sit on the signal's extremes.
    missing : ndarray, shape (n_positions,)
        Share of the averages left out because samples are missing.
    disagreement : ndarray, shape (n_positions,)
        Share of their power by which runs differ that were averaged at one place.
    findings : tuple of Finding
        What is wrong with the recordings, and what was left out of them for that.
    excitation_deg : float
        Angle of the force; NaN where unknown.
    forces : dict of str to ForceRecord
        Force of each run, for FRFs from recordings.
    exponential_window : ExponentialWindow or None
        Window that the analyser applied to the responses; its damping is part of the values.
    estimator : {"H1", "H2", "Hv"}
    all_runs : tuple of str
        Runs of the campaign in their order, where some have no row here.

    Examples
    --------
    >>> import numpy as np
    >>> import ringmodal as rm
    >>> frequency_hz = np.linspace(0.0, 100.0, 201)
    >>> omega = 2 * np.pi * frequency_hz
    >>> values = -(omega**2) / (1e5 - omega**2 + 20j * omega)  # 1 kg, 50 Hz, 3 %
    >>> frf = rm.FRF(
    ...     frequency_hz=frequency_hz,
    ...     values=values[None],
    ...     coherence=np.ones((1, 201)),
    ...     std=np.full((1, 201), 0.01),
    ...     node=np.array([1]),
    ...     position_deg=np.array([0.0]),
    ...     run=("bench",),
    ... )
    >>> frf
    <FRF: 1 position, 0 to 100 Hz in steps of 0.5 Hz, 1 run>
    """

    frequency_hz: NDArray[np.float64]
    values: NDArray[np.complex128]
    coherence: NDArray[np.float64]
    std: NDArray[np.float64]
    node: NDArray[np.int_]
    position_deg: NDArray[np.float64]
    run: tuple[str, ...]
    channel: tuple[str, ...] = ()
    blocks: BlockPlan | None = None
    n_effective: float = float("nan")
    reference: FRF | None = None
    clipped: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    force_clipped: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    missing: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    disagreement: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    axis: NDArray[np.int_] = field(default_factory=lambda: np.zeros(0, dtype=int))
    force_node: int = 0
    force_axis: int = 0
    findings: tuple[Finding, ...] = ()
    excitation_deg: float = float("nan")
    forces: Mapping[str, ForceRecord] = field(default_factory=dict)
    exponential_window: ExponentialWindow | None = None
    estimator: str = "H1"
    all_runs: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        try:
            super().__post_init__()
        except (TypeError, ValueError) as error:
            rule, remedy = "an FRF is made of arrays of numbers", "Use FRF.from_arrays"
            raise InputError("FRF", str(error), rule, remedy) from error
        require_shapes(self)
        if not self.channel:
            object.__setattr__(self, "channel", ("",) * self.n_positions)
        for name in ("clipped", "force_clipped", "missing", "disagreement"):
            if not getattr(self, name).size:
                object.__setattr__(self, name, readonly(np.zeros(self.n_positions)))
        if not self.axis.size:
            object.__setattr__(self, "axis", readonly(np.zeros(self.n_positions), np.dtype(int)))

    @classmethod
    def from_arrays(
        cls,
        frequency_hz: ArrayLike,
        values: ArrayLike,
        *,
        angles_deg: ArrayLike | None = None,
        nodes: ArrayLike | None = None,
        coherence: ArrayLike | None = None,
        std: ArrayLike | None = None,
        unit: str = "(m/s^2)/N",
        excitation_deg: float = float("nan"),
    ) -> FRF:
        """FRFs from arrays of your own, checked and converted to inertance.

        Parameters
        ----------
        frequency_hz : array_like, shape (n_frequencies,)
            Rising, in even steps.
        values : array_like of complex, shape (n_positions, n_frequencies)
            FRFs of e^{+jωt}, one row for each position.
        angles_deg : array_like, shape (n_positions,), optional
            Angles around the tyre, counter-clockwise; without them there are no orders.
        nodes : array_like of int, shape (n_positions,), optional
            Node numbers; default: 1, 2, 3, … where there are no angles.
        coherence, std : array_like, shape (n_positions, n_frequencies), optional
            Coherence from 0 to 1; standard deviation of the real and of the imaginary part, in
            `unit`.
        unit : str
            Motion over force: ``"(m/s^2)/N"``, ``"g/N"``, ``"(mm/s)/N"``, ``"mm/kN"`` …
        excitation_deg : float
            Angle of the force, if known: for the check of its place.

        Raises
        ------
        InputError
            If shapes do not fit, numbers are not finite, frequencies are uneven, values are real,
            angles are in radians or repeated, or the unit is not motion over force.

        Examples
        --------
        >>> import numpy as np
        >>> import ringmodal as rm
        >>> frequency_hz = np.arange(0.0, 101.0)
        >>> receptance = 1 / (1e5 - (2 * np.pi * frequency_hz) ** 2 + 40j * frequency_hz)
        >>> rm.FRF.from_arrays(frequency_hz, [receptance], unit="m/N")
        <FRF: 1 position, 0 to 100 Hz in steps of 1 Hz, 1 run>
        """
        lines = lines_of(frequency_hz)
        inertance, factor = inertances_of(values, lines, unit)
        angles, numbers = places_of(angles_deg, nodes, len(inertance))
        return cls(
            frequency_hz=lines,
            values=inertance,
            coherence=beside("coherence", coherence, inertance.shape, highest=1.0),
            std=beside("std", std, inertance.shape) * np.abs(factor),
            node=numbers,
            position_deg=angles,
            run=("arrays",) * len(inertance),
            excitation_deg=one_angle(excitation_deg),
        )

    @property
    def n_positions(self) -> int:
        """Number of rows."""
        return int(self.values.shape[0])

    @property
    def run_names(self) -> tuple[str, ...]:
        """Runs with a row here, in the order of the campaign where it is known, else by name."""
        return tuple(name for name in self._in_order if name in self.run)

    @property
    def run_numbers(self) -> tuple[int, ...]:
        """Place of each of `run_names` in the campaign, of which runs may have been left out."""
        return tuple(self._in_order.index(name) for name in self.run_names)

    @property
    def _in_order(self) -> tuple[str, ...]:
        order = self.all_runs or (self.reference.run if self.reference is not None else ())
        return tuple(dict.fromkeys([*order, *sorted(set(self.run))]))

    @property
    def exact_forces(self) -> Mapping[str, ForceRecord]:
        """Force of each run where the values are its H1, and follow from it exactly."""
        return self.forces if self.estimator == "H1" else {}

    def as_stored(self) -> FRF:
        """The same with coherence and σ rounded to the single precision of ``frf.parquet``.

        What is fitted is then what a result holds, to the last digit.
        """
        both = self.coherence, self.std
        coherence, std = (each.astype(np.float32).astype(float) for each in both)
        fixed = None if self.reference is None else self.reference.as_stored()
        return replace(self, coherence=coherence, std=std, reference=fixed)

    def rows(self, chosen: NDArray[np.generic]) -> FRF:
        """Keep the chosen rows (indices or a mask) only."""
        arrays = {name: getattr(self, name)[chosen] for name in ROW_ARRAYS}
        run, channel = (tuple(np.array(x, dtype=object)[chosen]) for x in (self.run, self.channel))
        return replace(self, run=run, channel=channel, all_runs=self._in_order, **arrays)

    def coherent_band_hz(self, good: float = CHECKS.good_coherence) -> tuple[float, float]:
        """Widest band in which the median coherence stays good; all lines where it is unknown."""
        levels = np.sqrt(np.mean(np.abs(self.values) ** 2, axis=0))
        enough = coherent_lines(np.median(self.coherence, axis=0), levels, good)
        enough = np.append(enough & (self.frequency_hz > 0), False)
        starts = np.flatnonzero(enough & ~np.append(False, enough[:-1]))
        if starts.size == 0:
            return float(self.frequency_hz[0]), float(self.frequency_hz[-1])
        stops = np.array([start + np.argmin(enough[start:]) for start in starts])
        widest = np.argmax(stops - starts)
        first, last = self.frequency_hz[[starts[widest], stops[widest] - 1]].tolist()
        return first, last

    def plot(
        self,
        ax: Any = None,
        *,
        angles_deg: ArrayLike | None = None,
        band_hz: tuple[float, float] | None = None,
    ) -> Any:
        """Draw magnitudes over frequency on axes of matplotlib, and return these.

        Parameters
        ----------
        ax : Axes, optional
            Default: those of a new figure of pyplot.
        angles_deg : array_like, optional
            Only the positions nearest to these angles, with a legend; otherwise all positions
            (thin) and their RMS (thick).
        band_hz : tuple of float, optional
            Default: `default_band_hz`.
        """
        band = self.default_band_hz() if band_hz is None else band_of(band_hz)
        return plot(self, ax, angles_deg=angles_deg, band_hz=band)

    def default_band_hz(
        self, good: float = CHECKS.good_coherence, *, is_tyre: bool | None = None
    ) -> tuple[float, float]:
        """Band of views and of an identification: where coherence is good.

        For a tyre (by default: positions on a circle) from 20 Hz to the end of good coherence,
        300 Hz at most: below its first mode a tyre hardly responds.
        """
        low, high = self.coherent_band_hz(good)
        if not (np.all(np.isfinite(self.position_deg)) if is_tyre is None else is_tyre):
            return low, high
        least, most = TYRE_BAND_HZ
        if not low < most or not least < high < most:
            high = min(most, float(self.frequency_hz[-1]))
        return (least, high) if least < high else (low, float(self.frequency_hz[-1]))

    def to_xarray(self) -> xr.Dataset:
        """FRFs as an xarray dataset; needs the package xarray.

        Returns
        -------
        xarray.Dataset
            ``inertance``, ``std`` and ``coherence`` over (``position``, ``frequency_hz``), with
            ``position_deg``, ``node``, ``axis``, ``run`` and ``channel`` along the positions.

        Raises
        ------
        InputError
            If xarray is not installed.
        """
        try:
            xarray = import_module("xarray")
        except ImportError as error:
            rule, remedy = "the package xarray is required", "Run: pip install xarray"
            raise InputError("xarray", "not installed", rule, remedy) from error
        grid = ("position", "frequency_hz")
        inertance = {"units": "(m/s^2)/N", "long_name": "inertance"}
        values = {
            "inertance": (grid, np.array(self.values), inertance),
            "std": (grid, np.array(self.std), {"units": "(m/s^2)/N"}),
            "coherence": (grid, np.array(self.coherence), {"units": "1"}),
        }
        along = {
            "frequency_hz": ("frequency_hz", np.array(self.frequency_hz), {"units": "Hz"}),
            "position_deg": ("position", np.array(self.position_deg), {"units": "degree"}),
            **{name: ("position", np.array(getattr(self, name))) for name in ("node", "axis")},
            "run": ("position", list(self.run)),
            "channel": ("position", list(self.channel)),
        }
        return cast("xr.Dataset", xarray.Dataset(values, coords=along))

    def to_frame(self, form: Literal["long", "wide"] = "long") -> pd.DataFrame:
        """Table of the FRFs.

        Parameters
        ----------
        form : {"long", "wide"}
            Long: one row for each position and frequency. Wide: one row for each frequency and one
            complex column for each position, named by its angle in degrees, or by its node where
            there are no angles.

        Returns
        -------
        pandas.DataFrame
            In long form: ``position_deg`` (NaN off a circle), ``node`` (−1 without), ``axis`` (1 to
            3 for X, Y, Z, 0 without), ``run``, ``channel``, ``frequency_hz``, ``inertance``
            (complex, (m/s²)/N), ``std`` (of its real and of its imaginary part, (m/s²)/N) and
            ``coherence``; NaN where unknown.

        Raises
        ------
        InputError
            If the form is neither.

        Examples
        --------
        >>> import numpy as np
        >>> from ema import FRF
        >>> ones = np.ones((2, 3))
        >>> frf = FRF([0, 1, 2], (2 + 1j) * ones, ones, 0.1 * ones, [1, 2], [0, 180], ("1", "1"))
        >>> table = frf.to_frame()
        >>> table.groupby("position_deg")["std"].max().to_dict()
        {0.0: 0.1, 180.0: 0.1}
        >>> frf.to_frame("wide")[180.0].abs().max().round(3)
        np.float64(2.236)
        """
        if form == "wide":
            on_circle = bool(np.isfinite(self.position_deg).all())
            name = "position_deg" if on_circle else "node"
            wide = frame_of(dict(enumerate(self.values))).set_axis(getattr(self, name), axis=1)
            return wide.set_axis(self.frequency_hz).rename_axis(index="frequency_hz", columns=name)
        if form != "long":
            raise InputError("form", repr(form), "it is 'long' or 'wide'", "Choose one of them")
        n_lines = self.frequency_hz.size
        return frame_of(
            {
                "position_deg": np.repeat(self.position_deg, n_lines),
                **{name: np.repeat(getattr(self, name), n_lines) for name in ("node", "axis")},
                "run": np.repeat(np.array(self.run, dtype=object), n_lines),
                "channel": np.repeat(np.array(self.channel, dtype=object), n_lines),
                "frequency_hz": np.tile(self.frequency_hz, self.n_positions),
                "inertance": self.values.ravel(),
                **{name: getattr(self, name).ravel() for name in ("std", "coherence")},
            }
        )

    def __repr__(self) -> str:
        runs = counted(len(self.run_names), "run")
        return f"<FRF: {counted(self.n_positions, 'position')}, {self._lines()}, {runs}>"

    def _repr_html_(self) -> str:
        angles = self.position_deg
        on_circle = self.n_positions and np.isfinite(angles).all()
        places = f"{angles.min():g}° to {angles.max():g}°" if on_circle else "by node"
        averages = f"{self.n_effective:.1f}" if np.isfinite(self.n_effective) else "unknown"
        band = self.default_band_hz()
        lines = (self.frequency_hz >= band[0]) & (self.frequency_hz <= band[1])
        within = self.coherence[:, lines]
        known = within[np.isfinite(within)]
        median = f"{np.median(known):.4f}" if known.size else "unknown"
        level = np.sqrt(np.mean(np.abs(self.values[:, lines]) ** 2, axis=0))
        curve = level_path(self.frequency_hz[lines], level, 480, 130)
        told = facts(
            "FRFs: inertance in (m/s²)/N",
            [
                ("positions", f"{self.n_positions}, {places}"),
                ("frequencies", self._lines()),
                ("runs", ", ".join(self.run_names)),
                ("independent averages", averages),
                (f"coherence γ², median {band_text(band)}", median),
                ("reference sensor", "no" if self.reference is None else "yes, kept apart"),
            ],
        )
        label = f"RMS inertance of all positions, {band_text(band)}, logarithmic"
        return told + picture(label, 480, 130, [(curve, 1.5)])

    def _lines(self) -> str:
        lines = self.frequency_hz
        if lines.size < 2:
            return counted(int(lines.size), "line")
        return f"{lines[0]:g} to {lines[-1]:g} Hz in steps of {lines[1] - lines[0]:.4g} Hz"


def position_finding(frf: FRF, row: int, check: Check, verdict: Verdict, detail: str) -> Finding:
    """Finding about one row of some FRFs."""
    angle_deg = float(frf.position_deg[row])
    place = angle_deg if np.isfinite(angle_deg) else None
    return Finding(frf.run[row], frf.channel[row], place, check, verdict, detail)
