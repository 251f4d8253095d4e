"""What became of a campaign: a row of the batch's tables, remembered for the next run."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from ema.regular_file import require_regular
from pipelines.batch_fingerprint import FileState, Fingerprint
from pipelines.console import plain
from pipelines.whole_file import file_written_whole

DONE = "done"
FAILED = "failed"
SCHEMA = 1

Row = tuple[Any, ...]


@dataclass(frozen=True)
class Record:
    """What became of a campaign.

    Parameters
    ----------
    campaign : str
        Name of the campaign.
    status : {"done", "failed"}
    fingerprint : Fingerprint
        What it was processed from.
    message : str
        Why it failed; empty where it is done.
    traceback : str
        Where it failed, for faults of the program only.
    seconds : float
        Wall time of the processing.
    designation : str
        The tyre's; empty where there is none.
    inflation_pressure_pa : float or None
    n_warnings : int
        Findings that are warnings or tell that something was left out.
    modes : tuple of tuple
        Rows of ``modes.csv``.
    parameters : tuple of tuple
        Name, value, standard deviation and origin of each ring and damping parameter.
    """

    campaign: str
    status: str
    fingerprint: Fingerprint
    message: str = ""
    traceback: str = ""
    seconds: float = 0.0
    designation: str = ""
    inflation_pressure_pa: float | None = None
    n_warnings: int = 0
    modes: tuple[Row, ...] = ()
    parameters: tuple[Row, ...] = ()

    @property
    def is_done(self) -> bool:
        """Whether there is a result."""
        return self.status == DONE


def write_record(record: Record, path: Path) -> None:
    """Write a record, whole or not at all.

    Raises
    ------
    InputError
        If it cannot be written.
    """
    text = json.dumps({"schema": SCHEMA, **plain(asdict(record))}, ensure_ascii=False)
    with file_written_whole(path) as partial:
        partial.write_text(text + "\n", encoding="utf-8", newline="\n")


def read_record(path: Path) -> Record | None:
    """Read a record; None where there is none of this version that is whole."""
    try:
        content = json.loads(require_regular(path).read_text(encoding="utf-8"))
        if content.pop("schema") != SCHEMA:
            return None
        fingerprint = content.pop("fingerprint")
        files = tuple(FileState(**state) for state in fingerprint["files"])
        content["fingerprint"] = Fingerprint(fingerprint["digest"], files)
        for name in ("modes", "parameters"):
            content[name] = tuple(map(tuple, content[name]))
        return Record(**content)
    except (OSError, ValueError, LookupError, TypeError, AttributeError):
        return None
