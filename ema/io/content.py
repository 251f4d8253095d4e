"""What a file holds, and what its header states of the measurement."""

from __future__ import annotations

import importlib
import re
import struct
import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from enum import Enum
from functools import lru_cache
from pathlib import Path
from types import ModuleType
from typing import NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ema.core.errors import InputError, RecordingFormatError
from ema.core.finding import Check, Finding, Verdict
from ema.core.frf import FRF
from ema.core.recording import Recording
from ema.core.units import NAMES_KEPT, amount, parse_axis

EXPORT_AGAIN = "Correct the file or export it again"
COPY_AGAIN = "Copy or export it again"
LEAVE_OUT = "Copy or export the file again, or leave out the run"

# Largest accepted size in memory over size of a compressed file. Vibration compresses by 1.1 to
# 10, a silent channel more.
MOST_EXPANSION = 64
_ALWAYS_BYTES = 1 << 24  # up to 16 MiB are accepted from any file
_LONGEST_REASON = 200  # characters of a library's message
# Columns that tell the tables of a result folder (docs/reference/files.md) from recordings.
_OF_A_RESULT = (
    *({"mode", "order", "frequency_hz"}, {"mode", "real", "imag"}, {"channel", "check"}),
    *({"order", "frequency_hz", "damping_ratio"}, {"order", "measured_hz", "model_hz"}),
    {"run", "frequency_hz", "real", "imag"},
)
# What well-kept readers raise on bytes that are not what they expect.
_ON_DAMAGE = (
    *(ArithmeticError, EOFError, LookupError, MemoryError, OSError, RuntimeError),
    *(SyntaxError, TypeError, ValueError, struct.error),  # the first of damaged XML
)


@dataclass(frozen=True, eq=False)
class CircleNodes:
    """Nodes around a circle by the geometry of a file, whether sensors are there or not."""

    angle_deg: Mapping[int, float] = field(default_factory=dict)
    #: X, Y and Z of a node's motion (one per row) in radial, tangential and axial components.
    frames: Mapping[int, NDArray[np.float64]] = field(default_factory=dict)
    #: Nodes whose axes the file defines; elsewhere they are the global ones, if not meant as local.
    defined: frozenset[int] = frozenset()


class WindowKind(Enum):
    """Window of an analyser that changes poles or averages; the value is its key in manifests."""

    EXPONENTIAL = "exponential_window_s"
    FORCE = "force_window_s"


@dataclass(frozen=True)
class StatedWindow:
    """A window that a header states."""

    kind: WindowKind
    said: str  # as the header has it
    seconds: float | None  # time constant or length; None where it is not stated as such


@dataclass(frozen=True, eq=False)
class Nodes:
    """Nodes of a file in its unit of length."""

    xyz: dict[int, NDArray[np.float64]]  # global Cartesian coordinates
    #: Global unit vectors, one per row, along which X, Y and Z of a node's motion count; only of
    #: nodes whose displacement coordinate system is not the global one.
    axes: dict[int, NDArray[np.float64]]
    doubt: str = ""  # what was assumed; empty where nothing was


@dataclass(frozen=True, eq=False)
class Coherences:
    """Coherences without their FRFs."""

    frequency_hz: NDArray[np.float64]
    #: By node and axis of the response, node and axis of the force.
    values: dict[tuple[int, ...], NDArray[np.float64]]


@dataclass(frozen=True, eq=False)
class FileContent:
    """Time series and FRFs of one file, and what its reader noticed."""

    path: Path
    recording: Recording | None = None
    frf: FRF | None = None  # as inertance
    frf_names: tuple[str, ...] = ()  # as those of channels
    frf_forces: tuple[tuple[int, int], ...] = ()  # node and axis of each, 0 where none is stated
    findings: tuple[Finding, ...] = ()  # what was assumed, converted or left out
    circle: CircleNodes = field(default_factory=CircleNodes)
    windows: tuple[StatedWindow, ...] = ()  # that the analyser applied
    frf_without_unit: tuple[int, ...] = ()  # rows whose values are as the file has them
    nodes: Nodes | None = None  # of a file with neither
    coherences: Coherences | None = None  # the same
    is_result: bool = False  # FRFs that were made of recordings before

    @property
    def frf_force_node(self) -> int | None:
        """Node of the force, where all FRFs have one."""
        nodes = {node for node, _ in self.frf_forces}
        return nodes.pop() or None if len(nodes) == 1 else None

    @property
    def frf_force_axis(self) -> int:
        """Axis of the force as `Channel.axis`, 0 where FRFs differ."""
        axes = {axis for _, axis in self.frf_forces}
        return axes.pop() if len(axes) == 1 else 0

    @property
    def has_data(self) -> bool:
        """Whether it has time series or FRFs."""
        return self.recording is not None or self.frf is not None


def remark(path: Path, channel: str, check: Check, detail: str) -> Finding:
    """Build a warning about a channel of a file (or about the file, `channel` empty)."""
    return Finding(path.name, channel, None, check, Verdict.WARNING, detail)


def note(path: Path, check: Check, detail: str) -> Finding:
    """Build a finding about a file that is as it should be."""
    return Finding(path.name, "", None, check, Verdict.OK, detail)


def left_out(path: Path, why: Mapping[str, str]) -> tuple[Finding, ...]:
    """Warnings about parts of a file that are not read: the reason by the name of the part."""
    return tuple(
        remark(path, name, Check.CONTENT, f"{reason}, left out") for name, reason in why.items()
    )


def refuse_result(path: Path, names: Iterable[str]) -> None:
    """Refuse a table that `ringmodal process` wrote, known by the names of its columns."""
    if any(columns <= set(names) for columns in _OF_A_RESULT):
        rule = "it is a table of a result folder, and a recording is needed"
        remedy = "Name the recordings; `ringmodal report`, `tune` and `refit` take a result folder"
        raise RecordingFormatError(path.name, "columns of results", rule, remedy)


