"""Settings of the identification and of the checks: every threshold with unit, effect and source.

The manifest's tables ``[identification]`` and ``[checks]`` change them; ``provenance.json`` records
them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any, TypeVar

from ema.core.errors import InputError

_LIKELIHOOD = "Wilks (1938): likelihood-ratio test; chosen with benchmarks/accuracy.py"
_ACCURACY = "benchmarks/accuracy.py"
_LABORATORY = "benchmarks/laboratory.py"

# Types of a value by that of the default, and the rule in words.
_KINDS: dict[type, tuple[Any, str]] = {
    bool: (bool, "it must be true or false"),
    int: (int, "it must be a whole number"),
    float: ((int, float), "it must be a number"),
}


def _setting(default: float, unit: str, effect: str, source: str) -> Any:
    return field(default=default, metadata={"unit": unit, "effect": effect, "source": source})


@dataclass(frozen=True)
class IdentificationSettings:
    """Thresholds of pole selection, curve fit and pairs; each field carries its source.

    Examples
    --------
    >>> import ringmodal as rm
    >>> rm.IdentificationSettings(pair_p_value=1e-6).pair_p_value
    1e-06
    """

    stable_frequency: float = _setting(
        0.01, "–", "poles of consecutive model orders this close are stable", "Allemang (1999)"
    )
    stable_damping: float = _setting(0.05, "–", "the same for the damping ratio", "Allemang (1999)")
    max_damping: float = _setting(
        0.2, "–", "poles with a larger damping ratio are not modes", "Reynders et al. (2012)"
    )
    cluster_step_min: float = _setting(
        0.01, "–", "smallest cut of the cluster tree, |Δλ|/|λ| + 1 − MAC", "Reynders et al. (2012)"
    )
    cluster_step_max: float = _setting(
        0.1, "–", "largest cut of the cluster tree", "Reynders et al. (2012)"
    )
    pin_reach: float = _setting(
        0.05,
        "–",
        "a pole of the diagram that an edit names is the nearest within this share",
        "convention",
    )
    exclude_reach: float = _setting(
        0.01, "–", "a mode that an edit names is the nearest within this share", "convention"
    )
    cross_check_frequency: float = _setting(
        0.005, "–", "both estimators agree within this share of the frequency", _ACCURACY
    )
    cross_check_damping: float = _setting(
        0.10, "–", "both estimators agree within this share of the damping", _ACCURACY
    )
    frequency_reach: float = _setting(
        0.01, "–", "how far a fitted frequency may move from its start", _ACCURACY
    )
    damping_reach: float = _setting(
        4.0, "factor", "how far a fitted damping ratio may move from its start", _ACCURACY
    )
    undetermined_share: float = _setting(
        0.1,
        "–",
        "modes whose frequency is known to no better than this are not listed",
        "convention",
    )
    visible_share: float = _setting(
        0.1,
        "–",
        "without a circle: poles with less of the response at their own resonance are dropped",
        "ruler, beam and wheel, measured",
    )
    pole_scatter: float = _setting(
        0.5,
        "half-widths",
        "beside the modes of a ring: poles known to no better than this are not listed",
        "ruler, beam and wheel, measured; benchmarks/laboratory.py",
    )
    drift_p_value: float = _setting(
        1e-4, "–", "a drift of the runs is taken for real below this chance", _LIKELIHOOD
    )
    residue_p_value: float = _setting(
        1e-4, "–", "a pole whose residues are as likely noise is dropped", _LIKELIHOOD
    )
    pair_p_value: float = _setting(
        1e-4, "–", "a second pole of an order is accepted below this chance", _LIKELIHOOD
    )
    wave_deviation: float = _setting(
        0.004,
        "–",
        "how far residues of a pair stray from pure waves (1 σ) where no other order shows it",
        "0.5° and 2 % of gain",
    )
    pair_damping_likeness: float = _setting(
        0.012, "–", "half the relative difference of a pair's damping (1 σ)", _ACCURACY
    )
    pair_split: float = _setting(
        0.02, "–", "half the relative difference of a pair's frequencies (1 σ)", _ACCURACY
    )
    pair_separation_std: float = _setting(
        6.0, "σ", "least difference of the two frequencies of a pair", _ACCURACY
    )
    pair_damping_factor: float = _setting(
        1.6, "factor", "largest ratio of the two damping ratios of a pair", _ACCURACY
    )
    pair_weakest_share: float = _setting(
        0.06, "–", "the weaker member has at least this share of the residues", _ACCURACY
    )


@dataclass(frozen=True)
class CheckSettings:
    """Thresholds of the checks on channels, sensors and runs; each field carries its source.

    Examples
    --------
    >>> import ringmodal as rm
    >>> rm.CheckSettings(dead_db=-60.0).dead_db
    -60.0
    """

    dead_db: float = _setting(
        -50.0, "dB", "a channel this far below the median power is excluded", "cables switched off"
    )
    clipped_share: float = _setting(
        1e-3, "–", "share of samples on the limits from which a sensor is excluded", _ACCURACY
    )
    few_clipped_share: float = _setting(
        1e-4, "–", "share of samples on the limits that is reported", _ACCURACY
    )
    incoherent_share: float = _setting(
        0.4, "–", "coherence below this share of the other channels' excludes", _ACCURACY
    )
    incoherent: float = _setting(0.3, "–", "… if it is also below this value", _ACCURACY)
    missing_share: float = _setting(
        0.5, "–", "share of lost averages from which a channel is excluded", "convention"
    )
    disagreement_share: float = _setting(
        0.1, "–", "averaged runs differ by more than this share of their power", _ACCURACY
    )
    contradiction_share: float = _setting(
        0.3, "–", "more than half of the places above this: averaged runs are refused", _ACCURACY
    )
    reciprocity_share: float = _setting(
        0.03,
        "–",
        "response at one force to another that the reverse does not explain from which their "
        "places are doubted",
        "a place 2° off leaves 0.05, sensors of 10 g more 0.01, simulated",
    )
    force_condition_doubt: float = _setting(
        10.0,
        "–",
        "condition number of forces that act at the same time from which they are doubted: the "
        "variance of their FRFs is tripled",
        "Belsley, Kuh & Welsch (1980)",
    )
    force_condition_most: float = _setting(
        1000.0,
        "–",
        "… and from which they are refused: noise 30 dB below a force counts as much as the force",
        "Belsley, Kuh & Welsch (1980)",
    )
    driving_point_spread: float = _setting(
        0.1,
        "–",
        "modal masses from the driving points of several forces that differ by more than this, and "
        "by more than their ±, are doubted",
        "calibration of load cell and sensors, 5 % each",
    )
    hum_db: float = _setting(
        20.0, "dB", "mains hum this far above the noise nearby is reported", "convention"
    )
    usual_gain_min: float = _setting(
        0.8, "factor", "smallest gain of a healthy sensor against the ring modes", "ISO 16063-21"
    )
    usual_gain_max: float = _setting(
        1.25, "factor", "largest gain of a healthy sensor against the ring modes", "ISO 16063-21"
    )
    gain_significance_std: float = _setting(
        5.0, "σ", "a gain is corrected only if it is this far from 1", _ACCURACY
    )
    contradiction_std: float = _setting(
        3.5, "σ", "RMS misfit over the ring modes from which a sensor contradicts them", _ACCURACY
    )
    most_corrections_per_run: int = _setting(
        3, "sensors", "more corrections in a run are withheld", "sensors do not fail by the dozen"
    )
    most_corrections_share: float = _setting(
        0.1, "–", "more corrections of all rows are withheld", "sensors do not fail by the dozen"
    )
    correct_sensors: bool = _setting(
        True, "–", "false: suspicious sensors are named, but not corrected or left out", "choice"
    )
    position_share: float = _setting(
        0.005, "–", "response in no wave of one order from which positions are doubted", _LABORATORY
    )
    no_wave_share: float = _setting(
        0.1, "–", "… and from which all orders are doubted", _LABORATORY
    )
    position_factor: float = _setting(
        4.0, "factor", "other angles have to explain the shapes this much better", _LABORATORY
    )
    consistent_ratio: float = _setting(
        1.5, "σ", "the fixed sensor's runs differ by more than this: the tyre changed", _ACCURACY
    )
    consistent_share: float = _setting(
        0.01,
        "–",
        "… and by more than this share of its FRF",
        "0.03 % of the frequencies of modes with 3 % damping",
    )
    steadiness_p_value: float = _setting(
        1e-4, "–", "a change within a run, or with level, is named below this chance", "t-test"
    )
    steady_change: float = _setting(
        1e-3,
        "–",
        "change of frequencies within a run from which it is a warning; half of it if the level "
        "doubles",
        "adds 0.1 % to a damping ratio of 1 %",
    )
    poor_coherence: float = _setting(
        0.5, "–", "median coherence below this is reported", "Bendat & Piersol (2010)"
    )
    good_coherence: float = _setting(
        0.7, "–", "median coherence that a default band needs", "Bendat & Piersol (2010)"
    )
    drive_point_agrees: float = _setting(
        0.5,
        "–",
        "response at the force over the crest from which the place is confirmed",
        _ACCURACY,
    )
    drive_point_clear: float = _setting(
        0.85, "–", "the same, from which another place is named", _ACCURACY
    )
    drive_point_offset_deg: float = _setting(
        2.0, "deg", "a place of the force that far off is named, if it fits better", _LABORATORY
    )


#: Defaults.
IDENTIFICATION, CHECKS = IdentificationSettings(), CheckSettings()


Settings = TypeVar("Settings", IdentificationSettings, CheckSettings)


def settings_from(kind: type[Settings], table: Mapping[str, Any], place: str) -> Settings:
    """Settings with the values of a manifest's table in place of the defaults.

    `InputError`, which names `place`, if a name is unknown or a value is of the wrong type.
    """
    known = {each.name: each for each in fields(kind)}
    for name, value in table.items():
        if name not in known:
            rule = f"known settings: {', '.join(known)}"
            raise InputError(place, repr(name), rule, "Correct or remove it")
        allowed, rule = _KINDS[type(known[name].default)]
        if not isinstance(value, allowed) or isinstance(value, bool) is not (allowed is bool):
            raise InputError(f"{place} {name}", repr(value), rule, "Correct or remove it")
    return kind(**table)
