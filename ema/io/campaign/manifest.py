"""The manifest of a campaign, ``campaign.toml``: its keys, their units and their limits."""

from __future__ import annotations

import difflib
import re
import tomllib
import unicodedata
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    Tag,
    ValidationError,
    field_validator,
    model_validator,
)

from ema.core.campaign import Direction, Processing, Tyre
from ema.core.errors import ManifestError, nearest
from ema.core.files import USE_SLASHES, require_regular
from ema.core.recording import overlap_share
from ema.core.units import amount, unit_of_key

MANIFEST_NAME = "campaign.toml"

_DECIMAL_COMMA = re.compile(rb"= *[0-9]+,[0-9]")
_SIMILAR = 0.8  # a free key that resembles a known one this much is a typing error
_QUOTES = dict.fromkeys(map(ord, "“”„‟«»"), '"') | dict.fromkeys(map(ord, "‘’‚"), "'")
_TOML = "a manifest must be TOML in UTF-8"
_LONGEST_VALUE = 60  # characters of a value in a message

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False, strict=True)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False, strict=True)]
Finite = Annotated[float, Field(allow_inf_nan=False, strict=True)]


def _between(lowest: float, highest: float, rule: str) -> AfterValidator:
    """Check the size of a number, to find wrong units."""

    def check(value: float) -> float:
        if not lowest <= value <= highest:
            raise ValueError(rule)
        return value

    return AfterValidator(check)


#: Limits of pressure and lengths, which show other units.
PRESSURES_PA, LENGTHS_M = (1e3, 1e7), (1e-3, 10.0)
_pressure = _between(*PRESSURES_PA, "tyres have 1000 to 10 000 000 Pa (1 bar is 100000 Pa)")
_length = _between(*LENGTHS_M, "tyres have 0.001 to 10 m (330 mm are 0.33 m)")
_mass = _between(0.0, 1.0, "sensors have up to 1 kg (4 g are 0.004 kg)")
_Pascals = Annotated[Positive, _pressure]
_Metres = Annotated[Positive, _length]
_Kilograms = Annotated[NotNegative, _mass]
_Axis = Annotated[str, Field(pattern="^[+-]?[XYZ]$")]
_ONE, _MANY = "<one>", "<many>"  # parts of the place of an error that no manifest has
_IS_LIST = Discriminator(lambda given: _MANY if isinstance(given, list | tuple) else _ONE)


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)

    @model_validator(mode="before")
    @classmethod
    def _in_si(cls, given: Any) -> Any:
        """Texts with a unit become numbers: ``mean_radius = "330 mm"`` is ``mean_radius_m``."""
        if not isinstance(given, dict):
            return given
        found = dict(given)
        for key in cls.model_fields:
            unit = unit_of_key(key)
            bare = key.removesuffix(f"_{unit}")
            if unit is None:
                continue
            if bare not in found:
                continue
            if key in found:
                raise ValueError(f"{bare} and {key} are the same; give one of them")
            if isinstance(found[bare], int | float):
                raise ValueError(f'write {bare} = "<number> <unit>", or {key} for SI')
            try:
                found[key] = _si(found.pop(bare), unit)
            except ValueError as error:
                raise ValueError(f"{bare}: {error}") from None
        return found


def _si(value: Any, unit: str) -> Any:
    """Numbers for the texts with units in a value, a table or a list."""
    if isinstance(value, str):
        return amount(value, unit)
    if isinstance(value, dict):
        return {key: _si(entry, unit) for key, entry in value.items()}
    return [_si(entry, unit) for entry in value] if isinstance(value, list) else value


