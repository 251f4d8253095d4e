"""Read a campaign from a folder, a manifest or self-describing recordings."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import replace
from functools import partial
from itertools import chain
from pathlib import Path

import numpy as np

from ema.core.campaign import Campaign, Run, with_later_findings
from ema.core.display import counted
from ema.core.errors import ManifestError, RecordingFormatError, nearest, require_type
from ema.core.files import USE_SLASHES, resolve
from ema.core.finding import Check, Finding, Verdict
from ema.core.frf_arrays import one_angle
from ema.core.recording import Recording
from ema.core.references import References
from ema.core.settings import CheckSettings, IdentificationSettings, settings_from
from ema.io.campaign import agreement
from ema.io.campaign.agreement import joined, read_folder, without_results
from ema.io.campaign.axes import (
    Around,
    calibrated,
    channels_along_circle,
    check_keys,
    frfs_along_circle,
)
from ema.io.campaign.manifest import MANIFEST_NAME, Manifest, read_manifest
from ema.io.campaign.references import (
    at_usual_place,
    check_references,
    exchanged,
    exchanged_frfs,
    grouped,
    of_one_force,
    roving,
    stated_forces,
)
from ema.io.campaign.roles import Grid, Wanted, assign, by_direction, ring_runs
from ema.io.content import FileContent, note, unreadable
from ema.io.formats import exists, is_folder, is_recording, is_text_table, read_file
from ema.io.frf_table import inertances
from ema.io.rates import SAME_RATE
from ema.signals.spikes_and_gaps import FirstLook, with_limits

_SAME_ANGLE_DEG = 1e-6
_OF_A_RESULT = "provenance.json"


def read_campaign(
    source: str | Path | Sequence[str | Path], *, only: Collection[str] | None = None
) -> Campaign:
    """Read recordings and manifest, check them and give each channel its role.

    Parameters
    ----------
    source : path or sequence of paths
        A folder (with ``campaign.toml``, or with recordings alone), a manifest, a recording, or
        several recordings.
    only : collection of str, optional
        Of the files that a manifest names, those that are read: the others may be missing, as in a
        campaign that is still being measured.

    Returns
    -------
    Campaign
        Runs whose samples stay on disk where the format allows, or FRFs.

    Raises
    ------
    RecordingFormatError
        If a file is missing, damaged, or has no usable data.
    ManifestError
        If the manifest is faulty or contradicts the recordings.

    Examples
    --------
    >>> import ringmodal as rm
    >>> campaign = rm.read_campaign("sample_data/tyre_225_55R17")
    >>> campaign
    <Campaign tyre_225_55R17: 6 runs with 72 responses, tyre 225/55R17>
    >>> campaign.findings  # nothing is wrong with these recordings
    ()
    """
    several = source if isinstance(source, Iterable) and not isinstance(source, str) else [source]
    remedy = "Name a folder, a manifest or recordings"
    paths = [Path(require_type("campaign", each, (str, Path), remedy)) for each in several]
    if len(paths) == 1 and is_folder(paths[0]):
        if exists(paths[0] / MANIFEST_NAME):
            return _with_manifest(paths[0] / MANIFEST_NAME, only)
        name, paths = paths[0].resolve().name, recordings_in(paths[0])
        contents = _usable(read_folder(paths))
    elif len(paths) == 1 and paths[0].suffix.lower() == ".toml":
        return _with_manifest(paths[0], only)
    elif not paths:
        rule = "a campaign needs at least one recording"
        raise RecordingFormatError("campaign", "no files", rule, "Name the recordings")
    else:
        name = paths[0].stem if len(paths) == 1 else paths[0].resolve().parent.name
        contents = _usable([read_file(path) for path in paths])
    files = [(with_frf_unit(content, None), Wanted()) for content in contents]
    return _fill(Campaign(name=name, sources=tuple(path.resolve() for path in paths)), files)


def recordings_in(folder: Path) -> list[Path]:
    """Recordings of a folder without hidden files, config_2 before config_10.

    Dead links stay in the list, for the error about them when they are read. `RecordingFormatError`
    if there are none, or the folder cannot be read.
    """
    if folder.is_file():
        rule, remedy = "the folder of a campaign is needed", f"Name its folder, {folder.parent}"
        raise RecordingFormatError(str(folder), "a file", rule, remedy)
    try:
        listed = [path for path in folder.iterdir() if not path.name.startswith(".")]
    except OSError as error:
        raise unreadable(folder, error, "the folder of a campaign must be readable") from error
    files = [path for path in listed if not path.is_dir()]
    if any(path.name == _OF_A_RESULT for path in files):
        rule = "it is a folder of results, and recordings are needed"
        remedy = "Name the folder of the recordings; `ringmodal report` and `tune` take a result"
        raise RecordingFormatError(str(folder), f"{_OF_A_RESULT} in it", rule, remedy)
    found = list(filter(is_recording, files)) or list(filter(is_text_table, files))
    if not found:
        rule = f"a campaign needs recordings, and a {MANIFEST_NAME} where they are incomplete"
        raise RecordingFormatError(str(folder), "no recordings", rule, "Check the folder name")
    return sorted(found, key=lambda path: [*map(_number, re.split(r"([0-9]+)", path.name))])


def _number(part: str) -> tuple[int, str]:
    return (int(part), "") if part.isdecimal() and len(part) < 100 else (-1, part)


def _with_manifest(path: Path, only: Collection[str] | None) -> Campaign:
    manifest = read_manifest(path)
    if only is not None:
        there = [section for section in manifest.runs if section.file in only]
        manifest = manifest.model_copy(update={"runs": there})
    files = _files_of(path, manifest)
    contents = _usable([read_file(file) for file in files])
    names = {name for each in contents if each.recording for name in each.recording.names}
    check_keys(names, "calibration", manifest.calibration)
    if names:
        check_keys(names, "sensors.mass_kg", manifest.sensors.own_kg)
    runs = [
        _run_by_manifest(content, manifest, number) for number, content in enumerate(contents, 1)
    ]
    usual = manifest.excitations[0]
    angle = usual.position_deg if len(manifest.excitations) == 1 else None
    campaign = Campaign(
        name=path.resolve().parent.name,
        tyre=None if manifest.tyre is None else manifest.tyre.tyre(),
        positions=None if manifest.grid is None else manifest.grid.positions,
        excitation_deg=None if manifest.grid is None or angle is None else angle % 360.0,
        sensor_mass_kg=manifest.sensors.default_kg,
        own_masses_kg=manifest.sensors.own_kg,
        live_mass_kg=usual.live_mass_kg,
        processing=manifest.processing.processing(),
        tuning=manifest.tuning.table(),
        identification=settings_from(
            IdentificationSettings, manifest.identification, f"{path.name}, [identification]"
        ),
        checks=settings_from(CheckSettings, manifest.checks, f"{path.name}, [checks]"),
        sources=(path.resolve(), *files),
    )
    return _fill(campaign, runs)


def _files_of(path: Path, manifest: Manifest) -> list[Path]:
    """Paths of the files of the runs, which must exist and be named once."""
    files: list[Path] = []
    for number, section in enumerate(manifest.runs, 1):
        where = f"{path.name}, runs.{number}.file"
        file = resolve(path, section.file)
        if not exists(file):
            remedy = _instead_of(section.file, path.parent)
            raise ManifestError(where, repr(section.file), "the file does not exist", remedy)
        if file in files:
            rule = f"run {files.index(file) + 1} names the same file"
            raise ManifestError(where, repr(section.file), rule, "Name each file once")
        files.append(file)
    return files


def _instead_of(file: str, folder: Path) -> str:
    """What to write for a file that does not exist; a backslash may have made a tab."""
    if "\\" in file or not file.isprintable():
        return f"Check the backslash: {USE_SLASHES}"
    return nearest(file, sorted(each.name for each in folder.iterdir()))


def _usable(read: Sequence[FileContent]) -> list[FileContent]:
    """Contents completed by one another; refused if none has data, or two are the same."""
    contents, paths = joined(without_results(read)), [each.path for each in read]
    agreement.check_duplicates(paths)
    if not any(each.has_data for each in contents):
        notes = "; ".join(finding.detail for each in contents for finding in each.findings)
        found = f"no time series and no FRFs ({notes or 'no datasets'})"
        rule = "no usable datasets"
        remedy = "Export time series (function type 1) or FRFs (function type 4)"
        raise RecordingFormatError(", ".join(path.name for path in paths), found, rule, remedy)
    return contents


def _run_by_manifest(
    content: FileContent, manifest: Manifest, number: int
) -> tuple[FileContent, Wanted]:
    """A run with its rate and calibration by the manifest, and what that states about it."""
    section = manifest.runs[number - 1]
    where = f"{MANIFEST_NAME}, runs.{number} ({section.file})"
    content = with_frf_unit(content, manifest.acquisition.frf_unit)
    names = () if content.recording is None else content.recording.names
    wanted = Wanted(
        where=where,
        forces=stated_forces(manifest, section, where, names),
        reference=section.reference,
        positions_deg=section.positions_deg,
        directions=section.directions,
        force_direction=section.excitations[0].direction,
        axes=None if manifest.grid is None else manifest.grid.axes,
    )
    if content.recording is not None:
        rate_hz = manifest.acquisition.sampling_rate_hz
        findings = [
            each
            for each in content.findings
            if rate_hz is None or each.check is not Check.SAMPLING_RATE
        ]
        recording = with_rate(content.recording, rate_hz)
        recording = calibrated(recording, manifest.calibration, findings)
        content = replace(content, recording=recording, findings=tuple(findings))
    elif content.frf is None and content.nodes is None and content.coherences is None:
        notes = "; ".join(finding.detail for finding in content.findings)
        found = "neither time series nor FRFs" + (f" ({notes})" if notes else "")
        rule = "each run must contain time series or FRFs"
        raise ManifestError(where, found, rule, "Give another file or remove the run")
    return content, wanted


def with_rate(recording: Recording, rate_hz: float | None) -> Recording:
    """Take the rate of the manifest where the file leaves it open; elsewhere they must agree."""
    if rate_hz is None:
        return recording
    low_hz, high_hz = recording.rate_range_hz
    known_hz = recording.sampling_rate_hz
    if np.isnan(known_hz) or low_hz * (1 - SAME_RATE) <= rate_hz <= high_hz * (1 + SAME_RATE):
        return replace(recording, sampling_rate_hz=rate_hz, rate_range_hz=(rate_hz, rate_hz))
    if abs(known_hz - rate_hz) > SAME_RATE * rate_hz:
        where = f"{MANIFEST_NAME}, acquisition.sampling_rate_hz"
        rule = f"{recording.path.name} was sampled at {known_hz:g} Hz"
        if high_hz - low_hz > SAME_RATE * known_hz:
            rule += f" ({low_hz:.6g} to {high_hz:.6g} Hz by its digits)"
        raise ManifestError(where, f"{rate_hz:g} Hz", rule, "Correct or remove the key")
    return recording


def with_frf_unit(content: FileContent, unit: str | None) -> FileContent:
    """FRFs whose file states no unit as inertances by the unit of the manifest; else refused."""
    frf, rows = content.frf, list(content.frf_without_unit)
    if frf is None or not rows:
        return content
    name = content.frf_names[rows[0]]
    converted = None if unit is None else inertances(frf.values[rows], unit, frf.frequency_hz)
    if converted is None:
        place, found = f"{content.path.name}, {name!r}", "no unit"
        if unit is not None:
            place, found = f"{MANIFEST_NAME}, acquisition.frf_unit", repr(unit)
        rule = "an FRF must be acceleration, velocity or displacement over force"
        remedy = 'Export it with its unit, or state it in the manifest: frf_unit = "(m/s^2)/N"'
        raise RecordingFormatError(place, found, rule, f"{remedy} in [acquisition]")
    values = np.array(frf.values)
    values[rows], detail = converted
    said = f"{counted(len(rows), 'FRF')} without unit, taken as {unit} by the manifest"
    finding = note(content.path, Check.UNIT, f"{said}; {detail}" if detail else said)
    findings = (*content.findings, finding)
    return replace(content, frf=replace(frf, values=values), findings=findings, frf_without_unit=())


def _fill(campaign: Campaign, files: Sequence[tuple[FileContent, Wanted]]) -> Campaign:
    """Add FRFs where the files have some, and else the runs."""
    findings = [finding for content, _ in files for finding in content.findings]
    campaign = agreement.with_stated_windows(campaign, [each for each, _ in files], findings)
    frfs = [(each, wanted) for each, wanted in files if each.frf is not None]
    if frfs:
        detail = "time series beside FRFs: the FRFs are used, the time series are left out"
        findings += [
            Finding(each.path.name, "", None, Check.CONTENT, Verdict.EXCLUDED, detail)
            for each, _ in files
            if each.recording is not None
        ]
        return _fill_frfs(campaign, frfs, findings)
    files = [_along_circle(campaign, content, wanted, findings) for content, wanted in files]
    recordings = [(each.recording, wanted) for each, wanted in files if each.recording is not None]
    return _fill_runs(campaign, recordings, findings)


def _fill_frfs(
    campaign: Campaign, files: Sequence[tuple[FileContent, Wanted]], findings: list[Finding]
) -> Campaign:
    """Add FRFs, by the place of their force where there are several."""
    contents = [content for content, _ in files]
    if (moved := exchanged_frfs(contents)) is not None:
        findings.append(roving(len({force for each in moved for force in each.frf_forces})))
    parts = [
        _along_circle(campaign, replace(part, recording=None), wanted, findings)
        for content, (_, wanted) in zip(moved or contents, files, strict=True)
        for part in of_one_force(content)
    ]
    groups = grouped(parts, campaign.positions, campaign.excitation_deg, findings)
    merged = []
    for force, group in groups:
        given = [(content, wanted.positions_deg) for content, wanted in group]
        frf = agreement.merge(given, campaign.positions, findings)
        merged.append(replace(frf, excitation_deg=one_angle(force.position_deg)))
    if len(merged) > 1:
        agreement.check_lines(merged)
        lines = merged[0].frequency_hz  # equal within rounding
        several = References(tuple(replace(frf, frequency_hz=lines) for frf in merged))
        angle_deg = groups[0][0].position_deg
        return replace(campaign, frf=several, excitation_deg=angle_deg, findings=tuple(findings))
    stated_deg = groups[0][1][0][1].forces[0].position_deg
    if campaign.excitation_deg is None and stated_deg is not None and campaign.has_circle:
        campaign = replace(campaign, excitation_deg=stated_deg % 360.0)
    return replace(campaign, frf=merged[0], findings=tuple(findings))


def _along_circle(
    campaign: Campaign, content: FileContent, wanted: Wanted, findings: list[Finding]
) -> tuple[FileContent, Wanted]:
    """Content by radial, tangential and axial motion; FRFs by the radial alone."""
    if campaign.positions is None:
        return content, wanted
    stated_deg = wanted.forces[0].position_deg
    force_deg = campaign.excitation_deg if stated_deg is None else stated_deg
    around = Around(content, wanted, campaign.positions, force_deg)
    if content.frf is not None:
        turned = frfs_along_circle(around, findings)
        return (content if turned is None else turned), wanted
    if content.recording is not None:
        return channels_along_circle(around, findings) or (content, wanted)
    return content, wanted


def _fill_runs(
    campaign: Campaign, recordings: Sequence[tuple[Recording, Wanted]], findings: list[Finding]
) -> Campaign:
    agreement.check_rates([recording for recording, _ in recordings])
    channels = [each.possible_responses(recording.channels) for recording, each in recordings]
    grid = Grid.over(campaign.positions, list(chain.from_iterable(channels)))
    runs, reference_deg = [], None
    noticed: list[_Noticed] = [findings]
    names = agreement.run_names([recording.path for recording, _ in recordings])
    for name, (recording, each) in zip(names, recordings, strict=True):
        look, own = FirstLook(recording), list[Finding]()
        run = assign(with_limits(recording, look), each, grid, name, own)
        runs.append(run)
        if run.reference is not None:
            reference_deg = _same_place(run, each, grid, reference_deg)
        in_use = (*run.channels, *(force.channel for force in run.forces[1:]))
        noticed += [own, partial(look.findings, name, replace(recording, channels=in_use))]
    findings = []
    noticed.append(findings)
    findings += grid.off_grid([place for run in runs for place in (*run.responses, *run.others)])
    campaign = _with_masses_of_sums(campaign, [each for _, each in recordings])
    _require_masses(campaign, runs)
    stated = [each for _, each in recordings]
    runs = at_usual_place(runs, stated, campaign.excitation_deg, grid, findings)
    kept = ring_runs(runs, stated, findings)
    others = by_direction(campaign, runs, stated)
    if (moved := exchanged(kept)) is not None:
        sensors, reference_deg = [each.channel.name for each in kept[0].responses], None
        # The sensor stays at what is now the force, and its mass with it.
        mass_kg = campaign.mass_of(sensors[0]) if len(sensors) == 1 else None
        campaign = replace(campaign, live_mass_kg=mass_kg, sensor_mass_kg=None, own_masses_kg={})
        findings.append(roving(len(sensors)))
        kept = moved
    check_references(kept)
    findings += agreement.coverage_findings(kept, campaign.positions)
    campaign = replace(
        campaign,
        runs=tuple(kept),
        excitation_deg=kept[0].forces[0].position_deg,
        reference_deg=reference_deg,
        others=others,
    )
    return with_later_findings(campaign, partial(_all_of, noticed))


_Noticed = Sequence[Finding] | Callable[[], Sequence[Finding]]


def _all_of(noticed: Sequence[_Noticed]) -> tuple[Finding, ...]:
    """Findings in the order of the runs; those about samples take a look at them."""
    parts = (each() if callable(each) else each for each in noticed)
    return tuple(chain.from_iterable(parts))


def _with_masses_of_sums(campaign: Campaign, stated: Sequence[Wanted]) -> Campaign:
    """Give channels that are sums of others at one place the mass of the sensor there.

    The channels of a triaxial sensor are one body. Without masses of their own the default holds.
    """
    own = dict(campaign.own_masses_kg)
    for name, members in chain.from_iterable(each.sums.items() for each in stated):
        masses = {campaign.mass_of(member) for member in members}
        if own and len(masses) > 1:
            found = f"{', '.join(members)} of different or unknown mass"
            rule = "channels that together give one motion must be of one sensor"
            remedy = "Give each of them the mass of all that is at its place"
            raise ManifestError(f"{MANIFEST_NAME}, sensors.mass_kg", found, rule, remedy)
        if own and (mass_kg := masses.pop()) is not None:
            own[name] = mass_kg
    return replace(campaign, own_masses_kg=own)


def _require_masses(campaign: Campaign, runs: Sequence[Run]) -> None:
    """Refuse masses of some sensors without those of the others."""
    sensors = [each.name for run in runs for each in run.sensors]
    unknown = [name for name in dict.fromkeys(sensors) if campaign.mass_of(name) is None]
    if campaign.own_masses_kg and unknown:
        raise ManifestError(
            f"{MANIFEST_NAME}, sensors.mass_kg",
            f"no mass of {', '.join(unknown)}",
            "where sensors have masses of their own, that of every sensor must be known",
            "Add default = … for all others, or name each (0 for one that does not touch the tyre)",
        )


def _same_place(run: Run, wanted: Wanted, grid: Grid, others: float | None) -> float | None:
    """Angle of the reference, which must be the same in all runs."""
    assert run.reference is not None
    angle = grid.known_place(run.reference, wanted.positions_deg).position_deg
    if angle is not None and others is not None and abs(angle - others) > _SAME_ANGLE_DEG:
        found = f"reference at {angle:g} degrees"
        rule = f"in earlier runs it is at {others:g}, and it must stay in place"
        raise ManifestError(f"{wanted.where}, reference", found, rule, "Correct its position")
    return others if angle is None else angle
