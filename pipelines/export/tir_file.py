"""Tyre property files (.tir, TeimOrbit): read, changed in single values, written to the byte."""

from __future__ import annotations

import math
import re
import shutil
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import count
from pathlib import Path

from ema.core.errors import InputError
from ema.core.files import require_regular
from pipelines.storage.atomic import file_written_whole

# Such files come in UTF-8, in code pages of Windows and in both: what is no UTF-8 is carried along.
_ENCODING, _UNDECODED = "utf-8", "surrogateescape"
_LINE = re.compile(r"[^\r\n]*(?:\r\n|\r|\n)|[^\r\n]+")
_SECTION = re.compile(r"\ufeff?\s*\[(?P<name>[^\]\r\n]*)\]")
_ENTRY = re.compile(
    r"(?P<key>\ufeff?[ \t]*[A-Za-z][\w.]*)(?P<equals>[ \t]*=[ \t]*)"
    r"(?P<value>'[^'\r\n]*'|\"[^\"\r\n]*\"|(?:[^$! \t\r\n]+(?:[ \t]+[^$! \t\r\n]+)*)?)"
    r"(?P<gap>[ \t]*)(?P<comment>(?:[$!][^\r\n]*)?)(?P<end>[\r\n]*)\Z"
)
UNITS = "UNITS"
_UTF_16 = (b"\xff\xfe", b"\xfe\xff")


@dataclass(frozen=True)
class TirEntry:
    """A line ``KEY = value $comment``.

    Parameters
    ----------
    section : str
        The section it stands in, upper case; empty above the first.
    key : str
        Upper case: such files do not distinguish.
    text : str
        The value without quotes.
    line : int
        Number of its line, from 1.
    """

    section: str
    key: str
    text: str
    line: int

    def stands_in(self, section: str | None) -> bool:
        """Whether it stands in a section; None stands for all but [UNITS]."""
        return self.section != UNITS if section is None else self.section == section.upper()


@dataclass(frozen=True)
class TirFile:
    """A tyre property file as it stands: all lines, whatever is in them.

    Parameters
    ----------
    name : str
        What messages call it.
    lines : tuple of str
        With their ends.
    """

    name: str
    lines: tuple[str, ...]

    @property
    def content(self) -> bytes:
        """The file, byte for byte."""
        return "".join(self.lines).encode(_ENCODING, _UNDECODED)

    def sections(self) -> tuple[str, ...]:
        """Names of the sections in their order, upper case; one that stands twice, twice."""
        found = map(_SECTION.match, self.lines)
        return tuple(match["name"].strip().upper() for match in found if match)

    def entries(self) -> Iterator[TirEntry]:
        """All lines that give a value to a key; comments and rows of tables are passed over."""
        return iter(self._entries)

    @cached_property
    def _entries(self) -> tuple[TirEntry, ...]:
        return tuple(self._read_entries())

    def _read_entries(self) -> Iterator[TirEntry]:
        section = ""
        for number, line in enumerate(self.lines, 1):
            if heading := _SECTION.match(line):
                section = heading["name"].strip().upper()
            elif entry := _ENTRY.match(line):
                key = entry["key"].lstrip("\ufeff \t").upper()
                yield TirEntry(section, key, _unquoted(entry["value"]), number)

    def find(self, key: str, section: str | None = None) -> TirEntry | None:
        """The entry of a key, in whatever case; None where there is none.

        Parameters
        ----------
        key : str
        section : str, optional
            Default: any but [UNITS], where MASS is the name of a unit.

        Raises
        ------
        InputError
            If it stands there more than once: programs differ in which one counts.
        """
        found = [
            entry
            for entry in self.entries()
            if entry.key == key.upper() and entry.stands_in(section)
        ]
        if len(found) > 1:
            lines = " and ".join(str(entry.line) for entry in found)
            raise InputError(
                f"{self.name}, {key.upper()}",
                f"given in lines {lines}",
                "programs differ in which of them counts",
                "Keep one of them",
            )
        return found[0] if found else None

    def number(self, key: str, section: str | None = None) -> float | None:
        """A value as it stands, in the file's unit; None where the key is not there or empty.

        Raises
        ------
        InputError
            If it is no finite number, or the key stands there more than once.
        """
        entry = self.find(key, section)
        return None if entry is None or not entry.text else self._number(entry)

    def with_value(self, entry: TirEntry, text: str) -> TirFile:
        """The file with another value in one line; quotes, comment and its column stay."""
        match = _ENTRY.match(self.lines[entry.line - 1])
        if match is None:
            raise ValueError(f"line {entry.line} of {self.name} holds no value")
        old = match["value"]
        quote = _quote(old)
        new = f"{quote}{text}{quote}"
        gap = _gap_for(match["gap"], len(old) - len(new)) if match["comment"] else match["gap"]
        line = f"{match['key']}{match['equals']}{new}{gap}{match['comment']}{match['end']}"
        return self._with_line(entry.line, line)

    def with_entry(self, section: str, key: str, text: str) -> TirFile:
        """The file with a new line at the end of a section, aligned with the line above it.

        A section that is not there is added at the end of the file.
        """
        last = self._last_line(section)
        end = self._line_end()
        if last is None:
            new = f"{'' if self._ends_with_line_end() else end}[{section}]{end}"
            return replace(self, lines=(*self.lines, new)).split().with_entry(section, key, text)
        above = _ENTRY.match(self.lines[last - 1])
        column, after = len(key) + 1, "= "
        if above:
            before, _, blanks = above["equals"].partition("=")
            column, after = len(above["key"].lstrip("\ufeff") + before), f"={blanks}"
        above_end = "" if self.lines[last - 1].endswith(("\r", "\n")) else end
        line = f"{above_end}{key:<{column}}{after}{text}{end}"
        lines = (*self.lines[:last], line, *self.lines[last:])
        return replace(self, lines=lines).split()

    def split(self) -> TirFile:
        """The same content, one line each."""
        return replace(self, lines=tuple(_LINE.findall("".join(self.lines))))

    def _number(self, entry: TirEntry) -> float:
        text = entry.text.strip().lower().replace("d", "e")  # Fortran writes 1.0D+05
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value) or "_" in text:
            raise InputError(
                f"{self.name}, line {entry.line}, {entry.key}",
                repr(entry.text),
                "it must be a number",
                "Correct the value",
            )
        return value

    def _with_line(self, number: int, line: str) -> TirFile:
        return replace(self, lines=(*self.lines[: number - 1], line, *self.lines[number:]))

    def _last_line(self, section: str) -> int | None:
        """Number of the last entry of a section, or of its heading; None where it is not there."""
        current, last = "", None
        for number, line in enumerate(self.lines, 1):
            heading = _SECTION.match(line)
            if heading:
                current = heading["name"].strip().upper()
            if current == section and (heading or _ENTRY.match(line)):
                last = number
        return last

    def _line_end(self) -> str:
        """The line end that the file uses most."""
        ends = [line[len(line.rstrip("\r\n")) :] for line in self.lines]
        found = [end for end in ends if end]
        return max(set(found), key=found.count) if found else "\r\n"

    def _ends_with_line_end(self) -> bool:
        return not self.lines or self.lines[-1].endswith(("\r", "\n"))