class TyreSection(_Section):
    """``[tyre]``: identity and given data; any other key is kept as a detail."""

    model_config = ConfigDict(extra="allow", frozen=True)

    designation: str = "not stated"
    inflation_pressure_pa: _Pascals | None = None
    mean_radius_m: _Metres | None = None
    belt_width_m: _Metres | None = None

    @model_validator(mode="after")
    def _no_slips(self) -> TyreSection:
        for key in self.model_extra or {}:
            similar = difflib.get_close_matches(key, type(self).model_fields, 1, _SIMILAR)
            if similar:
                raise ValueError(f"the key {key!r} resembles {similar[0]!r}; rename one of them")
        return self

    def tyre(self) -> Tyre:
        """Return the tyre, with free keys as texts."""
        details = {key: str(value) for key, value in (self.model_extra or {}).items()}
        sizes = (self.inflation_pressure_pa, self.mean_radius_m, self.belt_width_m)
        return Tyre(self.designation, *sizes, details)


class AcquisitionSection(_Section):
    """``[acquisition]``: what files may leave out."""

    sampling_rate_hz: Positive | None = None
    frf_unit: str | None = None  # of FRFs whose file states none


class SensorsSection(_Section):
    """``[sensors]``: the mass of one accelerometer, or masses by channel and a default."""

    mass_kg: Annotated[
        Annotated[_Kilograms | None, Tag(_ONE)] | Annotated[dict[str, _Kilograms], Tag(_MANY)],
        Discriminator(lambda given: _MANY if isinstance(given, dict) else _ONE),
    ] = None

    @property
    def default_kg(self) -> float | None:
        """Mass of each sensor without one of its own."""
        return self.mass_kg.get("default") if isinstance(self.mass_kg, dict) else self.mass_kg

    @property
    def own_kg(self) -> dict[str, float]:
        """Masses by channel."""
        given = self.mass_kg if isinstance(self.mass_kg, dict) else {}
        return {name: mass for name, mass in given.items() if name != "default"}


class CalibrationSection(_Section):
    """An entry of ``[calibration]``: unit or sensitivity of some channels."""

    unit: str | None = None
    sensitivity: str | None = None

    @model_validator(mode="after")
    def _says_something(self) -> CalibrationSection:
        if self.unit is None and self.sensitivity is None:
            raise ValueError("an entry must have a unit or a sensitivity")
        return self


class GridSection(_Section):
    """``[grid]``: node k lies at k·360/positions degrees; which axes point to 0° and 90°."""

    positions: Annotated[int, Field(ge=3, le=100_000, strict=True)]
    axes: Literal["local"] | tuple[_Axis, _Axis] | None = None

    @field_validator("axes")
    @classmethod
    def _span_a_plane(cls, axes: Any) -> Any:
        if isinstance(axes, tuple) and axes[0][-1] == axes[1][-1]:
            raise ValueError("the axes at 0 and at 90 degrees must be two of X, Y, Z")
        return axes


class ExcitationSection(_Section):
    """``[excitation]``, or one of several ``[[excitation]]``: channel and place of a force."""

    channel: str | None = None
    position_deg: Finite | None = None
    live_mass_kg: _Kilograms | None = None
    direction: Literal["radial", "tangential", "axial"] | None = None

    @field_validator("direction")
    @classmethod
    def _evaluated(cls, direction: str | None) -> str | None:
        if direction not in (None, "radial"):
            raise ValueError(
                "the ring needs radial excitation. Runs with another force may be added: "
                'excitation = { direction = "tangential" } in [[runs]]'
            )
        return direction


class RunExcitationSection(_Section):
    """``excitation`` of a run: where it differs from ``[excitation]``."""

    channel: str | None = None
    position_deg: Finite | None = None
    direction: Direction = Direction.RADIAL


class UncertainSection(_Section):
    """A value with its standard deviation."""

    value: Positive
    std: NotNegative


