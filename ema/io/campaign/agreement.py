"""Cross-run checks: duplicate files, sampling rates, run lengths and grid coverage."""

from __future__ import annotations

import filecmp
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from statistics import median
from typing import Any, cast

import numpy as np

from ema.core.campaign import Campaign, Run
from ema.core.display import counted
from ema.core.errors import RecordingFormatError
from ema.core.finding import Check, Finding, Verdict
from ema.core.frf import FRF
from ema.core.numerics import stacked
from ema.core.recording import ACCELERATION, FORCE, Channel, Recording
from ema.io.campaign.axes import REMEDY
from ema.io.campaign.manifest import MANIFEST_NAME
from ema.io.campaign.roles import Grid
from ema.io.content import Coherences, FileContent, WindowKind, note, remark
from ema.io.formats import read_file
from ema.io.rates import SAME_RATE
from ema.io.uff.frf import same_lines
from ema.io.uff.geometry import Surroundings, placed
from ema.signals.damage import SAME_LENGTH

_SAME_LINES = 1e-6  # relative, of frequency lines
_FEWEST_LINES = 64  # fewer show no decay
# Energy before the force over that behind it: below 1 for what is causal, its inverse where the
# phase is conjugate; noise has 1.
_BACKWARDS = 2.0
_SHOWN = 12  # positions in a message
# A table this many times smaller than the files beside it is hardly a run of the same test.
_SMALLER = 10
_SHOWN_BESIDE = 6  # names in a message
_TABLES = (".csv", ".tsv", ".txt", ".asc", ".dat", ".xlsx", ".xlsm")


def check_duplicates(paths: Sequence[Path]) -> None:
    """Refuse two files with the same content, one of which must have replaced another run."""
    for one, other in combinations(paths, 2):
        if filecmp.cmp(one, other, shallow=False):
            rule = f"it is {one.name} again, byte for byte, and runs must differ"
            remedy = "Remove one of them, or replace it by the right recording"
            raise RecordingFormatError(str(other), "a duplicated file", rule, remedy)


def with_stated_windows(
    campaign: Campaign, contents: Sequence[FileContent], findings: list[Finding]
) -> Campaign:
    """The campaign with the windows that all headers state; those of the manifest come first.

    An analyser may record without the window of its FRFs: one of recordings is to be confirmed.
    """
    for kind in WindowKind:
        key = kind.value
        said = [each for content in contents for each in content.windows if each.kind is kind]
        if not said or getattr(campaign.processing, key) is not None:
            continue
        known = {
            next((w.seconds for w in each.windows if w.kind is kind and w.seconds), None)
            for each in contents
        }
        seconds = known.pop() if len(known) == 1 else None
        text = "; ".join(dict.fromkeys(each.said for each in said))
        fitting = f"Give {key} in [processing] of {MANIFEST_NAME}"
        verdict, detail = Verdict.OK, f"{text}: taken as {key} = {seconds:.6g}" if seconds else ""
        if seconds is None:
            verdict, detail = Verdict.WARNING, f"{text}: no time that all files share. {fitting}"
        elif any(content.recording is not None for content in contents):
            verdict = Verdict.WARNING
            detail += f", if the samples were recorded behind the window. {fitting} to confirm"
        findings.append(Finding("", "", None, Check.WINDOW, verdict, detail))
        if seconds is not None:
            processing = replace(campaign.processing, **cast("Any", {key: seconds}))
            campaign = replace(campaign, processing=processing)
    return campaign


def run_names(paths: Sequence[Path]) -> list[str]:
    """Names of runs: those of their files, with as many folders as make them unique."""
    for depth in range(1, max(len(path.parts) for path in paths)):
        names = ["/".join(path.parts[-depth:]) for path in paths]
        if len(set(names)) == len(names):
            return names
    return [path.as_posix() for path in paths]


def check_rates(recordings: Sequence[Recording]) -> None:
    """Refuse recordings without a sampling rate, or with different ones."""
    first = recordings[0]
    for recording in recordings:
        rate = recording.sampling_rate_hz
        if np.isnan(rate):
            rule = "a file without a time column needs a sampling rate in the manifest"
            remedy = f"Set acquisition.sampling_rate_hz in {MANIFEST_NAME} (see `ringmodal init`)"
            raise RecordingFormatError(recording.path.name, "no sampling rate", rule, remedy)
        if abs(rate - first.sampling_rate_hz) > SAME_RATE * rate:
            rule = f"{first.path.name} was sampled at {first.sampling_rate_hz:g} Hz"
            remedy = "Resample to one rate for all runs, or process them separately"
            raise RecordingFormatError(recording.path.name, f"{rate:g} Hz", rule, remedy)


