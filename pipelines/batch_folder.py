"""The folder of a batch: what lies where in it."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from ema.errors import InputError
from pipelines.partial import partial_folder

CAMPAIGNS = "campaigns.parquet"
_RECORDS, _RESULTS, _RECORD = "records", "results", "record.json"


@dataclass(frozen=True)
class BatchFolder:
    """Where a batch keeps its results, what it remembers of them, and its tables.

    Parameters
    ----------
    path : Path
        Absolute: workers elsewhere use it too.
    """

    path: Path

    @property
    def modes(self) -> Path:
        """Modes of all campaigns."""
        return self.path / "modes.parquet"

    @property
    def parameters(self) -> Path:
        """Ring parameters of all campaigns."""
        return self.path / "parameters.parquet"

    @property
    def campaigns(self) -> Path:
        """What became of each campaign."""
        return self.path / CAMPAIGNS

    @property
    def summary(self) -> Path:
        """The summary page."""
        return self.path / "summary.html"

    def result(self, place: str) -> Path:
        """Result folder of a campaign."""
        return self.path / _RESULTS / place

    def record(self, place: str) -> Path:
        """What is remembered of a campaign, so that it need not be processed again."""
        return self.path / _RECORDS / place / _RECORD

    def is_complete(self) -> bool:
        """Whether all tables and the summary are there."""
        wanted = (self.modes, self.parameters, self.campaigns, self.summary)
        return all(path.is_file() for path in wanted)


def prepared(out: Path) -> BatchFolder:
    """Make the folder of a batch, or take the one of an earlier run.

    Raises
    ------
    InputError
        If it cannot be written, or holds other files.
    """
    folder = BatchFolder(Path(os.path.realpath(out)))
    records = folder.path / _RECORDS
    try:
        if folder.path.is_dir() and not _is_of_a_batch(folder.path, records):
            rule = "a batch needs a folder of its own"
            raise InputError(str(out), "a folder with other files", rule, "Choose another folder")
        records.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise _unwritable(out, error) from error
    _require_writable(out, folder.path)
    return folder


def _is_of_a_batch(folder: Path, records: Path) -> bool:
    """Whether a folder is empty, just begun, or holds what an earlier batch remembers."""
    others = [path for path in folder.iterdir() if path.name not in (_RECORDS, _RESULTS)]
    return not others or any(path.is_file() for path in records.rglob(_RECORD))


def _require_writable(out: Path, folder: Path) -> None:
    try:
        with partial_folder(folder / "probe"):
            pass
    except OSError as error:
        raise _unwritable(out, error) from error


def _unwritable(out: Path, error: OSError) -> InputError:
    rule = "a batch writes its results there"
    remedy = "Check free space and permissions, or choose another folder"
    return InputError(str(out), error.strerror or str(error), rule, remedy)
