"""Summary text of a comparison."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from model.parameters import DAMPING_NAMES, RING_NAMES
from pipelines.compare.compare import Comparison
from pipelines.compare.modes import UnmatchedMode
from pipelines.compare.significance import LEVEL, Agreement, Difference, Scatter, Verdict
from pipelines.storage.rounding import chance_text, number, signed, value_with_std

CAUTION = (
    "Significant means: more than the noise of both recordings explains. Pressure as set, "
    "temperature, mounting and warm-up also differ a little from test to test and are not part "
    "of σ; measure the same tyre again to see how much they shift a frequency."
)
METHOD = (
    "Ring modes are matched by order, members of a pair and all other modes by shape (MAC) and "
    "frequency. Differences are second minus first; percentages refer to the first.",
    "σ of a difference is the root of the sum of both variances. The effect of the band ends on a "
    "mode counts in full where the bands differ; in the same band only its change counts.",
    "Errors common to both results, such as a calibration or a clock, drop out of the difference; "
    "their size is unknown, and nothing is subtracted for them.",
    "Tests are two-sided and normal. p is the probability of a difference as large from noise "
    "alone, adjusted for the number of differences tested together (Holm 1979: frequencies and "
    f"damping ratios together, ring parameters separately); below {100 * LEVEL:g} % a difference "
    "is called significant.",
    "σ of a ring parameter follows from the residuals of the ring model where these are larger "
    "than the noise. The residuals of two similar tyres are similar: a change that is not "
    "significant may still be real.",
    "χ² sums (difference/σ)² over the modes, taken as independent; the root of χ² per degree of "
    "freedom is the size of the differences in units of their error bars.",
)
#: Modes named in a sentence at most.
MOST_NAMED = 3
#: p-value of χ² above which the error bars are conservative.
CONSERVATIVE_P_VALUE = 0.99

Named = tuple[str, Difference]


def findings(comparison: Comparison) -> tuple[str, ...]:
    """Frequencies, damping, shapes, modes, parameters and repeatability, as sentences."""
    modes, names = comparison.modes, comparison.names
    return (
        *movement("frequency", "frequencies", [(m.name, m.frequency) for m in modes]),
        *movement("damping ratio", "damping ratios", [(m.name, m.damping) for m in modes]),
        *_shapes(comparison),
        *_only_in(names[0], comparison.only_first),
        *_only_in(names[1], comparison.only_second),
        *_parameters(comparison),
        *_together(comparison),
    )


def movement(one: str, many: str, differences: Sequence[Named]) -> tuple[str, ...]:
    """How a quantity changes, as sentences: its name in singular and plural, values by mode."""
    tested = [each for each in differences if each[1].status is not Verdict.UNKNOWN]
    if not tested:
        return (f"No {one} could be tested.",) if differences else ()
    moved = [each for each in tested if each[1].is_significant]
    if not moved:
        name, largest = max(tested, key=lambda each: abs(each[1].percent))
        text = value_with_std(largest.percent, largest.percent_std)
        return (f"No {one} differs significantly; the largest difference is {text} % ({name}).",)
    up = [each for each in moved if each[1].value > 0]
    down = [each for each in moved if each[1].value < 0]
    if 1 < len(moved) == len(tested) and not (up and down):
        everything = f"{'Both' if len(moved) == 2 else f'All {len(moved)}'} {many}"
        everything += "" if len(tested) == len(differences) else " tested"
        return (f"{everything} {'rise' if up else 'fall'} significantly, by {_span(moved)}.",)
    parts = [
        f"{len(group)} {verb}{'s' * (len(group) == 1)} significantly, by "
        f"{_span(group)}{_listed(group)}"
        for verb, group in (("rise", up), ("fall", down))
        if group
    ]
    still = [each for each in tested if not each[1].is_significant]
    if still:
        verb = "shows" if len(still) == 1 else "show"
        parts.append(f"{len(still)} {verb} no significant change{_listed(still)}")
    return (f"Of {len(tested)} {many}, {'; '.join(parts)}.",)


def _span(group: Sequence[Named]) -> str:
    """From the smallest to the largest change, to the digits that the error bars leave."""
    sizes = [abs(difference.percent) for _, difference in group]
    vaguest = max(difference.percent_std for _, difference in group)
    places = min(max(-math.floor(math.log10(vaguest)), 0), 3)
    low, high = f"{min(sizes):.{places}f}", f"{max(sizes):.{places}f}"
    return f"{low} %" if low == high else f"{low} to {high} %"


def _listed(group: Sequence[Named]) -> str:
    names = [name for name, _ in group]
    return f" ({', '.join(names)})" if len(names) <= MOST_NAMED else ""


def _shapes(comparison: Comparison) -> Iterator[str]:
    known = [mode for mode in comparison.modes if not math.isnan(mode.mac)]
    if known:
        worst = min(known, key=lambda mode: mode.mac)
        yield f"Lowest MAC of matched shapes: {worst.mac:.3f} ({worst.name})."
    for side, name in enumerate(comparison.names):
        modes = [mode.name for mode in comparison.modes if mode.averaged[side]]
        if modes:
            yield f"Resolved as pairs in {name} only: {', '.join(modes)}; their means are compared."


def _only_in(name: str, modes: Sequence[UnmatchedMode]) -> tuple[str, ...]:
    """One sentence for each reason."""
    by_reason: dict[str, list[str]] = {}
    for each in modes:
        text = f"{each.name} at {each.mode.frequency_hz:.1f} Hz"
        by_reason.setdefault(each.reason, []).append(text)
    return tuple(
        f"Only in {name}: {', '.join(group)}; {reason}." for reason, group in by_reason.items()
    )


def _parameters(comparison: Comparison) -> tuple[str, ...]:
    tested = [change for change in comparison.parameters if change.is_tested]
    moved = [
        f"{(RING_NAMES | DAMPING_NAMES)[change.name][0]} by "
        f"{signed(change.difference.percent, 1)} %"
        for change in tested
        if change.difference.is_significant
    ]
    if not tested:
        return ()
    if not moved:
        return (f"None of {len(tested)} identified ring parameters differs significantly.",)
    return (f"Ring parameters that differ significantly: {', '.join(moved)}.",)


def _together(comparison: Comparison) -> tuple[str, ...]:
    found = comparison.agreement
    if found is None:
        return ()
    if comparison.differing:
        named = "; ".join(each.change for each in comparison.differing)
        return (f"The differences include the effect of: {named}.",)
    if not comparison.is_repeat:
        return ()
    return (
        "Same tyre and conditions as far as stated.",
        f"Frequencies differ by {scatter_text(found.frequency)}",
        f"Damping ratios differ by {scatter_text(found.damping)}",
        *_common_shift(found),
    )


def scatter_text(scatter: Scatter) -> str:
    """Size of the differences of all modes against their error bars, with a verdict."""
    if not scatter.freedom:
        return "amounts that cannot be judged: σ is unknown."
    size = (
        f"{number(scatter.rms_percent, 2)} % rms, {number(scatter.ratio, 2)} times what the error "
        f"bars allow (χ² = {number(scatter.chi_square, 3)} for {scatter.freedom}, p-value "
        f"{chance_text(scatter.p_value)})"
    )
    if not scatter.is_noise:
        return f"{size}: something besides noise changes from one measurement to the next."
    if scatter.p_value > CONSERVATIVE_P_VALUE:
        return f"{size}: noise explains them, and the error bars are conservative."
    return f"{size}: noise alone explains them."


def _common_shift(found: Agreement) -> tuple[str, ...]:
    """A probable common cause, where all frequencies shift together by more than noise."""
    if found.frequency.is_noise or not found.apart.freedom:
        return ()
    shift = value_with_std(found.shift_percent, found.shift_std_percent)
    return (
        f"All frequencies together shift by {shift} %; apart from this they differ by "
        f"{number(found.apart.ratio, 2)} times what the error bars allow. A common shift has one "
        "cause: pressure as set, temperature, or the clock of the analyser.",
    )
