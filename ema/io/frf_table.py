"""FRFs from the columns of a table: frequency, two parts of each FRF, perhaps its coherence."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ema.core.errors import RecordingFormatError
from ema.core.finding import Check, Finding, Verdict
from ema.core.frf import FRF
from ema.core.numerics import constant
from ema.core.recording import DERIVATIVES
from ema.core.units import FREQUENCY, is_stated, parse_axis, parse_ratio
from ema.io.columns import Column, is_time, label_of_axis
from ema.io.content import EXPORT_AGAIN, NOWHERE, FileContent, Point, point_of, stated_windows
from ema.io.rates import NARROW, even_step, last_place, uneven, usual_spacings

_FREQUENCY_NAMES = {"f", "freq", "frequency", "frequenz", "frequence", "fréquence", "frequencia"}
_FREQUENCY_WORD = re.compile(r"(?:^|[^a-z])(?:freq|frequency|frequenz|frequence)(?:[^a-z]|$)")
# Names of an angular frequency, which is in rad/s where its unit is none, 1/s or rad.
_ANGULAR = re.compile(r"omega|ω|w|(?:kreis|winkel)frequenz|pulsation")
_ANGULAR_WORD = re.compile(r"(?:^|[^a-z])(?:angular|circular|rad)(?:[^a-z]|$)")
_PER_SECOND = {"1/s", "s^-1", "s-1", "1/sec", "rad"}
# An FRF with a resonance passes 90°; a phase in rad that is not wrapped stays below 14 turns.
_FEWEST_DEGREES = 90.0
_DEGREES = {"deg", "°", "degree", "degrees", "grad"}
_RADIANS = {"rad", "radian", "radians"}
_DECIBEL = re.compile(r"dB(?:\s+re\.?)?\s*[:(]?\s*1?\s*(?P<unit>\S.*?)?\)?", re.IGNORECASE)
#: What is done with motion over force, by the power of jω.
CONVERTED = (
    "",
    "{} over force, converted to inertance (factor jω)",
    "{} over force, converted to inertance (factor −ω²)",
)
_SEPARATORS = " \t_-:|,.()"
_SAME_LINE = 1e-3  # of the step between lines


class _Part(Enum):
    """What a column has of an FRF."""

    REAL = r"re|real|realteil|reell|réelle?"
    IMAGINARY = r"im|imag|imaginary|imaginär|imaginärteil|imaginaer|imaginaire"
    MAGNITUDE = r"mag|magn|magnitude|abs|amp|ampl|amplitude|betrag|modul(?:e|us)?"
    PHASE = r"phase|phas|ph|phi|arg|angle|winkel"
    COHERENCE = r"coh|coherence|kohärenz|kohaerenz|msc|cxy|gamma2"


_PARTS = {
    part: re.compile(rf"(?<![^\W_])(?:{part.value})(?![^\W_])", re.IGNORECASE) for part in _Part
}
# Of a conjugate FRF, or of a part with the other sign; "H1 - imag" and "H1-imag" have a dash.
_SIGN_AHEAD = re.compile(
    r"(?:^|[\s(\[])[-\u2212]$|(?<![^\W_])(?:neg\w*|minus|conj\w*)(?![^\W_])", re.I
)
_PAIRS = ((_Part.REAL, _Part.IMAGINARY), (_Part.MAGNITUDE, _Part.PHASE))


def has_frequency(columns: Sequence[Column]) -> bool:
    """Whether the first column is of frequencies, by its name or its unit."""
    if not columns:
        return False
    axis = parse_axis(unit_of_lines(columns[0]))
    return axis is not None and axis.kind == FREQUENCY


def unit_of_lines(column: Column) -> str:
    """Unit of frequencies: stated, or in the name, as that or as its meaning."""
    name, unit = label_of_axis(column.name.strip(_SEPARATORS), column.unit)
    unit = column.unit if is_stated(column.unit) else unit
    plain = name.lower()
    is_word = _FREQUENCY_WORD.search(plain) is not None
    is_angular = _ANGULAR.fullmatch(plain) or (is_word and _ANGULAR_WORD.search(plain))
    if is_angular:
        is_bare = unit.replace(" ", "") in _PER_SECOND or not is_stated(unit)
        return "rad/s" if is_bare else unit
    if is_stated(column.unit):
        return unit
    is_named = plain in _FREQUENCY_NAMES
    if is_named or (is_word and _rises_evenly(column)):
        return unit or "Hz"
    return name


def refuse_other_lines(path: Path, columns: Sequence[Column]) -> None:
    """Refuse FRFs over something that is no frequency, such as orders, or is not called so."""
    found = [each for each in columns if parse_ratio(each.unit) and _has_part(each.name)]
    if len(found) < 2 or any(is_time(each.name, each.unit) for each in columns):
        return
    first = columns[0]
    what = f"{first.name!r} in {first.unit!r}" if is_stated(first.unit) else repr(first.name)
    rule = "FRFs must stand behind a column of frequencies"
    remedy = "Call that column Frequency [Hz], if it is"
    raise RecordingFormatError(
        path.name, f"FRFs such as {found[0].name!r} behind {what}", rule, remedy
    )


def with_frequency_first(path: Path, columns: Sequence[Column]) -> list[Column] | None:
    """Columns of FRFs in any order, complex ones as two; None without frequencies."""
    first = next(filter(are_lines, columns), None)
    if first is None:
        return None
    other = next((each for each in columns if len(each.samples) != len(first.samples)), None)
    if other is not None:
        found = f"{len(first.samples)} frequencies, {len(other.samples)} values of {other.name!r}"
        rule = "FRFs must have a value for each frequency"
        raise RecordingFormatError(path.name, found, rule, EXPORT_AGAIN)
    ordered = [first]
    for each in columns:
        if each.samples.dtype.kind == "c":
            parts = {"real": each.samples.real, "imag": each.samples.imag}
            ordered += [replace(each, name=f"{each.name} {k}", samples=v) for k, v in parts.items()]
        elif not (are_lines(each) and np.array_equal(each.samples, first.samples)):
            named = f"{each.name} {each.matrix}" if not _has_part(each.name) else each.name
            ordered.append(replace(each, name=named) if _has_part(each.matrix) else each)
    return ordered


def _has_part(name: str) -> bool:
    return any(form.search(name) for form in _PARTS.values())


def are_lines(column: Column) -> bool:
    """Whether a column is of evenly spaced frequencies."""
    return has_frequency([column]) and _rises_evenly(column)


def _rises_evenly(column: Column) -> bool:
    return column.samples.dtype.kind in "iuf" and even_step(column.samples) is not None


@dataclass
class _Parts:
    """Columns of one FRF."""

    name: str
    columns: dict[_Part, Column] = field(default_factory=dict)

    @property
    def pair(self) -> tuple[_Part, _Part]:
        """The two parts that it has, or should have."""
        return next((each for each in _PAIRS if set(each) & set(self.columns)), _PAIRS[0])

    @property
    def unit(self) -> str:
        """Unit of the first part, in decibels with that behind the reference."""
        first = self.columns.get(self.pair[0])
        text = "" if first is None else first.unit
        decibel = _DECIBEL.fullmatch(text)
        return (decibel["unit"] or "") if decibel else text


def frf_content(
    path: Path,
    columns: Sequence[Column],
    findings: Sequence[Finding],
    statements: Mapping[str, object],
) -> FileContent:
    """FRFs as inertance; their names are what the headings of their columns have in common.

    `statements` are entries of headers, which may name windows and triggers.

    `RecordingFormatError` if frequencies are uneven, an FRF lacks its phase or its other part, a
    column belongs to none, or a unit is not stated.
    """
    noticed = list(findings)
    lines = _lines(path, columns[0], noticed)
    grouped = _grouped(path, columns[1:])
    values = np.array([_inertance(path, each, lines, noticed) for each in grouped])
    coherence = np.full(values.shape, np.nan)
    for row, each in enumerate(grouped):
        if _Part.COHERENCE in each.columns:
            coherence[row] = _coherence(path, each.columns[_Part.COHERENCE])
    names = [each.name for each in grouped]
    points, forces = _points(path, names)
    known = all(point.node for point in points)
    senses = [point.sense * force.sense for point, force in zip(points, forces, strict=True)]
    values *= np.array(senses)[:, None]
    frf = FRF(
        frequency_hz=lines,
        values=values,
        coherence=coherence,
        std=constant(np.nan, values.shape),
        node=np.array([point.node * known for point in points]),
        position_deg=np.full(len(names), np.nan),
        run=(path.name,) * len(names),
        axis=np.array([point.axis * known for point in points]),
    )
    without = tuple(row for row, each in enumerate(grouped) if not is_stated(each.unit))
    of_forces = tuple((force.node, force.axis) for force in forces) if known else ()
    windows, ignored = stated_windows(path, statements)
    found = FileContent(path, None, frf, tuple(names), of_forces, (*noticed, *ignored))
    return replace(found, frf_without_unit=without, windows=windows)


def _points(path: Path, names: Sequence[str]) -> tuple[list[Point], list[Point]]:
    """Place of the response and of the force of each FRF by its name, as with dataset 58."""
    responses = [point_of(name) or NOWHERE for name in names]
    forces = [point_of(each.reference) or NOWHERE for each in responses]
    said = {each.reference for each in responses}
    if len(said) > 1 and NOWHERE in forces:
        rule = "where FRFs are of several forces, each name must have the point of its force"
        found = f"forces {', '.join(sorted(said)[:3])}"
        raise RecordingFormatError(path.name, found, rule, "Write e.g. 13Z/1Z, or a file for each")
    return responses, forces


def _fault(path: Path, column: str, found: str, rule: str, remedy: str) -> RecordingFormatError:
    return RecordingFormatError(f"{path.name}, column {column!r}", found, rule, remedy)


def _lines(path: Path, column: Column, findings: list[Finding]) -> NDArray[np.float64]:
    """Frequency lines in Hz, which must be equidistant."""
    axis = parse_axis(unit_of_lines(column))
    stored = np.asarray(column.samples, dtype=np.float64) * (axis.factor if axis else 1.0)
    even = _even_lines(stored)
    if even is None or stored[0] < 0.0:
        rule = "frequencies must be positive and at equal steps"
        raise _fault(path, column.name, uneven(stored, "Hz"), rule, EXPORT_AGAIN)
    lines, tolerance, is_sure = even
    if tolerance > NARROW:
        step = lines[1] - lines[0]
        detail = f"printed frequencies leave {100 * tolerance:.2g} % open: steps of {step:.7g} Hz"
        verdict = Verdict.OK if is_sure else Verdict.WARNING
        findings.append(Finding(path.name, "", None, Check.SAMPLING_RATE, verdict, detail))
    return lines


def _even_lines(stored: NDArray[np.float64]) -> tuple[NDArray[np.float64], float, bool] | None:
    """Lines of an even grid from rounded ones; None where they are not equidistant.

    Beside them by how much (relative) their step may be wrong, and whether it is the likeliest.
    """
    steps = even_step(stored)
    if steps is None:
        return None
    numbers = np.rint(stored[0] / steps.step) + np.arange(len(stored))
    half = last_place(stored) / 2
    if steps.tolerance > NARROW and numbers[0] >= 0 and math.isfinite(half):
        behind = numbers > 0  # each line leaves a range of steps for a grid through zero
        low = float(np.max((stored[behind] - half) / numbers[behind]))
        high = float(np.min((stored[behind] + half) / numbers[behind]))
        if low <= high:
            usual = usual_spacings(low, high)
            step = usual[0] if len(usual) == 1 else (low + high) / 2
            return step * numbers, (high - low) / (2 * step), len(usual) == 1
    offset = float(np.mean(stored - steps.step * numbers))  # the first is rounded like the others
    offset = 0.0 if abs(offset) <= _SAME_LINE * steps.step else offset
    return offset + steps.step * numbers, steps.tolerance, steps.tolerance <= NARROW


def _grouped(path: Path, columns: Sequence[Column]) -> list[_Parts]:
    """Columns of each FRF, by what their names have in common; a coherence follows its FRF."""
    named = [(column, *_part_and_name(path, column)) for column in columns]
    names = {name for _, part, name in named if part is not _Part.COHERENCE}
    groups: dict[str, _Parts] = {}
    for column, part, name in named:
        own = name if name in names else _of_coherence(path, column, name, groups)
        found = groups.setdefault(own, _Parts(own))
        if part in found.columns:
            rule = f"{found.columns[part].name!r} is the same part of the same FRF"
            raise _fault(path, column.name, "a part twice", rule, "Give each FRF a name of its own")
        found.columns[part] = column
    if not groups:
        rule = "FRFs must follow the frequencies"
        raise RecordingFormatError(path.name, "no columns beside them", rule, EXPORT_AGAIN)
    for each in groups.values():
        each.name = each.name or "FRF"
    return list(groups.values())


def _part_and_name(path: Path, column: Column) -> tuple[_Part, str]:
    """Part that a column is, and the rest of its name."""
    found = [(part, form.search(column.name)) for part, form in _PARTS.items()]
    matches = [(part, match) for part, match in found if match]
    if len(matches) != 1 or not matches[0][1]:
        rule = "beside frequencies, each column must be a part of an FRF"
        remedy = "Call it by its FRF and real, imag, magnitude, phase or coherence: 'H1 real'"
        raise _fault(path, column.name, "no such part", rule, remedy)
    part, match = matches[0]
    if _SIGN_AHEAD.search(column.name[: match.start()]):
        rule = "the part may have the other sign, or a dash is between two names"
        remedy = f"Call it 'H1 {match[0]}' and give it the values of that part"
        raise _fault(path, column.name, "a sign in front of a part", rule, remedy)
    before = column.name[: match.start()].rstrip(_SEPARATORS)
    return part, f"{before} {column.name[match.end() :].strip(_SEPARATORS)}".strip()


def _of_coherence(path: Path, column: Column, name: str, groups: dict[str, _Parts]) -> str:
    """FRF of a coherence of another name: the one it ends like, else the one it stands behind."""
    alike = [each for each in groups if name and re.search(rf"(?<!\w){re.escape(name)}$", each)]
    if len(alike) == 1:
        return alike[0]
    *before, last = list(groups.values()) or [_Parts("")]
    if last.columns and all(_Part.COHERENCE in each.columns for each in before):
        return last.name
    rule = "a coherence must be called as its FRF or stand behind it"
    raise _fault(path, column.name, "no FRF of this name", rule, "Rename it, or leave it out")


def _inertance(
    path: Path, parts: _Parts, lines: NDArray[np.float64], findings: list[Finding]
) -> NDArray[np.complex128]:
    """One FRF in (m/s²)/N, or as the file has it where that states no unit."""
    pair, unit = parts.pair, parts.unit
    lacking = [each for each in pair if each not in parts.columns]
    if lacking:
        rule = "an FRF needs real and imaginary part, or magnitude and phase"
        found = f"no {lacking[0].name.lower()}"
        raise _fault(path, parts.name, found, rule, "Export both")
    first, second = (parts.columns[each] for each in pair)
    ordinate = np.asarray(first.samples, dtype=np.float64)
    if pair[0] is _Part.REAL and _DECIBEL.fullmatch(first.unit):
        rule = "real and imaginary part are never in decibels"
        raise _fault(path, first.name, f"unit {first.unit!r}", rule, "Correct the names or units")
    if pair[0] is _Part.MAGNITUDE:
        if _DECIBEL.fullmatch(first.unit):
            ordinate = 10 ** (ordinate / 20)
        values: NDArray[np.complex128] = ordinate * np.exp(1j * _radians(path, second))
    else:
        values = ordinate + 1j * np.asarray(second.samples, dtype=np.float64)
        if is_stated(second.unit) and second.unit != first.unit:
            rule = f"the unit of {first.name!r} is {unit!r}"
            raise _fault(path, second.name, f"unit {second.unit!r}", rule, EXPORT_AGAIN)
    if not is_stated(unit):
        return values
    if (converted := inertances(values, unit, lines)) is None:
        rule = "the unit of an FRF must be one of motion over force"
        remedy = f"Write it behind the name: '{first.name} [(m/s^2)/N]', dB as [dB re 1 (m/s^2)/N]"
        raise _fault(path, first.name, f"unit {first.unit!r}", rule, remedy)
    values, detail = converted
    if detail:
        findings.append(Finding(path.name, parts.name, None, Check.QUANTITY, Verdict.OK, detail))
    return values


def inertances(
    values: NDArray[np.complex128], unit: str, lines: NDArray[np.float64]
) -> tuple[NDArray[np.complex128], str] | None:
    """FRFs of a unit as inertances in (m/s²)/N, and what was converted; None for another unit."""
    ratio = parse_ratio(unit)
    if ratio is None or ratio[0].quantity not in DERIVATIVES:
        return None
    motion, force = ratio
    power = DERIVATIVES[motion.quantity]
    scaled = values * (motion.factor / force.factor) * (2j * np.pi * lines) ** power
    return scaled, CONVERTED[power].format(motion.quantity)


def _radians(path: Path, column: Column) -> NDArray[np.float64]:
    phase = np.asarray(column.samples, dtype=np.float64)
    unit = column.unit.strip().lower()
    if unit in _RADIANS:
        return phase
    if unit in _DEGREES or (not unit and np.nanmax(np.abs(phase)) > _FEWEST_DEGREES):
        return np.deg2rad(phase)
    rule = "a phase must be in deg or rad"
    remedy = f"Write it behind the name: '{column.name} [deg]'"
    raise _fault(path, column.name, f"unit {column.unit!r}", rule, remedy)


def _coherence(path: Path, column: Column) -> NDArray[np.float64]:
    values = np.asarray(column.samples, dtype=np.float64)
    if not np.all((values >= 0) & (values <= 1.001)):
        found = f"{np.nanmin(values):g} to {np.nanmax(values):g}"
        raise _fault(path, column.name, found, "a coherence must be from 0 to 1", EXPORT_AGAIN)
    return np.minimum(values, 1.0)