def coverage_findings(runs: Sequence[Run], positions: int | None) -> list[Finding]:
    """Findings about lengths, references and positions that make the result poorer."""
    findings = _lengths(runs)
    if positions is None:
        return findings
    without = [run.name for run in runs if run.reference is None]
    if without and len(runs) > 1:
        detail = "no run has a reference sensor: only the modes can show whether the tyre changed"
        if len(without) < len(runs):
            named = ", ".join(without)
            detail = f"no reference sensor in {named}: not compared with the other runs"
        findings.append(Finding("", "", None, Check.REFERENCE, Verdict.WARNING, detail))
    forces = dict.fromkeys(run.references for run in runs)
    by_force = [[run for run in runs if run.references == each] for each in forces]
    of_grid = (each for own in by_force for each in _grid_findings(own, positions))
    return findings + list(dict.fromkeys(of_grid))


def _grid_findings(runs: Sequence[Run], positions: int) -> list[Finding]:
    """Positions that were not measured with a force, or several times."""
    measured = {response.node for run in runs for response in run.responses}
    missing = [node * 360.0 / positions for node in range(positions) if node not in measured]
    repeated = _repeated_positions(runs)
    if not missing:
        return repeated
    detail = f"{len(missing)} of {positions} grid positions not measured: {_degrees(missing)}"
    return [Finding("", "", None, Check.GRID, Verdict.WARNING, detail), *repeated]


def _lengths(runs: Sequence[Run]) -> list[Finding]:
    """Runs that are not as long as most; compared with the longest where most differ."""
    durations = [run.recording.duration_s for run in runs]
    usual = float(np.median(durations))
    alike = np.abs(np.array(durations) - usual) <= SAME_LENGTH * usual
    if np.mean(alike) <= 0.5:
        usual = max(durations)
    findings = []
    for run, duration_s in zip(runs, durations, strict=True):
        if abs(duration_s - usual) > SAME_LENGTH * usual:
            shorter = duration_s < usual
            verdict = Verdict.WARNING if shorter else Verdict.OK
            count = "fewer" if shorter else "more"
            detail = f"{duration_s:.4g} s long, others {usual:.4g} s: {count} averages"
            findings.append(Finding(run.name, "", None, Check.LENGTH, verdict, detail))
    return findings


def _repeated_positions(runs: Sequence[Run]) -> list[Finding]:
    """Positions measured in several runs, which is intended if all are measured equally often."""
    angles = [r.position_deg for run in runs for r in run.responses if r.position_deg is not None]
    times = Counter(round(angle, 6) for angle in angles)
    repeated = sorted(angle for angle, count in times.items() if count > 1)
    if not repeated:
        return []
    if len(set(times.values())) == 1:
        detail = f"each position measured in {times[repeated[0]]} runs and averaged"
        return [Finding("", "", None, Check.GRID, Verdict.OK, detail)]
    detail = f"measured in several runs and averaged: {_degrees(repeated)}; intended?"
    return [Finding("", "", None, Check.GRID, Verdict.WARNING, detail)]


def _degrees(angles: Sequence[float]) -> str:
    more = " …" if len(angles) > _SHOWN else ""
    return ", ".join(f"{angle:g}" for angle in angles[:_SHOWN]) + f"{more} degrees"


def merge(
    files: Sequence[tuple[FileContent, dict[str, float] | None]],
    positions: int | None,
    findings: list[Finding],
) -> FRF:
    """Stack the FRFs of all files, which must have the same frequency lines.

    Each file comes with angles by name, where given; `positions` is the number on the grid.
    """
    for content, _ in files:
        _check_causal(content)
    if positions is not None:
        files = [(_along_force(content, findings), given) for content, given in files]
    frfs = [content.frf for content, _ in files if content.frf is not None]
    check_lines(frfs)
    rows = [
        (content.path, channel, given)
        for content, given in files
        for channel in _rows_as_channels(content)
    ]
    grid = Grid.over(positions, [channel for _, channel, _ in rows])
    places = [grid.place(*row, findings) for row in rows]
    findings += grid.off_grid(places)
    angles = [np.nan if place.position_deg is None else place.position_deg for place in places]
    return FRF(
        frequency_hz=frfs[0].frequency_hz,
        values=stacked([frf.values for frf in frfs]),
        coherence=stacked([frf.coherence for frf in frfs]),
        std=stacked([frf.std for frf in frfs]),
        node=np.array([-1 if place.node is None else place.node for place in places]),
        position_deg=np.array(angles),
        axis=stacked([frf.axis for frf in frfs]),
        force_node=_common([content.frf_force_node or 0 for content, _ in files]),
        force_axis=_common([content.frf_force_axis for content, _ in files]),
        run=tuple(run for frf in frfs for run in frf.run),
    )


