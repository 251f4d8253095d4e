"""Values that options take: read, checked, and completed by the shell."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Sequence
from pathlib import Path

from ema.core.errors import InputError
from model.tuning_problem import PARAMETERS

ESTIMATORS = ("H1", "H2", "Hv")
METHODS = ("lsce", "plscf")
OBJECTIVES = ("frequency", "paper")
WINDOWS = (  # those that are common for shaker tests; any other of scipy is taken as well
    *("boxcar", "hann", "hamming", "blackman", "blackmanharris", "flattop"),
    *("bartlett", "bohman", "cosine", "nuttall", "parzen", "triang", "tukey"),
)


def ring_parameter_names(incomplete: str) -> list[str]:
    """What the shell offers for NAME=VALUE."""
    return [f"{name}=" for name in PARAMETERS if name.startswith(incomplete)]


def completing(values: Sequence[str]) -> Callable[[str], list[str]]:
    """What the shell offers for an option that takes one of some values."""

    def offers(incomplete: str) -> list[str]:
        return [value for value in values if value.startswith(incomplete)]

    return offers


def choice(option: str, value: str, known: Sequence[str]) -> str:
    """The known value that is meant, in whatever case it was typed.

    Raises
    ------
    InputError
        If there is none; the most similar one is named.
    """
    for each in known:
        if each.casefold() == value.casefold():
            return each

    similar = difflib.get_close_matches(value, known, n=1)
    remedy = f"Did you mean {similar[0]!r}?" if similar else "Choose one of them"
    raise InputError(option, repr(value), f"it must be one of {', '.join(known)}", remedy)


def numbers(option: str, texts: Sequence[str] | None) -> tuple[float, ...]:
    """Numbers of a comma-separated option that may be repeated.

    Raises
    ------
    InputError
        If it holds anything else.
    """
    parts = [part for text in texts or () for part in text.split(",") if part.strip()]
    try:
        return tuple(float(part) for part in parts)
    except ValueError as error:
        raise InputError(
            option,
            repr(",".join(texts or ())),
            "it must be numbers separated by commas",
            "Write e.g. 78.7,100.3",
        ) from error


def ring_parameters(option: str, texts: Sequence[str] | None) -> dict[str, float]:
    """Values of a repeated NAME=VALUE option; names are those of the ring's parameters.

    Raises
    ------
    InputError
        If a text is none, or there is no such parameter.
    """
    values = {}
    for text in texts or ():
        name, _, value = text.partition("=")
        name = name.strip()
        try:
            number = float(value)
        except ValueError as error:
            raise InputError(
                option, repr(text), "it must be NAME=NUMBER", "Write e.g. mass_per_area_kg_m2=19.7"
            ) from error
        values[choice(option, name, PARAMETERS)] = number
    return values


TABLE_ENDINGS = (".csv", ".parquet")
FIGURE_ENDINGS = (".png", ".svg")


def require_target(path: Path, endings: tuple[str, ...]) -> Path:
    """Refuse a file that could not be written, before anything is computed.

    Raises
    ------
    InputError
        For another ending, or a folder that does not exist.
    """
    if path.suffix.lower() not in endings:
        raise InputError(
            str(path),
            f"the ending {path.suffix!r}",
            f"it must be {' or '.join(endings)}",
            "Choose another name",
        )
    if path.is_dir() or not path.absolute().parent.is_dir():
        found = "a folder" if path.is_dir() else "a place in a folder that does not exist"
        raise InputError(str(path), found, "it must be a new or old file", "Choose another place")
    return path
