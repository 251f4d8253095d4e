"""Layout detection for text tables: dialect, header, units and first row of numbers."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from itertools import islice

from ema.core.errors import RecordingFormatError
from ema.core.units import is_stated
from ema.io.columns import is_time
from ema.io.content import EXPORT_AGAIN
from ema.io.rates import UNSTATED, Rate
from ema.io.text.preamble import Preamble, stated_rate
from ema.io.text.source import (
    BLANKS,
    COMPLEX,
    COMPLEX_REMEDY,
    COMPLEX_RULE,
    MISSING,
    NOT_A_NUMBER,
    THOUSANDS,
    Dialect,
    Line,
    TextSource,
    cells_of,
    heading_cells,
    holds_numbers_alone,
    is_clock,
    is_date,
    is_known_unit,
    is_number,
    label,
    lines_of,
)

_MOST_PREAMBLE = 200  # lines
_SAMPLE_ROWS = 20
_SAMPLE_CELLS = 40_000  # of tables with thousands of columns
_TIME_WITHIN = 50  # columns
_MOST_BELOW_NAMES = 6  # lines about channels between their names and the numbers
_SEPARATORS = ("\t", ";", ",", "|")
# By the separator of a dialect: others, unless they may be in a number.
_OTHER_SEPARATORS = {
    each: re.compile("[" + "\t;|".replace(each, "") + "]") for each in (*_SEPARATORS, BLANKS)
}


@dataclass(frozen=True)
class Layout:
    """Where the numbers of a file are, how they are written, and what they are called."""

    dialect: Dialect
    names: tuple[str, ...]  # of the columns; empty where a column has none
    units: tuple[str, ...]
    first_line: int  # of the numbers in the file, counted from 1
    start: int  # first character of the numbers in the beginning of the text
    clocks: frozenset[int] = frozenset()  # columns of times of day, perhaps with their date
    dates: frozenset[int] = frozenset()  # columns of dates alone
    filled: int = 0  # columns without the empty ones of separators at the ends of rows
    either_decimal: bool = False  # whether the first rows, integers, leave the decimal sign open
    rate: Rate = UNSTATED  # stated above the table
    starts_s: tuple[float, ...] = ()  # of the columns, where a row above the table states them
    statements: Mapping[str, str] = field(default_factory=dict)  # of all lines above the table

    @property
    def width(self) -> int:
        """Number of cells in each row."""
        return len(self.names)


@dataclass(frozen=True)
class _Row:
    """A line, and how many of its cells are numbers and texts."""

    line: Line
    separator: str
    width: int
    filled: int
    numbers: int
    texts: int

    @cached_property
    def is_heading(self) -> bool:
        """Whether one of the cells is the name of a time column."""
        cells = cells_of(self.line.text, self.separator)[:_TIME_WITHIN]
        return self.texts > 0 and any(is_time(*label(cell)) for cell in cells)

    @property
    def is_data(self) -> bool:
        return self.numbers > 0 and self.texts == 0

    @property
    def is_damaged_data(self) -> bool:
        return self.numbers >= self.texts > 0 and not self.is_heading


@dataclass(frozen=True)
class _Table:
    """A table in one dialect: its rows of numbers, and the lines of names and units."""

    dialect: Dialect
    rows: tuple[_Row, ...]
    names: Line | None
    units: Line | None

    @property
    def n_data(self) -> int:
        return sum(row.is_data and row.width == self.rows[0].width for row in self.rows)

    @property
    def rank(self) -> tuple[bool, bool, int, int]:
        """The better a dialect fits, the higher."""
        return self.names is not None, self.n_data > 0, self.rows[0].width, self.n_data


def find_layout(source: TextSource) -> Layout:
    """Find the table in a text file: lines of text, then names, perhaps units, then numbers.

    Separator and decimal sign are those with which the first rows contain only numbers, as many
    as there are names above them.
    """
    where = source.path.name
    if not source.head:
        rule = "a table must have a header row and at least one row of numbers"
        raise RecordingFormatError(where, "the file is empty", rule, EXPORT_AGAIN)
    if "\x00" in source.head:
        rule = "a table must be text in UTF-8, latin-1, or UTF-16 with a byte-order mark"
        raise RecordingFormatError(where, "binary data", rule, EXPORT_AGAIN)
    lines = list(islice(lines_of(source), _MOST_PREAMBLE + _SAMPLE_ROWS))
    tables = [_table(lines, dialect) for dialect in _dialects(lines, _SEPARATORS)]
    best = max((each for each in tables if each), key=lambda each: each.rank, default=None)
    if best is None or best.names is None or best.rows[0].width == 1:
        tables += [_table(lines, dialect) for dialect in _dialects(lines, (BLANKS,))]
        best = max((each for each in tables if each), key=lambda each: each.rank, default=None)
    if best is None:
        found = "only blank rows, or rows of over a megabyte"
        if lines:
            found = f"no rows of numbers below the header, down to line {lines[-1].number}"
        rule = f"numbers must follow a header row, after at most {_MOST_PREAMBLE} other rows"
        remedy = EXPORT_AGAIN
        if lines and COMPLEX.search(lines[-1].text):
            rule, remedy = COMPLEX_RULE, COMPLEX_REMEDY
        raise RecordingFormatError(where, found, rule, remedy)
    if best.names is None:
        raise _no_header(where, lines, best)
    return _layout(where, lines, best, tables)


def _dialects(lines: Sequence[Line], separators: Sequence[str]) -> Iterator[Dialect]:
    """Dialects to try; the tab also reads a table of one column, which has no separator."""
    for separator in separators:
        if separator in "\t " or any(separator in line.text for line in lines):
            yield Dialect(separator, ".")
            yield Dialect(separator, ",")


def _row(line: Line, dialect: Dialect) -> _Row:
    return _row_of_numbers(line, dialect) or _row_of_cells(line, dialect)


def _row_of_numbers(line: Line, dialect: Dialect) -> _Row | None:
    """A row of plain numbers at one glance; None for one whose cells must be looked at.

    With a decimal sign that is not of the dialect a number is a text.
    """
    for decimal, form in _row_forms(dialect.separator).items():
        if form.fullmatch(line.text):
            width = line.text.count(dialect.separator) + 1
            texts = 0 if decimal == dialect.decimal else line.text.count(decimal)
            return _Row(line, dialect.separator, width, width, width - texts, texts)
    return None


@lru_cache
def _row_forms(separator: str) -> dict[str, re.Pattern[str]]:
    """Rows of plain numbers by their decimal sign; none where runs of blanks separate."""
    forms = {}
    for decimal in ".,".replace(separator, "") if separator != BLANKS else "":
        cell = rf"[+-]?[0-9]+(?:[{decimal}][0-9]*)?(?:[eE][+-]?[0-9]+)?"
        forms[decimal] = re.compile(rf"{cell}(?:{re.escape(separator)}{cell})*")
    return forms


def _row_of_cells(line: Line, dialect: Dialect) -> _Row:
    cells = cells_of(line.text, dialect.separator)
    foreign = _OTHER_SEPARATORS[dialect.separator]
    has_foreign = foreign.search(line.text) is not None
    filled, numbers, texts, is_only = 0, 0, 0, len(cells) == 1
    for index, cell in enumerate(cells, 1):
        filled = index if cell else filled
        if has_foreign and foreign.search(cell):  # neither in numbers nor in times
            texts += 1
        elif is_number(cell, dialect.decimal, is_only=is_only) or cell.lower() in NOT_A_NUMBER:
            numbers += 1
        elif cell.lower() not in MISSING and not (is_clock(cell) or is_date(cell)):
            texts += 1
    return _Row(line, dialect.separator, len(cells), filled, numbers, texts)


def _table(lines: Sequence[Line], dialect: Dialect) -> _Table | None:
    """The longest run of numbers near the beginning, if possible one with names above."""
    rows: list[_Row] = []
    n_data = 0  # rows in succession
    for line in lines:
        row = _row(line, dialect)
        rows.append(row)
        n_data = n_data + 1 if row.is_data else 0
        if n_data >= max(2, min(_SAMPLE_ROWS, 2 + _SAMPLE_CELLS // row.width, len(rows))):
            break
    tables = [_table_at(rows, first, dialect) for first in _starts(rows, dialect)]
    return max(tables, key=lambda each: (each.names is not None, each.n_data), default=None)


def _starts(rows: Sequence[_Row], dialect: Dialect) -> list[int]:
    """Where rows of numbers begin; rows with a text in them count where there are no others."""

    def is_numeric(row: _Row) -> bool:
        if row.is_damaged_data:
            return stated_rate(row.line.text, dialect.decimal) is None
        return row.is_data

    widths = [row.width if is_numeric(row) else 0 for row in rows]
    starts = [index for index, width in enumerate(widths) if width not in (0, [0, *widths][index])]
    clean = [index for index in starts if any(row.is_data for row in _run(rows, index))]
    return [index for index in clean or starts if index <= _MOST_PREAMBLE]


def _run(rows: Sequence[_Row], first: int) -> tuple[_Row, ...]:
    """Rows of numbers of the same width from `first` on."""
    run = []
    for row in rows[first : first + _SAMPLE_ROWS]:
        if not row.numbers or row.width != rows[first].width:
            break
        run.append(row)
    return tuple(run)


def _table_at(rows: Sequence[_Row], first: int, dialect: Dialect) -> _Table:
    """The table whose numbers begin at a row, with the rows above it that name the columns.

    There may be units between names and numbers, and a row of other text below the units; or else
    units above the names.
    """
    run = _run(rows, first)
    width, filled = run[0].width, max(row.filled for row in run)

    def fits(index: int) -> bool:
        if index < 0 or (rows[index].numbers and not rows[index].is_heading):
            return False
        cells = heading_cells(rows[index].line.text, dialect.separator, width)
        named = max((i for i, cell in enumerate(cells, 1) if cell), default=0)
        return len(cells) == width or filled <= named <= width

    above = first - 1
    if not fits(above) or holds_numbers_alone(rows[above].line.text):
        return _Table(dialect, run, None, None)
    for units in (above, above - 1):
        holds = fits(units - 1) and fits(units)
        holds = holds and _share_of_units(rows[units], dialect, width) > 0.5
        if holds and not _share_of_units(rows[units - 1], dialect, width) > 0.5:
            return _Table(dialect, run, rows[units - 1].line, rows[units].line)
        if rows[above].is_heading:
            break
    named = _names_with_units(rows, above, fits, dialect, width)
    if named is not None:
        return _Table(dialect, run, named, None)
    # Units are not names: those are in a line further up that has lost a cell.
    has_names = not (
        above and rows[above - 1].width > 1 and _share_of_units(rows[above], dialect, width) > 0.5
    )
    if not has_names:
        return _Table(dialect, run, None, None)
    on_top = fits(above - 1) and _share_of_units(rows[above - 1], dialect, width) == 1.0
    return _Table(dialect, run, rows[above].line, rows[above - 1].line if on_top else None)


def _names_with_units(
    rows: Sequence[_Row], above: int, fits: Callable[[int], bool], dialect: Dialect, width: int
) -> Line | None:
    """A line of names with their units, above others of as many cells: hardware, sensors, steps."""

    def holds_units(index: int) -> bool:
        cells = heading_cells(rows[index].line.text, dialect.separator, width)
        return sum(bool(label(cell)[1]) for cell in cells) > width / 2

    if rows[above].is_heading or holds_units(above):
        return None
    for index in range(above - 1, max(above - _MOST_BELOW_NAMES, 0) - 1, -1):
        if not fits(index):
            break
        if holds_units(index):
            return rows[index].line
    return None


def _share_of_units(row: _Row, dialect: Dialect, width: int) -> float:
    """Share of a row's cells that are units; 0 for a row that names columns for sure."""
    cells = heading_cells(row.line.text, dialect.separator, width)
    known = [is_known_unit(cell) for cell in cells if is_stated(cell)]
    return sum(known) / len(known) if known and not row.is_heading else 0.0


