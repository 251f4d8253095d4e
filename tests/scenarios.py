"""What a named scenario is: files built byte by byte, and what a good tool makes of them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from builders import binary58, floats

from ema.core.errors import InputError, ManifestError, RecordingFormatError

N = 64  # samples of a channel: four blocks of sixteen
RATE_HZ = 2000.0
# Whole numbers, so that every precision and every text format holds them exactly.
FORCE = np.random.default_rng(1).integers(-100, 100, N).astype(float)
ACCELERATION = np.random.default_rng(2).integers(-100, 100, N).astype(float)
G = 9.80665


@dataclass(frozen=True)
class Link:
    """A symbolic link, where a file is asked for."""

    target: str


class Folder:
    """A folder, where a file is asked for."""


@dataclass(frozen=True)
class Refused:
    """The error a scenario ends in: its type, and regular expressions its message matches."""

    error: type[InputError]
    patterns: tuple[str, ...]

    def holds(self, error: InputError) -> list[str]:
        """Which of the patterns the message misses."""
        return [each for each in self.patterns if not re.search(each, str(error))]


@dataclass(frozen=True, eq=False)
class Read:
    """What is read: runs, channels, first samples in SI, rate, and texts among the findings.

    `frf` says what `estimate_frf` makes of it: its number of rows, or the error it ends in;
    `missing` that samples which are no finite numbers cost averages, and that this is said.
    """

    runs: int = 1
    channels: tuple[str, ...] = ("force", "A01")
    first: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    rate_hz: float = RATE_HZ
    findings: tuple[str, ...] = ()
    frf: int | Refused = 1
    missing: bool = False


@dataclass(frozen=True, eq=False)
class Scenario:
    """Files, which of them is handed over (the folder by default), and what is expected.

    `pending` is what a tool that does not do so yet has to learn.
    """

    name: str
    files: Mapping[str, bytes | Link | type[Folder]]
    expected: Read | Refused
    source: str = ""
    pending: str = ""

    def build(self, folder: Path) -> Path:
        """Write the files below `folder` and return what `read_campaign` is given."""
        for name, content in self.files.items():
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            if isinstance(content, Link):
                path.symlink_to(content.target)
            elif isinstance(content, bytes):
                path.write_bytes(content)
            else:
                path.mkdir()
        return folder / self.source


def bad_file(*patterns: str) -> Refused:
    """A recording that cannot be used."""
    return Refused(RecordingFormatError, patterns)


def bad_manifest(*patterns: str) -> Refused:
    """A manifest that cannot be used."""
    return Refused(ManifestError, patterns)


def unusable(*patterns: str) -> Refused:
    """Files that are read and a signal that gives no FRF."""
    return Refused(InputError, patterns)


def force(values=FORCE, **header) -> bytes:
    """A force in a dataset 58b."""
    defaults = {"name": "force", "node": 0, "axis": (13, 0, 0, "Force", "N"), "n": len(values)}
    return _binary(values, defaults | header)


def sensor(values=ACCELERATION, **header) -> bytes:
    """An acceleration in a dataset 58b."""
    return _binary(values, {"n": len(values)} | header)


def _binary(values, header) -> bytes:
    big, double = header.get("big", False), header.get("ordinate") == 4
    return binary58(floats(values, big=big, double=double), **header)


def table(
    header="force [N],A01 [m/s^2]",
    separator=",",
    eol="\n",
    time=True,
    signals=(FORCE, ACCELERATION),
) -> str:
    """A table of force and acceleration under a heading; `time` puts a column before them."""
    rows = []
    for k, (first, second) in enumerate(zip(*signals, strict=True)):
        cells = [f"{k / RATE_HZ:.4f}"] if time else []
        rows.append(separator.join([*cells, f"{first:.1f}", f"{second:.1f}"]))
    heading = (f"time [s]{separator}" if time else "") + header.replace(",", separator)
    return eol.join([heading, *rows]) + eol
