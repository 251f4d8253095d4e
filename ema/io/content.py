"""What one file holds, whatever its format."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ema.frf import FRF
from ema.quality import WARNING, Finding
from ema.recording import Recording


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
