"""Options of a run, the same in Python and on the command line; units of what is shown."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from math import inf
from typing import Any

from ema.core.campaign import Campaign, Processing
from ema.core.display import DASH, plain, value_with_std
from ema.core.errors import InputError
from ema.core.settings import CheckSettings, IdentificationSettings
from model.coefficients import PressureLoad
from model.parameters import TuningPriors

#: Units of pressure that can be shown.
UNITS_PA = {"bar": 1e5, "kPa": 1e3, "Pa": 1.0, "psi": 6894.757293168}
#: Pressure model of a tuning: that of the paper.
DEFAULT_LOAD: PressureLoad = "dead"
#: Shares of a value, and the field of `TuningPriors` for each.
_SHARES = {
    "calibration": "calibration_std",
    "model_form": "model_form_std",
    "order_1": "order_1_std",
}
#: Values that are given elsewhere, in SI.
_SPREADS = {
    "inflation_pressure_pa": "pressure_std",
    "mean_radius_m": "radius_std",
    "belt_width_m": "width_std",
}


def _number_from(low: float, below: float = inf) -> Callable[[Any], bool]:
    def is_valid(value: Any) -> bool:
        plain = isinstance(value, int | float) and not isinstance(value, bool)
        return plain and low <= value < below

    return is_valid


def _whole_from(low: int, high: int) -> Callable[[Any], bool]:
    return lambda value: type(value) is int and low <= value <= high


def _is_band(value: Any) -> bool:
    is_pair = isinstance(value, list | tuple) and len(value) == 2
    return is_pair and all(map(_number_from(0.0), value)) and value[0] < value[1]


#: Settings that a decision may change: whether a value is one, and the rule.
SETTINGS: dict[str, tuple[Callable[[Any], bool], str]] = {
    "band_hz": (_is_band, "it must be two frequencies that rise from 0 Hz or above"),
    "max_order": (_whole_from(1, 200), "it must be a whole number up to 200"),
    "method": (("lsce", "plscf").__contains__, "it must be lsce or plscf"),
    "estimator": (("H1", "H2", "Hv").__contains__, "it must be H1, H2 or Hv"),
    "averages": (_whole_from(1, 10**9), "it must be a whole number ≥ 1"),
    "block_seconds": (_number_from(1e-9), "it must be a number > 0"),
    "window": (lambda value: isinstance(value, str), "it must be the name of a window of scipy"),
    "overlap": (_number_from(0.0, 1.0), "it must be from 0 to below 1"),
    "exponential_window_s": (_number_from(1e-9), "it must be a number > 0"),
    "exponential_window_std_s": (_number_from(0.0), "it must be a number ≥ 0"),
    "force_window_s": (_number_from(1e-9), "it must be a number > 0"),
}


@dataclass(frozen=True)
class Options:
    """Options of a run; None leaves the value of the manifest or a default in force.

    Parameters
    ----------
    processing : Processing
        Averages, block length, window, overlap and band; what is set here overrides the manifest.
    estimator : {"H1", "H2", "Hv"}
        FRF estimator.
    max_order : int
        Highest model order of the stability diagram.
    pinned_hz : tuple of float
        Frequencies of the modes, instead of the automatic selection; empty for automatic.
    excluded_hz : tuple of float
        Frequencies of poles that are not modes.
    method : {"lsce", "plscf"}
        Pole estimator; the other one is used for the cross-check.
    tune : bool
        Whether to determine the ring's parameters.
    objective : {"frequency", "paper"}
        What the tuning minimises: relative frequency errors, or the residual of eq. 18.
    given : dict
        Ring parameters known from elsewhere, by name, in SI.
    tuning : dict
        As the manifest's ``[tuning]``, which it overrides key by key.
    strict : bool
        Whether warnings about the recordings are errors.
    identification : IdentificationSettings, optional
        Thresholds of poles, curve fit and pairs, instead of those of the manifest.
    checks : CheckSettings, optional
        Thresholds of the checks on channels and sensors, instead of those of the manifest.

    Examples
    --------
    >>> import ringmodal as rm
    >>> options = rm.Options(processing=rm.Processing(band_hz=(60.0, 160.0)), tune=False)
    >>> rm.process("sample_data/tyre_225_55R17", options)
    <Result tyre_225_55R17: 4 modes, no ring, 0 warnings>
    """

    processing: Processing = field(default_factory=Processing)
    estimator: str = "H1"
    max_order: int = 60
    pinned_hz: tuple[float, ...] = ()
    excluded_hz: tuple[float, ...] = ()
    method: str = "lsce"
    tune: bool = True
    objective: str = "frequency"
    given: dict[str, float] = field(default_factory=dict)
    tuning: dict[str, Any] = field(default_factory=dict)
    strict: bool = False
    identification: IdentificationSettings | None = None
    checks: CheckSettings | None = None


def given_processing(options: Options) -> dict[str, Any]:
    """What was chosen on the way to the modes instead of the manifest or a default."""
    usual = Options()
    unset = vars(usual.processing)
    given = {name: each for name, each in vars(options.processing).items() if each != unset[name]}
    own = {name: getattr(options, name) for name in ("estimator", "max_order", "method")}
    return given | {name: each for name, each in own.items() if each != getattr(usual, name)}


def with_settings(options: Options, settings: Mapping[str, Any]) -> Options:
    """Options with settings of ``edits.toml`` where they do not choose for themselves."""
    given = given_processing(options)
    lengths = {"averages", "block_seconds"} if {"averages", "block_seconds"} & {*given} else set()
    chosen = {name: each for name, each in settings.items() if name not in lengths} | given
    if "band_hz" in chosen:
        chosen["band_hz"] = tuple(chosen["band_hz"])
    blocks = {name: chosen[name] for name in vars(options.processing) if name in chosen}
    own = {name: chosen[name] for name in ("estimator", "max_order", "method") if name in chosen}
    return replace(options, processing=replace(options.processing, **blocks), **own)


def processing_in_force(campaign: Campaign, chosen: Processing) -> Processing:
    """Combine the manifest's processing with what was chosen on top of it.

    Averages and block length exclude each other: choosing one drops the manifest's other.
    """
    if chosen.averages is not None and chosen.block_seconds is not None:
        found = f"averages {chosen.averages} and block_seconds {chosen.block_seconds:g}"
        raise InputError("processing", found, "each sets the block length", "Leave one of them out")
    if chosen.band_hz is not None and not 0 <= chosen.band_hz[0] < chosen.band_hz[1]:
        found = f"{chosen.band_hz[0]:g} to {chosen.band_hz[1]:g} Hz"
        raise InputError("band_hz", found, "a band rises from 0 Hz or above", "Correct the limits")
    manifest = campaign.processing
    if chosen.averages is not None or chosen.block_seconds is not None:
        manifest = replace(manifest, averages=None, block_seconds=None)
    given = {name: value for name, value in vars(chosen).items() if value is not None}
    if chosen.exponential_window_s is None:
        del given["exponential_window_std_s"]
    return replace(manifest, **given)


def tuning_in_force(manifest: Mapping[str, Any], chosen: Mapping[str, Any]) -> dict[str, Any]:
    """Combine the manifest's ``[tuning]`` with what was chosen on top of it, key by key."""
    merged = dict(manifest)
    for name, entry in chosen.items():
        earlier = merged.get(name)
        both = isinstance(entry, dict) and isinstance(earlier, dict)
        merged[name] = {**earlier, **entry} if both and earlier else entry
    return merged


