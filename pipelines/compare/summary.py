"""A comparison in words, as rows of tables, and as a record for other programs."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

from ema.core.display import DASH, chance_text, number, plain, signed, value_with_std
from model.identifiability import AT_BOUND, GIVEN, NOT_IDENTIFIED
from model.parameters import DAMPING_NAMES, RING_NAMES
from pipelines.compare.compare import Comparison
from pipelines.compare.conditions import Contrast
from pipelines.compare.modes import MatchedMode, UnmatchedMode
from pipelines.compare.significance import (
    LEVEL,
    Agreement,
    Difference,
    ParameterChange,
    Scatter,
    Verdict,
)
from pipelines.results.options import Units, with_unit
from pipelines.results.result import Result

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
Row = tuple[str, ...]

#: Short enough for a terminal.
COMPARISON_HEAD = (
    *("mode", "first / Hz", "second / Hz", "change / %", "verdict"),
    *("damping change / %", "verdict on damping", "MAC"),
)
MODE_HEAD = ("mode", "first", "second", "change", "relative / %", "z", "p", "verdict")
PARAMETER_HEAD = ("parameter", "unit", "first", "second", "change / %", "p", "verdict")
CONTRAST_HEAD = ("", "first", "second", "verdict")


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


def comparison_rows(comparison: Comparison) -> tuple[Row, ...]:
    """One row per matched mode under `COMPARISON_HEAD`, as printed."""
    return tuple(
        (
            mode.name,
            value_with_std(mode.first.frequency_hz, mode.first.frequency_std_hz),
            value_with_std(mode.second.frequency_hz, mode.second.frequency_std_hz),
            percent_text(mode.frequency),
            mode.frequency.status,
            percent_text(mode.damping),
            mode.damping.status,
            DASH if math.isnan(mode.mac) else f"{mode.mac:.3f}",
        )
        for mode in comparison.modes
    )


def frequency_rows(comparison: Comparison) -> tuple[Row, ...]:
    """Frequencies in Hz under `MODE_HEAD`."""
    return tuple(_mode_row(mode, mode.frequency, "frequency_std_hz") for mode in comparison.modes)


def damping_rows(comparison: Comparison) -> tuple[Row, ...]:
    """Damping ratios in percent under `MODE_HEAD`."""
    return tuple(_mode_row(mode, mode.damping, "damping_std", 100) for mode in comparison.modes)


def parameter_rows(comparison: Comparison) -> tuple[Row, ...]:
    """Ring and damping parameters under `PARAMETER_HEAD`."""
    return tuple(_parameter_row(change, comparison.units) for change in comparison.parameters)


def contrast_rows(contrasts: tuple[Contrast, ...]) -> tuple[Row, ...]:
    """Conditions or options under `CONTRAST_HEAD`."""
    return tuple(
        (
            each.name,
            each.first or DASH,
            each.second or DASH,
            "not stated for both" if each.is_open else "differs" if each.differs else "same",
        )
        for each in contrasts
    )


def percent_text(difference: Difference) -> str:
    """Relative difference with its sign and, where known, its ±."""
    if not math.isfinite(difference.percent_std):
        return signed(difference.percent, 2)
    return _with_sign(difference.percent, difference.percent_std)


def _mode_row(mode: MatchedMode, difference: Difference, std: str, scale: float = 1) -> Row:
    return (
        mode.name,
        value_with_std(scale * difference.first, scale * getattr(mode.first, std)),
        value_with_std(scale * difference.second, scale * getattr(mode.second, std)),
        _with_sign(scale * difference.value, scale * difference.std),
        percent_text(difference),
        signed(difference.z, 1),
        chance_text(difference.adjusted_p_value),
        difference.status,
    )


def _parameter_row(change: ParameterChange, units: Units) -> Row:
    title, _, si_unit = (RING_NAMES | DAMPING_NAMES)[change.name]
    difference = change.difference
    _, _, unit = with_unit(1.0, None, si_unit, units)

    def text(si_value: float, si_std: float, how: str) -> str:
        value, std, _ = with_unit(si_value, si_std, si_unit, units)
        return plain(value) if how == GIVEN else value_with_std(value, std)

    return (
        title,
        unit,
        text(difference.first, change.first_std, change.first_how),
        text(difference.second, change.second_std, change.second_how),
        change_text(change),
        chance_text(difference.adjusted_p_value) if change.is_tested else DASH,
        change.status if change.is_tested else f"{change.status}: {change.hows}",
    )


def change_text(change: ParameterChange) -> str:
    """Relative change; none of a parameter that one of the results does not determine."""
    if {change.first_how, change.second_how} & {NOT_IDENTIFIED, AT_BOUND}:
        return DASH
    return percent_text(change.difference) if change.difference.value else "0"


def _with_sign(value: float, std: float) -> str:
    return f"{'+' if value > 0 else ''}{value_with_std(value, std)}"


def comparison_record(comparison: Comparison) -> dict[str, Any]:
    """Everything that was found, in SI and fractions, for ``--json``; NaN where unknown."""
    found = comparison.agreement
    return {
        "first": _result_record(comparison.first, comparison.names[0]),
        "second": _result_record(comparison.second, comparison.names[1]),
        "findings": findings(comparison),
        "doubts": comparison.doubts,
        "level": LEVEL,
        "correction": "Holm",
        "modes": [_mode_record(mode) for mode in comparison.modes],
        "only_first": [_unmatched_record(mode) for mode in comparison.only_first],
        "only_second": [_unmatched_record(mode) for mode in comparison.only_second],
        "mac": comparison.mac.tolist(),
        "shapes": comparison.shapes_note,
        "parameters": [
            {"name": change.name}
            | _difference_record(change.difference)
            | _fields(change, "first_std", "second_std", "first_how", "second_how", "status")
            for change in comparison.parameters
        ],
        "agreement": found
        and {
            "frequency": _scatter_record(found.frequency),
            "damping": _scatter_record(found.damping),
            **_fields(found, "shift_percent", "shift_std_percent"),
            "apart_from_shift": _scatter_record(found.apart),
        },
        "repeat": comparison.is_repeat,
        "conditions": [_contrast_record(each) for each in comparison.conditions],
        "processing": [_contrast_record(each) for each in comparison.processing],
    }


def _fields(found: object, *names: str) -> dict[str, Any]:
    return {name: getattr(found, name) for name in names}


def _result_record(result: Result, name: str) -> dict[str, Any]:
    return {
        "name": name,
        "designation": None if result.tyre is None else result.tyre.designation,
        "band_hz": result.modal_model.band_hz,
        "created": result.provenance.get("created"),
    }


def _difference_record(difference: Difference) -> dict[str, Any]:
    return {
        **_fields(difference, "first", "second"),
        "difference": difference.value,
        **_fields(difference, "std", "percent", "percent_std", "z"),
        "chance": difference.p_value,
        "adjusted_chance": difference.adjusted_p_value,
    }


def _mode_record(mode: MatchedMode) -> dict[str, Any]:
    return {
        **_fields(mode.first, "order", "member"),
        "first_mode": mode.first_number,
        "second_mode": mode.second_number,
        "mac": mode.mac,
        "frequency_hz": _difference_record(mode.frequency) | {"status": mode.frequency.status},
        "damping_ratio": _difference_record(mode.damping) | {"status": mode.damping.status},
        "remark": mode.remark,
    }


def _unmatched_record(mode: UnmatchedMode) -> dict[str, Any]:
    of_mode = _fields(mode.mode, "order", "member", "frequency_hz", "damping_ratio")
    return {"mode": mode.number, **of_mode, "reason": mode.reason}


def _scatter_record(scatter: Scatter) -> dict[str, Any]:
    of_fit = _fields(scatter, "freedom", "chi_square", "ratio")
    return {**of_fit, "chance": scatter.p_value, "rms_percent": scatter.rms_percent}


def _contrast_record(contrast: Contrast) -> dict[str, Any]:
    stated = {"first": contrast.first or None, "second": contrast.second or None}
    return {"name": contrast.name, **stated, "differs": contrast.differs}
