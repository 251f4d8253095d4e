"""Sampling rates and starts: a printed number is an interval, the better source decides."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ema.core.errors import RecordingFormatError
from ema.core.finding import Check, Finding, Verdict
from ema.core.recording import Channel
from ema.io.content import EXPORT_AGAIN, note, remark

MOST_DIGITS = 7  # a plain number has no more
_SENSELESS = 1e100  # beyond any time or frequency; NaN and infinity are too
_PIECE = 1 << 16  # values of a long column that are looked at together
_UNEVEN = 0.2  # of a step: a single dropped sample deviates by at least half a step
SAME_RATE = 1e-4  # relative, of a stated rate and that of a rounded time column
_EXACT = 1e-9  # relative, of the step of a long column in double precision
ROUNDING = 1e-12  # relative, of a step kept in double precision
NARROW = 1e-5  # relative half-width from which on a rate is said to be open
_COARSE = 1e-2  # of a rate printed with one or two digits, which are meant: 7e3
_FINEST = 9  # decimals that stamps may be rounded to
FEWEST_DIGITS = 3  # significant ones
# Counts of date and time, by the size of their first value: seconds of one.
_COUNTS = {
    "days of a spreadsheet": (30_000.0, 60_000.0, 86_400.0),
    "days as datenum has them": (715_000.0, 760_000.0, 86_400.0),
    "parts of a day": (0.0, 1.0, 86_400.0),
    "ms since 1970": (0.5e12, 5e12, 1e-3),
    "us since 1970": (0.5e15, 5e15, 1e-6),
    "ns since 1970": (0.5e18, 5e18, 1e-9),
}
_MOST_STEP_S = 0.05  # slower recordings have no day in which they are a number of seconds
_SHARE_OF_SAMPLE = 0.02  # by which starts may miss a whole sample: 1.4 degrees of phase at fs/10
FASTEST_HZ = 5e5  # no vibration is recorded faster: such a time has another unit


def _hardware_rates() -> NDArray[np.float64]:
    """Rates of acquisition hardware, such as 1000, 1024, 2500, 2560, 51200, 65536 Hz."""
    found = {2.0**i * 10.0**j for i in range(-3, 25) for j in range(7)}
    return np.array(sorted(rate for rate in found if 1.0 <= rate <= 1e7))


# Less usual: audio clocks, multiples of three, and 51.2 kHz divided by whole numbers (NI 9234).
_HARDWARE = _hardware_rates()
_SELDOM = np.unique(
    [
        *(44100.0 * 2.0**i for i in range(-3, 3)),
        *(3.0 * rate for rate in _HARDWARE),
        *(51200.0 / divisor for divisor in range(1, 32)),
    ]
)
_KNOWN = np.concatenate([_HARDWARE, _SELDOM])


@dataclass(frozen=True)
class Rate:
    """A sampling rate, and the range that its source leaves open."""

    hz: float = math.nan  # NaN where nothing states it
    low_hz: float = math.nan
    high_hz: float = math.nan
    source: str = ""  # as the file calls it, with what it prints
    is_sure: bool = True  # whether no other rate of the range is as likely

    @property
    def is_open(self) -> bool:
        """Whether other rates are possible, by more than a rounding."""
        return self.high_hz - self.low_hz > 2 * NARROW * self.hz

    def allows(self, hz: float) -> bool:
        """Whether this may be the rate."""
        return bool(self.low_hz * (1 - SAME_RATE) <= hz <= self.high_hz * (1 + SAME_RATE))

    @property
    def text(self) -> str:
        """The range, in Hz."""
        return f"{self.low_hz:.6g} to {self.high_hz:.6g} Hz"


UNSTATED = Rate()


def exact_rate(hz: float, source: str = "") -> Rate:
    """A rate that is what it says."""
    return Rate(hz, hz, hz, source)


def is_possible(hz: float) -> bool:
    """Whether a number may be a rate: neither it nor one over it is zero or infinite."""
    return 0.0 < hz < math.inf and 1.0 / hz < math.inf


def agreed(path: Path, stated: Rate, measured: Rate) -> Rate:
    """The rate that two sources of a file allow: the narrower one decides.

    `RecordingFormatError` if they contradict each other.
    """
    if math.isnan(stated.hz) or math.isnan(measured.hz):
        return measured if math.isnan(stated.hz) else stated
    if not (
        stated.low_hz * (1 - SAME_RATE) <= measured.high_hz
        and measured.low_hz <= stated.high_hz * (1 + SAME_RATE)
    ):
        found = f"{stated.hz:g} Hz by {stated.source}, {measured.hz:g} Hz by {measured.source}"
        rule = "a recording has one sampling rate"
        raise RecordingFormatError(path.name, found, rule, EXPORT_AGAIN)
    widths = [each.high_hz - each.low_hz for each in (stated, measured)]
    narrow, wide = (stated, measured) if widths[0] <= widths[1] else (measured, stated)
    return wide if narrow.is_open and narrow.allows(wide.hz) and wide.is_sure else narrow


def rate_findings(path: Path, rate: Rate) -> list[Finding]:
    """Say which range a printed rate leaves, where that matters."""
    if not rate.is_open or rate.hz == 0:
        return []
    detail = (
        f"{rate.source} leaves {rate.text}; {rate.hz:.10g} Hz taken, unless sampling_rate_hz in "
        "[acquisition] of the manifest sets another"
    )
    verdict = Verdict.OK if rate.is_sure else Verdict.WARNING
    return [Finding(path.name, "", None, Check.SAMPLING_RATE, verdict, detail)]


def parse_number(text: str) -> float:
    """Read a Fortran real, such as ``1.5D-03`` or ``1.5-103``; ValueError for other texts."""
    plain = text.strip().upper().replace("D", "E")
    if "_" in plain or not plain.isascii():
        raise ValueError(f"{text!r} is not a number")
    sign = max(plain.rfind("+"), plain.rfind("-"))
    if sign > 0 and plain[sign - 1] != "E" and "." in plain[:sign]:
        plain = f"{plain[:sign]}E{plain[sign:]}"
    return float(plain)


def plainest(value: float, tolerance: float) -> tuple[float, int]:
    """Number with the fewest significant digits within `tolerance` of `value`, and their number."""
    for digits in range(1, MOST_DIGITS + 1):
        candidate = float(f"{value:.{digits - 1}e}")
        if abs(candidate - value) <= tolerance:
            return candidate, digits
    return value, MOST_DIGITS + 1


class Steps(NamedTuple):
    """A step, its inverse, and by how much (relative) both may be wrong."""

    step: float
    inverse: float
    tolerance: float


def _printed(text: str) -> tuple[float, float, int]:
    """A printed positive number, its last place relative to it, and its significant digits."""
    value = parse_number(text)
    if not 0.0 < value < math.inf or not 0.0 < 1.0 / value < math.inf:
        raise ValueError(f"{text!r} is not a positive step")
    mantissa = text.strip().upper().replace("D", "E").partition("E")[0]
    digits = len(mantissa.replace(".", "").strip("+-0"))
    place = 10.0 ** -len(mantissa.partition(".")[2]) / parse_number(mantissa)
    return value, place, digits


def step_and_inverse(printed: str, factor: float = 1.0) -> tuple[float, float]:
    """Step and its inverse, from a step printed with few digits, e.g. ``"1.52588E-05"``.

    Six digits of 1/65536 s give 65535.95 Hz. Usually either the step or its inverse is a plain
    number; the one with fewer digits within the last printed place is taken as exact. `factor`
    turns what is printed into s or Hz. ValueError for other texts than positive numbers.
    """
    value, place, digits = _printed(printed)
    step = value * factor
    if factor != 1.0:
        step, digits = plainest(step, place * step)
    inverse, inverse_digits = plainest(1.0 / step, place / step)
    if inverse_digits <= digits:
        return 1.0 / inverse, inverse
    return step, 1.0 / step


@lru_cache  # channels of one file have the same step
def rate_of_step(printed: str, source: str, factor: float = 1.0) -> Rate:
    """Sampling rate of a printed time step, `factor` seconds each.

    A number such as 0.000488 is 1/2048 or 1/2050 s: rates that acquisition hardware has come
    first. A step whose inverse is such a rate, printed without zeros at its end, is exact.
    ValueError for other texts than positive numbers.
    """
    value, place, _ = _printed(printed)
    hz = 1.0 / (value * factor)
    source = f"{source} = {printed.strip()}"
    if place / 2 <= NARROW:
        inverse = step_and_inverse(printed, factor)[1]
        return Rate(inverse, hz / (1 + place), hz * (1 + place), source)
    mantissa = printed.strip().upper().replace("D", "E").partition("E")[0]
    nearest = float(_HARDWARE[np.argmin(np.abs(_HARDWARE - hz))])
    if abs(nearest - hz) <= _EXACT * hz and not mantissa.endswith("0"):
        return exact_rate(nearest, source)
    return likeliest(hz / (1 + place / 2), hz / (1 - place / 2), hz, source)


def rate_of_text(printed: str, source: str, factor: float = 1.0) -> Rate:
    """A rate as it is printed, `factor` Hz each: 2.05 kHz is 2048 Hz, 2050 Hz is that.

    ValueError for other texts than positive numbers.
    """
    value, place, _ = _printed(printed)
    hz = value * factor
    if not NARROW < place / 2 < _COARSE or printed.isdigit():
        return exact_rate(hz, source)
    rate = likeliest(hz * (1 - place / 2), hz * (1 + place / 2), hz, f"{source} = {printed}")
    if np.min(np.abs(_KNOWN - hz)) <= _EXACT * hz or rate.hz not in _KNOWN:
        return exact_rate(hz, source)
    return rate


def likeliest(low_hz: float, high_hz: float, hz: float, source: str) -> Rate:
    """The rate of acquisition hardware within a range; without one, the plainest number."""
    for known in (_HARDWARE, _SELDOM):
        inside = known[(known >= low_hz * (1 - _EXACT)) & (known <= high_hz * (1 + _EXACT))]
        if inside.size:
            nearest = float(inside[np.argmin(np.abs(inside - hz))])
            return Rate(nearest, low_hz, high_hz, source, is_sure=inside.size == 1)
    plain = plainest(hz, min(hz - low_hz, high_hz - hz))[0]
    return Rate(plain, low_hz, high_hz, source, is_sure=False)


def even_step(abscissa: NDArray[np.float64]) -> Steps | None:
    """Step and its inverse of rounded times or frequencies; None where they are not equidistant."""
    if len(abscissa) < 2 or not -_SENSELESS < np.min(abscissa) <= np.max(abscissa) < _SENSELESS:
        return None
    span = float(abscissa[-1] - abscissa[0])
    if not span > 0.0:
        return None
    step = span / (len(abscissa) - 1)
    deviation = _deviation(abscissa, float(abscissa[0]), step)
    if not 1.0 / step < math.inf:
        return None
    if not deviation <= _UNEVEN * step:
        return _rounded_step(abscissa)
    tolerance = max(2.0 * deviation / span, _EXACT)
    plain_step, step_digits = plainest(step, tolerance * step)
    inverse, inverse_digits = plainest(1.0 / step, tolerance / step)
    if inverse_digits <= step_digits:
        return Steps(1.0 / inverse, inverse, tolerance)
    return Steps(plain_step, 1.0 / plain_step, tolerance)


def _deviation(stamps: NDArray[np.float64], start: float, step: float) -> float:
    """Largest deviation of stamps from an even grid."""
    found = 0.0
    for begin in range(0, len(stamps), _PIECE):  # long columns are not doubled in memory
        piece = stamps[begin : begin + _PIECE]
        off = np.arange(begin, begin + len(piece), dtype=np.float64)
        off *= step
        off += start
        off -= piece
        found = max(found, float(off.max()), -float(off.min()))
    return found


def _rounded_step(stamps: NDArray[np.float64]) -> Steps | None:
    """Step of stamps that are printed more coarsely than a fifth of it.

    They lie within half their last place of the straight line through all of them; a single
    dropped sample moves half of them by at least another half step.
    """
    index = np.arange(len(stamps), dtype=np.float64) - (len(stamps) - 1) / 2
    step = float(index @ (stamps - stamps.mean()) / (index @ index))
    if not step > 0.0:
        return None
    deviation = np.abs(stamps - (stamps.mean() + step * index))
    for places in (last_place(stamps), _last_digits(stamps)):
        tolerance = float(np.max(places)) / (step * (len(stamps) - 1))
        if tolerance < _UNEVEN and np.all(
            deviation <= (1 + tolerance) * places / 2 + _UNEVEN * step
        ):
            return Steps(step, 1.0 / step, tolerance)
    return None


def last_place(stamps: NDArray[np.float64]) -> float:
    """The decimal place to which all stamps are rounded; infinite where there is none."""
    since = stamps - stamps[0]
    fitting = (d for d in range(_FINEST + 1) if _are_whole(since * 10.0**d))
    return 10.0 ** -next(fitting, -math.inf)


def _last_digits(stamps: NDArray[np.float64]) -> NDArray[np.float64]:
    """The last place of each stamp, if all have equally many significant digits; else infinite."""
    size = np.abs(stamps)
    decades = 10.0 ** np.floor(np.log10(np.maximum(size, size[size > 0].min())) + ROUNDING)
    places = (decades * 10.0 ** (1 - digits) for digits in range(FEWEST_DIGITS, MOST_DIGITS + 1))
    return next((each for each in places if _are_whole(stamps / each)), np.full(1, np.inf))


def _are_whole(numbers: NDArray[np.float64]) -> bool:
    return float(np.max(np.abs(numbers - np.rint(numbers)))) < 1e-3


def rate_of_stamps(stamps: NDArray[np.float64], source: str) -> Rate | None:
    """Sampling rate of a column of times in s; None where they are not evenly spaced."""
    steps = even_step(stamps)
    if steps is None:
        return None
    hz, width = steps.inverse, steps.tolerance * steps.inverse
    if steps.tolerance <= NARROW:
        return Rate(hz, hz - width, hz + width, source)
    found = likeliest(hz - width, hz + width, hz, source)
    return Rate(found.hz, hz - width, hz + width, source, found.is_sure)


def count_of_dates(stamps: NDArray[np.float64]) -> tuple[str, float]:
    """What numbers without a unit count if they are date and time, and its seconds; else empty."""
    step = (stamps[-1] - stamps[0]) / max(len(stamps) - 1, 1)
    for count, (low, high, seconds) in _COUNTS.items():
        is_fine = 0.0 < step * seconds < _MOST_STEP_S
        if low <= stamps[0] < high and is_fine and (low or _is_usual(1.0 / (step * seconds))):
            return count, seconds
    return "", 1.0


def usual_spacings(low_hz: float, high_hz: float) -> list[float]:
    """Spacings of lines within a range that analysers have: rates over powers of two."""
    tens = 10.0 ** np.arange(-6, 7)
    found = {float(each) for each in np.outer(tens, 2.0 ** np.arange(-24, 25)).ravel()}
    return sorted(each for each in found if low_hz <= each <= high_hz)


def _is_usual(hz: float) -> bool:
    """Whether acquisition hardware has a rate."""
    return bool(np.min(np.abs(_KNOWN - hz)) <= SAME_RATE * hz)


def uneven(stamps: NDArray[np.float64], unit: str = "s") -> str:
    """Where times or frequencies that `even_step` refused leave their even steps."""
    axis = "time" if unit == "s" else "frequency"
    if len(stamps) < 2:
        return f"{len(stamps)} {axis} stamp"
    missing = np.flatnonzero(~np.isfinite(stamps))
    if missing.size:
        return f"no {axis} in row {missing[0] + 1} of {len(stamps)}"
    steps = np.diff(stamps)
    usual = float(np.median(steps))
    row = int(np.argmax(np.abs(steps - usual)))
    return (
        f"{axis} goes from {stamps[row]:g} {unit} to {stamps[row + 1]:g} {unit} at row {row + 2} "
        f"of {len(stamps)}, elsewhere in steps of {usual:g} {unit}"
    )


def aligned(
    path: Path,
    channels: Sequence[Channel],
    starts_s: Sequence[float],
    rate_hz: float,
    findings: list[Finding],
    lengths: Sequence[int] = (),
    rounding_s: float = 0.0,
) -> tuple[Channel, ...]:
    """Channels cut to the span that all of them have, if they start whole samples apart.

    `rounding_s` is the last printed place of the starts. `RecordingFormatError` if starts differ
    by parts of a sample, are printed too coarsely, or have nothing in common.
    """
    lengths = list(lengths) or [channel.n_samples for channel in channels]
    all_lengths = {*lengths, *(channel.n_samples for channel in channels)}
    if max(starts_s) - min(starts_s) == 0 and len(all_lengths) == 1 and all_lengths != {0}:
        return tuple(channels)
    late = np.array(starts_s) - min(starts_s)
    if late.any():
        late *= _known(path, rate_hz, late.max())
    first, last = (channels[int(place)] for place in (np.argmin(late), np.argmax(late)))
    apart = f"{last.name!r} begins {np.ptp(starts_s):.6g} s after {first.name!r}"
    whole = np.rint(late)
    missed = np.max(np.abs(late - whole))
    if whole.any():
        missed = max(missed, rounding_s * rate_hz)
    if not missed <= _SHARE_OF_SAMPLE:
        rule = "channels must start together, or whole samples apart"
        remedy = "Resample them to one start, or export them again"
        raise RecordingFormatError(path.name, f"{apart}, {late.max():.6g} samples", rule, remedy)
    begin = (whole.max() - whole).astype(int)
    n_samples = min(length - start for length, start in zip(lengths, begin, strict=True))
    if n_samples < 1:
        raise RecordingFormatError(path.name, apart, "they have no time in common", EXPORT_AGAIN)
    if whole.any():
        detail = f"{apart} ({whole.max():.0f} samples): cut to the {n_samples} samples of both"
        findings.append(note(path, Check.START, detail))
    elif len(set(lengths)) > 1:
        detail = f"{max(lengths)} and {n_samples} samples: cut to the shorter"
        findings.append(remark(path, "", Check.START, detail))
    return tuple(
        channel
        if (start, n_samples) == (0, channel.n_samples)
        else replace(channel, samples=channel.samples[start : start + n_samples])
        for channel, start in zip(channels, begin.tolist(), strict=True)
    )


def _known(path: Path, rate_hz: float, late_s: float) -> float:
    """A sampling rate by which starts can be compared."""
    if rate_hz > 0:
        return rate_hz
    found, rule = f"channels begin up to {late_s:.6g} s apart", "their sampling rate must be known"
    remedy = "State it in the file, as in 'Sampling rate: 2048 Hz'"
    raise RecordingFormatError(path.name, found, rule, remedy)
