"""A campaign that is still being measured: what each run is worth, and what to do next."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

import ema
from ema.checks.corrections import screen
from ema.checks.quality import check_reference, coherence_findings, gain_findings, reference_finding
from ema.core.campaign import Campaign
from ema.core.errors import FitError, InputError
from ema.core.files import resolve
from ema.core.finding import Check, Finding, Verdict
from ema.core.frf import FRF, TYRE_BAND_HZ
from ema.core.recording import Channel
from ema.core.references import frfs_of
from ema.core.units import SI_UNIT
from ema.io.campaign.manifest import MANIFEST_NAME, RunSection, read_manifest
from ema.io.campaign.read import recordings_in
from ema.io.formats import read_headers
from pipelines.results.tables import in_band

_SETTLED_S = 2.0  # a file that has not changed for so long is written
_EVERY_S = 0.5  # between looks at sizes and times
_FIRST_LOOK_S = 60.0
_SHIFT_STEPS = 5  # after three, a shift of 2 % is known to 1e-4 of it
#: What a run is measured again for; other warnings are shown.
_REPEAT = frozenset(
    {
        *(Check.CLIPPED, Check.SILENT, Check.DROPOUT, Check.STUCK, Check.MISSING_SAMPLES),
        *(Check.LOST_SAMPLES, Check.DOUBLE_HITS, Check.COHERENCE, Check.EXCITATION),
        *(Check.REFERENCE, Check.GAIN, Check.LENGTH, Check.LEVEL, Check.DEAD, Check.INCOHERENT),
        Check.AVERAGED_RUNS,
    }
)
_PLACES = "campaign.toml says where they are; `ringmodal init FOLDER` writes a draft."
# Of runs that are not measured yet, or checks that ask for all of them.
_TOO_EARLY = frozenset({Check.GRID, Check.AVERAGES, Check.NODE})


@dataclass(frozen=True)
class RunSeen:
    """A run as it is on the drive, and what was found in it."""

    name: str
    state: str  # {"measured", "being written", "missing", "unreadable", "not checked"}
    content: Mapping[str, Any]
    lines: tuple[Finding, ...] = ()
    error: str = ""

    @property
    def faults(self) -> list[Finding]:
        """Reasons to measure it again."""
        return [each for each in self.lines if not each.is_ok and each.check in _REPEAT]


@dataclass(frozen=True)
class Expected:
    """The runs of a campaign that its manifest names, or the recordings that are there."""

    folder: Path
    files: dict[str, Path]
    sections: dict[str, RunSection]  # empty without a manifest

    @property
    def is_planned(self) -> bool:
        """Whether it is known how many runs there will be."""
        return bool(self.sections)


def expected(folder: Path) -> Expected:
    """The runs of a campaign's folder; none as long as nothing is there."""
    manifest = folder / MANIFEST_NAME
    if manifest.is_file():
        sections = {section.file: section for section in read_manifest(manifest).runs}
        files = {name: resolve(manifest, name) for name in sections}
        return Expected(folder, files, sections)
    try:
        found = recordings_in(folder)
    except InputError:
        found = []
    return Expected(folder, {path.name: path for path in found}, {})


def settled(runs: Expected, now_s: float | None = None) -> dict[str, tuple[int, int]]:
    """Size and time of the files that are written, by name."""
    now_s = time.time() if now_s is None else now_s
    found = {}
    for name, path in runs.files.items():
        try:
            status = path.stat()
        except OSError:
            continue
        if status.st_size and now_s - status.st_mtime >= _SETTLED_S:
            found[name] = (status.st_size, status.st_mtime_ns)
    return found


def looked_at(runs: Expected, written: Sequence[str]) -> tuple[RunSeen, ...]:
    """Every run, with the checks of those that are `written`."""
    unreadable: dict[str, str] = {}
    usable = list(written)
    campaign = None
    while usable and campaign is None:
        try:
            campaign = _read(runs, usable)
        except (InputError, FitError) as error:
            broken = next((name for name in usable if name in str(error)), usable[-1])
            unreadable[broken] = str(error)
            usable.remove(broken)
    checked: dict[str, RunSeen] = {}
    for each in [] if campaign is None else _together(runs, usable, campaign):
        checked |= _checked(each)
    seen = []
    for name, path in runs.files.items():
        state = "missing" if not path.exists() else "being written"
        if name in unreadable:
            is_whole = not runs.is_planned and _can_be_read(path)
            state = "not checked" if is_whole else "unreadable"
            seen.append(RunSeen(name, state, {}, error=unreadable[name]))
        elif name in checked:
            seen.append(checked[name])
        else:
            seen.append(RunSeen(name, state, {}))
    return tuple(seen)


def _read(runs: Expected, names: Sequence[str]) -> Campaign:
    if runs.is_planned:
        return ema.read_campaign(runs.folder, only=names)
    return ema.read_campaign([runs.files[name] for name in names])