def _no_header(where: str, lines: Sequence[Line], table: _Table) -> RecordingFormatError:
    row = table.rows[0]
    above = next((line for line in reversed(lines) if line.number < row.line.number), None)
    place = f"{where}, line {row.line.number}"
    rule = "the row above the numbers must name each column, with its unit in square brackets"
    if above is None or not any(character.isalpha() for character in above.text):
        found = f"no header: {row.line.text[:20]!r} …"
        return RecordingFormatError(place, found, rule, "Add a header line")
    count = len(heading_cells(above.text, table.dialect.separator, row.width))
    found = f"{row.width} cells below {count} in line {above.number}; header and rows differ"
    if count == row.width:
        found = f"units in line {above.number}, no header of {row.width} names above them"
    return RecordingFormatError(place, found, rule, "Correct the header, or the row below it")


def _layout(
    where: str, lines: Sequence[Line], table: _Table, tables: Sequence[_Table | None]
) -> Layout:
    first, dialect = table.rows[0].line, table.dialect
    _check_commas(where, table)
    labels = [label(cell) for cell in _heading(table, table.names)]
    cells = cells_of(first.text, dialect.separator)
    other = replace(dialect, decimal="," if dialect.decimal == "." else ".")
    above = Preamble(where, lines[: lines.index(table.names)], dialect, labels)
    stated = zip(labels, _heading(table, table.units), above.units, strict=True)
    return Layout(
        dialect=dialect,
        names=tuple(name for name, _ in labels),
        units=tuple(
            unit or (below.strip() or on_top).removeprefix("[").removesuffix("]").strip()
            for (_, unit), below, on_top in stated
        ),
        first_line=first.number,
        start=first.start,
        clocks=frozenset(index for index, cell in enumerate(cells) if is_clock(cell)),
        dates=frozenset(index for index, cell in enumerate(cells) if is_date(cell)),
        filled=max(each.filled for each in table.rows),
        either_decimal=any(t and t.dialect == other and t.rank == table.rank for t in tables),
        rate=above.rate,
        starts_s=above.starts_s,
        statements=above.statements,
    )


def _check_commas(where: str, table: _Table) -> None:
    """Refuse quoted commas between commas where all may separate thousands, as in ``"1,234"``."""
    if table.dialect != Dialect(",", ","):
        return
    cells = [cell for row in table.rows for cell in cells_of(row.line.text, ",") if "," in cell]
    if cells and all(map(THOUSANDS.fullmatch, cells)):
        place = f"{where}, line {table.rows[0].line.number}"
        rule = "the comma may be a decimal comma or separate thousands"
        raise RecordingFormatError(place, repr(cells[0]), rule, "Export plain numbers")


def _heading(table: _Table, line: Line | None) -> list[str]:
    """Cells of a line of names or units, as many as the table has columns; empty without a line."""
    width = table.rows[0].width
    cells = heading_cells(line.text, table.dialect.separator, width) if line else []
    return [*cells, *[""] * width][:width]