def tir_of(content: bytes, name: str) -> TirFile:
    """A tyre property file from its bytes; nothing is refused, everything is kept."""
    return TirFile(name, tuple(_LINE.findall(content.decode(_ENCODING, _UNDECODED))))


def read_tir(path: Path) -> TirFile:
    """Read a tyre property file.

    Raises
    ------
    InputError
        If it cannot be read, or is no such file.
    """
    try:
        content = require_regular(path).read_bytes()
    except OSError as error:
        raise InputError(
            str(path),
            error.strerror or "unreadable",
            "it must be a tyre property file",
            "Check the path",
        ) from error
    if content.startswith(_UTF_16) or b"\0" in content:
        rule = "tyre property files are plain text in UTF-8 or ANSI"
        found = "UTF-16, or no text at all"
        raise InputError(str(path), found, rule, "Save it as UTF-8, or choose a .tir file")
    tir = tir_of(content, path.name)
    if not tir.sections():
        rule = "a tyre property file has sections, e.g. [UNITS]"
        raise InputError(str(path), "no section", rule, "Choose a .tir file")
    return tir


def _quote(value: str) -> str:
    """The sign in which a value is quoted; empty where it is not."""
    is_quoted = len(value) > 1 and value[0] == value[-1] and value[0] in "'\""
    return value[0] if is_quoted else ""


def _unquoted(value: str) -> str:
    return value[1:-1] if _quote(value) else value


def _gap_for(gap: str, wider: int) -> str:
    """Blanks before a comment that keep its column; at least one, and tabs as they are."""
    if not gap or "\t" in gap:
        return gap or " "
    return " " * max(1, len(gap) + wider)


def save_tir(tir: TirFile, path: Path) -> Path | None:
    """Write a tyre property file; one that stands there is copied first.

    Parameters
    ----------
    tir : TirFile
    path : Path

    Returns
    -------
    Path or None
        The copy; None where no file stood there.

    Raises
    ------
    InputError
        If it cannot be written; what stood there stands.
    """
    with file_written_whole(path) as partial:
        partial.write_bytes(tir.content)
        backup = _backed_up(path) if path.exists() else None
        if backup is not None:
            shutil.copymode(path, partial)
    return backup


def _backed_up(path: Path) -> Path:
    """Copy a file to FILE.bak, or to FILE.bak2 and so on, whichever is free."""
    content = path.read_bytes()
    for number in count(1):
        backup = path.with_name(f"{path.name}.bak{number if number > 1 else ''}")
        try:
            copy = backup.open("xb")
        except FileExistsError:
            continue
        try:
            with copy:
                copy.write(content)
            shutil.copystat(path, backup)
        except BaseException:
            backup.unlink()
            raise
        return backup
    raise AssertionError("counting never ends")
