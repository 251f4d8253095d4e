"""Lines above a table: sampling rates, starts, units and other statements."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from ema.core.errors import RecordingFormatError
from ema.core.units import FREQUENCY, TIME, parse_axis
from ema.io.columns import is_time
from ema.io.content import EXPORT_AGAIN, entries, not_together
from ema.io.rates import UNSTATED, Rate, is_possible, rate_of_step, rate_of_text
from ema.io.text.source import THOUSANDS, Dialect, Line, heading_cells, label, starts_of

_RATE = (
    r"(?:sampl\w*|data|scan)[\s_-]*(?:rate|freq\w*)|abtast(?:rate|frequenz)|fs|f_s|"
    r"samples[\s_-]*(?:per|/)[\s_-]*s(?:ec\w*)?"
)
_STEP = (
    r"dt|delta[\s_-]*[tx]|abtast(?:intervall|zeit|schritt)|"
    r"(?:sampl\w*|scan|time)[\s_-]*(?:interval|period|step|increment|spacing)"
)
_STATEMENT = re.compile(
    rf"[\s#%!/;'\"*]*(?:(?P<rate>{_RATE})|(?P<step>{_STEP}))\s*(?:[\[(](?P<unit>[^\])]*)[\])])?"
    r"[\s\"]*[:=;,|\s][\s:=\"]*(?P<value>[0-9](?:[0-9.,]*[0-9])?\.?(?:e[+-]?[0-9]+)?)"
    r"(?:[\s;,|\"]*[\[(]?(?P<behind>[a-zµμ]+(?:/s)?|\b1/s)[\])]?)?[\s;,|\"]*",
    re.IGNORECASE,
)
_PARTS = re.compile(r"[,;]|:\s")  # of a comment such as ``Config: data_rate = 512 Hz, …``
_SAMPLES_PER_SECOND = {"s/s": 1.0, "ks/s": 1e3, "ms/s": 1e6}
# Rows above a table with a value for each column, as LabVIEW writes them.
_ROW_OF_STARTS = re.compile(
    r"[xt]_?0|wf_start_offset|(?:(?:channel|kanal)[\s_-]*)?start(?:[\s_-]*(?:time|value|offset))?|"
    r"(?:time|zeit)[\s_-]*offset|startzeit|abscissa[\s_-]*min\w*|t[\s_-]*start|begin\w*|"
    r"first[\s_-]*sample",
    re.IGNORECASE,
)
_ROW_OF_DELAYS = re.compile(r"(?:[a-z]+[\s_-]*)?(?:delay|latency|lag|verzug)", re.IGNORECASE)
_ROW_OF_CLOCKS = re.compile("time|uhrzeit", re.IGNORECASE)
_ROW_OF_STEPS = re.compile(_STEP, re.IGNORECASE)
_ROW_OF_UNITS = re.compile(
    r"(?:(?:y|vertical)(?:[\s_-]*axis)?[\s_-]*)?(?:unit|einheit)(?:s|en)?(?:[\s_-]*labels?)?",
    re.IGNORECASE,
)
_UNIT_OF_X = re.compile(
    r"(?:x|horizontal|abscissa)[\s_-]*(?:axis[\s_-]*)?(?:units?|label|einheit)", re.IGNORECASE
)
_LONGEST = 200


@dataclass(frozen=True)
class Preamble:
    """The lines above the names of a table."""

    where: str  # the file, as messages name it
    lines: Sequence[Line]
    dialect: Dialect  # of the table
    labels: Sequence[tuple[str, str]]  # name and unit of each column

    @property
    def statements(self) -> dict[str, str]:
        """Name and value of lines such as ``Window: Hanning`` or ``Window;Hanning``."""
        found: dict[str, str] = {}
        for line in self.lines:
            key, *values = heading_cells(line.text, self.dialect.separator, 0)
            values = [each for each in values if each]
            is_pair = values and "=" not in key and ":" not in key.rstrip(": ")
            found |= {key.rstrip(": "): " ".join(values)} if is_pair else entries([key])
        return found

    @property
    def units(self) -> list[str]:
        """Units of the columns by a row such as ``Unit,s,N``; empty where there is none."""
        return self._row(_ROW_OF_UNITS)[1]

    @property
    def starts_s(self) -> tuple[float, ...]:
        """Starts of the columns by a row such as ``X0,0,0.03125``; empty where they are equal."""
        line, delays = self._row(_ROW_OF_DELAYS)
        if line is not None and len({each for each in delays if each}) > 1:
            rule = "channels differ in it, and a delay may count either way"
            remedy = "Write a row X0 of the times of the first samples, or export them aligned"
            raise RecordingFormatError(self._place(line), "a row of delays", rule, remedy)
        line, values = self._row(_ROW_OF_STARTS)
        if line is None:
            line, values = self._row(_ROW_OF_CLOCKS)
            values = values if any(":" in each for each in values) else []
        first = next((each for each in values if each), "")
        values = [each or first for each in values]
        if line is None or len(set(values)) < 2:
            return ()
        axis = parse_axis(self._unit_of(line))
        seconds = axis.factor if axis is not None and axis.kind == TIME else 1.0
        try:
            return tuple(seconds * each for each in starts_of(values, self.dialect.decimal))
        except ValueError as error:
            rule = "starts of channels must be numbers of seconds or times of day"
            raise RecordingFormatError(self._place(line), str(error), rule, EXPORT_AGAIN) from error

    @property
    def rate(self) -> Rate:
        """The sampling rate that the lines state."""
        rate, first = UNSTATED, 0
        of_columns, steps = self._row(_ROW_OF_STEPS)
        steps = sorted({each for each in steps if each})
        if of_columns is not None and len(steps) > 1:
            found = f"steps {', '.join(steps)} in line {of_columns.number}"
            raise not_together(Path(self.where), found)
        if of_columns is not None and steps:
            text = f"dt [{self._unit_of(of_columns) or 's'}] = {steps[0]}"
            rate = stated_rate(text, self.dialect.decimal) or UNSTATED
            first = of_columns.number if rate is not UNSTATED else 0
        for line in self.lines:
            parts = (line.text, *(each for each in _PARTS.split(line.text) if "=" in each))
            found_in = (stated_rate(part, self.dialect.decimal) for part in parts)
            stated = next((each for each in found_in if each is not None), None)
            if stated is None:
                continue
            if first and not (stated.allows(rate.hz) or rate.allows(stated.hz)):
                found = f"{stated.hz:g} Hz, and {rate.hz:g} Hz in line {first}"
                rule = "a recording has one sampling rate"
                raise RecordingFormatError(self._place(line), found, rule, EXPORT_AGAIN)
            if not first or not stated.is_open:
                rate, first = stated, line.number
        return rate

    def _unit_of(self, line: Line) -> str:
        """Unit of a row, behind its key; empty without one."""
        return label(heading_cells(line.text, self.dialect.separator, 0)[0].rstrip(": "))[1]

    def _place(self, line: Line) -> str:
        return f"{self.where}, line {line.number}"

    def _row(self, form: re.Pattern[str]) -> tuple[Line | None, list[str]]:
        """The last row with a value for each column, and these values.

        Its key stands above the time where the table has one. One value holds for all columns.
        """
        labels = self.labels
        width, missing = len(labels), [""] * len(labels)
        for line in reversed(self.lines):
            key, *values = heading_cells(line.text, self.dialect.separator, width)
            while values and not values[-1]:
                values.pop()
            if not values or not form.fullmatch(label(key.rstrip(": "))[0]):
                continue
            if len(values) == 1:
                return line, values * width
            is_key_above_time = len(values) < width and (not labels[0][0] or is_time(*labels[0]))
            cells = ["", *values] if is_key_above_time else values
            if len(cells) <= width:
                return line, [*cells, *missing][:width]
            if form in (_ROW_OF_STARTS, _ROW_OF_STEPS):
                found = f"{len(values)} values of {key!r} above {width} columns"
                rule = "a row of starts or steps must have a value for each channel"
                raise RecordingFormatError(self._place(line), found, rule, EXPORT_AGAIN)
        return None, missing


def stated_rate(line: str, decimal: str) -> Rate | None:
    """Sampling rate that a line such as ``Sampling rate [Hz]; 2000`` or ``dt = 0.0005`` states.

    `decimal` is the decimal sign of the table. The other one is understood too, unless it may as
    well separate thousands. None where the line states no rate, or not clearly.
    """
    match = _STATEMENT.fullmatch(line) if len(line) <= _LONGEST else None
    if match is None:
        return None
    value = match["value"].replace(",", ".")
    other = "," if decimal == "." else "."
    if value.count(".") > 1 or (other in match["value"] and THOUSANDS.fullmatch(match["value"])):
        return None
    unit = (match["unit"] or match["behind"] or "").strip()
    if unit.lower() in _SAMPLES_PER_SECOND:
        factor: float | None = _SAMPLES_PER_SECOND[unit.lower()]
    elif not unit:
        factor = 1.0
    else:
        axis = parse_axis(unit)
        kind = FREQUENCY if match["rate"] else TIME
        factor = axis.factor if axis is not None and axis.kind == kind else None
    try:
        if factor is None or not is_possible(float(value) * factor):
            return None
        if match["step"]:
            return rate_of_step(value, match["step"].strip(), factor)
        return rate_of_text(value, match["rate"].strip(), factor)
    except ValueError:
        return None


def refuse_frequencies(path: Path, statements: Mapping[str, str]) -> None:
    """Refuse a table that lines above it put over frequencies, while its columns do not."""
    for key, value in statements.items():
        axis = parse_axis(value)
        if axis is not None and axis.kind == FREQUENCY and _UNIT_OF_X.fullmatch(key):
            rule = "FRFs must stand behind a column of frequencies"
            remedy = "Call columns Frequency [Hz], 'H1 real', 'H1 imag', or export a universal file"
            raise RecordingFormatError(path.name, f"{key!r} is {value}", rule, remedy)
