"""What a comparison found, in sentences that can be signed."""

from __future__ import annotations

import math
from collections.abc import Sequence

from model.parameters import DAMPING_NAMES, RING_NAMES
from pipelines.compare.compare import Comparison
from pipelines.compare.modes import UnmatchedMode
from pipelines.compare.significance import LEVEL, UNKNOWN, Agreement, Difference, Scatter
from pipelines.storage.rounding import chance_text, number, signed, value_with_std

CAUTION = (
    "Significant means: more than the noise of both recordings explains. The pressure as set, the "
    "temperature, the mounting and the warm-up differ a little from test to test as well and are "
    "not in σ; how much they move a frequency is seen by measuring the same tyre again."
)
METHOD = (
    "The ring's modes are matched by order, members of a pair and all other modes by shape (MAC) "
    "and frequency. Differences are second minus first; percentages refer to the first.",
    "σ of a difference is the root of the sum of both variances. What the ends of the band do to a "
    "mode counts in full where the bands differ; in one band, only what differs between the two.",
    "Errors that both results share, such as a calibration or a clock, drop out of the difference; "
    "how large they are is not known, and nothing is subtracted for them.",
    "Tests are two-sided and normal. p is the chance of a difference as large from noise alone, "
    "raised for the number of differences tested together (Holm 1979: frequencies and damping "
    f"ratios together, ring parameters by themselves); below {100 * LEVEL:g} % a difference is "
    "called significant.",
    "σ of a ring parameter rests on the misfit of the ring model where that is larger than the "
    "noise. The misfit of two like tyres is much the same: a change called not significant may "
    "still be real.",
    "χ² sums (difference/σ)² over the modes, counted as independent; its root over the degrees of "
    "freedom says how many times larger the differences are than the error bars allow.",
)
MOST_NAMED = 3
#: A χ² that noise exceeds with this chance is smaller than the error bars make it.
SURELY_EXCEEDED = 0.99

Named = tuple[str, Difference]


def findings(comparison: Comparison) -> tuple[str, ...]:
    """Say what the comparison found: frequencies, damping, modes, parameters, repeatability."""
    modes = comparison.modes
    return (
        *movement("frequency", "frequencies", [(m.name, m.frequency) for m in modes]),
        *movement("damping ratio", "damping ratios", [(m.name, m.damping) for m in modes]),
        *_shapes(comparison),
        *_means(comparison),
        *_only_in(comparison.names[0], comparison.only_first),
        *_only_in(comparison.names[1], comparison.only_second),
        *_parameters(comparison),
        *_together(comparison),
    )


def movement(one: str, many: str, differences: Sequence[Named]) -> tuple[str, ...]:
    """Say how frequencies or damping ratios move: claims only what is significant.

    Parameters
    ----------
    one, many : str
        What it is, in the singular and in the plural.
    differences : sequence of (str, Difference)
        With the name of each mode.
    """
    tested = [each for each in differences if each[1].status != UNKNOWN]
    if not tested:
        return (f"No {one} could be tested.",) if differences else ()
    moved = [each for each in tested if each[1].is_significant]
    if not moved:
        name, largest = max(tested, key=lambda each: abs(each[1].percent))
        text = value_with_std(largest.percent, largest.percent_std)
        return (f"No {one} differs significantly; the largest difference is {text} % ({name}).",)
    up = [each for each in moved if each[1].value > 0]
    down = [each for each in moved if each[1].value < 0]
    if len(moved) == len(tested) and not (up and down) and len(moved) > 1:
        verb = "rise" if up else "fall"
        everything = f"{'Both' if len(moved) == 2 else f'All {len(moved)}'} {many}"
        everything += "" if len(tested) == len(differences) else " tested"
        return (f"{everything} {verb} significantly, by {_span(moved)}.",)
    parts = [
        f"{len(group)} {verb if len(group) > 1 else verb + 's'} significantly, by "
        f"{_span(group)}{_listed(group)}"
        for verb, group in (("rise", up), ("fall", down))
        if group
    ]
    still = [each for each in tested if not each[1].is_significant]
    if still:
        parts.append(f"{len(still)} {_without_change(len(still))}{_listed(still)}")
    return (f"Of {len(tested)} {many}, {'; '.join(parts)}.",)


def _relation(chance: float) -> str:
    text = chance_text(chance)
    return text if text.startswith("<") else f"= {text}"


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


def _without_change(count: int) -> str:
    return "shows no significant change" if count == 1 else "show no significant change"


def _shapes(comparison: Comparison) -> tuple[str, ...]:
    known = [mode for mode in comparison.modes if not math.isnan(mode.mac)]
    if not known:
        return ()
    worst = min(known, key=lambda mode: mode.mac)
    return (f"Lowest MAC of matched shapes: {worst.mac:.3f} ({worst.name}).",)


def _means(comparison: Comparison) -> tuple[str, ...]:
    """Say of which pairs only the mean could be compared."""
    sides = (
        (name, [mode.name for mode in comparison.modes if mode.averaged[side]])
        for side, name in enumerate(comparison.names)
    )
    return tuple(
        f"Resolved as pairs in {name} only: {', '.join(modes)}; their means are compared."
        for name, modes in sides
        if modes
    )


def _only_in(name: str, modes: Sequence[UnmatchedMode]) -> tuple[str, ...]:
    """One sentence for each reason."""
    by_reason: dict[str, list[UnmatchedMode]] = {}
    for each in modes:
        by_reason.setdefault(each.reason, []).append(each)
    return tuple(
        f"Only in {name}: "
        + ", ".join(f"{each.name} at {each.mode.frequency_hz:.1f} Hz" for each in group)
        + f"; {reason}."
        for reason, group in by_reason.items()
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
        return (f"The differences include the effect of what differs: {named}.",)
    if not comparison.is_repeat:
        return ()
    return (
        "Same tyre and conditions as far as stated.",
        f"Frequencies differ by {scatter_text(found.frequency)}",
        f"Damping ratios differ by {scatter_text(found.damping)}",
        *_common_shift(found),
    )


def scatter_text(scatter: Scatter) -> str:
    """How large the differences of all modes are against their error bars, and what that says."""
    if not scatter.freedom:
        return "amounts that cannot be judged: σ is unknown."
    size = (
        f"{number(scatter.rms_percent, 2)} % rms, {number(scatter.ratio, 2)} times what the error "
        f"bars allow (χ² = {number(scatter.chi_square, 3)} for {scatter.freedom}, "
        f"p {_relation(scatter.chance)})"
    )
    if not scatter.is_noise:
        return f"{size}: something besides noise changes from one measurement to the next."
    if scatter.chance > SURELY_EXCEEDED:
        return f"{size}: noise explains them, and the error bars are on the safe side."
    return f"{size}: noise alone explains them."


def _common_shift(found: Agreement) -> tuple[str, ...]:
    """Point to one cause, where all frequencies move together by more than noise."""
    if found.frequency.is_noise or not found.apart.freedom:
        return ()
    shift = value_with_std(found.shift_percent, found.shift_std_percent)
    return (
        f"All frequencies together shift by {shift} %; apart from this they differ by "
        f"{number(found.apart.ratio, 2)} times what the error bars allow. A common shift has one "
        "cause: pressure as set, temperature, or the clock of the analyser.",
    )
