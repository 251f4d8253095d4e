"""Content of one file, independent of its format, and what the readers share."""

from __future__ import annotations

import importlib
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np
import pyarrow as pa

from ema.core.errors import InputError, RecordingFormatError
from ema.core.finding import WARNING, Finding
from ema.core.frf import FRF
from ema.core.recording import Recording

if TYPE_CHECKING:
    import pyarrow as pa


@dataclass(frozen=True, eq=False)
class FileContent:
    """Time series and FRFs of one file, and what its reader noticed.

    Parameters
    ----------
    path : Path
        The file.
    recording : Recording or None
        Its time series.
    frf : FRF or None
        Its FRFs, as inertance.
    frf_names : tuple of str
        Names of the FRFs, as those of channels.
    frf_force_node : int or None
        Node of the force of the FRFs, where the file numbers it.
    findings : tuple of Finding
        What was assumed, converted or left out.
    """

    path: Path
    recording: Recording | None = None
    frf: FRF | None = None
    frf_names: tuple[str, ...] = ()
    frf_force_node: int | None = None
    findings: tuple[Finding, ...] = ()


def remark(path: Path, channel: str, check: str, detail: str) -> Finding:
    """Build a warning about a channel of a file (or about the file, `channel` empty)."""
    return Finding(path.name, channel, None, check, WARNING, detail)


MOST_EXPANSION = (
    64  # of a compressed file: vibration compresses by 1.1 to 10, a silent channel more
)
_ALWAYS_BYTES = 1 << 24
_COPY_AGAIN = "Copy the file again or export it without compression"


def check_expansion(where: str, path: Path, n_bytes: int) -> None:
    """Refuse data that would be far larger in memory than in a compressed file.

    Parameters
    ----------
    where : str
        File and place in it.
    path : Path
        The file, whose size counts.
    n_bytes : int
        Size of the data in memory; up to 16 MiB are never refused.

    Raises
    ------
    RecordingFormatError
        If it is more than `MOST_EXPANSION` times the size of the file.
    """
    size = path.stat().st_size
    if n_bytes <= max(MOST_EXPANSION * size, _ALWAYS_BYTES):
        return
    found = f"{n_bytes} bytes of numbers claimed by a file of {size} bytes"
    rule = f"the compression ratio must not exceed {MOST_EXPANSION}"
    raise RecordingFormatError(where, found, rule, _COPY_AGAIN)


def check_stored(where: str, n_claimed: int, n_stored: int) -> None:
    """Refuse uncompressed data that claim more bytes than are there.

    Raises
    ------
    RecordingFormatError
        If `n_claimed` exceeds `n_stored`.
    """
    if n_claimed <= n_stored:
        return
    found = f"{n_claimed} bytes of numbers claimed, {n_stored} stored"
    raise RecordingFormatError(where, found, "the file is truncated or damaged", _COPY_AGAIN)


# What well-kept readers raise on bytes that are not what they expect.
_ON_DAMAGE = (
    ArithmeticError,
    EOFError,
    LookupError,
    MemoryError,
    OSError,
    RuntimeError,
    TypeError,
    ValueError,
    struct.error,
)
_LONGEST_REASON = 200


def require(module: str, extra: str, path: Path) -> ModuleType:
    """Import an optional library, or say how to install it.

    Parameters
    ----------
    module : str
        What is imported, e.g. ``"nptdms"``.
    extra : str
        The extra of ringmodal that installs it, e.g. ``"tdms"``.
    path : Path
        The file that needs it.

    Raises
    ------
    RecordingFormatError
        If it is not installed.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        found = f"the ending {path.suffix!r}"
        rule = f"reading this format requires {module}, which is not installed"
        remedy = f"Run pip install 'ringmodal[{extra}]' or export the file as UFF or CSV"
        raise RecordingFormatError(str(path), found, rule, remedy) from error


@contextmanager
def reading(path: Path, kind: str) -> Iterator[None]:
    """Turn any exception of a format's library inside the block into an `InputError`.

    Parameters
    ----------
    path : Path
        The file being read.
    kind : str
        What the file should be, e.g. ``"a Parquet file"``.

    Raises
    ------
    RecordingFormatError
        In place of the library's exception.
    """
    try:
        yield
    except InputError:
        raise
    except _ON_DAMAGE as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        if len(reason) > _LONGEST_REASON:
            reason = f"{reason[:_LONGEST_REASON]} …"
        rule = f"{kind} that is whole can be read; this one is damaged, cut short or something else"
        raise RecordingFormatError(path.name, reason, rule, "Copy or export it again") from error


def arrow_reader(content: bytes) -> pa.BufferReader:
    """Copy bytes to memory of Arrow's own, for it to read.

    When parsing fails, a thread of Arrow's may be the last to let go of what it read. Were that
    Python's, the thread would have to ask the interpreter; asking while Python ends, it would be
    stopped by force, and with it the process: exit code 134 instead of the error's.

    Parameters
    ----------
    content : bytes

    Returns
    -------
    pyarrow.BufferReader
    """
    # The default pool holds megabytes in reserve.
    memory = pa.allocate_buffer(len(content), memory_pool=pa.system_memory_pool())
    np.frombuffer(memory, np.uint8)[:] = np.frombuffer(content, np.uint8)
    return pa.BufferReader(memory)


EXPORT_AGAIN = "Correct the file or export it again"
