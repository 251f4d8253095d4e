"""Libraries that only some formats need."""

from __future__ import annotations

import importlib
from pathlib import Path
from types import ModuleType

from ema.errors import RecordingFormatError


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