def not_together(path: Path, found: str) -> RecordingFormatError:
    """The error about channels of one file that differ in length, rate or time."""
    rule = "channels of one run must be sampled together, at one rate and equally long"
    remedy = "Export them at one rate, without those that are not needed"
    return RecordingFormatError(path.name, found, rule, remedy)


def check_expansion(where: str, path: Path, n_bytes: int) -> None:
    """Refuse data whose `n_bytes` in memory are far more than the compressed file at `path`."""
    size = path.stat().st_size
    if n_bytes > max(MOST_EXPANSION * size, _ALWAYS_BYTES):
        found = f"{n_bytes} bytes of numbers claimed by a file of {size} bytes"
        rule = f"the compression ratio must not exceed {MOST_EXPANSION}"
        raise RecordingFormatError(where, found, rule, "Export it without compression")


def check_stored(where: str, n_claimed: int, n_stored: int) -> None:
    """Refuse uncompressed data that claim more bytes than the file has."""
    if n_claimed > n_stored:
        found = f"{n_claimed} bytes of numbers claimed, {n_stored} stored"
        raise RecordingFormatError(where, found, "the file is truncated or damaged", COPY_AGAIN)


def unreadable(path: Path, error: OSError, rule: str = "the file must be readable") -> InputError:
    """Build the error about a file or folder that the system does not open."""
    reason = error.strerror or str(error)
    return RecordingFormatError(str(path), reason, rule, "Check the name and the access rights")


def require(module: str, path: Path) -> ModuleType:
    """Import the optional library that reads `path`, or say how to install it."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        rule = f"reading this format requires {module}, which is not installed"
        remedy = f"Run pip install {module}, or export the file as UFF or CSV"
        raise RecordingFormatError(str(path), f"ending {path.suffix!r}", rule, remedy) from error


@contextmanager
def reading(path: Path, kind: str) -> Iterator[None]:
    """Turn any exception of a format's library inside the block into a `RecordingFormatError`.

    `kind` is what the file should be, e.g. ``"a Parquet file"``.
    """
    try:
        yield
    except InputError:
        raise
    except _ON_DAMAGE as error:
        reason = textwrap.shorten(str(error), _LONGEST_REASON, placeholder=" …")
        rule = f"the file is damaged, cut short or something else than {kind}"
        found = reason or type(error).__name__
        raise RecordingFormatError(path.name, found, rule, COPY_AGAIN) from error


def arrow_reader(content: bytes) -> pa.BufferReader:
    """Copy bytes to memory of Arrow's own, for it to read.

    When parsing fails, a thread of Arrow may be the last to release what it read. If that were
    memory of Python, the thread would need the interpreter; while Python ends it would be stopped
    by force, and the process with it: exit code 134 instead of the error's.
    """
    # The default pool keeps megabytes in reserve.
    memory = pa.allocate_buffer(len(content), memory_pool=pa.system_memory_pool())
    np.frombuffer(memory, np.uint8)[:] = np.frombuffer(content, np.uint8)
    return pa.BufferReader(memory)


# Component, node and direction, as field programs and analysers write them, perhaps with those of
# the force behind a slash or a colon: Tire:13:+Z/Tire:1:+Z, M#1 13Z:1Z.
_POINT = re.compile(
    r"(?P<words>(?:[^:/\s]+\s+)*?)(?:(?![^:/]*\b[0-9]+[+-]?[RXYZ]:)[^:/]*:)*?(?P<node>[0-9]{1,9}):?(?P<sign>[+-]?)"
    r"(?:R|(?P<axis>[XYZ]))(?:\s*[/:]\s*(?P<reference>.*))?",
    re.IGNORECASE,
)
_LONGEST_POINT = 120  # characters


class Point(NamedTuple):
    """A degree of freedom: node, sense (1 or −1) and axis as in `Channel`."""

    node: int
    sense: int
    axis: int
    reference: str = ""  # the force of an FRF, as its name has it


#: What a name without a point states.
NOWHERE = Point(0, 1, 0)


@lru_cache(NAMES_KEPT)
def point_of(name: str) -> Point | None:
    """Point of an id such as ``"Tire:13:+Z"``; None for other names."""
    match = _POINT.fullmatch(name.strip()) if len(name) <= _LONGEST_POINT else None
    if match is None or (match["words"] and not match["reference"]):
        return None
    axis = " XYZ".index((match["axis"] or " ").upper())
    sense = -1 if match["sign"] == "-" else 1
    return Point(int(match["node"]), sense, axis, match["reference"] or "")


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
_OFF = {"", "0", "0.0", "none", "no", "off", "false", "free run"}
_OFF |= {"rectangular", "uniform", "boxcar"}
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
        name = place.rpartition("/")[2]
        if not _SUBJECT.search(name) or (text := _text(value)).lower() in _OFF:
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


_SCALE = re.compile(
    r"(?:[a-z]+[\s_-]*)?(?:scal(?:e|ing)(?:[\s_-]*factor)?|factor|faktor|gain|slope|multiplier|lsb|"
    r"sensitivity|calibration|offset|skalierung|verst\w*rkung|empfindlichkeit|"
    r"per[\s_-]*(?:count|bit|lsb|digit)|counts?[\s_-]*(?:to|per)[\s_-]*\w+)s?",
    re.IGNORECASE,
)


@lru_cache(NAMES_KEPT)
def states_scale(name: str) -> bool:
    """Whether a name is one of a factor or an offset of stored numbers."""
    return _SCALE.fullmatch(name.strip()) is not None


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
