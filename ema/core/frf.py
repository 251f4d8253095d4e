"""Frequency response functions of all positions against one force."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from ema.core.arrays import ReadonlyArrays, frame_of, readonly
from ema.core.block_plan import BlockPlan, ExponentialWindow
from ema.core.display import counted, facts
from ema.core.errors import FitError, InputError
from ema.core.finding import Check, Finding, Verdict
from ema.core.recording import Channel

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, eq=False)
class ForceRecord:
    """Force of one run as recorded, read when needed."""

    force: Channel
    plan: BlockPlan  # blocks of this run
    is_steady: bool  # whether it is steady noise, not a sweep, bursts or impacts


#: Arrays of an `FRF` with one row for each position.
ROW_ARRAYS = (
    *("values", "coherence", "std", "node", "position_deg", "axis"),
    *("clipped", "force_clipped", "missing", "disagreement"),
)


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

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.channel:
            object.__setattr__(self, "channel", ("",) * self.n_positions)
        for name in ("clipped", "force_clipped", "missing", "disagreement"):
            if not getattr(self, name).size:
                object.__setattr__(self, name, readonly(np.zeros(self.n_positions)))
        if not self.axis.size:
            object.__setattr__(
                self, "axis", readonly(np.zeros(self.n_positions), np.dtype(np.int_))
            )

    @property
    def n_positions(self) -> int:
        """Number of rows."""
        return int(self.values.shape[0])

    @property
    def run_names(self) -> tuple[str, ...]:
        """Runs with a row here, in the order of the campaign where it is known, else by name."""
        here = set(self.run)
        order = dict.fromkeys(self.reference.run if self.reference is not None else ())
        return tuple(name for name in dict.fromkeys([*order, *sorted(here)]) if name in here)

    @property
    def exact_forces(self) -> Mapping[str, ForceRecord]:
        """Force of each run where the values are its H1, and follow from it exactly."""
        return self.forces if self.estimator == "H1" else {}

    def as_stored(self) -> FRF:
        """The same with coherence and σ rounded to the single precision of ``frf.parquet``.

        What is fitted is then what a result holds, to the last digit.
        """
        coherence, std = (
            each.astype(np.float32).astype(float) for each in (self.coherence, self.std)
        )
        fixed = None if self.reference is None else self.reference.as_stored()
        return replace(self, coherence=coherence, std=std, reference=fixed)

    def rows(self, chosen: NDArray[np.generic]) -> FRF:
        """Keep the chosen rows (indices or a mask) only."""
        arrays = {name: getattr(self, name)[chosen] for name in ROW_ARRAYS}
        run, channel = (
            tuple(np.asarray(names, dtype=object)[chosen]) for names in (self.run, self.channel)
        )
        return replace(self, run=run, channel=channel, **arrays)

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
            In long form: ``position_deg`` (NaN off a circle), ``node`` (−1 without), ``run``,
            ``channel``, ``frequency_hz``, ``inertance`` (complex, (m/s²)/N), ``std`` (of its real
            and of its imaginary part, (m/s²)/N) and ``coherence``; NaN where unknown.

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
            wide = wide.set_axis(self.frequency_hz)
            return wide.rename_axis(index="frequency_hz", columns=name)
        if form != "long":
            raise InputError("form", repr(form), "it is 'long' or 'wide'", "Choose one of them")
        n_lines = self.frequency_hz.size
        return frame_of(
            {
                "position_deg": np.repeat(self.position_deg, n_lines),
                "node": np.repeat(self.node, n_lines),
                "run": np.repeat(np.array(self.run, dtype=object), n_lines),
                "channel": np.repeat(np.array(self.channel, dtype=object), n_lines),
                "frequency_hz": np.tile(self.frequency_hz, self.n_positions),
                "inertance": self.values.ravel(),
                "std": self.std.ravel(),
                "coherence": self.coherence.ravel(),
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
        known = self.coherence[np.isfinite(self.coherence)]
        return facts(
            "FRFs: inertance in (m/s²)/N",
            [
                ("positions", f"{self.n_positions}, {places}"),
                ("frequencies", self._lines()),
                ("runs", ", ".join(self.run_names)),
                ("independent averages", averages),
                ("coherence γ², median", f"{np.median(known):.4f}" if known.size else "unknown"),
                ("reference sensor", "no" if self.reference is None else "yes, kept apart"),
            ],
        )

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


# Beyond the band, lines are used up to this share of its width, for modes just outside it …
_MARGIN = 0.25
# … as long as they are not noisier than the noisiest part of the band by more than this factor.
_MARGIN_NOISE = 2.0
_FEWEST_LINES = 32


def widened_band(frf: FRF, band_hz: tuple[float, float]) -> slice:
    """Lines of the band and, where their noise allows, of a margin on both sides.

    `FitError` where the band holds too few lines to identify anything.
    """
    frequency_hz = frf.frequency_hz
    low = int(np.searchsorted(frequency_hz, band_hz[0], side="left"))
    high = int(np.searchsorted(frequency_hz, band_hz[1], side="right"))
    if high - low < _FEWEST_LINES:
        raise FitError(
            f"only {max(high - low, 0)} frequency lines between {band_hz[0]:g} and "
            f"{band_hz[1]:g} Hz; at least {_FEWEST_LINES} are needed, and the FRFs end at "
            f"{frequency_hz[-1]:g} Hz. Widen the band, use longer blocks or correct the sampling "
            "rate."
        )
    margin = int(_MARGIN * (high - low))
    first, last = max(low - margin, 0), min(high + margin, frequency_hz.size)
    noise = np.median(frf.std[:, first:last], axis=0)
    # FRFs without σ get no verdict on their noise: the margin stays whole.
    allowed = _MARGIN_NOISE * np.max(noise[low - first : high - first])
    barred = first + np.flatnonzero((noise > allowed) | (frequency_hz[first:last] <= 0))
    below, above = barred[barred < low], barred[barred >= high]
    return slice(int(below.max(initial=first - 1)) + 1, int(above.min(initial=last)))
