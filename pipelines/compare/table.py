"""A comparison as rows of tables, and as a record for other programs."""

from __future__ import annotations

import math
from typing import Any

from model.identifiability import GIVEN
from model.parameters import DAMPING_NAMES, RING_NAMES
from pipelines.compare.compare import Comparison
from pipelines.compare.conditions import Contrast
from pipelines.compare.modes import MatchedMode, UnmatchedMode
from pipelines.compare.significance import LEVEL, Difference, ParameterChange, Scatter
from pipelines.compare.summary_text import findings
from pipelines.results.result import Result
from pipelines.storage.rounding import DASH, chance_text, plain, signed, value_with_std

Row = tuple[str, ...]

#: Short enough for a terminal.
COMPARISON_HEAD = (
    *("mode", "first / Hz", "second / Hz", "change / %", "verdict"),
    *("damping change / %", "verdict on damping", "MAC"),
)
MODE_HEAD = ("mode", "first", "second", "change", "relative / %", "z", "p", "verdict")
PARAMETER_HEAD = ("parameter", "unit", "first", "second", "change / %", "p", "verdict")
CONTRAST_HEAD = ("", "first", "second", "verdict")


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
    return tuple(_parameter_row(change) for change in comparison.parameters)


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


def _parameter_row(change: ParameterChange) -> Row:
    title, _, unit = (RING_NAMES | DAMPING_NAMES)[change.name]
    difference = change.difference

    def text(value: float, std: float, how: str) -> str:
        return plain(value) if how == GIVEN else value_with_std(value, std)

    return (
        title,
        unit,
        text(difference.first, change.first_std, change.first_how),
        text(difference.second, change.second_std, change.second_how),
        percent_text(difference) if difference.value else "0",
        chance_text(difference.adjusted_p_value) if change.is_tested else DASH,
        change.status if change.is_tested else f"{change.status}: {change.hows}",
    )


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
