"""Sign-off: what the edits changed against the automatic result, and the new result folder."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from ema.core.display import value_with_std
from ema.core.edits import OF_CHANNELS, OF_POLES, EditKind
from ema.core.errors import InputError
from ema.core.modes import Mode
from pipelines.process.refit import of_blocks, refit
from pipelines.report.save import save
from pipelines.results.edits_file import EDITS_NAME
from pipelines.results.result import Result
from pipelines.review.bench import Bench, StaleError
from pipelines.review.recordings import recordings_of, replayed
from pipelines.review.sight import ModeRow, Sight
from pipelines.review.state import edit_text

_FAR_SIGMA = 3.0  # a change that is worth a warning
_WORSE = 1.05  # ratio of the reduced χ² above which a fit got worse
_MOST_LETTERS = 200  # of a name
_REVIEWED = "reviewed"


def signoff(bench: Bench) -> dict[str, Any]:
    """What there is to sign."""
    sight = bench.sight()
    target = proposed(bench.folder)
    return {
        "ready": bench.is_final,
        "revision": sight.revision,
        "edits": [
            {"text": edit_text(edit, sight), "reason": edit.reason, "by": edit.by}
            for edit in sight.session.edits
        ],
        "modes": [_mode(row) for row in sight.modes],
        "chi2": sight.model.misfit,
        "chi2_automatic": sight.automatic.misfit,
        "warnings": list(_warnings(sight)),
        "folder": target.name,
        "command": replay_command(bench.result, target),
    }


def sign(bench: Bench, revision: int, by: str, note: str, name: str) -> Path:
    """Write the result with its edits, signed, as a new folder beside the one that was opened.

    Raises
    ------
    InputError
        If nobody signs, or the name is none for a new folder.
    StaleError
        If the numbers shown are not final, or not those of this revision.
    """
    if not by.strip() or len(by) > _MOST_LETTERS:
        rule = f"a result is signed by a name of up to {_MOST_LETTERS} letters"
        raise InputError("by", repr(by)[:80], rule, "Type your name")
    target = _beside(bench.folder, name)
    bench.require(revision)
    if not bench.is_final:
        raise StaleError("the final fit is not done")
    edits = bench.session.edits
    again = (replayed if of_blocks(edits) else refit)(bench.result, edits)
    at = datetime.now(UTC).isoformat(timespec="seconds")
    signed = {"by": by.strip(), "at": at, **({"note": note} if note else {})}
    bench.require(revision)
    save(replace(again, provenance={**again.provenance, "signed": signed}), target)
    return target


def proposed(result: Path) -> Path:
    """A free name beside a result."""
    number, first = 1, result.with_name(f"{result.name}_{_REVIEWED}")
    place = first
    while place.exists():
        number += 1
        place = first.with_name(f"{first.name}_{number}")
    return place


def replay_command(result: Result, target: Path) -> str:
    """The command that gives the signed result again."""
    sources = [str(path) for path in recordings_of(result)] or ["CAMPAIGN"]
    again = target.with_name(f"{target.name}_again")
    command = ["ringmodal", "process", *sources, "--edits", str(target / EDITS_NAME)]
    return shlex.join([*command, "--out", str(again)])


def _beside(result: Path, name: str) -> Path:
    """The new folder; the page gives a name, never a path."""
    plain = name == Path(name).name and not name.startswith(".") and name.isprintable()
    if not name or not plain or "\\" in name or len(name) > _MOST_LETTERS:
        rule = f"it is a plain name of up to {_MOST_LETTERS} letters"
        raise InputError("folder", repr(name)[:80], rule, "Type another one")
    return result.with_name(name)


def _mode(row: ModeRow) -> dict[str, Any]:
    before = row.automatic
    shift, _ = row.shift_in_std()
    return {
        "name": row.name,
        "automatic": "" if before is None else _in_words(before),
        "signed": _in_words(row.mode) if row.listed else row.chosen,
        "delta_sigma": shift,
        "chosen": row.chosen,
    }


def _in_words(mode: Mode) -> str:
    frequency = value_with_std(mode.frequency_hz, mode.frequency_std_hz)
    return f"{frequency} Hz, {100 * mode.damping_ratio:.3g} %"


def _warnings(sight: Sight) -> Iterator[str]:
    now, before = sight.model.misfit, sight.automatic.misfit
    if now > _WORSE * before:
        yield (
            f"The fit is worse than the automatic one: χ² {before:.3g} → {now:.3g}. You may sign; "
            "the report will say so."
        )
    for row in sight.modes:
        if abs(row.shift_in_std()[0]) > _FAR_SIGMA:
            shift = row.shift_in_std()[0]
            yield f"{row.name} moved by {shift:+.0f} σ against the automatic result."
    yield from _without_reason(sight)


def _without_reason(sight: Sight) -> Iterator[str]:
    counted: Sequence[EditKind] = (*OF_POLES, *OF_CHANNELS, EditKind.RUN_OUT)
    bare = [edit for edit in sight.session.edits if edit.kind in counted and not edit.reason]
    if bare:
        yield f"{len(bare)} of {len(sight.session.edits)} edits have no reason."