def tuning_arguments(
    tuning: Mapping[str, Any], given: Mapping[str, float], tyre: Mapping[str, float | None]
) -> dict[str, Any]:
    """Arguments of `tune_ring` from a table ``[tuning]`` and ring parameters given besides it."""
    known: dict[str, float] = dict(given)
    priors: dict[str, tuple[float, float]] = {}
    bounds, start, spreads = {}, {}, {}
    for name, entry in tuning.items():
        where = f"[tuning] {name}"
        if name == "pressure_load":
            continue
        if name in _SHARES or name in _SPREADS:
            size = tyre.get(name) if name in _SPREADS else 1.0
            if size:
                spreads[(_SHARES | _SPREADS)[name]] = entry["std"] / size
            continue
        if ("lower" in entry) != ("upper" in entry):
            raise InputError(where, repr(entry), "limits are lower and upper", "Give both")
        if "std" in entry and "value" not in entry:
            raise InputError(where, repr(entry), "a std belongs to a value", "Give value too")
        if "lower" in entry:
            bounds[name] = entry["lower"], entry["upper"]
        if "start" in entry:
            start[name] = entry["start"]
        if "value" in entry and name not in given:
            if entry.get("std"):
                priors[name] = entry["value"], entry["std"]
            else:
                known[name] = entry["value"]
    growth_m = known.pop("radial_growth_m", None)
    return {
        "given": known,
        "start": start,
        "bounds": bounds,
        "radial_growth_m": growth_m,
        "pressure_load": tuning.get("pressure_load", DEFAULT_LOAD),
        "priors": TuningPriors(parameters=priors, **spreads),
    }


class Units(StrEnum):
    """Units that results are shown in."""

    LAB = "lab"  # bar and mm, the default
    SI = "si"


# What an SI unit is shown as, and its factor; others are shown as they are.
_SHOWN = {Units.SI: {"Pa": ("kPa", 1e-3)}, Units.LAB: {"Pa": ("bar", 1e-5), "m": ("mm", 1e3)}}


def with_unit(
    value: float, std: float | None, unit: str, units: Units
) -> tuple[float, float | None, str]:
    """A value in SI and its standard deviation as they are shown, and the unit."""
    shown, factor = _SHOWN[units].get(unit, (unit, 1.0))
    return value * factor, None if std is None else std * factor, shown


def quantity(value: float, unit: str, units: Units) -> str:
    """A given value in SI as it is shown, such as "2.2 bar"."""
    value, _, unit = with_unit(value, None, unit, units)
    return f"{plain(value)} {unit}"


def parameter_rows(
    values: Any, found: Any, names: Mapping[str, tuple[str, str, str]], units: Units
) -> list[tuple[str, str, str, str, str]]:
    """Name, symbol, value with ±, unit and how obtained of each parameter that `values` has.

    `found` has the standard deviations `std` in SI and `how` each was obtained.
    """
    rows = []
    for name, (title, symbol, si_unit) in names.items():
        if (si_value := getattr(values, name)) is not None:
            value, std, unit = with_unit(si_value, found.std.get(name), si_unit, units)
            text = value_with_std(value, std)
            rows.append((title, symbol, text, unit, found.how.get(name, DASH)))
    return rows
