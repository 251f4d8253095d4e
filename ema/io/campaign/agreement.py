"""Cross-run checks: duplicate files, sampling rates, run lengths and grid coverage."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Sequence
from itertools import combinations
from pathlib import Path

import numpy as np

from ema.core.arrays import stacked
from ema.core.campaign import Run
from ema.core.errors import RecordingFormatError
from ema.core.finding import OK, WARNING, Finding
from ema.core.frf import FRF
from ema.core.recording import ACCELERATION, Channel, Recording
from ema.io.campaign.manifest import MANIFEST_NAME
from ema.io.campaign.roles import Grid
from ema.io.content import FileContent
from ema.signals.damage import SAME_LENGTH

RATE_TOLERANCE = 1e-4  # relative: programs print rates with few digits
_PROBE_BYTES = 1 << 16
_SHOWN = 12


def check_duplicates(paths: Sequence[Path]) -> None:
    """Refuse two files with the same content: one run would stand in the place of another.

    Files of one size are compared at their start, middle and end, and by SHA-256 only where those
    agree.

    Raises
    ------
    RecordingFormatError
        Naming both files.
    """
    probes = Counter((path.stat().st_size, _probe(path)) for path in paths)
    for one, other in combinations(paths, 2):
        size = one.stat().st_size
        if size != other.stat().st_size or probes[size, _probe(one)] < 2:
            continue
        if _sha256(one) == _sha256(other):
            rule = f"it is {one.name} again, byte for byte, and a run counts once"
            remedy = "Remove one of them, or copy the right recording into its place"
            raise RecordingFormatError(str(other), "a duplicated file", rule, remedy)


def _probe(path: Path) -> bytes:
    size = path.stat().st_size
    with path.open("rb") as file:
        parts = []
        for start in (0, size // 2, max(size - _PROBE_BYTES, 0)):
            file.seek(start)
            parts.append(file.read(_PROBE_BYTES))
    return b"".join(parts)


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def run_names(paths: Sequence[Path]) -> list[str]:
    """Names of runs: those of their files, with as much of the folder as tells them apart."""
    for depth in range(1, max(len(path.parts) for path in paths)):
        names = ["/".join(path.parts[-depth:]) for path in paths]
        if len(set(names)) == len(names):
            return names
    return [path.as_posix() for path in paths]


def check_rates(recordings: Sequence[Recording]) -> None:
    """Refuse recordings without a sampling rate, or with different ones.

    Raises
    ------
    RecordingFormatError
    """
    first = recordings[0]
    for recording in recordings:
        rate = recording.sampling_rate_hz
        if np.isnan(rate):
            rule = "a file without a time column needs a sampling rate in the manifest"
            remedy = (
                f"Set acquisition.sampling_rate_hz in {MANIFEST_NAME} "
                "(`ringmodal init FOLDER` drafts one)"
            )
            raise RecordingFormatError(recording.path.name, "no sampling rate", rule, remedy)
        if abs(rate - first.sampling_rate_hz) > RATE_TOLERANCE * rate:
            rule = f"{first.path.name} was sampled at {first.sampling_rate_hz:g} Hz"
            remedy = "All runs of a campaign share one rate: resample, or process them apart"
            raise RecordingFormatError(recording.path.name, f"{rate:g} Hz", rule, remedy)


def coverage_findings(runs: Sequence[Run], positions: int | None) -> list[Finding]:
    """What makes the runs poorer than they could be, though not wrong."""
    return [
        *_lengths(runs),
        *_without_reference(runs, positions),
        *_missing_positions(runs, positions),
        *_repeated_positions(runs, positions),
    ]


def _lengths(runs: Sequence[Run]) -> list[Finding]:
    """Runs that are not as long as most; the longest is the measure where most differ."""
    durations = [run.recording.duration_s for run in runs]
    usual = _usual(durations)
    findings = []
    for run, duration_s in zip(runs, durations, strict=True):
        place = (run.name, "", None, "length")
        if duration_s < (1 - SAME_LENGTH) * usual:
            detail = f"{duration_s:.4g} s long, others {usual:.4g} s: fewer averages"
            findings.append(Finding(*place, WARNING, detail))
        elif duration_s > (1 + SAME_LENGTH) * usual:
            detail = f"{duration_s:.4g} s long, others {usual:.4g} s: more averages"
            findings.append(Finding(*place, OK, detail))
    return findings


def _usual(durations: Sequence[float]) -> float:
    """Length that more than half of the runs have, or that of the longest."""
    middle = float(np.median(durations))
    alike = np.abs(np.array(durations) - middle) <= SAME_LENGTH * middle
    return middle if np.mean(alike) > 0.5 else max(durations)


def _without_reference(runs: Sequence[Run], positions: int | None) -> list[Finding]:
    without = [run.name for run in runs if run.reference is None]
    if positions is None or len(runs) < 2 or not without:
        return []
    detail = "no run has a reference sensor: only its modes may tell whether the tyre changed"
    if len(without) < len(runs):
        detail = f"no reference sensor in {', '.join(without)}: not compared with the other runs"
    return [Finding("", "", None, "reference", WARNING, detail)]


def _missing_positions(runs: Sequence[Run], positions: int | None) -> list[Finding]:
    if positions is None:
        return []
    measured = {response.node for run in runs for response in run.responses}
    missing = [node * 360.0 / positions for node in range(positions) if node not in measured]
    if not missing:
        return []
    detail = f"{len(missing)} of {positions} grid positions not measured: {_degrees(missing)}"
    return [Finding("", "", None, "grid", WARNING, detail)]


def _repeated_positions(runs: Sequence[Run], positions: int | None) -> list[Finding]:
    """Positions measured in several runs: all of them equally often is a plan, a few are a slip."""
    angles = [r.position_deg for run in runs for r in run.responses if r.position_deg is not None]
    times = Counter(round(angle, 6) for angle in angles)
    repeated = sorted(angle for angle, count in times.items() if count > 1)
    if positions is None or not repeated:
        return []
    if len(set(times.values())) == 1:
        detail = f"each position measured in {times[repeated[0]]} runs and averaged"
        return [Finding("", "", None, "grid", OK, detail)]
    detail = f"measured in several runs and averaged: {_degrees(repeated)}; intended?"
    return [Finding("", "", None, "grid", WARNING, detail)]


def _degrees(angles: Sequence[float]) -> str:
    more = " …" if len(angles) > _SHOWN else ""
    return ", ".join(f"{angle:g}" for angle in angles[:_SHOWN]) + f"{more} degrees"


def merge(
    contents: Sequence[FileContent],
    positions_deg: Sequence[dict[str, float] | None],
    positions: int | None,
) -> tuple[FRF, list[Finding]]:
    """Stack the FRFs of all files that hold some; they share their frequency lines.

    Parameters
    ----------
    contents : sequence of FileContent
        Files with an `frf`.
    positions_deg : sequence of dict or None
        Angles by name, for each file.
    positions : int or None
        Number of grid positions.

    Raises
    ------
    RecordingFormatError
        If lines differ between files.
    ManifestError
        If there is a grid and the place of a row is not known.
    """
    frfs = [content.frf for content in contents if content.frf is not None]
    first = frfs[0].frequency_hz
    for content, frf in zip(contents, frfs, strict=True):
        lines = frf.frequency_hz
        if len(lines) != len(first) or not np.allclose(lines, first, rtol=1e-6):
            found = f"{len(lines)} lines to {lines[-1]:g} Hz"
            rule = f"{contents[0].path.name} has {len(first)} lines to {first[-1]:g} Hz"
            remedy = "Process files of different resolution one by one"
            raise RecordingFormatError(content.path.name, found, rule, remedy)
    rows = [_rows_as_channels(content) for content in contents]
    channels = [channel for of_file in rows for channel in of_file]
    grid = Grid.over(positions, channels)
    findings: list[Finding] = []
    places = [
        grid.place(content.path, channel, given, findings)
        for content, of_file, given in zip(contents, rows, positions_deg, strict=True)
        for channel in of_file
    ]
    return FRF(
        frequency_hz=first,
        values=stacked([frf.values for frf in frfs]),
        coherence=stacked([frf.coherence for frf in frfs]),
        std=stacked([frf.std for frf in frfs]),
        node=np.array([-1 if place.node is None else place.node for place in places]),
        position_deg=np.array(
            [np.nan if place.angle_deg is None else place.angle_deg for place in places]
        ),
        run=tuple(run for frf in frfs for run in frf.run),
    ), findings


def _rows_as_channels(content: FileContent) -> list[Channel]:
    """Name, node and angle of each row, as a channel without samples."""
    frf = content.frf
    assert frf is not None
    names = [
        name if content.frf_names.count(name) == 1 else f"{name} #{row}"
        for row, name in enumerate(content.frf_names, 1)
    ]
    return [
        Channel(
            name=name,
            quantity=ACCELERATION,
            unit="",
            samples=frf.frequency_hz[:0],
            node=int(node),
            angle_deg=None if np.isnan(angle) else float(angle),
        )
        for name, node, angle in zip(names, frf.node, frf.position_deg, strict=True)
    ]
