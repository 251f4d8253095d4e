"""Inspection of recordings before processing."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ema.core.errors import InputError
from ema.core.finding import Check, Finding, Verdict
from ema.core.frf import FRF
from ema.core.numerics import one_blas_thread
from ema.core.recording import VOLTAGE, Channel, Recording
from ema.core.units import is_stated
from ema.io.campaign.calibration import calibrated
from ema.io.campaign.manifest import MANIFEST_NAME, Manifest, read_manifest, resolve
from ema.io.campaign.read import recordings_in, with_frf_unit, with_rate
from ema.io.content import remark
from ema.io.formats import exists, is_folder, read_file, read_headers
from ema.signals.signal_checks import SignalSummary, level_findings, signal_findings, summarise
from ema.signals.spikes import with_limits
from pipelines.storage.result_folder import named


@dataclass(frozen=True, eq=False)
class ChannelReport:
    """One channel of a file, and its signal in SI units if it was read."""

    channel: Channel
    signal: SignalSummary | None
    findings: tuple[Finding, ...]


@dataclass(frozen=True, eq=False)
class FileReport:
    """Content of one file and what looks wrong in it."""

    path: Path
    size_bytes: int
    sampling_rate_hz: float  # NaN without time series, or if neither file nor manifest state it
    channels: tuple[ChannelReport, ...]  # time series
    frf: FRF | None
    frf_names: tuple[str, ...]
    findings: tuple[Finding, ...]  # about the file, not one of its channels

    @property
    def all_findings(self) -> tuple[Finding, ...]:
        """Findings about the file and its channels."""
        return (*self.findings, *(each for row in self.channels for each in row.findings))

    @property
    def wrong(self) -> tuple[Finding, ...]:
        """What looks wrong."""
        return tuple(f for f in self.all_findings if not f.is_ok and f.check != Check.CONTENT)

    @property
    def notes(self) -> tuple[Finding, ...]:
        """What is worth knowing but not wrong, as are datasets that a reader skipped."""
        return tuple(f for f in self.all_findings if f.is_ok or f.check == Check.CONTENT)


@dataclass(frozen=True)
class Inspection:
    """Reports on all files that can be read, and what is wrong with the others."""

    files: tuple[FileReport, ...]
    errors: tuple[InputError, ...]

    @property
    def looks_wrong(self) -> bool:
        """Whether anything is wrong with any file."""
        return bool(self.errors) or any(report.wrong for report in self.files)


def inspect_files(sources: Sequence[Path], *, levels: bool = True) -> Inspection:
    """Inspect recordings; an unreadable one does not hide the others.

    Parameters
    ----------
    sources : sequence of Path
        Recordings, folders of recordings, or manifests. A manifest (in a folder, or named) gives
        sampling rate and calibration where the files do not.
    levels : bool
        Whether to read the signals; otherwise read headers only.
    """
    found = [each for source in sources for each in _look(source, levels)]
    return Inspection(
        tuple(each for each in found if isinstance(each, FileReport)),
        tuple(each for each in found if isinstance(each, InputError)),
    )


def _look(source: Path, levels: bool) -> Iterator[FileReport | InputError]:
    """Report on each file of a source, or its error."""
    manifest, files = None, [source]
    in_folder = is_folder(source)
    if in_folder or source.suffix.lower() == ".toml":
        files = []
        try:
            files = recordings_in(source) if in_folder else []
            path = source / MANIFEST_NAME if in_folder else source
            if not in_folder or exists(path):
                manifest = read_manifest(path)
            if manifest is not None and not files:
                files = [resolve(source, run.file) for run in manifest.runs]
        except InputError as error:
            yield error
    for path in files:
        try:
            yield _report(path, manifest, levels)
        except InputError as error:
            yield error


@one_blas_thread
def _report(path: Path, manifest: Manifest | None, levels: bool) -> FileReport:
    content = read_file(path) if levels else read_headers(path)
    if manifest is not None and manifest.acquisition.frf_unit is not None:
        content = with_frf_unit(content, manifest.acquisition.frf_unit)
    recording, findings = content.recording, list(content.findings)
    if content.frf_without_unit:
        unstated = [content.frf_names[row] for row in content.frf_without_unit]
        detail = f"no unit of {named(unstated)}: set frf_unit in [acquisition] of the manifest"
        findings.append(remark(path, "", Check.UNIT, detail))
    channels: tuple[ChannelReport, ...] = ()
    rate_hz = float("nan")
    if recording is not None:
        recording, noticed = _with_manifest(recording, manifest)
        if manifest is not None and manifest.acquisition.sampling_rate_hz is not None:
            findings = [each for each in findings if each.check is not Check.SAMPLING_RATE]
        findings += [*noticed, *_remarks(recording)]
        summaries = None
        rate_hz = recording.sampling_rate_hz
        if levels:
            recording = with_limits(recording)
            summaries = [summarise(channel, rate_hz) for channel in recording.channels]
            findings += level_findings(recording, summaries)
        channels = tuple(_channel_reports(recording, summaries, findings))
    names = {row.channel.name for row in channels}
    return FileReport(
        path=path,
        size_bytes=path.stat().st_size,
        sampling_rate_hz=rate_hz,
        channels=channels,
        frf=content.frf,
        frf_names=content.frf_names,
        findings=tuple(finding for finding in findings if finding.channel not in names),
    )


def _with_manifest(
    recording: Recording, manifest: Manifest | None
) -> tuple[Recording, list[Finding]]:
    """Rate and calibration of this recording by the manifest."""
    if manifest is None:
        return recording, []
    recording = with_rate(recording, manifest.acquisition.sampling_rate_hz)
    findings: list[Finding] = []
    return calibrated(recording, manifest.calibration, findings), findings


def _remarks(recording: Recording) -> list[Finding]:
    """Rates, units and names that the manifest has to add."""
    file, findings = recording.path.name, []
    if np.isnan(recording.sampling_rate_hz):
        detail = "not stated: set sampling_rate_hz in [acquisition] of the manifest"
        findings.append(Finding(file, "", None, Check.SAMPLING_RATE, Verdict.OK, detail))
    for channel in recording.channels:
        if channel.quantity == VOLTAGE:
            detail = "volts: set a sensitivity in [calibration] of the manifest"
        elif not is_stated(channel.unit) and abs(channel.scale_to_si) != 1.0:
            detail = f"no unit stated: factor {abs(channel.scale_to_si):g} to SI by the file"
        elif not is_stated(channel.unit):
            detail = "no unit stated: taken as SI, unless [calibration] of the manifest sets one"
        else:
            continue
        place = file, channel.name, channel.angle_deg
        findings.append(Finding(*place, Check.UNIT, Verdict.OK, detail))
    detail = "several channels have this name; names must be unique"
    for name, count in Counter(recording.names).items():
        if count > 1:
            findings.append(Finding(file, name, None, Check.NAME, Verdict.WARNING, detail))
    return findings


def _channel_reports(
    recording: Recording, summaries: Sequence[SignalSummary] | None, findings: Sequence[Finding]
) -> Iterator[ChannelReport]:
    for row, channel in enumerate(recording.channels):
        about = [finding for finding in findings if finding.channel == channel.name]
        if channel.name in recording.names[:row]:  # reported for the first of that name
            about = []
        signal = None if summaries is None else summaries[row]
        if signal is not None:
            known = {finding.check for finding in about}  # some readers count missing samples
            found = signal_findings(signal, recording.path.name, channel)
            about += [finding for finding in found if finding.check not in known]
        yield ChannelReport(channel, signal, tuple(about))
