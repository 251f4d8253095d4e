"""A tyre's parameter set as TOML: every value with its uncertainty and how it was obtained."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches
from math import inf, isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeGuard

from ema.errors import InputError
from model.damping import DampingResult
from model.identifiability import AT_BOUND, GIVEN, IDENTIFIED, NOT_IDENTIFIED
from model.parameters import RingDamping, RingParameters, Wheel
from model.tuning_result import TuningResult
from pipelines.library_seal import KEY, unsealed

if TYPE_CHECKING:
    from tomlkit import TOMLDocument

SCHEMA = 1
RING_NAMES = (
    "mean_radius_m",
    "belt_width_m",
    "mass_per_area_kg_m2",
    "radial_stiffness_n_m3",
    "circumferential_stiffness_n_m3",
    "axial_stiffness_n_m",
    "bending_stiffness_n_m",
)
DAMPING_NAMES = ("radial_n_s_m3", "circumferential_n_s_m3", "loss_factor")
WHEEL_NAMES = ("mass_kg", "inertia_kg_m2")
# What else a tyre was measured under; a manifest's [tyre] may tell them.
CONDITION_NAMES = ("temperature_c", "load_n", "speed_m_s", "rim_width_m", "tread_depth_m")
HOWS = (GIVEN, IDENTIFIED, NOT_IDENTIFIED, AT_BOUND)

_OPTIONAL = ("damping", "wheel", "provenance")


@dataclass(frozen=True)
class Parameter:
    """One value of a parameter set.

    Parameters
    ----------
    value : float
        SI.
    how : str
        ``"given"``, ``"identified"``, ``"not identified"`` or ``"at bound"``.
    std : float or None
        Standard deviation; None where unknown.
    """

    value: float
    how: str = "given"
    std: float | None = None


@dataclass(frozen=True)
class ParameterSet:
    """Content of a ``tyre.toml``.

    Parameters
    ----------
    designation : str
    conditions : dict
        At least ``inflation_pressure_pa``.
    ring, damping : dict of str to Parameter
    wheel : dict of str to float
    provenance : dict
    """

    designation: str
    conditions: dict[str, Any]
    ring: dict[str, Parameter]
    damping: dict[str, Parameter] = field(default_factory=dict)
    wheel: dict[str, float] = field(default_factory=dict)
    provenance: dict[str, Any] = field(default_factory=dict)

    @property
    def ring_parameters(self) -> RingParameters:
        """The ring, ready for the model."""
        values = {name: parameter.value for name, parameter in self.ring.items()}
        return RingParameters(
            **values, inflation_pressure_pa=self.conditions["inflation_pressure_pa"]
        )

    @property
    def ring_damping(self) -> RingDamping | None:
        """The damping; None where the set holds none."""
        if not self.damping:
            return None
        radial, circumferential, loss = (self.damping[name].value for name in DAMPING_NAMES)
        return RingDamping(radial, circumferential, loss)

    @property
    def wheel_parameters(self) -> Wheel | None:
        """The wheel; None where the set holds none."""
        return Wheel(**self.wheel) if self.wheel else None


def from_tuning(
    designation: str,
    tuning: TuningResult,
    damping: DampingResult | None,
    provenance: dict[str, Any],
    details: Mapping[str, str] | None = None,
) -> ParameterSet:
    """Parameter set of a tuned ring.

    Parameters
    ----------
    designation : str
    tuning : TuningResult
    damping : DampingResult or None
    provenance : dict
    details : mapping of str to str, optional
        Further keys of the manifest's ``[tyre]``; numbers named in `CONDITION_NAMES` become
        conditions.
    """
    ring = {
        name: Parameter(
            float(getattr(tuning.ring, name)),
            tuning.how.get(name, "given"),
            _finite(tuning.std.get(name)),
        )
        for name in RING_NAMES
        if getattr(tuning.ring, name) is not None
    }
    damped = {}
    if damping is not None:
        damped = {
            name: Parameter(
                float(getattr(damping.damping, name)),
                damping.how[name],
                _finite(damping.std.get(name)),
            )
            for name in DAMPING_NAMES
        }
    conditions = {"inflation_pressure_pa": float(tuning.ring.inflation_pressure_pa)}
    for name in CONDITION_NAMES:
        value = _number(details.get(name, "")) if details else None
        if value is not None:
            conditions[name] = value
    return ParameterSet(designation, conditions, ring, damped, {}, provenance)


def write_parameter_set(path: Path, parameters: ParameterSet) -> None:
    """Write a parameter set as TOML."""
    import tomlkit

    text = tomlkit.dumps(parameter_document(parameters))
    path.write_text(text, encoding="utf-8", newline="\n")


def parameter_document(parameters: ParameterSet) -> TOMLDocument:
    """A parameter set as a TOML document, to which other sections may be added."""
    import tomlkit

    document = tomlkit.document()
    document["schema"] = SCHEMA
    document["designation"] = parameters.designation
    document["conditions"] = parameters.conditions
    for name in ("ring", "damping"):
        section = getattr(parameters, name)
        if section:
            table = tomlkit.table()
            for key, parameter in section.items():
                table[key] = _inline(parameter)
            document[name] = table
    if parameters.wheel:
        document["wheel"] = parameters.wheel
    if parameters.provenance:
        document["provenance"] = parameters.provenance
    return document


def read_parameter_set(path: Path | str) -> ParameterSet:
    """Read a parameter set.

    Raises
    ------
    InputError
        If the file is missing, no TOML, lacks or misspells a parameter, holds a value that cannot
        be, or is an edited version of a library.
    """
    import tomllib

    path = Path(path)
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(
            str(path),
            error.strerror or "unreadable",
            "it must be a parameter set",
            "Check the path",
        ) from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(
            path.name, str(error), "it must be TOML in UTF-8", "Correct the line"
        ) from error
    if KEY in _optional_section(path, content, "version"):
        content = unsealed(path)
    return parameter_set_of(path, content)


def parameter_set_of(path: Path, content: dict[str, Any]) -> ParameterSet:
    """Parameter set from the content of a TOML file; sections that it does not know are left.

    Raises
    ------
    InputError
        If a parameter is missing, misspelt, no number or of unknown origin; names `path`.
    """
    if content.get("schema") != SCHEMA:
        raise InputError(
            f"{path.name}, schema",
            repr(content.get("schema")),
            f"this version reads schema {SCHEMA}",
            f"Write schema = {SCHEMA}, or use the version of ringmodal that wrote the file",
        )
    conditions = _section(path, content, "conditions")
    if "inflation_pressure_pa" not in conditions:
        raise _missing(path, "conditions", "inflation_pressure_pa")
    for name in ("inflation_pressure_pa", *CONDITION_NAMES):
        if name in conditions:
            _require_number(path, "conditions", conditions, name)
    _refuse_misspelt(path, content)
    return ParameterSet(
        designation=_designation(path, content),
        conditions=conditions,
        ring=_parameters(path, content, "ring", RING_NAMES, optional=("belt_width_m",)),
        damping=_parameters(path, content, "damping", DAMPING_NAMES)
        if "damping" in content
        else {},
        wheel=_wheel(path, content) if "wheel" in content else {},
        provenance=_optional_section(path, content, "provenance"),
    )


def _designation(path: Path, content: dict[str, Any]) -> str:
    designation = content.get("designation", path.stem)
    if not isinstance(designation, str):
        where, rule = f"{path.name}, designation", "it must be a text"
        raise InputError(where, repr(designation), rule, 'Write e.g. designation = "225/55R17"')
    return designation


def _parameters(
    path: Path,
    content: dict[str, Any],
    name: str,
    known: tuple[str, ...],
    optional: tuple[str, ...] = (),
) -> dict[str, Parameter]:
    section = _known_section(path, content, name, known, optional)
    return {key: _parameter(path, name, key, entry) for key, entry in section.items()}


def _wheel(path: Path, content: dict[str, Any]) -> dict[str, float]:
    section = _known_section(path, content, "wheel", WHEEL_NAMES)
    for key in section:
        _require_number(path, "wheel", section, key)
    return section


def _known_section(
    path: Path,
    content: dict[str, Any],
    name: str,
    known: tuple[str, ...],
    optional: tuple[str, ...] = (),
) -> dict[str, Any]:
    """A section that holds all of its keys and no other ones."""
    section = _section(path, content, name)
    for key in section:
        if key not in known:
            raise InputError(
                f"{path.name}, [{name}]",
                f"unknown key {key!r}",
                f"known are {', '.join(known)}",
                "Correct or remove it",
            )
    for key in known:
        if key not in section and key not in optional:
            raise _missing(path, name, key)
    return section


def _require_number(path: Path, name: str, section: dict[str, Any], key: str) -> None:
    value = section[key]
    if not (_is_number(value) and isfinite(value)):
        raise InputError(
            f"{path.name}, [{name}] {key}",
            repr(value),
            "it must be a number, and finite",
            f"Write {key} = …, without quotes",
        )


def _parameter(path: Path, section: str, key: str, entry: Any) -> Parameter:
    fields = entry if isinstance(entry, dict) else {"value": entry}
    where, value, std = f"{path.name}, [{section}] {key}", fields.get("value"), fields.get("std")
    if not _is_number(value) or not (std is None or _is_number(std)):
        rule = "value and std must be numbers"
        raise InputError(where, str(entry), rule, "Write { value = …, how = …, std = … }")
    if std is not None and not 0 <= std < inf:
        rule = "a standard deviation is finite and not below zero"
        raise InputError(where, f"std = {std:g}", rule, "Leave std out where it is not known")
    how = fields.get("how", GIVEN)
    if how not in HOWS:
        from ema.io.manifest import nearest  # loads the manifest's checks, needed for this alone

        rule = f"how must be one of {', '.join(HOWS)}"
        raise InputError(where, f"how = {how!r}", rule, nearest(str(how), HOWS))
    return Parameter(float(value), how, None if std is None else float(std))


def _is_number(value: object) -> TypeGuard[int | float]:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _refuse_misspelt(path: Path, content: dict[str, Any]) -> None:
    """Refuse a name that is nearly that of a section which is not there: its values would go."""
    absent = [name for name in _OPTIONAL if name not in content]
    for name in content:
        similar = [] if name in absent else get_close_matches(name, absent, n=1, cutoff=0.8)
        if similar:
            rule = "a parameter set has no such section"
            remedy = f"Did you mean [{similar[0]}]? Call it otherwise where not"
            raise InputError(path.name, f"[{name}]", rule, remedy)


def _optional_section(path: Path, content: dict[str, Any], name: str) -> dict[str, Any]:
    return _section(path, content, name) if name in content else {}


def _section(path: Path, content: dict[str, Any], name: str) -> dict[str, Any]:
    section = content.get(name)
    if section is None:
        raise InputError(
            path.name, f"no section [{name}]", "a parameter set needs it", f"Add [{name}]"
        )
    if not isinstance(section, dict):
        where, rule = f"{path.name}, {name}", "it must be a section"
        raise InputError(where, repr(section), rule, f"Begin it with a line [{name}]")
    return section


def _missing(path: Path, section: str, key: str) -> InputError:
    return InputError(
        f"{path.name}, [{section}]", f"no {key}", "a parameter set needs it", f"Add {key} = …"
    )


def _number(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return value if isfinite(value) else None


def _finite(value: float | None) -> float | None:
    return None if value is None or not isfinite(value) else float(value)


def _inline(parameter: Parameter) -> Any:
    import tomlkit

    entry = tomlkit.inline_table()
    entry["value"] = parameter.value
    entry["how"] = parameter.how
    if parameter.std is not None:
        entry["std"] = parameter.std
    return entry