def _together(runs: Expected, names: Sequence[str], campaign: Campaign) -> list[Campaign]:
    """What is checked together: all runs, or each alone where nothing says where sensors were."""
    is_placed = runs.is_planned or all(each.check is not Check.NODE for each in campaign.findings)
    return [campaign] if is_placed else [_read(runs, [name]) for name in names]


def _can_be_read(path: Path) -> bool:
    """Whether a file is in order, and only what its channels are is not known."""
    try:
        return read_headers(path).recording is not None
    except InputError:
        return False


def _checked(campaign: Campaign) -> dict[str, RunSeen]:
    found = frfs_of(ema.estimate_frf(campaign))
    low, high = TYRE_BAND_HZ if campaign.processing.band_hz is None else campaign.processing.band_hz
    band_hz = low, min(high, float(found[0].frequency_hz[-1]))
    findings = list(campaign.findings)
    for frf in found:
        findings += [*frf.findings, *coherence_findings(frf, band_hz), *_of_reference(frf, band_hz)]
        findings += _of_channels(campaign, frf, band_hz)
    files = {Path(path).name: path for path in campaign.sources}
    seen = {}
    for run in campaign.runs:
        own = tuple(
            each
            for each in dict.fromkeys(findings)
            if run.name == each.run.split("+")[-1] and each.check not in _TOO_EARLY
        )
        name = next((file for file in files if run.name == file or run.name in file), run.name)
        of_run = (each for each in found if run.name in "+".join(each.run).split("+"))
        numbers = _numbers(campaign, next(of_run, found[0]), run.name, band_hz)
        seen[name] = RunSeen(name, "measured", numbers, own)
    return seen


def _of_reference(frf: FRF, band_hz: tuple[float, float]) -> list[Finding]:
    if frf.reference is None or frf.reference.n_positions < 2:
        return []
    check = check_reference(frf.reference, band_hz)
    found = [each for each in gain_findings(check) if not each.is_ok]
    if not check.consistent:  # it concerns all runs; the last one is new
        finding = reference_finding(check)
        found.append(replace(finding, run=check.run[-1]))
    return found


def _of_channels(campaign: Campaign, frf: FRF, band_hz: tuple[float, float]) -> list[Finding]:
    """Channels that processing will leave out or doubt; what it refuses concerns the last run."""
    try:
        return screen(frf, band_hz)[1]
    except InputError as error:
        last, said = campaign.runs[-1].name, f"{error.where}: {error.found}; {error.rule}"
        return [Finding(last, "", None, Check.AVERAGED_RUNS, Verdict.WARNING, said)]


def _numbers(
    campaign: Campaign, frf: FRF, run: str, band_hz: tuple[float, float]
) -> dict[str, Any]:
    rows = np.array([run in each.split("+") for each in frf.run])
    lines = in_band(frf.frequency_hz, band_hz)
    recording = next(each for each in campaign.runs if each.name == run)
    coherence = frf.coherence[rows][:, lines]
    forces = [each.channel for each in recording.forces] or [recording.force]
    levels = [_rms(each.channel) for each in recording.responses]
    good_hz = frf.rows(rows).coherent_band_hz() if rows.any() else (np.nan, np.nan)
    return {
        "seconds": recording.recording.duration_s,
        "force_n": [_rms(each) for each in forces],
        "sensors": [min(levels), max(levels)],
        "unit": SI_UNIT.get(recording.responses[0].channel.quantity, "").replace("^2", "²"),
        "coherence": float(np.nanmedian(coherence)) if np.isfinite(coherence).any() else None,
        "coherent_from_hz": good_hz[0],
        "coherent_to_hz": good_hz[1],
        "clipped": float(frf.clipped[rows].max(initial=0.0)),
        "reference_drift_percent": _drift_percent(frf.reference, run, band_hz),
    }


def _rms(channel: Channel) -> float:
    """Of a whole recording, without its mean, in SI."""
    return float(np.nanstd(channel.block(0, channel.n_samples)))


def _drift_percent(reference: FRF | None, run: str, band_hz: tuple[float, float]) -> float | None:
    """Shift of all frequencies of the reference sensor against the first run.

    The δ by which H(f/(1 + δ)) of the first run comes nearest to that of this one, by the method of
    Gauss and Newton.
    """
    if reference is None or run not in reference.run:
        return None
    lines = in_band(reference.frequency_hz, band_hz)
    frequency_hz, values = reference.frequency_hz[lines], reference.values[:, lines]
    first, measured = values[0], values[reference.run.index(run)]
    shift = 0.0
    for _ in range(_SHIFT_STEPS):
        seen = np.interp(frequency_hz / (1 + shift), frequency_hz, first)
        slope = -frequency_hz * np.gradient(seen, frequency_hz)
        power = float(np.sum(np.abs(slope) ** 2))
        if power == 0:
            return None
        shift += float(np.sum((measured - seen) * slope.conj()).real) / power
    return 100 * shift


