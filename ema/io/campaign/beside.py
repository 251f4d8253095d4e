"""What lies beside recordings: geometry and coherence in files of their own, stray tables."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from statistics import median

import numpy as np

from ema.core.display import counted
from ema.core.errors import RecordingFormatError
from ema.core.finding import Check
from ema.core.frf import FRF
from ema.core.recording import FORCE, Recording
from ema.io.content import Coherences, FileContent, note, remark
from ema.io.formats import read_file
from ema.io.uff.frf import same_lines
from ema.io.uff.geometry import Surroundings, placed

# A table this many times smaller than the files beside it is hardly a run of the same test.
_SMALLER = 10
_SHOWN = 6  # names in a message
_TABLES = (".csv", ".tsv", ".txt", ".asc", ".dat", ".xlsx", ".xlsm")


def read_folder(paths: Sequence[Path]) -> list[FileContent]:
    """Read the files of a folder; small tables that are no recordings are set aside and named."""
    if len(paths) < 2:
        return [read_file(path) for path in paths]
    typical = median(path.stat().st_size if path.is_file() else 0 for path in paths)
    return [
        _unless_stray(path) if _is_small_table(path, typical) else read_file(path) for path in paths
    ]


def _is_small_table(path: Path, typical: float) -> bool:
    is_table = path.suffix.lower() in _TABLES and path.is_file()
    return is_table and _SMALLER * path.stat().st_size < typical


def _unless_stray(path: Path) -> FileContent:
    try:
        content = read_file(path)
    except RecordingFormatError as error:
        found = f"{error.found}; {error.rule}"
    else:
        recording = content.recording
        if recording is None or any(each.quantity == FORCE for each in recording.channels):
            return content
        found = f"no force among its columns {', '.join(recording.names[:_SHOWN])}"
    detail = f"a small table beside the recordings and none itself, set aside: {found}"
    return FileContent(path, findings=(remark(path, "", Check.CONTENT, detail),))


def joined(contents: Sequence[FileContent]) -> list[FileContent]:
    """The contents, those with data completed by what the others have.

    Where a file has angles or coherences of its own, these stay. A file that was joined to others
    says so; one that fits none is what it was without.
    """
    found = list(contents)
    for at, extra in enumerate(contents):
        if extra.has_data or (extra.nodes is None and extra.coherences is None):
            continue
        n_joined = 0
        for k, content in enumerate(found):
            completed = _completed(content, extra, found) if content.has_data else content
            n_joined += completed is not content
            found[k] = completed
        if not n_joined:
            found[at] = replace(extra, nodes=None, coherences=None)
            continue
        kind = "geometry" if extra.nodes is not None else "coherence"
        detail = f"{kind} joined to {counted(n_joined, 'file')}"
        found[at] = replace(extra, findings=(note(extra.path, Check.CONTENT, detail),))
    return found


def _completed(
    content: FileContent, extra: FileContent, all_of_them: Sequence[FileContent]
) -> FileContent:
    if extra.nodes is not None and not content.circle.angle_deg:
        in_use = {node for each in all_of_them for node in _nodes_of(each)}
        around = placed(extra.path, extra.nodes, in_use)
        content = _with_angles(content, around)
    if extra.coherences is not None and content.frf is not None:
        content = _with_coherences(content, content.frf, extra.coherences)
    return content


def _nodes_of(content: FileContent) -> set[int]:
    recording, frf = content.recording, content.frf
    of_channels = [] if recording is None else [each.node for each in recording.channels]
    return {node for node in of_channels if node} | set([] if frf is None else frf.node.tolist())


def _with_angles(content: FileContent, around: Surroundings) -> FileContent:
    """Angles of sensors whose file states none."""
    angles = around.angle_deg
    if not _nodes_of(content) & set(angles):
        return content
    recording, frf = content.recording, content.frf
    return replace(
        content,
        recording=None if recording is None else _placed_channels(recording, angles),
        frf=None if frf is None else _placed_rows(frf, angles),
        circle=around.circle,
        findings=(*content.findings, *around.findings),
    )


def _placed_channels(recording: Recording, angles: dict[int, float]) -> Recording:
    channels = (
        replace(each, angle_deg=angles.get(each.node or 0)) if each.angle_deg is None else each
        for each in recording.channels
    )
    return replace(recording, channels=tuple(channels))


def _placed_rows(frf: FRF, angles: dict[int, float]) -> FRF:
    known = [angles.get(node, np.nan) for node in frf.node.tolist()]
    return replace(frf, position_deg=np.where(np.isnan(frf.position_deg), known, frf.position_deg))


def _with_coherences(content: FileContent, frf: FRF, extra: Coherences) -> FileContent:
    """Coherences of the same ends and lines, where an FRF has none."""
    if not same_lines(extra.frequency_hz, frf.frequency_hz):
        return content
    force = content.frf_force_node or 0, content.frf_force_axis
    places = zip(frf.node.tolist(), frf.axis.tolist(), strict=True)
    ends = [(*place, *force) for place in places]
    unknown = np.isnan(frf.coherence).all(axis=1)
    rows = [row for row in np.flatnonzero(unknown).tolist() if ends[row] in extra.values]
    if not rows or len(set(ends)) < len(ends):
        return content
    coherence = np.array(frf.coherence)
    coherence[rows] = [extra.values[ends[row]] for row in rows]
    return replace(content, frf=replace(frf, coherence=coherence))
