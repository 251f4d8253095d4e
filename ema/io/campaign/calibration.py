"""Calibration: units and sensitivities from the manifest, for files that lack them."""

from __future__ import annotations

import fnmatch
import math
import re
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace

from ema.core.errors import ManifestError, nearest
from ema.core.finding import Check, Finding, Verdict
from ema.core.recording import UNKNOWN, VOLTAGE, Channel, Recording
from ema.core.units import SI_UNIT, Unit, is_stated, parse_unit
from ema.io.campaign.manifest import MANIFEST_NAME, CalibrationSection
from ema.io.content import remark

_SENSITIVITY = re.compile(r"^\s*([+-]?[0-9.,]+(?:[eE][+-]?[0-9]+)?)\s*(.+?)\s*$")
_AMBIGUOUS = re.compile(r"^[+-]?[1-9][0-9]{0,2},[0-9]{3}$")  # decimal comma or thousands?
_MECHANICAL = SI_UNIT.keys() - {VOLTAGE}  # quantities
_WRITE = "Give the number and its unit as on the calibration sheet, e.g. '10.2 mV/g'"


@dataclass(frozen=True)
class Sensitivity:
    """Quantity that a sensor measures, and its output."""

    quantity: str
    volts_per_si: float  # volts per m/s², N, m/s or m


def parse_sensitivity(text: str) -> Sensitivity | None:
    """Parse e.g. ``"10.2 mV/g"``, ``"2.25 mV/N"``, ``"98 (m/s^2)/V"``; None for other texts."""
    match = _SENSITIVITY.match(text)
    if match is None or _AMBIGUOUS.match(match[1]):
        return None
    try:
        value = float(match[1].replace(",", "."))
    except ValueError:
        return None
    units = _parts(match[2])
    if units is None or not value or not math.isfinite(value):
        return None
    above, below = units
    if above.quantity == VOLTAGE and below.quantity in _MECHANICAL:
        return Sensitivity(below.quantity, value * above.factor / below.factor)
    if below.quantity == VOLTAGE and above.quantity in _MECHANICAL:
        return Sensitivity(above.quantity, below.factor / (value * above.factor))
    return None


def _parts(text: str) -> tuple[Unit, Unit] | None:
    """Units above and below a slash outside of all brackets; mV/m/s^2 means mV/(m/s^2)."""
    for place, sign in enumerate(text):
        if sign == "/" and text.count("(", 0, place) == text.count(")", 0, place):
            above, below = parse_unit(text[:place]), parse_unit(text[place + 1 :])
            if above is not None and below is not None:
                return above, below
    return None


def check_keys(names: Collection[str], place: str, keys: Iterable[str]) -> None:
    """Refuse a key at a place of the manifest that names no channel."""
    for key in keys:
        if key not in names and not fnmatch.filter(names, key):
            where = f"{MANIFEST_NAME}, {place}.{key}"
            rule = "no recording has a channel of that name"
            raise ManifestError(where, repr(key), rule, nearest(key, sorted(names)))


def calibrated(
    recording: Recording, sections: Mapping[str, CalibrationSection], findings: list[Finding]
) -> Recording:
    """Apply ``[calibration]`` of the manifest to all channels that its keys name.

    Keys are names of channels, or patterns such as ``"A*"``; a name has priority.
    """
    channels = []
    for channel in recording.channels:
        fitting = (key for key in sections if fnmatch.fnmatchcase(channel.name, key))
        entry = channel.name if channel.name in sections else next(fitting, None)
        if entry is not None:
            channel = _calibrate(recording, channel, entry, sections[entry], findings)
        channels.append(channel)
    return replace(recording, channels=tuple(channels))


def _calibrate(
    recording: Recording,
    channel: Channel,
    key: str,
    section: CalibrationSection,
    findings: list[Finding],
) -> Channel:
    where = f"{MANIFEST_NAME}, calibration.{key}"
    sign = math.copysign(1.0, channel.scale_to_si)
    if section.unit is not None:
        unit = parse_unit(section.unit)
        if unit is None or unit.quantity == UNKNOWN:
            remedy = "Write e.g. m/s^2, g, mm/s^2, N, kN, lbf, V or mV"
            raise ManifestError(f"{where}.unit", repr(section.unit), "it is not known", remedy)
        if is_stated(channel.unit) and parse_unit(channel.unit) not in (None, unit):
            detail = f"the file states {channel.unit!r}, the manifest {section.unit!r} and decides"
            findings.append(remark(recording.path, channel.name, Check.UNIT, detail))
        channel = replace(
            channel, quantity=unit.quantity, unit=section.unit, scale_to_si=sign * unit.factor
        )
    if section.sensitivity is not None:
        channel = _with_sensitivity(recording, channel, where, section.sensitivity, findings)
    detail = f"{section.sensitivity or section.unit} by the manifest"
    place = recording.path.name, channel.name, None
    findings.append(Finding(*place, Check.CALIBRATION, Verdict.OK, detail))
    return channel


def _with_sensitivity(
    recording: Recording, channel: Channel, where: str, text: str, findings: list[Finding]
) -> Channel:
    sensitivity = parse_sensitivity(text)
    if sensitivity is None:
        rule = "a sensitivity must be volts over m/s^2, g, N or the like"
        raise ManifestError(f"{where}.sensitivity", repr(text), rule, _WRITE)
    if channel.quantity != VOLTAGE and is_stated(channel.unit):
        unit = f"in {channel.unit!r} in {recording.path.name}"
        found = f"a sensitivity for {channel.name!r}, which is {unit}"
        remedy = 'Leave it out, or add unit = "V" if the file\'s unit is wrong'
        raise ManifestError(where, found, "a sensitivity is for a channel in volts", remedy)
    if channel.quantity != VOLTAGE:
        detail = "no unit stated; taken as V, as a sensitivity is given"
        findings.append(remark(recording.path, channel.name, Check.UNIT, detail))
    scale_to_si = channel.scale_to_si / sensitivity.volts_per_si
    return replace(channel, quantity=sensitivity.quantity, scale_to_si=scale_to_si)
