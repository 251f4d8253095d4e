"""Windows and triggers of the analyser that headers state: taken over, or named as not used."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from ema.core.finding import Check, Finding
from ema.core.units import amount, parse_axis
from ema.io.content import StatedWindow, WindowKind, note

_SUBJECT = re.compile(r"window|pre-?trig|trigger", re.IGNORECASE)
_MEANS = {
    WindowKind.EXPONENTIAL: re.compile(r"(?<![a-z])exp(?:o|onential)?(?![a-z])", re.IGNORECASE),
    WindowKind.FORCE: re.compile(r"(?<![a-z])(?:force|impact|transient)(?![a-z])", re.IGNORECASE),
}
# What the name of a time has besides "window" and its unit: the constant τ of e^(-t/τ), a length.
_TIMES = {
    WindowKind.EXPONENTIAL: {"exp", "exponential", "time", "constant", "tau"},
    WindowKind.FORCE: {"force", "impact", "transient", "length", "width", "duration"},
}
_OFF = {
    "",
    "0",
    "0.0",
    "none",
    "no",
    "off",
    "false",
    "rectangular",
    "uniform",
    "boxcar",
    "free run",
}
_ENTRY = re.compile(r"\s*([^=:]{3,60}?)\s*[=:]\s*(\S.*?)\s*")
_LONGEST, _SHOWN = 40, 6  # characters of a value, entries in a message


def entries(lines: Iterable[str]) -> dict[str, str]:
    """Name and value of lines such as ``"Exponential window: 0.5 s"``."""
    matches = (_ENTRY.fullmatch(line) for line in lines)
    return {match[1]: match[2] for match in matches if match}


def stated_windows(
    path: Path, statements: Mapping[str, object]
) -> tuple[tuple[StatedWindow, ...], tuple[Finding, ...]]:
    """Exponential and force windows among statements, and a finding about all other treatment.

    `statements` are numbers, texts or arrays of one number by name, perhaps with their place in
    front of a last slash. What is switched off, or no window and no trigger, is skipped.
    """
    windows, others = [], []
    for place, value in statements.items():
        name, text = place.rpartition("/")[2], _text(value)
        if not _SUBJECT.search(name) or text.lower() in _OFF:
            continue
        said = f"{name} = {text[:_LONGEST]}"
        words = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", f"{name} {text}").replace("_", " ")
        kinds = [kind for kind, form in _MEANS.items() if form.search(words)]
        if "trig" in name.lower() or not kinds:
            others.append(said)
        windows += [
            StatedWindow(kind, said, _seconds(kind, name, text))
            for kind in kinds
            if said not in others
        ]
    if not others:
        return tuple(windows), ()
    shown = "; ".join(dict.fromkeys(others[:_SHOWN])) + (" …" if len(others) > _SHOWN else "")
    return tuple(windows), (note(path, Check.IGNORED, f"stated in the file, not used: {shown}"),)


def states_treatment(name: str, value: object) -> bool:
    """Whether a variable is a text, a number or a struct about a window or a trigger."""
    is_one = isinstance(value, str | dict) or (isinstance(value, np.ndarray) and value.size == 1)
    return is_one and _SUBJECT.search(name) is not None


def _text(value: object) -> str:
    """A value in one line; empty for what is no text and no single number."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.item() if value.size == 1 else ""
    if isinstance(value, bytes):
        value = value.decode("latin-1")
    return " ".join(str(value).split()) if isinstance(value, str | int | float) else ""


def _seconds(kind: WindowKind, name: str, text: str) -> float | None:
    """A time in s; None where the name means another one, or no unit is stated."""
    words = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name)
    *rest, last = [*re.findall(r"[a-z]+", words.lower())] or [""]
    axis = parse_axis(last) if rest else None
    means = set(rest if axis else (*rest, last)) - {"window", "response"}
    if not means <= _TIMES[kind]:
        return None
    try:
        found = float(text) * axis.factor if axis else amount(text, "s")
    except ValueError:
        return None
    return found if 0 < found < np.inf else None


def statements_of_1858(codes: Sequence[int]) -> dict[str, str]:
    """What the second record of dataset 1858 states about windows, as name and value."""
    windows = dict(enumerate(("Hanning narrow", "Hanning broad", "flat top"), start=1))
    windows |= {4: "exponential", 5: "impact", 6: "impact and exponential"}
    kind = codes[1] if len(codes) > 1 else 0
    return {"Window type (dataset 1858)": windows.get(kind, str(kind))} if kind else {}
