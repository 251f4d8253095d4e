"""A tyre's parameter set as TOML: every value with its uncertainty and how it was obtained."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeGuard

import tomlkit

from ema.core.errors import InputError, nearest
from ema.core.files import require_regular
from model.damping import DampingResult
from model.identifiability import AT_BOUND, GIVEN, IDENTIFIED, NOT_IDENTIFIED
from model.parameters import RingDamping, RingParameters, Wheel
from model.tuning import TuningResult
from pipelines.storage.checksums import ACCEPTED, KEY, OWN, content_sha256, unsealed

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
# No parameter or condition of a tyre is as large, or as small but zero, in SI units.
LARGEST, SMALLEST = 1e15, 1e-15
# These enter with high powers, and would overflow long before.
_LARGEST_OF = {"mean_radius_m": 10.0, "belt_width_m": 10.0, "loss_factor": 10.0}

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
    """Write a parameter set as TOML; where it tells its provenance, with a checksum in it."""
    document = parameter_document(parameters)
    if parameters.provenance:
        document["provenance"][OWN] = _checksum(tomllib.loads(tomlkit.dumps(document)))
    path.write_text(tomlkit.dumps(document), encoding="utf-8", newline="\n")


def parameter_document(parameters: ParameterSet) -> TOMLDocument:
    """A parameter set as a TOML document, to which other sections may be added."""
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


def read_parameter_set(
    path: Path | str, *, must_be_as_written: bool = False, accept_changes: bool = False
) -> ParameterSet:
    """Read a parameter set.

    Parameters
    ----------
    path : path
    must_be_as_written : bool
        Whether to refuse a file that tells from which recordings it is but has been edited.
    accept_changes : bool
        Whether to take an edited file all the same; its provenance says so then.

    Raises
    ------
    InputError
        If the file is missing, no TOML, lacks or misspells a parameter, holds a value that cannot
        be, is an edited version of a library, or was edited and is not accepted.
    """
    path = Path(path)
    try:
        content = tomllib.loads(require_regular(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(
            str(path),
            error.strerror or "unreadable",
            "it must be a parameter set",
            "Check the path",
        ) from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise InputError(
            path.name, str(error), "it must be TOML in UTF-8", "Correct the line"
        ) from error
    if KEY in _optional_section(path, content, "version"):
        return parameter_set_of(path, unsealed(path))
    found = parameter_set_of(path, content)
    if not must_be_as_written or _is_as_written(content):
        return found
    if not accept_changes:
        raise InputError(
            str(path),
            "changed after it was written, or of version 0.1.0",
            "values with the provenance of recordings are used as they were identified",
            'Remove [provenance] and write how = "given" where a value is yours, '
            "or accept it as it is with --accept-changes",
        )
    return accepted(found, (path.name,))


def accepted(parameters: ParameterSet, names: Iterable[str]) -> ParameterSet:
    """The set with the names of changed files in its provenance, which were accepted as they are.

    Parameters
    ----------
    parameters : ParameterSet
    names : iterable of str
    """
    earlier = parameters.provenance.get(ACCEPTED, [])
    provenance = {**parameters.provenance, ACCEPTED: sorted({*earlier, *names})}
    return replace(parameters, provenance=provenance)


def _is_as_written(content: dict[str, Any]) -> bool:
    """Whether a file has its checksum, or tells of no recordings and needs none."""
    origin = content.get("provenance", {})
    if OWN in origin:
        return bool(origin[OWN] == _checksum(content))
    return "inputs" not in origin


def _checksum(content: dict[str, Any]) -> str:
    """Checksum over everything in a parameter set but itself."""
    origin = {key: value for key, value in content["provenance"].items() if key != OWN}
    return content_sha256({**content, "provenance": origin})


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
        provenance=_provenance(path, content),
    )


def _provenance(path: Path, content: dict[str, Any]) -> dict[str, Any]:
    """Where it comes from, without the checksum, which belongs to the file."""
    section = _optional_section(path, content, "provenance")
    told = section.get(ACCEPTED, [])
    if not (isinstance(told, list) and all(isinstance(name, str) for name in told)):
        where, rule = f"{path.name}, [provenance] {ACCEPTED}", "it must be a list of file names"
        raise InputError(where, repr(told), rule, "Correct or remove it")
    return {key: value for key, value in section.items() if key != OWN}


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
    where = f"{path.name}, [{name}] {key}"
    if not (_is_number(value) and isfinite(value)):
        rule = "it must be a number, and finite"
        raise InputError(where, repr(value), rule, f"Write {key} = …, without quotes")
    _require_size(where, key, value)


def _parameter(path: Path, section: str, key: str, entry: Any) -> Parameter:
    fields = entry if isinstance(entry, dict) else {"value": entry}
    where, value, std = f"{path.name}, [{section}] {key}", fields.get("value"), fields.get("std")
    if not _is_number(value) or not (std is None or _is_number(std)):
        rule = "value and std must be numbers"
        raise InputError(where, str(entry), rule, "Write { value = …, how = …, std = … }")
    if isfinite(value):  # the ring's own limits name what is not
        _require_size(where, key, value)
    if std is not None and not 0 <= std <= LARGEST:
        rule = f"a standard deviation is finite, not below zero and at most {LARGEST:g}"
        raise InputError(where, f"std = {std:g}", rule, "Leave std out where it is not known")
    how = fields.get("how", GIVEN)
    if how not in HOWS:
        rule = f"how must be one of {', '.join(HOWS)}"
        raise InputError(where, f"how = {how!r}", rule, nearest(str(how), HOWS))
    return Parameter(float(value), how, None if std is None else float(std))


def _require_size(where: str, key: str, value: float) -> None:
    largest = _LARGEST_OF.get(key, LARGEST)
    if value != 0 and not SMALLEST <= abs(value) <= largest:
        rule = f"numbers are zero, or from {SMALLEST:g} to {largest:g}"
        raise InputError(where, f"{value:g}", rule, "Check its exponent and its unit")


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

    entry = tomlkit.inline_table()
    entry["value"] = parameter.value
    entry["how"] = parameter.how
    if parameter.std is not None:
        entry["std"] = parameter.std
    return entry
