"""Guesses from recordings: force, reference and positions of the sensors."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ema.core.errors import InputError
from ema.core.recording import ACCELERATION, FORCE, UNKNOWN, VOLTAGE, Channel, motions
from ema.core.units import is_stated
from ema.io.content import FileContent

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


def excitation_deg(sources: Sequence[Source], places: Places) -> float | None:
    """Angle of the force by geometry or node number."""
    forces = [c for source in sources for c in source.channels if c.name in forces_in(source)]
    angles = {channel.angle_deg for channel in forces}
    nodes = {c.node for c in forces} | {s.force_node for s in sources if s.has_frfs}
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
