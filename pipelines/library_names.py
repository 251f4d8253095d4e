"""What tyres and versions are called: on the command line, and as folders on every system."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable

from ema.errors import InputError

APPROVED, NEWEST = "approved", "newest"
_LONGEST = 80  # bytes in UTF-8: a name has 255, and on Windows a whole path about 250 characters
_OF_WINDOWS = re.compile(r"(con|prn|aux|nul|(com|lpt)[\d¹²³])(\..*)?", re.IGNORECASE)


def folder_name(designation: str, tyre_id: str = "") -> str:
    """Name of a tyre's folder, allowed on Windows too: ``225-55R17`` or ``225-55R17_winter-A``.

    Parameters
    ----------
    designation : str
        As on the sidewall, ``225/55R17``.
    tyre_id : str
        Tells tyres of one designation apart.

    Raises
    ------
    InputError
        If there is no letter or digit in it.
    """
    name = "_".join(part for part in map(_safe, (designation, tyre_id)) if part)
    if not name:
        raise InputError(
            "tyre's name",
            repr(designation),
            "a folder is named after it, which takes a letter or a digit",
            "Name the tyre with --tyre",
        )
    return f"tyre-{name}" if _OF_WINDOWS.fullmatch(name) else name


def _safe(text: str) -> str:
    words = re.sub(r"[^\w.]+", "-", unicodedata.normalize("NFC", text))
    return words.encode()[:_LONGEST].decode(errors="ignore").strip("-._")


def split_reference(text: str) -> tuple[str, int | str]:
    """Tyre and version of ``NAME``, ``NAME@3``, ``NAME@approved`` or ``NAME@newest``.

    Returns
    -------
    tuple of str and (int or str)
        Version ``""`` where none is named.

    Raises
    ------
    InputError
        If the version is none of these.
    """
    name, at, version = text.rpartition("@")
    if not at:
        return text, ""
    if version in (APPROVED, NEWEST):
        return name, version
    if not re.fullmatch(r"[0-9]{1,9}", version) or int(version) == 0:
        rule = f"a version is a number from 1 on, {APPROVED} or {NEWEST}"
        raise InputError(text, f"version {version!r}", rule, f"Write e.g. {name}@1")
    return name, int(version)


def require_version(reference: str, command: str) -> str:
    """Tyre of a reference that has to name a version.

    Raises
    ------
    InputError
        If it names none.
    """
    name, version = split_reference(reference)
    if not version:
        rule = "the version has to be named: a newer one may have come in the meantime"
        remedy = f"Write e.g. `ringmodal tyre {command} {name}@1`"
        raise InputError(reference, "no version", rule, remedy)
    return name


def unknown(where: str, found: str, rule: str, known: Iterable[str]) -> InputError:
    """The error for a name that is not known; it suggests the nearest one, whatever its case."""
    from ema.io.manifest import nearest  # loads the manifest's checks, needed for this alone

    names = list(known)
    same = [name for name in names if name.casefold() == found.casefold()]
    return InputError(where, repr(found), rule, nearest(same[0] if same else found, names))
