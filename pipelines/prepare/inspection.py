"""Inspect files before a manifest exists: what they hold, and what roles their channels have."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ema.core.errors import InputError
from ema.core.files import resolve
from ema.core.finding import Check, Finding, Verdict
from ema.core.frf import FRF
from ema.core.numerics import one_blas_thread
from ema.core.recording import ACCELERATION, FORCE, UNKNOWN, VOLTAGE, Channel, Recording, motions
from ema.core.units import is_stated
from ema.io.campaign.axes import calibrated
from ema.io.campaign.manifest import MANIFEST_NAME, Manifest, read_manifest
from ema.io.campaign.read import recordings_in, with_frf_unit, with_rate
from ema.io.campaign.references import exchanged_frfs
from ema.io.content import FileContent, remark
from ema.io.formats import exists, is_folder, read_file, read_headers
from ema.signals.signal_checks import SignalSummary, level_findings, signal_findings, summarise
from ema.signals.spikes_and_gaps import with_limits
from pipelines.storage.atomic import named

GEOMETRY, NODES, NAMES = "the file's geometry", "the node numbers", "the channels' names"
LAYOUT = "spacing and step"

_FORCE_NAME = re.compile(r"force|kraft|load.?cell|hammer|impedance|^f[0-9xyz]?$", re.IGNORECASE)
_REFERENCE_NAME = re.compile(
    r"((^|[^a-zA-Z])(?i:ref)|[a-z]R(ef|EF))($|[^a-zA-Z]|(?i:erence|erenz))"
)
_DEGREES = re.compile(r"(?<![0-9.,])([0-9]{1,3}(?:[.,][0-9]+)?)[ _]?(?:°|deg|grad)", re.IGNORECASE)
_NUMBER = re.compile(
    r"^(?:p|pos|position|point|pt|punkt|n|node)[ _.-]*([0-9]{1,4})[ _:.-]*[+-]?[xyz]?$",
    re.IGNORECASE,
)
# Common numbers of positions around a tyre; with fewer it could be any structure.
_PROBABLE_GRIDS = (24, 30, 36, 40, 45, 48, 60, 72, 80, 90, 96, 100, 120, 144, 180, 360)
_FULL_CIRCLE = 360
_ON_GRID = 0.01  # of a grid step, as names have few digits


@dataclass(frozen=True, eq=False)
class Source:
    """A file of the campaign and its channels; rows of FRFs count as accelerations."""

    path: Path
    channels: tuple[Channel, ...]
    sampling_rate_hz: float  # NaN for FRFs, and if the file does not state it
    has_frfs: bool
    force_node: int | None = None  # node of the force of the FRFs
    lacks_unit: bool = False  # whether FRFs have none


@dataclass(frozen=True)
class Layout:
    """Sensors evenly spaced in the order of their channels, turned from run to run; degrees."""

    spacing_deg: float
    step_deg: float = 0.0


@dataclass(frozen=True)
class Places:
    """Positions of the sensors, as far as files state them."""

    positions: int | None = None  # number of grid positions; None if unknown, or without a circle
    known_from: str = ""  # `GEOMETRY`, `NODES`, `NAMES` or `LAYOUT`; empty if unknown
    angle_deg: dict[tuple[Path, str], float] | None = None  # angles by file and channel on a circle
    is_guess: bool = False  # whether the number of positions is only probable


def sources_of(content: FileContent) -> list[Source]:
    """Time series and FRFs of a file."""
    found, unknown = [], float("nan")
    if content.frf is not None and (moved := exchanged_frfs([content])) is not None:
        content = moved[0]
    if (recording := content.recording) is not None:
        found.append(Source(content.path, recording.channels, recording.sampling_rate_hz, False))
    if (frf := content.frf) is not None:
        angles = [None if np.isnan(angle) else float(angle) for angle in frf.position_deg]
        nothing = np.zeros(0)
        channels = tuple(
            Channel(name, ACCELERATION, "m/s^2", nothing, node=int(node), angle_deg=angle)
            for name, node, angle in zip(content.frf_names, frf.node, angles, strict=True)
        )
        lacks_unit = bool(content.frf_without_unit)
        found.append(
            Source(content.path, channels, unknown, True, content.frf_force_node, lacks_unit)
        )
    return found


def needs_calibration(channel: Channel) -> bool:
    """Whether it is a signal in volts, or without a unit."""
    unstated = channel.quantity == UNKNOWN and not is_stated(channel.unit)
    return channel.quantity == VOLTAGE or unstated


def forces_in(source: Source) -> list[str]:
    """Names of the channels that may be the excitation: by quantity, or else by name."""
    forces = [channel.name for channel in source.channels if channel.quantity == FORCE]
    unknown = (channel.name for channel in source.channels if needs_calibration(channel))
    return forces or [name for name in unknown if _FORCE_NAME.search(name)]


def reference_of(sources: Sequence[Source]) -> str | None:
    """Name of the fixed sensor: by its name, or the only one that keeps its node in all runs."""
    sensors = [channel for source in sources for channel in sensors_in(source)]
    called = [channel.name for channel in sensors if _REFERENCE_NAME.search(channel.name)]
    if called or len(sources) < 2:
        return called[0] if called else None
    counts = Counter(channel.name for channel in sensors)
    nodes = {name: {c.node for c in sensors if c.name == name} for name in counts}
    in_all = (name for name, count in counts.items() if count == len(sources))
    fixed = [name for name in in_all if len(nodes[name] - {0}) == 1]
    moving = any(len(each) > 1 for each in nodes.values())
    return fixed[0] if len(fixed) == 1 and moving else None


def sensors_in(source: Source, reference: str | None = None) -> list[Channel]:
    """Channels that may be responses: motions, or else those without calibration."""
    others = {reference, *forces_in(source)}
    candidates = motions(source.channels)
    candidates = candidates or [c for c in source.channels if needs_calibration(c)]
    return [channel for channel in candidates if channel.name not in others]


def force_nodes(sources: Sequence[Source]) -> set[int | None]:
    """Nodes of the forces as the files state them."""
    forces = (c for source in sources for c in source.channels if c.name in forces_in(source))
    return {c.node for c in forces} | {s.force_node for s in sources if s.has_frfs}


def excitation_deg(sources: Sequence[Source], places: Places) -> float | None:
    """Angle of the force by geometry or node number."""
    forces = [c for source in sources for c in source.channels if c.name in forces_in(source)]
    angles = {channel.angle_deg for channel in forces}
    nodes = force_nodes(sources)
    if len(angles) == 1 and None not in angles:
        return angles.pop()
    if places.positions is None or places.known_from != NODES or len(nodes) != 1:
        return None
    node = nodes.pop()
    on_grid = node is not None and 0 <= node <= places.positions
    return _angle(node, places.positions) if node is not None and on_grid else None


def places_of(sources: Sequence[Source], reference: str | None) -> Places:
    """Positions of all sensors by geometry, node numbers, or names such as ``A01_030deg``, ``P12``.

    Unknown if one sensor does not fit, or if two of a run coincide.
    """
    sensors = [(source, c) for source in sources for c in sensors_in(source, reference)]
    if not sensors:
        return Places()
    angles = [channel.angle_deg for _, channel in sensors]
    if None not in angles:
        return _places_at(sensors, angles, GEOMETRY)
    if any(channel.node for _, channel in sensors):
        return _places_by_number(sensors, [c.node for _, c in sensors], NODES)
    degrees = [_matched(_DEGREES, channel.name) for _, channel in sensors]
    if all(angle is not None and angle <= 360 for angle in degrees):
        return _places_at(sensors, degrees, NAMES)
    numbers = [_matched(_NUMBER, channel.name) for _, channel in sensors]
    integers = [None if number is None else int(number) for number in numbers]
    found = _places_by_number(sensors, integers, NAMES)
    return found if found.positions else Places()


def places_laid_out(sources: Sequence[Source], reference: str | None, layout: Layout) -> Places:
    """Angles of sensors that are evenly spaced and turned from run to run; the first one at 0°."""
    sensors, angles = [], []
    for run, source in enumerate(sources):
        for number, channel in enumerate(sensors_in(source, reference)):
            sensors.append((source, channel))
            angles.append(layout.spacing_deg * number + layout.step_deg * run)
    places = _places_at(sensors, angles, LAYOUT)
    if not places.known_from:
        n_sensors = len(sensors_in(sources[0], reference))
        found, rule = f"{layout.spacing_deg:g}° between {n_sensors} sensors", "two sensors coincide"
        remedy = "Correct the spacing, or name the sensor that stays in place with --reference"
        raise InputError("--spacing-deg", found, rule, remedy)
    return places


def _matched(pattern: re.Pattern[str], name: str) -> float | None:
    found = pattern.findall(name)
    return float(found[0].replace(",", ".")) if len(found) == 1 else None


def _places_by_number(
    sensors: Sequence[tuple[Source, Channel]], numbers: Sequence[int | None], known_from: str
) -> Places:
    known = [number for number in numbers if number is not None]
    if len(known) < len(numbers):
        return Places()
    positions, is_guess = _grid_of_numbers(known)
    if positions is None:
        return Places(known_from=known_from)
    found = _places_at(sensors, [_angle(number, positions) for number in known], known_from)
    return replace(found, positions=positions, is_guess=is_guess) if found.known_from else found


def _angle(number: int, positions: int) -> float:
    """Number k is at k·360/positions degrees; counted from 1, the last one is at 0."""
    return number % positions * 360.0 / positions


def _places_at(
    sensors: Sequence[tuple[Source, Channel]], angles: Sequence[float | None], known_from: str
) -> Places:
    """Places of known angles, unless two of a run coincide."""
    angle_deg = {
        (source.path, channel.name): round((angle or 0.0) % 360.0, 6)
        for (source, channel), angle in zip(sensors, angles, strict=True)
    }
    distinct = {(path, angle) for (path, _), angle in angle_deg.items()}
    if len(distinct) < len(sensors):
        return Places()
    positions = _grid_of_angles(angle_deg.values())
    return Places(positions or _FULL_CIRCLE, known_from, angle_deg, is_guess=positions is None)


def _grid_of_angles(angles_deg: Iterable[float]) -> int | None:
    """Coarsest regular grid with all angles on it; None if there is none."""
    angles = np.array(list(angles_deg)) / 360.0
    for positions in range(3, _FULL_CIRCLE + 1):
        steps = angles * positions
        if np.all(np.abs(steps - np.round(steps)) < _ON_GRID):
            return positions
    return None


def _grid_of_numbers(numbers: Sequence[int]) -> tuple[int | None, bool]:
    """Grid that numbers from 0 or 1 fill; else the next larger one, as a guess."""
    distinct = sorted(set(numbers))
    lowest, highest = distinct[0], distinct[-1]
    step = math.gcd(*(number - lowest for number in distinct)) or 1
    filled = highest + step if lowest == 0 else highest
    if filled in _PROBABLE_GRIDS and lowest in (0, step):
        return filled, False
    if lowest == 0 and highest in _PROBABLE_GRIDS:  # 0 and 360 degrees are counted both
        return highest, True
    larger = next((grid for grid in _PROBABLE_GRIDS if grid >= filled), None)
    probable = larger is not None and 2 * len(distinct) >= larger and lowest <= step
    return (larger, True) if probable else (None, False)


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