def advice(runs: Expected, seen: Sequence[RunSeen]) -> tuple[str, str]:
    """What to do now: {"ok", "warning", "wait"}, and in words."""
    for number, run in enumerate(seen, 1):
        if run.state == "not checked":
            return "warning", run.error
        if run.state == "unreadable":
            return "warning", f"Measure run {number} ({run.name}) again: {run.error}"
        if run.faults:
            fault = run.faults[0]
            return "warning", f"Repeat run {number} ({run.name}), because: {_in_words(fault)}"
    for number, run in enumerate(seen, 1):
        if run.state == "being written":
            return "wait", f"Run {number} ({run.name}) is being written."
        if run.state == "missing":
            return "ok", f"Next is run {number} ({run.name}). {_turn(runs, run.name)}".strip()
    if not seen:
        return "wait", "No recording yet."
    if runs.is_planned:
        return "ok", f"All {len(seen)} runs are measured. Process the campaign."
    started = "1 run is" if len(seen) == 1 else f"{len(seen)} runs are"
    return "ok", f"{started} in order. Turn the sensors for the next one. {_PLACES}"


def _in_words(finding: Finding) -> str:
    what = dict.fromkeys(filter(None, (finding.check.value, finding.channel)))  # may be the same
    return f"{' '.join(what)}: {finding.detail}"


def _turn(runs: Expected, name: str) -> str:
    """Where the sensors go for a run of the manifest, and by how much they are turned for it."""
    names = list(runs.sections)
    places = _moved(runs.sections.get(name))
    if not places:
        return ""
    at = names.index(name)
    before = _moved(runs.sections[names[at - 1]]) if at else {}
    steps = {round((places[each] - before[each]) % 360, 6) for each in places if each in before}
    listed = ", ".join(f"{sensor} at {angle:g}°" for sensor, angle in places.items())
    if before.keys() == places.keys() and len(steps) == 1 and 0 not in steps:
        return f"Turn the sensors by {(steps.pop() + 180) % 360 - 180:+g}°: {listed}."
    return f"Turn the sensors: {listed}."


def _moved(section: RunSection | None) -> dict[str, float]:
    """Angles of the sensors that do not stay where they are."""
    if section is None:
        return {}
    places = dict(section.positions_deg or {})
    return {name: angle for name, angle in places.items() if name != section.reference}


def as_record(runs: Expected, seen: Sequence[RunSeen]) -> dict[str, Any]:
    """What the page shows."""
    verdict, text = advice(runs, seen)
    lines = {
        run.name: [
            {"text": _in_words(each), "verdict": each.verdict.value}
            for each in run.lines
            if each.verdict is not Verdict.OK
        ]
        for run in seen
    }
    return {
        **{"name": runs.folder.name, "folder": str(runs.folder)},
        "runs_expected": len(runs.files) if runs.is_planned else None,
        "advice": {"verdict": verdict, "text": text},
        "runs": [
            {
                **{"run": run.name, "state": run.state, "error": run.error},
                "repeat": bool(run.faults),
                **{"lines": lines[run.name], **run.content},
            }
            for run in seen
        ],
    }


class Watch:
    """A thread that looks at a campaign's folder whenever a file was written.

    Parameters
    ----------
    folder : Path
    changed : callable
        Called after each look.
    """

    def __init__(self, folder: Path, changed: Callable[[], None]) -> None:
        self._folder, self._changed = folder, changed
        self._record: dict[str, Any] = {}
        self._looked, self._ended = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._run, name="watch", daemon=True)
        self._thread.start()

    def record(self) -> dict[str, Any]:
        """What was seen last; the first time, as soon as it is."""
        self._looked.wait(_FIRST_LOOK_S)
        return self._record

    def end(self) -> None:
        """Stop looking."""
        self._ended.set()
        self._thread.join()

    def _run(self) -> None:
        before: object = None
        while not self._ended.is_set():
            try:
                runs = expected(self._folder)
                now = settled(runs), [path.exists() for path in runs.files.values()]
                if now != before or not self._record:
                    before, self._record = now, as_record(runs, looked_at(runs, list(now[0])))
                    self._changed()
            except (InputError, FitError, OSError) as error:  # as of a manifest being edited
                told = {"name": self._folder.name, "folder": str(self._folder), "runs": []}
                advice_now = {"verdict": "warning", "text": str(error)}
                if self._record.get("advice") != advice_now:
                    self._record = {**told, "runs_expected": None, "advice": advice_now}
                    self._changed()
            self._looked.set()
            self._ended.wait(_EVERY_S)
