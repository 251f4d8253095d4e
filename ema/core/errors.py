"""Exceptions and warnings, and making hidden characters visible."""

from __future__ import annotations

import difflib
import errno
import re
from collections.abc import Iterable
from typing import Any

# C0 and C1 controls, line and paragraph separators, lone surrogates (bytes of file names that are
# no text), and marks that are not seen but turn the reading direction. Tabs and line ends stay.
_HIDDEN = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff\ufeff]"
)
# What spreadsheets take for the start of a formula, behind quotes and blanks too.
# https://owasp.org/www-community/attacks/CSV_Injection
_FORMULA = re.compile(r"[\s\"']*[=+\-@\t＝＋－＠]")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_OF_DRIVES = (errno.ENOSPC, errno.EDQUOT, errno.EIO, errno.EROFS, errno.EFBIG)


class InputError(ValueError):
    """Input that cannot be used; its message says where, what, why and what to do.

    Parameters
    ----------
    where : str
        File and place in it, e.g. ``"config_3.uff, dataset 4"``.
    found : str
        The value found, e.g. ``"49857 of 79292 values"``.
    rule : str
        The rule it breaks, e.g. ``"the file is truncated"``.
    remedy : str
        What the user can do, as a sentence without its full stop, or as a question.

    Examples
    --------
    >>> import ringmodal as rm
    >>> try:
    ...     rm.read_campaign("sample_data/tyre_225_55R71")
    ... except rm.InputError as error:
    ...     print(error.where)
    sample_data/tyre_225_55R71
    """

    def __init__(self, where: str, found: str, rule: str, remedy: str) -> None:
        end = "" if remedy.endswith("?") else "."
        super().__init__(f"{where}: {found}; {rule}. {remedy}{end}")
        self.where = where
        self.found = found
        self.rule = rule
        self.remedy = remedy

    def __reduce__(self) -> tuple[type, tuple[str, str, str, str]]:
        """Keep the four parts when the error travels between processes."""
        return type(self), (self.where, self.found, self.rule, self.remedy)


def require_type(name: str, value: Any, kind: type | tuple[type, ...], remedy: str) -> Any:
    """The value of an argument, if it is of a type; a truth value is no number."""
    if not isinstance(value, kind) or isinstance(value, bool):
        kinds = kind if isinstance(kind, tuple) else (kind,)
        rule = f"it must be of type {' or '.join(each.__name__ for each in kinds[:2])}"
        raise InputError(name, f"{type(value).__name__} {value!r:.60}", rule, remedy)
    return value


class RecordingFormatError(InputError):
    """A recording is missing, damaged, truncated or of an unknown format."""


class ManifestError(InputError):
    """A campaign's manifest is missing, unreadable or contradicts the recordings."""


class FitError(RuntimeError):
    """An identification step cannot be carried out on these data.

    Examples
    --------
    >>> import ringmodal as rm
    >>> frf = rm.estimate_frf(rm.read_campaign("sample_data/tyre_225_55R17"))
    >>> try:
    ...     rm.build_stability(frf, band_hz=(20.0, 21.0))
    ... except rm.FitError as error:
    ...     print("no modes:", type(error).__name__)
    no modes: FitError
    """


class SupersededError(RuntimeError):
    """A fit was stopped, as nobody waits for it any more."""


def visible(text: str) -> str:
    """A text in which characters that are not seen but act are named: ESC is ``[U+001B]``."""
    return _HIDDEN.sub(lambda found: f"[U+{ord(found[0]):04X}]", text)


def visible_line(text: str) -> str:
    """The same in one line, without anything else that cannot be printed."""
    return "".join(
        sign if sign.isprintable() else " " if sign.isspace() else f"[U+{ord(sign):04X}]"
        for sign in text
    )


def escaped(json_text: str) -> str:
    """JSON in which such characters are escaped: what is read is the same, what is seen is not."""
    return _HIDDEN.sub(lambda found: f"\\u{ord(found[0]):04x}", json_text)


def inert(value: Any) -> Any:
    """A cell of a table that a spreadsheet takes for a text; what is no text stays as it is.

    A text that starts like a formula gets an apostrophe in front, which `original` takes away.
    """
    if not isinstance(value, str):
        return value
    shown = visible(value)
    return f"'{shown}" if _FORMULA.match(shown) and not _NUMBER.fullmatch(shown) else shown


def original(cell: str) -> str:
    """The text that `inert` put an apostrophe in front of; any other as it is."""
    text = cell[1:]
    return text if cell.startswith("'") and inert(text) == cell else cell


def nearest(name: str, names: Iterable[str]) -> str:
    """Suggest the most similar name, or list the names where none is similar."""
    known = list(names)
    similar = difflib.get_close_matches(name, known, n=1)
    return (
        f"Did you mean {similar[0]!r}?" if similar else f"Choose from: {', '.join(known) or 'none'}"
    )


def unknown(where: str, found: str, rule: str, known: Iterable[str]) -> InputError:
    """The error for a name that is not known; it suggests the nearest one, whatever its case."""
    names = list(dict.fromkeys(known))
    same = [name for name in names if name.casefold() == found.casefold()]
    return InputError(where, repr(found), rule, nearest(same[0] if same else found, names))


def file_trouble(error: OSError) -> str:
    """Message for a file, or a drive, that cannot be read or written any more."""
    return (
        f"Error: {error.filename or 'drive'}: {error.strerror}; it could be neither read nor "
        "written. Check that the drive is there, its free space and what it permits."
    )


def out_of_memory(error: MemoryError) -> str:
    """Message for recordings that are too large for the machine."""
    detail = f" ({error})" if str(error) else ""
    return (
        f"Error: not enough memory{detail}. Close other programs, use shorter blocks or a "
        "narrower band, or a machine with more memory."
    )


def is_drive_trouble(error: OSError) -> bool:
    """Whether a file or its drive is at fault; what a library writes may not name the file."""
    return error.filename is not None or error.errno in _OF_DRIVES
