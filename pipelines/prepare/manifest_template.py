"""Manifest template: a ``campaign.toml`` with everything that recordings state."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tomlkit
from jinja2 import Environment, PackageLoader, StrictUndefined

from ema.core.errors import InputError
from ema.core.recording import VOLTAGE
from ema.io.campaign.agreement import joined, without_results
from ema.io.campaign.manifest import MANIFEST_NAME
from ema.io.campaign.read import recordings_in
from ema.io.content import FileContent
from ema.io.formats import read_file
from pipelines.prepare.inspection import (
    GEOMETRY,
    NODES,
    Layout,
    Places,
    Source,
    excitation_deg,
    force_nodes,
    forces_in,
    needs_calibration,
    places_laid_out,
    places_of,
    reference_of,
    sensors_in,
    sources_of,
)
from pipelines.storage.atomic import file_written_whole, named

_MOST_NAMED = 6  # channels in a message
_BARE_KEY = re.compile(r"^[A-Za-z0-9_-]+$")


@dataclass(frozen=True)
class Draft:
    """A manifest template."""

    text: str  # TOML; lines to fill in are comments
    missing: tuple[str, ...]  # what the files do not state
    left_out: tuple[str, ...] = ()  # why files were left out


@dataclass(frozen=True, eq=False)
class _Sketch:
    """What is known of the campaign, or guessed."""

    runs: tuple[Source, ...]
    frfs: tuple[Source, ...]  # beside time series, which are preferred
    beside: tuple[Path, ...]  # places or coherences of the others
    unread: tuple[Path, ...]
    force: str | None
    reference: str | None
    places: Places

    @property
    def is_structure(self) -> bool:
        """Whether positions are numbered, but not on a circle."""
        return bool(self.places.known_from) and self.places.positions is None


def draft_manifest(
    folder: Path, *, layout: Layout | None = None, reference: str | None = None
) -> Draft:
    """Make a manifest template from the recordings in a folder.

    Parameters
    ----------
    folder : Path
    layout : Layout or None
        Positions of evenly spaced sensors. Default: those in the files.
    reference : str or None
        Channel of the sensor that stays in place. Default: by its name.

    Raises
    ------
    InputError
        If the folder has no readable recordings, no run has the reference, or two sensors of a run
        coincide.
    """
    sources, beside, errors = _read_all(recordings_in(folder))
    if not sources:
        found = "; ".join(text.rstrip(".") for text in errors.values())
        rule = "a manifest template needs recordings"
        raise InputError(str(folder), found, rule, "Copy the files there, or name another folder")
    series = tuple(source for source in sources if not source.has_frfs)
    runs = series or tuple(sources)
    if reference is not None:
        known = sorted({channel.name for run in runs for channel in run.channels})
        if reference not in known:
            rule = f"the recordings have {named(known, 20)}"
            raise InputError("--reference", repr(reference), rule, "Name one of them")
    elif series:
        reference = reference_of(runs)
    forces = {name for source in runs for name in forces_in(source)}
    sketch = _Sketch(
        runs=runs,
        frfs=tuple(source for source in sources if source.has_frfs and series),
        beside=beside,
        unread=tuple(errors),
        force=forces.pop() if len(forces) == 1 else None,
        reference=reference,
        places=places_laid_out(runs, reference, layout) if layout else places_of(runs, reference),
    )
    return Draft(_text_of(sketch), tuple(_missing(sketch)), tuple(errors.values()))


def _read_all(paths: Sequence[Path]) -> tuple[list[Source], tuple[Path, ...], dict[Path, str]]:
    """Content of all usable files, those joined to it, and what is wrong with the others."""
    contents: list[FileContent] = []
    errors: dict[Path, str] = {}
    for path in paths:
        try:
            path.name.encode()
            contents.append(read_file(path))
        except UnicodeEncodeError:
            errors[path] = f"{path.name!a}: the name is not UTF-8; rename the file"
        except InputError as error:
            errors[path] = str(error)
    sources: list[Source] = []
    beside: list[Path] = []
    for content in joined(without_results(contents)):
        sources += sources_of(content)
        if content.nodes is not None or content.coherences is not None:
            beside.append(content.path)
        elif not content.has_data:
            notes = "; ".join(finding.detail for finding in content.findings)
            text = f"{content.path.name}: neither time series nor FRFs"
            errors[content.path] = f"{text} ({notes})" if notes else text
    return sources, tuple(beside), errors


def write_draft(folder: Path, draft: Draft, *, force: bool = False) -> Path:
    """Write a manifest template beside the recordings.

    Raises
    ------
    InputError
        If there is a manifest and `force` is not given.
    """
    path = folder / MANIFEST_NAME
    if path.exists() and not force:
        remedy = "Move it away, or use --force"
        raise InputError(str(path), "a manifest", "it already exists", remedy)
    with file_written_whole(path) as partial:
        partial.write_text(draft.text, encoding="utf-8", newline="\n")
    return path


def _missing(sketch: _Sketch) -> Iterator[str]:
    """What the user has to add, in the order of the manifest."""
    if not sketch.is_structure:
        yield (
            "[tyre] inflation_pressure_pa and mean_radius_m, for the ring parameters; designation, "
            "for the report"
        )
    rates = _rates(sketch)
    if len(rates) > 1:
        yield f"one sampling rate: the files have {', '.join(f'{rate:g} Hz' for rate in rates)}"
    if not rates and not sketch.runs[0].has_frfs:
        yield "[acquisition] sampling_rate_hz, which the files do not state"
    if any(run.lacks_unit for run in sketch.runs):
        yield "[acquisition] frf_unit, which the files do not state"
    volts, unitless = _uncalibrated(sketch)
    if volts:
        yield f"[calibration] sensitivity of {named(volts, _MOST_NAMED)}, in volts"
    if unitless:
        yield f"[calibration] unit of {named(unitless, _MOST_NAMED)}; taken as SI without one"
    if _force_is_open(sketch):
        names = {channel.name for source in sketch.runs for channel in source.channels}
        yield f"[excitation] channel, the force, one of {named(sorted(names), _MOST_NAMED)}"
    if not sketch.places.known_from:
        yield (
            "[grid] positions, and positions_deg of each run, the angles of the sensors; for "
            "sensors 30° apart, turned by 5° from run to run, use --spacing-deg 30 --step-deg 5"
        )
    elif sketch.places.is_guess and sketch.places.positions:
        known_from = sketch.places.known_from
        yield f"[grid] positions: {sketch.places.positions} is a guess from {known_from}"


def _rates(sketch: _Sketch) -> list[float]:
    """Sampling rates that files state, each once."""
    rates = [source.sampling_rate_hz for source in sketch.runs]
    return list(dict.fromkeys(round(rate, 6) for rate in rates if not np.isnan(rate)))


def _force_is_open(sketch: _Sketch) -> bool:
    """Whether the force channel is unclear; a single one in each run needs no name."""
    return any(not source.has_frfs and len(forces_in(source)) != 1 for source in sketch.runs)


def _uncalibrated(sketch: _Sketch) -> tuple[list[str], list[str]]:
    """Names of the channels in volts, and of those without unit."""
    used = {sketch.reference}
    for source in sketch.runs:
        sensors = (channel.name for channel in sensors_in(source, sketch.reference))
        used.update(sensors, forces_in(source))
    channels = [c for run in sketch.runs for c in run.channels if c.name in used]
    channels = [channel for channel in channels if needs_calibration(channel)]
    volts = dict.fromkeys(c.name for c in channels if c.quantity == VOLTAGE)
    unitless = dict.fromkeys(c.name for c in channels if c.quantity != VOLTAGE)
    return list(volts), list(unitless)


def _text_of(sketch: _Sketch) -> str:
    environment = Environment(
        loader=PackageLoader("pipelines.prepare", "."),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters.update({"text": _text, "key": _key})
    volts, unitless = _uncalibrated(sketch)
    instead = "FRFs, instead of the time series"
    return environment.get_template("campaign.toml.j2").render(
        vars(sketch),
        is_structure=sketch.is_structure,
        rates=_rates(sketch),
        has_series=not sketch.runs[0].has_frfs,
        lack_frf_unit=any(run.lacks_unit for run in sketch.runs),
        volts=volts,
        unitless=unitless,
        force_is_open=_force_is_open(sketch),
        n_force_places=len(force_nodes(sketch.runs)),
        angle_deg=excitation_deg(sketch.runs, sketch.places),
        runs=[(source, _positions(sketch, source)) for source in sketch.runs],
        left_out=[
            *((source.path, instead) for source in sketch.frfs),
            *((path, "left out: unreadable") for path in sketch.unread),
        ],
    )


def _positions(sketch: _Sketch, source: Source) -> str:
    """The line of a run about the positions of its sensors."""
    sensors, places = sensors_in(source, sketch.reference), sketch.places
    # Positions in the file are those of accelerations; uncalibrated channels are listed.
    in_file = places.known_from in (GEOMETRY, NODES) and not any(map(needs_calibration, sensors))
    if in_file or sketch.is_structure:
        return f"# positions follow from {places.known_from}"
    if places.angle_deg is None:
        return f"# positions_deg = {{ {', '.join(f'{_key(c.name)} = <deg>' for c in sensors)} }}"
    known = (f"{_key(c.name)} = {places.angle_deg[source.path, c.name]!r}" for c in sensors)
    return f"positions_deg = {{ {', '.join(known)} }}"


def _key(name: str) -> str:
    return name if _BARE_KEY.match(name) else _text(name)


def _text(value: str) -> str:
    """A string of TOML, with escapes as needed; names of files may have any bytes."""
    return tomlkit.item(value.encode("utf-8", "replace").decode()).as_string()
