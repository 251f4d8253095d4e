"""Does a level make sense for its unit? A tyre at 500 g, or a shaker at 0.001 N, does not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ema.io.units import SI_UNIT, is_stated, parse_unit
from ema.quality import WARNING, Finding
from ema.recording import ACCELERATION, FORCE, Channel, Recording
from ema.signal_summary import SignalSummary, summarise

_PIECES, _PIECE = 4, 4096
# A weak impact, or a short one in a long recording, has little rms but a peak well above it.
_PEAK_PER_RMS = 5.0


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


# Below, a sensor shows its own noise (0.01 m/s² is 1 mg; a load cell resolves some mN). Above, it
# leaves its range: 500 g peak of the least sensitive accelerometers used on tyres, some kN of
# shakers and load cells. In between lie weak shakers on heavy tyres and strong ones on light
# structures: a false alarm would teach users not to read the warnings.
_PLAUSIBLE = {
    ACCELERATION: _Plausible(0.01, 30.0, 1000.0, ("m/s^2", "g", "mm/s^2"), ("mm/s^2",)),
    FORCE: _Plausible(0.05, 20.0, 2000.0, ("N", "kN", "lbf", "mN"), ("kN", "lbf", "mN")),
}
_RARE = np.log(30.0)  # a rare unit has to bring the level this much nearer to the usual one


def level_findings(
    recording: Recording, summaries: Sequence[SignalSummary] | None = None
) -> list[Finding]:
    """Channels whose level makes no sense for their unit, with the unit that is likely meant.

    A few pieces along the recording tell that a level is in order. Only where they do not is the
    whole channel read, as an impact may lie between them.

    Parameters
    ----------
    recording : Recording
    summaries : sequence of SignalSummary, optional
        Of its channels, where they are known already.

    Returns
    -------
    list of Finding
        Check ``"level"``, verdict warning; empty where all is well. Channels without signal are
        not judged, nor quantities other than acceleration and force.
    """
    findings = []
    for row, channel in enumerate(recording.channels):
        usual = _PLAUSIBLE.get(channel.quantity)
        if usual is None or (summaries is None and usual.holds(*_probe(channel))):
            continue
        summary = summarise(channel) if summaries is None else summaries[row]
        if summary.rms_ac > 0 and not usual.holds(summary.rms_ac, summary.peak_ac):
            place = (recording.path.name, channel.name, channel.angle_deg)
            findings.append(Finding(*place, "level", WARNING, _explain(channel, summary.rms_ac)))
    return findings


def _probe(channel: Channel) -> tuple[float, float]:
    """Rms and largest deviation about the mean, from a few pieces along the recording."""
    last = max(channel.n_samples - _PIECE, 0)
    starts = np.linspace(0, last, min(_PIECES, 1 + channel.n_samples // _PIECE)).astype(int)
    pieces = [channel.block(start, start + _PIECE) for start in starts.tolist()]
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