def _overlap(value: Any) -> float:
    """A share of a block, or percent."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise ValueError("overlap must be a share such as 0.5, or percent such as 50")
    return overlap_share(value)


class ProcessingSection(_Section):
    """``[processing]``: how recordings become FRFs."""

    averages: Annotated[int, Field(ge=1, strict=True)] | None = None
    block_seconds: Positive | None = None
    window: str | None = None
    overlap: Annotated[float, BeforeValidator(_overlap)] | None = None
    band_hz: tuple[NotNegative, Positive] | None = None
    exponential_window_s: Positive | UncertainSection | None = None
    force_window_s: Positive | None = None

    @model_validator(mode="after")
    def _consistent(self) -> ProcessingSection:
        if self.averages is not None and self.block_seconds is not None:
            raise ValueError("averages and block_seconds exclude each other")
        if self.band_hz is not None and self.band_hz[0] >= self.band_hz[1]:
            raise ValueError("band_hz must be [lower, upper]")
        return self

    def processing(self) -> Processing:
        """Return the settings."""
        given = {name: getattr(self, name) for name in type(self).model_fields}
        if isinstance(window := self.exponential_window_s, UncertainSection):
            given["exponential_window_s"] = window.value
            given["exponential_window_std_s"] = window.std
        return Processing(**given)


class KnownSection(_Section):
    """What is known of a parameter: value with standard deviation, or limits and a start."""

    value: NotNegative | None = None
    std: NotNegative | None = None
    lower: NotNegative | None = None
    upper: Positive | None = None
    start: NotNegative | None = None


class SpreadSection(_Section):
    """Standard deviation of a value that is given elsewhere."""

    std: NotNegative


_Known = NotNegative | KnownSection | None


class TuningSection(_Section):
    """``[tuning]``: pressure model, what is known of the ring, and how well."""

    pressure_load: Literal["dead", "follower"] | None = None
    mass_per_area_kg_m2: _Known = None
    radial_stiffness_n_m3: _Known = None
    circumferential_stiffness_n_m3: _Known = None
    axial_stiffness_n_m: _Known = None
    bending_stiffness_n_m: _Known = None
    radial_growth_m: _Known = None
    inflation_pressure_pa: SpreadSection | None = None
    mean_radius_m: SpreadSection | None = None
    belt_width_m: SpreadSection | None = None
    calibration: SpreadSection | None = None  # these three are shares
    model_form: SpreadSection | None = None
    order_1: SpreadSection | None = None

    def table(self) -> dict[str, Any]:
        """Every key that is given; a plain number is a value without standard deviation."""
        given = self.model_dump(exclude_none=True)
        return {
            name: {"value": entry} if isinstance(entry, float) else entry
            for name, entry in given.items()
        }


class RunSection(_Section):
    """One ``[[runs]]``: a file, its reference sensor, and the positions of its sensors."""

    file: Annotated[str, Field(min_length=1)]
    reference: str | None = None
    positions_deg: dict[str, Finite] | None = None
    directions: dict[str, Direction] = {}
    excitation: Annotated[
        Annotated[RunExcitationSection, Tag(_ONE)]
        | Annotated[tuple[RunExcitationSection, ...], Field(min_length=1), Tag(_MANY)],
        _IS_LIST,
    ] = RunExcitationSection()

    @model_validator(mode="after")
    def _one_direction(self) -> RunSection:
        if len({each.direction for each in self.excitations}) > 1:
            raise ValueError("forces that act at the same time must have one direction")
        return self

    @property
    def excitations(self) -> tuple[RunExcitationSection, ...]:
        """The forces of the run, several where they act at the same time."""
        return self.excitation if isinstance(self.excitation, tuple) else (self.excitation,)


class Manifest(_Section):
    """The manifest with all sections."""

    schema_version: Annotated[int, Field(alias="schema", ge=1, le=1, strict=True)]
    tyre: TyreSection | None = None
    acquisition: AcquisitionSection = AcquisitionSection()
    sensors: SensorsSection = SensorsSection()
    calibration: dict[str, CalibrationSection] = {}
    grid: GridSection | None = None
    excitation: Annotated[
        Annotated[ExcitationSection, Tag(_ONE)]
        | Annotated[tuple[ExcitationSection, ...], Field(min_length=1), Tag(_MANY)],
        _IS_LIST,
    ] = ExcitationSection()
    processing: ProcessingSection = ProcessingSection()
    tuning: TuningSection = TuningSection()
    identification: dict[str, Any] = {}  # `settings_from` checks these two
    checks: dict[str, Any] = {}
    runs: Annotated[tuple[RunSection, ...], Field(min_length=1)]

    @property
    def excitations(self) -> tuple[ExcitationSection, ...]:
        """All forces of the campaign."""
        return self.excitation if isinstance(self.excitation, tuple) else (self.excitation,)

    @field_validator("excitation")
    @classmethod
    def _told_apart(cls, excitation: Any) -> Any:
        several = excitation if isinstance(excitation, tuple) else ()
        names = [each.channel for each in several]
        if len(several) > 1 and (None in names or len(set(names)) < len(names)):
            raise ValueError(
                "each of several forces must have a channel of its own; where one channel moves "
                "from run to run, its place goes into the runs: excitation = { position_deg = … }"
            )
        if len({each.live_mass_kg for each in several}) > 1:
            raise ValueError("live_mass_kg must be the same for all forces")
        return excitation


def _parsed(text: str) -> dict[str, Any]:
    """Contents of TOML; umlauts as one character, quotation marks as a word processor sets them."""
    text = unicodedata.normalize("NFC", text)
    try:
        return tomllib.loads(text)
    except ValueError:
        plain = text.translate(_QUOTES)
        if plain == text:
            raise
        return tomllib.loads(plain)


def read_manifest(path: Path) -> Manifest:
    """Read and check a manifest; the first fault is named with its place and the nearest key."""
    require_regular(path)
    try:
        raw = path.read_bytes()
        content = _parsed(raw.decode("utf-8-sig"))
    except OSError as error:
        rule, remedy = "a manifest must be readable", "Check the name and the access rights"
        raise ManifestError(str(path), error.strerror or str(error), rule, remedy) from error
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        where, found = f"{path.name}, line {line}", f"byte 0x{raw[error.start]:02x}"
        raise ManifestError(where, found, _TOML, "Save it in UTF-8 from the editor") from error
    except (ValueError, RecursionError) as error:  # TOML, an endless number, nesting
        remedy = "Correct the place named"
        if _DECIMAL_COMMA.search(raw):
            remedy += "; numbers have a decimal point, not a comma"
        if b"<" in raw:
            remedy += "; in a template, replace everything in angle brackets by values"
        if b"\\" in raw:
            remedy += f"; {USE_SLASHES}"
        raise ManifestError(path.name, str(error), _TOML, remedy) from error
    try:
        return Manifest.model_validate(content)
    except ValidationError as error:
        raise _explain(path, error) from None


def _explain(path: Path, error: ValidationError) -> ManifestError:
    # A misspelt key is also missing under its right name: name the misspelt one.
    first = min(error.errors(), key=lambda each: each["type"] != "extra_forbidden")
    place = tuple(part for part in first["loc"] if part not in (_ONE, _MANY))
    dotted = ".".join(str(part + 1 if isinstance(part, int) else part) for part in place)
    where = f"{path.name}, {dotted}" if place else path.name
    if first["type"] == "extra_forbidden":
        remedy = nearest(str(place[-1]), _valid_keys(place[:-1]))
        return ManifestError(where, f"key {place[-1]!r}", "it is not known here", remedy)
    if first["type"] == "missing":
        return ManifestError(where, "nothing", "this key is required", "Add it")
    message = str(first["msg"]).removeprefix("Value error, ")
    found = repr(first["input"])
    found = found if len(found) <= _LONGEST_VALUE else f"{found[:_LONGEST_VALUE]}…"
    return ManifestError(where, found, message[:1].lower() + message[1:], "Correct the value")


def _valid_keys(place: tuple[Any, ...]) -> list[str]:
    """Keys that the section at `place` may have."""
    section: type[BaseModel] = Manifest
    for part in place:
        if isinstance(part, str) and part in section.model_fields:
            section = _section_type(section.model_fields[part].annotation) or section
    return [field.alias or name for name, field in section.model_fields.items()]


def _section_type(annotation: Any) -> type[BaseModel] | None:
    """Find the section among the parts of a type such as ``tuple[RunSection, ...] | None``."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    for part in get_args(annotation):
        if (section := _section_type(part)) is not None:
            return section
    return None
