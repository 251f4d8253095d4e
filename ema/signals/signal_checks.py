"""Signal checks: level, clipping, dead channels, missing samples and hum."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from ema.core.display import counted
from ema.core.finding import Check, Finding, Verdict
from ema.core.recording import ACCELERATION, DISPLACEMENT, FORCE, VELOCITY, Channel, Recording
from ema.core.units import SI_UNIT, is_stated, parse_unit
from ema.signals.clipping_and_hum import Hum, HumMeter, Plateaus
from ema.signals.extents import Extent

_PIECE = 1 << 18
# Limits of the signal lie beyond its rms; the rest between impacts or bursts does not.
_LIMIT_RMS = 1.0
# A sensor that holds one value this long, though its signal is steady else, has dropped out.
_DROPOUT_SHARE, _DROPOUT_SAMPLES = 0.01, 100
STEADY_CREST = 8.0
_LOUD_HUM = 0.01  # of the rms
# A weak impact, or a short one in a long recording, has little rms but a peak well above it.
_PEAK_PER_RMS = 5.0
_RARE = np.log(30.0)  # a rare unit has to bring the level this much nearer to the usual one


@dataclass(frozen=True)
class SignalSummary:
    """One signal in SI units; missing samples count nowhere but in `n_missing`.

    Missing are samples that are not finite, or impossible: beyond the channel's limit.
    """

    n_samples: int
    mean: float  # the constant part (DC); NaN, as all levels, where every sample is missing
    rms: float  # of the whole signal, its mean included
    rms_ac: float  # about the mean
    lowest: float  # extreme samples
    highest: float
    n_clipped_low: int  # samples on flat tops at the lowest and the highest value
    n_clipped_high: int
    n_missing: int
    first_missing: int | None  # index
    longest_hold: int  # samples of the longest run of one value
    longest_hold_start: int  # its first sample
    hum: Hum | None  # None without lines of the mains, or where the signal is too short to tell
    n_impossible: int = 0  # those of the missing ones that are numbers
    first_impossible: int | None = None  # index
    worst_impossible: float = 0.0  # largest magnitude of these; 0 without any

    @property
    def peak(self) -> float:
        """Largest magnitude, the mean included."""
        return max(abs(self.lowest), abs(self.highest))

    @property
    def peak_ac(self) -> float:
        """Largest deviation from the mean."""
        return max(self.highest - self.mean, self.mean - self.lowest)

    @property
    def crest_factor(self) -> float:
        """Largest deviation from the mean over the rms about it; NaN for a constant."""
        return self.peak_ac / self.rms_ac if self.rms_ac > 0 else float("nan")

    @property
    def clipped_share(self) -> float:
        """Share of samples on flat tops at the limits of the signal."""
        return (self.n_clipped_low + self.n_clipped_high) / max(self.n_samples, 1)

    @property
    def is_silent(self) -> bool:
        """Whether there is nothing but one value, or no value at all."""
        return not self.highest > self.lowest


@dataclass
class _Moments:
    """Mean and sum of squares about it, merged piece by piece (Chan, Golub & LeVeque 1983)."""

    n: int = 0
    mean: float = 0.0
    squares: float = 0.0
    lowest: float = np.inf
    highest: float = -np.inf

    def add(self, samples: NDArray[np.float64]) -> None:
        if not samples.size:
            return
        mean = float(samples.mean())
        about = samples - mean
        n, shift = self.n + samples.size, mean - self.mean
        self.squares += float(about @ about) + shift**2 * self.n * samples.size / n
        self.mean += shift * samples.size / n
        self.n = n
        self.lowest = min(self.lowest, float(samples.min()))
        self.highest = max(self.highest, float(samples.max()))


@dataclass
class _Gaps:
    """Missing samples of a signal that comes piece by piece, and which of them are numbers."""

    n_missing: int = 0
    first_missing: int | None = None
    n_impossible: int = 0
    first_impossible: int | None = None
    worst_impossible: float = 0.0

    def add(self, start: int, known: NDArray[np.bool_], raw: NDArray[np.float64]) -> None:
        self.n_missing += int(np.count_nonzero(~known))
        if self.first_missing is None:
            self.first_missing = start + int(np.argmin(known))
        impossible = np.flatnonzero(~known & np.isfinite(raw))
        if not impossible.size:
            return
        self.n_impossible += impossible.size
        self.worst_impossible = max(self.worst_impossible, float(np.abs(raw[impossible]).max()))
        if self.first_impossible is None:
            self.first_impossible = start + int(impossible[0])


def summarise(channel: Channel, sampling_rate_hz: float = float("nan")) -> SignalSummary:
    """Summarise a channel in one pass, piece by piece; hum only with its sampling rate."""
    moments, plateaus = _Moments(), Plateaus()
    hum_meter = HumMeter(sampling_rate_hz, channel.n_samples)
    gaps = _Gaps()
    for start in range(0, channel.n_samples, _PIECE):
        stop = min(start + _PIECE, channel.n_samples)
        piece = channel.block(start, stop)
        known = np.isfinite(piece)
        if not known.all():
            gaps.add(start, known, channel.raw_block(start, stop))
        moments.add(piece[known])
        plateaus.add(piece)
        hum_meter.add(piece)
    empty = moments.n == 0
    rms_ac = np.nan if empty else float(np.sqrt(moments.squares / moments.n))
    mean = np.nan if empty else moments.mean
    if moments.highest == moments.lowest:  # exactly, whatever the rounding of the mean
        mean, rms_ac = moments.lowest, 0.0
    low, high = plateaus.clipped()
    return SignalSummary(
        n_samples=channel.n_samples,
        mean=mean,
        rms=float(np.hypot(mean, rms_ac)),
        rms_ac=rms_ac,
        lowest=np.nan if empty else moments.lowest,
        highest=np.nan if empty else moments.highest,
        n_clipped_low=low if mean - moments.lowest > _LIMIT_RMS * rms_ac else 0,
        n_clipped_high=high if moments.highest - mean > _LIMIT_RMS * rms_ac else 0,
        longest_hold=plateaus.longest,
        longest_hold_start=plateaus.longest_start,
        hum=hum_meter.hum(rms_ac),
        **vars(gaps),
    )


def signal_findings(summary: SignalSummary, file: str, channel: Channel) -> list[Finding]:
    """Everything about a signal that is not in order, one warning each; `file` is named in them."""
    said = {
        Check.MISSING_SAMPLES: _missing(summary),
        Check.IMPOSSIBLE_SAMPLES: _impossible(summary, channel),
        Check.SILENT: _silent(summary, channel),
        Check.CLIPPED: _clipped(summary, channel),
        Check.DROPOUT: _dropout(summary, channel),
        Check.HUM: _hum(summary),
    }
    return [
        Finding(file, channel.name, channel.angle_deg, check, Verdict.WARNING, detail)
        for check, detail in said.items()
        if detail
    ]


def _missing(summary: SignalSummary) -> str:
    count = summary.n_missing - summary.n_impossible
    if not count:
        return ""
    if count == summary.n_samples:
        return "there is no number in it"
    found = f"{count} samples are no numbers ({100 * count / summary.n_samples:.2g} %)"
    return found if summary.n_impossible else f"{found}, first at sample {summary.first_missing}"


def _impossible(summary: SignalSummary, channel: Channel) -> str:
    count = summary.n_impossible
    if not count:
        return ""
    worst = _level(summary.worst_impossible, channel)
    detail = f"{counted(count, 'sample')} of up to {worst}, which no sensor gave: taken as missing"
    if not np.isnan(summary.peak):
        detail += f"; all others are within {_level(summary.peak, channel)}"
    return f"{detail}; first at sample {summary.first_impossible}"


def _silent(summary: SignalSummary, channel: Channel) -> str:
    if not summary.is_silent or summary.n_missing == summary.n_samples:
        return ""
    return f"it holds nothing but the value {_level(summary.highest, channel)}"


def _clipped(summary: SignalSummary, channel: Channel) -> str:
    low, high = summary.n_clipped_low, summary.n_clipped_high
    if not low and not high:
        return ""
    symmetric = np.isclose(summary.highest, -summary.lowest, rtol=1e-3)
    if low and high and symmetric:
        limits = f"±{_level(summary.highest, channel)}"
    else:
        ends = ((summary.lowest, low), (summary.highest, high))
        limits = " and ".join(_level(value, channel) for value, count in ends if count)
    return f"{100 * summary.clipped_share:.2g} % of the samples ({low + high}) lie flat at {limits}"


def _dropout(summary: SignalSummary, channel: Channel) -> str:
    held = summary.longest_hold
    shortest = max(_DROPOUT_SAMPLES, _DROPOUT_SHARE * summary.n_samples)
    event = not summary.crest_factor < STEADY_CREST
    # A force may well be zero between impacts and bursts.
    if channel.quantity == FORCE or summary.is_silent or event or held < shortest:
        return ""
    return f"{held} samples in a row hold one value, from sample {summary.longest_hold_start}"


def _hum(summary: SignalSummary) -> str:
    hum = summary.hum
    if hum is None or hum.rms < _LOUD_HUM * summary.rms_ac:
        return ""
    share = 100 * hum.rms / summary.rms_ac
    where = f"strongest at {hum.frequency_hz:g} Hz"
    return f"hum of the {hum.mains_hz:g} Hz mains makes {share:.2g} % of the rms, {where}"


def _level(value: float, channel: Channel) -> str:
    return f"{value:.4g} {SI_UNIT.get(channel.quantity, '')}".rstrip()


_PIECES, _CHECK_PIECE = 4, 4096


@dataclass(frozen=True)
class _Plausible:
    """Levels a shaker or hammer test has, rms in SI, and the units that get mixed up."""

    lowest: float
    usual: float
    highest: float
    units: tuple[str, ...]
    rare: tuple[str, ...]

    def holds(self, rms: float, peak: float) -> bool:
        """Whether rms and largest deviation about the mean are among them."""
        strong = rms >= self.lowest or peak >= _PEAK_PER_RMS * self.lowest
        return strong and rms <= self.highest

    def must_hold(self, extent: Extent) -> bool:
        """Whether extreme samples alone tell so: no rms is above them, no peak below half of both.

        One sample of them is enough to be strong, as of an impact.
        """
        swing = extent.highest - extent.lowest
        return swing / 2 >= _PEAK_PER_RMS * self.lowest and extent.size <= self.highest


# Below, a sensor shows its own noise (0.01 m/s² is 1 mg; a load cell resolves some mN). Above, it
# leaves its range: 500 g peak of the least sensitive accelerometers used on tyres, some kN of
# shakers and load cells. In between lie weak shakers on heavy tyres and strong ones on light
# structures: a false alarm would teach users not to read the warnings.
_PLAUSIBLE = {
    ACCELERATION: _Plausible(0.01, 30.0, 1000.0, ("m/s^2", "g", "mm/s^2"), ("mm/s^2",)),
    # What these accelerations are at 100 Hz.
    VELOCITY: _Plausible(1.6e-5, 0.05, 1.6, ("m/s", "mm/s", "um/s", "in/s"), ("um/s", "in/s")),
    DISPLACEMENT: _Plausible(2.5e-8, 8e-5, 2.5e-3, ("m", "mm", "um", "in"), ("in",)),
    FORCE: _Plausible(0.05, 20.0, 2000.0, ("N", "kN", "lbf", "mN"), ("kN", "lbf", "mN")),
}


def level_findings(
    recording: Recording,
    summaries: Sequence[SignalSummary] | None = None,
    extents: Mapping[str, Extent] = MappingProxyType({}),
) -> list[Finding]:
    """Channels whose level makes no sense for their unit, with the unit that is likely meant.

    The extreme samples, or a few pieces along the recording, tell that a level is in order. Only
    where they do not is the whole channel read, as an impact may lie between them; `summaries` are
    those of the channels, where they are known already, `extents` those of channels by name.
    Channels without signal are not judged, nor quantities other than motions and forces.
    """
    findings = []
    for row, channel in enumerate(recording.channels):
        usual = _PLAUSIBLE.get(channel.quantity)
        if usual is None or (
            summaries is None
            and (usual.must_hold(_extent_in_use(channel, extents)) or usual.holds(*_probe(channel)))
        ):
            continue
        summary = summarise(channel) if summaries is None else summaries[row]
        if summary.rms_ac > 0 and not usual.holds(summary.rms_ac, summary.peak_ac):
            place = (recording.path.name, channel.name, channel.angle_deg)
            detail = _explain(channel, summary.rms_ac)
            findings.append(Finding(*place, Check.LEVEL, Verdict.WARNING, detail))
    return findings


def _extent_in_use(channel: Channel, extents: Mapping[str, Extent]) -> Extent:
    """What is known of all samples of a channel, if none of them is set aside."""
    is_whole = channel.limit == np.inf and not channel.gaps
    return extents.get(channel.name, Extent()) if is_whole else Extent()


def _probe(channel: Channel) -> tuple[float, float]:
    """Rms and largest deviation about the mean, from a few pieces along the recording."""
    last = max(channel.n_samples - _CHECK_PIECE, 0)
    starts = np.linspace(0, last, min(_PIECES, 1 + channel.n_samples // _CHECK_PIECE)).astype(int)
    pieces = [channel.block(start, start + _CHECK_PIECE) for start in starts.tolist()]
    samples = np.concatenate(pieces)
    samples = samples[np.isfinite(samples)]
    if not samples.size:
        return 0.0, 0.0
    about = samples - samples.mean()
    return float(np.sqrt(np.mean(about**2))), float(np.max(np.abs(about)))


def _explain(channel: Channel, rms: float) -> str:
    usual, si = _PLAUSIBLE[channel.quantity], SI_UNIT[channel.quantity]
    stated = channel.unit if is_stated(channel.unit) else si
    detail = (
        f"{rms:.4g} {si} rms, where {usual.lowest:g} to {usual.highest:g} {si} are usual for a tyre"
    )
    unit = parse_unit(stated)
    likely = None
    if unit is not None and unit.quantity == channel.quantity:
        likely = _likely_unit(usual, rms / unit.factor, but=unit.factor)
    if likely is not None:
        detail += (
            f"; if the numbers are {likely[0]} rather than {stated}, it is {likely[1]:.4g} {si}"
        )
    else:
        detail += "; check unit and sensitivity"
    return f"{detail}, if the sensor is connected" if rms < usual.lowest else detail


def _likely_unit(usual: _Plausible, number: float, *, but: float) -> tuple[str, float] | None:
    """Unit that brings a number nearest to the usual level, rare ones last, and its level then."""
    levels = {}
    for name in usual.units:
        unit = parse_unit(name)
        if unit is not None and unit.factor != but:
            levels[name] = number * unit.factor
    fitting = {n: level for n, level in levels.items() if usual.lowest <= level <= usual.highest}
    if not fitting:
        return None

    def oddity(item: tuple[str, float]) -> float:
        return float(abs(np.log(item[1] / usual.usual)) + _RARE * (item[0] in usual.rare))

    return min(fitting.items(), key=oddity)