def check_lines(frfs: Sequence[FRF]) -> None:
    """Refuse FRFs of files with different frequency lines."""
    first = frfs[0].frequency_hz
    for frf in frfs[1:]:
        lines = frf.frequency_hz
        if len(lines) != len(first) or not np.allclose(lines, first, rtol=_SAME_LINES):
            found = f"{len(lines)} lines to {lines[-1]:g} Hz"
            rule = f"{frfs[0].run[0]} has {len(first)} lines to {first[-1]:g} Hz"
            remedy = "Process files of different resolution separately"
            raise RecordingFormatError(frf.run[0], found, rule, remedy)


def _common(numbers: Sequence[int]) -> int:
    return numbers[0] if len(set(numbers)) == 1 else 0


def _check_causal(content: FileContent) -> None:
    """Refuse FRFs of which most respond before the force, as with phases in e^{-jωt}.

    The conjugate of an FRF is its impulse response backwards in time, whatever its sign.
    """
    frf = content.frf
    assert frf is not None
    n_lines = frf.frequency_hz.size
    if n_lines < _FEWEST_LINES:
        return
    energy = np.abs(np.fft.ifft(frf.values, axis=1)) ** 2
    half = n_lines // 2
    after, before = energy[:, 1:half].sum(axis=1), energy[:, n_lines - half + 1 :].sum(axis=1)
    if np.mean(before > _BACKWARDS * after) > 0.5:
        found = "impulse responses that run backwards in time"
        rule = "phases must be those of e^{+jωt}; these are conjugate (e^{-jωt})"
        remedy = "Change the sign of the imaginary parts, or export with the other convention"
        raise RecordingFormatError(content.path.name, found, rule, remedy)


def _along_force(content: FileContent, findings: list[Finding]) -> FileContent:
    """FRFs on a circle in the direction of the force, where nodes were measured in several."""
    frf, names = content.frf, content.frf_names
    assert frf is not None
    axes = np.unique(frf.axis).tolist()
    if len(axes) < 2 or len(np.unique(frf.node)) == frf.n_positions:
        return content
    if content.frf_force_axis not in axes:
        found = f"responses in {' '.join(map(_axis_name, axes))}, force in another direction"
        rule = "on a circle, radial responses to a radial force are used"
        remedy = f"State the direction of the force in the file. {REMEDY}"
        raise RecordingFormatError(content.path.name, found, rule, remedy)
    kept = frf.axis == content.frf_force_axis
    detail = (
        f"{np.count_nonzero(~kept)} of {kept.size} FRFs are not in the direction of the force "
        f"({_axis_name(content.frf_force_axis)}): left out"
    )
    findings.append(Finding(content.path.name, "", None, Check.DIRECTION, Verdict.OK, detail))
    rows = np.flatnonzero(kept)
    return replace(content, frf=frf.rows(kept), frf_names=tuple(names[row] for row in rows))


def _axis_name(axis: int) -> str:
    return "?XYZ"[axis] if 0 <= axis <= 3 else str(axis)


def _rows_as_channels(content: FileContent) -> list[Channel]:
    """Name, node and angle of each row, as a channel without samples."""
    frf = content.frf
    assert frf is not None
    channels = []
    rows = zip(content.frf_names, frf.node, frf.position_deg, strict=True)
    for row, (name, node, angle) in enumerate(rows, 1):
        unique = name if content.frf_names.count(name) == 1 else f"{name} #{row}"
        angle_deg = None if np.isnan(angle) else float(angle)
        samples = frf.frequency_hz[:0]
        channels.append(
            Channel(unique, ACCELERATION, "", samples, node=int(node), angle_deg=angle_deg)
        )
    return channels


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
        found = f"no force among its columns {', '.join(recording.names[:_SHOWN_BESIDE])}"
    detail = f"a small table beside the recordings and none itself, set aside: {found}"
    return FileContent(path, findings=(remark(path, "", Check.CONTENT, detail),))


def without_results(contents: Sequence[FileContent]) -> list[FileContent]:
    """The contents, of which FRFs of a result are set aside and named where others have data."""
    if all(each.is_result for each in contents if each.has_data):
        return list(contents)
    detail = "FRFs of a result beside what others have measured: set aside"
    return [
        FileContent(each.path, findings=(remark(each.path, "", Check.CONTENT, detail),))
        if each.is_result
        else each
        for each in contents
    ]


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
    places = zip(frf.node.tolist(), frf.axis.tolist(), strict=True)
    forces = content.frf_forces or ((0, 0),) * frf.n_positions
    ends = [(*place, *force) for place, force in zip(places, forces, strict=True)]
    unknown = np.isnan(frf.coherence).all(axis=1)
    rows = [row for row in np.flatnonzero(unknown).tolist() if ends[row] in extra.values]
    if not rows or len(set(ends)) < len(ends):
        return content
    coherence = np.array(frf.coherence)
    coherence[rows] = [extra.values[ends[row]] for row in rows]
    return replace(content, frf=replace(frf, coherence=coherence))
