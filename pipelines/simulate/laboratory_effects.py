"""Effects of a laboratory campaign: what differs from an ideal tyre measured ideally."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import Field, dataclass, field, fields
from enum import StrEnum
from pathlib import Path
from typing import Any

from ema.core.errors import InputError

MOST_SAMPLES = 4_000_000  # per channel and run; a run is computed in memory
LOWEST_EXCITED_HZ = 10.0
HIGHEST_EXCITED = 0.45  # of the sampling rate


class Excitation(StrEnum):
    """Time course of the force."""

    RANDOM = "random"
    PINK = "pink"
    BURST = "burst"
    SWEEP = "sweep"
    HAMMER = "hammer"


def _effect(default: Any, unit: str, help_text: str, least: float = 0.0, most: float = 1.0) -> Any:
    """A field with unit, limits and explanation."""
    metadata = {"unit": unit, "help": help_text, "limits": (least, most)}
    return field(default=default, metadata=metadata)


@dataclass(frozen=True)
class Effects:
    """Options of a laboratory campaign; the defaults are an ideal test of an ideal tyre.

    Every field has its unit, limits and explanation in its metadata, see `describe_effects`.
    Shares and relative changes are fractions: 0.01 is 1 %.

    Raises
    ------
    InputError
        If a value has the wrong type or is out of its limits.

    Examples
    --------
    >>> from pipelines.simulate.laboratory_effects import Effects
    >>> Effects(seed=3, splice=0.02, angle_error_deg=0.5).switched_on
    {'seed': 3, 'splice': 0.02, 'angle_error_deg': 0.5}
    """

    seed: int = _effect(1, "–", "seed of everything random, the tyre included", 0, 2**31)
    # The test.
    duration_s: float = _effect(20.0, "s", "length of each run", 1.0, 1000.0)
    sampling_rate_hz: float = _effect(2000.0, "Hz", "sampling rate", 600.0, 20_000.0)
    runs: int = _effect(6, "–", "number of runs", 1, 36)
    sensors: int = _effect(12, "–", "turned sensors of a run", 3, 72)
    circle_deg: tuple[float, ...] = _effect(
        (0.0, 360.0), "deg", "first and last angle of the sensors; 0, 360 is the circle", 0.0, 360.0
    )
    force_deg: float = _effect(0.0, "deg", "angle of the force as declared", 0.0, 360.0)
    further_forces_deg: tuple[float, ...] = _effect(
        (), "deg", "further places of the force; all runs are made again for each", 0.0, 360.0
    )
    # The force.
    excitation: Excitation = field(
        default=Excitation.RANDOM,
        metadata={"unit": "–", "help": f"time course of the force: {', '.join(Excitation)}"},
    )
    force_rms_n: float = _effect(10.0, "N", "rms of the force without shaker interaction", 0.1, 1e3)
    level_step_db: float = _effect(0.0, "dB", "rise of the force from first to last run", -40, 40)
    event_s: float = _effect(4.0, "s", "length of a burst with its pause, or of a sweep", 1.0, 100)
    hits: int = _effect(10, "–", "hammer hits in a run, timed by hand", 1, 200)
    double_hits: float = _effect(0.0, "–", "share of hits that bounce")
    preload_n: float = _effect(50.0, "N", "static force; none with a hammer", 0.0, 1e3)
    shaker: bool = _effect(False, "–", "shaker moves with the tyre: force drops at resonances")
    # The tyre.
    stiffness: float = _effect(1.0, "–", "factor on pressure and all stiffness", 0.2, 5.0)
    splice: float = _effect(0.0, "–", "share of the belt's mass added in a splice", 0.0, 0.1)
    stiffness_variation: float = _effect(0.0, "–", "rms of the stiffness over the angle", 0.0, 0.2)
    damping_variation: float = _effect(0.0, "–", "rms of the damping over the angle", 0.0, 0.4)
    mass_variation: float = _effect(0.0, "–", "rms of the mass over the angle", 0.0, 0.2)
    rim_hz: tuple[float, ...] = _effect((), "Hz", "rim on fixture, x and z; empty: fixed", 1.0, 1e4)
    rim_mass_kg: float = _effect(12.0, "kg", "mass of the rim on its fixture", 0.1, 1e3)
    rim_turning_hz: float = _effect(0.0, "Hz", "rim turning on its fixture; 0 is fixed", 0.0, 1e4)
    lateral_hz: tuple[float, ...] = _effect((), "Hz", "lateral modes, seen weakly", 1.0, 1e4)
    cavity_coupling: float = _effect(0.0, "–", "coupling of the air's first mode", 0.0, 0.3)
    # Changes of the tyre.
    pressure_drift: float = _effect(0.0, "–", "pressure, last against first run", -0.3, 0.3)
    pressure_drift_within: float = _effect(0.0, "–", "pressure, change in each run", -0.3, 0.3)
    temperature_drift: float = _effect(0.0, "–", "frequencies, last against first run", -0.1, 0.1)
    temperature_damping: float = _effect(0.0, "–", "damping, last against first run", -0.5, 0.5)
    drift_within: float = _effect(0.0, "–", "all frequencies, change in each run", -0.1, 0.1)
    softening: float = _effect(0.0, "–", "fall of all frequencies if the level doubles", -0.1, 0.1)
    # Sensors and load cell.
    sensor_mass_kg: float = _effect(0.0, "kg", "mass of each sensor", 0.0, 0.1)
    declare_mass: bool = _effect(True, "–", "sensor mass is in the manifest")
    live_mass_kg: float = _effect(0.0, "kg", "mass between load cell and tyre", 0.0, 1.0)
    angle_error_deg: float = _effect(0.0, "deg", "largest error of a sensor's angle", 0.0, 10.0)
    tilt_deg: float = _effect(0.0, "deg", "rms tilt: sensors see tangential motion", 0.0, 30.0)
    gain_error: float = _effect(0.0, "–", "rms error of the sensitivities", 0.0, 0.2)
    delay_us: float = _effect(0.0, "µs", "largest delay of a sensor's channel", 0.0, 1e4)
    mirrored_step: bool = _effect(False, "–", "tyre turned the other way from run to run")
    reversed_sequence: bool = _effect(False, "–", "sensors count the other way round")
    offset_deg: float = _effect(0.0, "deg", "sensors of one run sit this far off", -180.0, 180.0)
    offset_run: int = _effect(2, "–", "run with the offset, from 1; 0 means all", 0, 36)
    force_offset_deg: float = _effect(0.0, "deg", "force acts this far off", -180.0, 180.0)
    dead_sensor: int = _effect(0, "–", "number of a sensor that gives noise only; 0: none", 0, 72)
    flipped_sensor: int = _effect(0, "–", "number of a sensor of wrong sign; 0: none", 0, 72)
    scaled_sensor: int = _effect(0, "–", "number of a sensor that reads half; 0: none", 0, 72)
    swapped_sensor: int = _effect(0, "–", "number of a sensor swapped with the next", 0, 71)
    # Noise and conversion.
    snr_db: float = _effect(60.0, "dB", "mean response over sensor noise, rms", -40.0, 300.0)
    floor: float = _effect(0.0, "–", "low-frequency noise (1/f), share of the mean response")
    force_snr_db: float = _effect(80.0, "dB", "force over load-cell noise, rms", -40.0, 300.0)
    hum: float = _effect(0.0, "–", "50 Hz hum, share of the mean response", 0.0, 10.0)
    bits: int = _effect(0, "–", "bits of the converter; 0 does not quantise", 0, 32)
    clip: float = _effect(0.0, "–", "sensors clip at this multiple of the rms; 0: never", 0.0, 99)

    def __post_init__(self) -> None:
        for entry in fields(self):
            object.__setattr__(self, entry.name, _converted(entry, getattr(self, entry.name)))
        ascending = len(self.circle_deg) == 2 and self.circle_deg[0] < self.circle_deg[1]
        faulty = max(self.faulty_sensors, default=0)
        for name, holds, rule in (
            ("duration_s", self.n_samples <= MOST_SAMPLES, f"at most {MOST_SAMPLES} samples a run"),
            ("circle_deg", ascending, "two ascending angles"),
            ("further_forces_deg", len({*self.forces_deg}) == len(self.forces_deg), "other angles"),
            ("rim_hz", len(self.rim_hz) in (0, 2), "no frequency or two, of x and z"),
            ("sensors", faulty <= self.sensors, "faulty sensors are among them"),
            ("bits", self.bits == 0 or self.bits >= 4, "0, or 4 and more"),
        ):
            _require(holds, name, getattr(self, name), rule)

    @property
    def forces_deg(self) -> tuple[float, ...]:
        """Angles of the force as declared, one after the other."""
        return self.force_deg, *self.further_forces_deg

    @property
    def all_runs(self) -> int:
        """Runs for all places of the force together."""
        return self.runs * len(self.forces_deg)

    @property
    def n_samples(self) -> int:
        """Samples of each channel in a run."""
        return round(self.duration_s * self.sampling_rate_hz)

    @property
    def declared_mass_kg(self) -> float:
        """Mass of each sensor as the manifest states it; 0 where it does not."""
        return self.sensor_mass_kg if self.declare_mass else 0.0

    @property
    def band_hz(self) -> tuple[float, float]:
        """Band of the force, as far as its time course is free."""
        return LOWEST_EXCITED_HZ, HIGHEST_EXCITED * self.sampling_rate_hz

    @property
    def faulty_sensors(self) -> frozenset[int]:
        """Numbers of the sensors with a fault."""
        lone = (self.dead_sensor, self.flipped_sensor, self.scaled_sensor)
        both = (self.swapped_sensor, self.swapped_sensor + 1) if self.swapped_sensor else ()
        return frozenset((*lone, *both)) - {0}

    @property
    def switched_on(self) -> dict[str, Any]:
        """Options that are not at their default."""
        return {
            entry.name: getattr(self, entry.name)
            for entry in fields(self)
            if getattr(self, entry.name) != entry.default
        }


def _require(holds: bool, name: str, value: Any, rule: str) -> None:
    if not holds:
        raise InputError(name, repr(value), rule, "Correct the value")


def _converted(entry: Field[Any], value: Any) -> Any:
    """The value in the type of its default, within its limits."""
    default = entry.default
    if isinstance(default, bool):
        _require(isinstance(value, bool), entry.name, value, "true or false")
        return value
    if isinstance(default, StrEnum):
        _require(value in tuple(Excitation), entry.name, value, f"one of {', '.join(Excitation)}")
        return Excitation(value)
    if isinstance(default, tuple):
        several = value if isinstance(value, list | tuple) else (value,)
        return tuple(_number(entry, each) for each in several)
    return _number(entry, value)


def _number(entry: Field[Any], value: Any) -> float:
    whole, (least, most) = isinstance(entry.default, int), entry.metadata["limits"]
    known = isinstance(value, int if whole else int | float) and not isinstance(value, bool)
    _require(known, entry.name, value, f"it must be a {'whole ' if whole else ''}number")
    rule = f"it must lie between {least:g} and {most:g}"
    _require(least <= value <= most, entry.name, value, rule)
    return value if whole else float(value)


def effects_from(table: Mapping[str, Any], place: str = "effects") -> Effects:
    """Effects from a table of names and values; `place` is where it comes from, for messages."""
    known = [entry.name for entry in fields(Effects)]
    for name in table:
        if name not in known:
            rule = f"known effects: {', '.join(known)}"
            raise InputError(place, repr(name), rule, "Correct or remove it")
    return Effects(**table)


def parse_effect(text: str) -> tuple[str, Any]:
    """Name and value of ``name=value``, the value as in TOML or a plain word."""
    name, separator, value = text.partition("=")
    if not separator:
        raise InputError("--effect", repr(text), "name=value", "Give for example splice=0.02")
    try:
        return name.strip(), tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        return name.strip(), value.strip()


def effects_of(
    file: Path | None, texts: Sequence[str], defaults: Mapping[str, Any]
) -> Effects | None:
    """Effects of a TOML file and of ``name=value`` texts, which go before; None without either."""
    if file is None and not texts:
        return None
    try:
        stated = {} if file is None else tomllib.loads(file.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise InputError(str(file), "file not found", "a TOML file", "Check the path") from error
    except (OSError, ValueError) as error:
        raise InputError(str(file), str(error), "a TOML file", "Fix it") from error
    stated |= dict(parse_effect(text) for text in texts)
    return effects_from({**defaults, **stated}, "--effect" if file is None else str(file))


def describe_effects() -> list[tuple[str, Any, str, str]]:
    """Name, default, unit and explanation of every effect."""
    return [
        (entry.name, entry.default, entry.metadata["unit"], entry.metadata["help"])
        for entry in fields(Effects)
    ]


def readme(effects: Effects) -> str:
    """Content of ``README.md`` of a campaign."""
    chosen = effects.switched_on
    listed = "".join(
        f"| `{name}` | {chosen[name]} | {unit} | {text} |\n"
        for name, _, unit, text in describe_effects()
        if name in chosen
    )
    return f"""# Simulated campaign of a laboratory

No lab has measured these recordings: they were computed from the mass, damping and stiffness
matrices of a ring on an elastic foundation. `truth.json` has the exact modes: `modes` of the bare
tyre in the state of the first run half-way through, `as_tested_first_run` with everything that
hung on it. The processing never reads it.

Effects that differ from an ideal test of an ideal tyre:

| effect | value | unit | meaning |
|---|---|---|---|
{listed}"""
