"""The result folder: written whole or not at all, and read back for later stages."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from ema.core.errors import InputError
from ema.core.files import require_regular
from ema.core.finding import WARNING, Finding
from pipelines.results.check import CheckedResult, checked_result
from pipelines.results.identification_file import read_identification
from pipelines.results.result import Result
from pipelines.results.schema import require_provenance
from pipelines.storage.checksums import ACCEPTED
from pipelines.storage.result_folder import MARKER, recover

_ATTEMPTS = 20  # another process may replace the result again and again


def load(folder: Path | str, *, accept_changes: bool = False) -> Result:
    """Read a result folder back: everything but tuning, damping and validation.

    Those follow from the modes; `pipelines.process.run.tune` adds them again.

    Parameters
    ----------
    folder : path
    accept_changes : bool
        Whether to take parts that are not as they were written; each becomes a warning among the
        findings, and its checksum a part of the provenance.

    Raises
    ------
    InputError
        If the folder is no result, is damaged, or a part of it was changed, is missing or was
        added and is not accepted.

    Examples
    --------
    >>> import ringmodal as rm
    >>> rm.load("result").modal_model
    <ModalModel: 8 modes, 20 to 260 Hz>
    """
    folder = Path(folder)
    for attempts_left in reversed(range(_ATTEMPTS)):
        recover(folder)
        before = _marker_bytes(folder)
        try:
            result = _loaded(folder, accept_changes=accept_changes)
        except InputError:
            if not attempts_left or _marker_bytes(folder) == before:
                raise
        else:
            if not attempts_left or _marker_bytes(folder) == before:
                return result
    raise AssertionError("the last attempt returns or raises")


def _loaded(folder: Path, *, accept_changes: bool) -> Result:
    checked = checked_result(folder, accept_changes=accept_changes)

    record = checked.marker.content
    require_provenance(folder / MARKER, record)  # a checksum that fits vouches for no types
    return with_accepted(read_identification(folder, record), checked)


def with_accepted(result: Result, checked: CheckedResult) -> Result:
    """A result that tells which of its parts were accepted although they had changed."""
    if not checked.accepted:
        return result
    findings = dict.fromkeys(
        [
            *result.findings,
            *(
                Finding("", name, None, "changed", WARNING, f"{change.value}; accepted as it is")
                for name, change in checked.accepted.items()
            ),
        ]
    )
    earlier = result.provenance.get(ACCEPTED, {})
    provenance = {**result.provenance, ACCEPTED: {**earlier, **checked.sha256}}
    return replace(result, findings=tuple(findings), provenance=provenance)


def _marker_bytes(folder: Path) -> bytes | None:
    """What tells one result from the next: another process may replace it meanwhile."""
    with suppress(OSError, InputError):
        return require_regular(folder / MARKER).read_bytes()
    return None
