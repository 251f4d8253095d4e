"""Libraries that only some formats need, and what they say about damaged files."""

from __future__ import annotations

import importlib
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

from ema.errors import InputError, RecordingFormatError

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
    """Import a library that reads a format, or tell how it is installed.

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
        rule = f"this format is read by {module}, which is not installed"
        remedy = f"Run pip install 'ringmodal[{extra}]', or export the file as UFF or CSV"
        raise RecordingFormatError(str(path), found, rule, remedy) from error


@contextmanager
def reading(path: Path, kind: str) -> Iterator[None]:
    """Turn whatever a format's library raises inside the block into a fault of the file.

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
