"""A tyre's parameter set as TOML: every value with its uncertainty and how it was obtained."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from math import isfinite, nan
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeGuard

import tomlkit

from ema.core.errors import InputError, nearest
from ema.core.files import require_regular
from model import parameters as of_model
from model.damping import DampingResult
from model.identifiability import AT_BOUND, GIVEN, IDENTIFIED, NOT_IDENTIFIED
from model.parameters import RingDamping, RingParameters, Wheel
from model.tuning import TuningResult
from pipelines.results.verdict import SECTIONS, Basis, Covariance, basis_of, basis_records
from pipelines.storage.checksums import ACCEPTED, KEY, OWN, content_sha256, unsealed

if TYPE_CHECKING:
    from tomlkit import TOMLDocument

SCHEMA = 1
RING_NAMES = tuple(name for name in of_model.RING_NAMES if name != "inflation_pressure_pa")
DAMPING_NAMES = tuple(of_model.DAMPING_NAMES)
WHEEL_NAMES = ("mass_kg", "inertia_kg_m2")
# Further conditions; a manifest's [tyre] may have them.
CONDITION_NAMES = ("temperature_c", "load_n", "speed_m_s", "rim_width_m", "tread_depth_m")
HOWS = (GIVEN, IDENTIFIED, NOT_IDENTIFIED, AT_BOUND)
# Limits of any parameter or condition in SI units; zero is permitted.
LARGEST, SMALLEST = 1e15, 1e-15
# These are raised to high powers and would overflow before.
_LARGEST_OF = {"mean_radius_m": 10.0, "belt_width_m": 10.0, "loss_factor": 10.0}

_OPTIONAL = ("damping", "wheel", "provenance", "version", *SECTIONS)


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
    basis : Basis
        Pressure model, verdict, warnings and covariance.
    """

    designation: str
    conditions: dict[str, Any]
    ring: dict[str, Parameter]
    damping: dict[str, Parameter] = field(default_factory=dict)
    wheel: dict[str, float] = field(default_factory=dict)
    provenance: dict[str, Any] = field(default_factory=dict)
    basis: Basis = field(default_factory=Basis)

    @property
    def ring_parameters(self) -> RingParameters:
        """The ring, ready for the model."""
        values = {name: parameter.value for name, parameter in self.ring.items()}
        return RingParameters(
            **values, inflation_pressure_pa=self.conditions["inflation_pressure_pa"]
        )

    @property
    def ring_damping(self) -> RingDamping | None:
        """The damping, if there is any."""
        if not self.damping:
            return None
        radial, circumferential, loss = (self.damping[name].value for name in DAMPING_NAMES)
        return RingDamping(radial, circumferential, loss)

    @property
    def ring_and_damping(self) -> dict[str, Parameter]:
        """Parameters of both by name."""
        return {**self.ring, **self.damping}

    @property
    def wheel_parameters(self) -> Wheel | None:
        """The wheel, if there is one."""
        return Wheel(**self.wheel) if self.wheel else None


def from_tuning(
    designation: str,
    tuning: TuningResult,
    damping: DampingResult | None,
    provenance: dict[str, Any],
    details: Mapping[str, str] | None = None,
    warnings: tuple[str, ...] = (),
) -> ParameterSet:
    """Parameter set of a tuned ring.

    `details` are further keys of the manifest's ``[tyre]``; numbers named in `CONDITION_NAMES`
    become conditions. `warnings` are those of the campaign.
    """
    how = {**dict.fromkeys(RING_NAMES, GIVEN), **tuning.how}
    ring = _obtained(RING_NAMES, tuning.ring, how, tuning.std)
    damped = {}
    if damping is not None:
        damped = _obtained(DAMPING_NAMES, damping.damping, damping.how, damping.std)
    conditions = {"inflation_pressure_pa": float(tuning.ring.inflation_pressure_pa)}
    for name in CONDITION_NAMES:
        with suppress(ValueError, KeyError):
            value = float((details or {})[name])
            if isfinite(value):
                conditions[name] = value
    covariance = Covariance(tuple(tuning.std), tuple(map(tuple, tuning.covariance.tolist())))
    basis = Basis(tuning.pressure_load, tuning.verdict, warnings, covariance)
    return ParameterSet(designation, conditions, ring, damped, {}, provenance, basis)


def tuned_parameters(
    tuning: TuningResult | None, damping: DampingResult | None
) -> dict[str, Parameter]:
    """Parameters of a tuned ring and its damping by name; none without a ring."""
    return {} if tuning is None else from_tuning("", tuning, damping, {}).ring_and_damping


def _obtained(
    names: Iterable[str], values: object, how: Mapping[str, str], std: Mapping[str, float]
) -> dict[str, Parameter]:
    """Parameters of a tuned ring or its damping; those without value are left out."""
    known = {name: getattr(values, name) for name in names}
    stds = {name: float(std[name]) if isfinite(std.get(name, nan)) else None for name in known}
    return {
        name: Parameter(float(value), how[name], stds[name])
        for name, value in known.items()
        if value is not None
    }


def write_parameter_set(path: Path, parameters: ParameterSet) -> None:
    """Write a parameter set as TOML, with a checksum in its provenance if it has any."""
    document = parameter_document(parameters)
    if parameters.provenance:
        document["provenance"][OWN] = _checksum(tomllib.loads(tomlkit.dumps(document)))
    path.write_text(tomlkit.dumps(document), encoding="utf-8", newline="\n")


def parameter_document(parameters: ParameterSet) -> TOMLDocument:
    """A parameter set as a TOML document; other sections may be added."""
    document = tomlkit.document()
    document["schema"] = SCHEMA
    document["designation"] = parameters.designation
    document["conditions"] = parameters.conditions
    for name in ("ring", "damping"):
        if section := getattr(parameters, name):
            document[name] = table = tomlkit.table()
            for key, parameter in section.items():
                table[key] = entry = tomlkit.inline_table()
                entry |= {k: part for k, part in vars(parameter).items() if part is not None}
    if parameters.wheel:
        document["wheel"] = parameters.wheel
    document |= basis_records(parameters.basis)
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
        Whether to refuse an edited file whose provenance names recordings.
    accept_changes : bool
        Whether to accept an edited file; its provenance records that.

    Raises
    ------
    InputError
        If the file is missing, not TOML, lacks or misspells a parameter, has an impossible value,
        is an edited version of a library, or was edited and is not accepted.
    """
    path = Path(path)
    try:
        raw = require_regular(path).read_bytes()
    except OSError as error:
        reason, rule = error.strerror or "unreadable", "it must be a parameter set"
        raise InputError(str(path), reason, rule, "Check the path") from error
    try:
        content = tomllib.loads(raw.decode())
    except (ValueError, RecursionError) as error:  # TOML, UTF-8, an endless number, nesting
        rule, remedy = "it must be TOML in UTF-8", "Correct the line"
        raise InputError(path.name, str(error), rule, remedy) from error
    if KEY in _section(path, content, "version"):
        return parameter_set_of(path, unsealed(path))
    found = parameter_set_of(path, content)
    if not must_be_as_written or _is_as_written(content):
        return found
    if not accept_changes:
        rule = "a set with the provenance of recordings must be as it was identified"
        remedy = 'Remove [provenance] and write how = "given" for your own values, '
        remedy += "or accept it as it is with --accept-changes"
        raise InputError(str(path), "changed after it was written", rule, remedy)
    return accepted(found, (path.name,))


def accepted(parameters: ParameterSet, names: Iterable[str]) -> ParameterSet:
    """The set with the names of changed files that were accepted in its provenance."""
    earlier = parameters.provenance.get(ACCEPTED, [])
    provenance = {**parameters.provenance, ACCEPTED: sorted({*earlier, *names})}
    return replace(parameters, provenance=provenance)


def _is_as_written(content: dict[str, Any]) -> bool:
    """Whether the checksum fits; without recordings in its provenance a file needs none."""
    origin = content.get("provenance", {})
    if OWN in origin:
        return bool(origin[OWN] == _checksum(content))
    return "inputs" not in origin


def _checksum(content: dict[str, Any]) -> str:
    """Checksum of a parameter set without the checksum in it."""
    origin = {key: value for key, value in content["provenance"].items() if key != OWN}
    return content_sha256({**content, "provenance": origin})


def parameter_set_of(path: Path, content: dict[str, Any]) -> ParameterSet:
    """Parameter set from the content of a TOML file; unknown sections are ignored."""
    if (schema := content.get("schema")) != SCHEMA:
        rule = f"this version reads schema {SCHEMA}"
        remedy = f"Write schema = {SCHEMA}, or use the version of ringmodal that wrote the file"
        raise InputError(f"{path.name}, schema", repr(schema), rule, remedy)
    conditions = _section(path, content, "conditions")
    if "inflation_pressure_pa" not in conditions:
        raise _missing(path, "conditions", "inflation_pressure_pa")
    _refuse_misspelt(path, content)
    designation = content.get("designation", path.stem)
    if not isinstance(designation, str):
        where, rule = f"{path.name}, designation", "it must be text"
        raise InputError(where, repr(designation), rule, 'Write e.g. designation = "225/55R17"')
    ring = _section(path, content, "ring", RING_NAMES, optional=("belt_width_m",))
    damping = _section(path, content, "damping", DAMPING_NAMES)
    wheel = _section(path, content, "wheel", WHEEL_NAMES)
    for section, values in (("conditions", conditions), ("wheel", wheel)):
        for key in ("inflation_pressure_pa", *CONDITION_NAMES, *WHEEL_NAMES):
            if key in values:
                _number(path, section, key, values[key])
    provenance = _section(path, content, "provenance")
    names = provenance.get(ACCEPTED, [])
    if not (isinstance(names, list) and all(isinstance(name, str) for name in names)):
        where, rule = f"{path.name}, [provenance] {ACCEPTED}", "it must be a list of file names"
        raise InputError(where, repr(names), rule, "Correct or remove it")
    return ParameterSet(
        designation=designation,
        conditions=conditions,
        ring={key: _parameter(path, "ring", key, entry) for key, entry in ring.items()},
        damping={key: _parameter(path, "damping", key, entry) for key, entry in damping.items()},
        wheel=wheel,
        provenance={key: value for key, value in provenance.items() if key != OWN},
        basis=basis_of(
            path,
            {name: _section(path, content, name) for name in SECTIONS},
            (*of_model.RING_NAMES, *DAMPING_NAMES),
        ),
    )


def _section(
    path: Path,
    content: dict[str, Any],
    name: str,
    known: tuple[str, ...] = (),
    optional: tuple[str, ...] = (),
) -> dict[str, Any]:
    """A section with all `known` keys and no others; an optional one may be missing."""
    section = content.get(name, {} if name in _OPTIONAL else None)
    if section is None:
        found, rule = f"no section [{name}]", "a parameter set needs it"
        raise InputError(path.name, found, rule, f"Add [{name}]")
    if not isinstance(section, dict):
        where, rule = f"{path.name}, {name}", "it must be a section"
        raise InputError(where, repr(section), rule, f"Begin it with a line [{name}]")
    if not known or name not in content:
        return section
    for key in section:
        if key not in known:
            where, rule = f"{path.name}, [{name}]", f"known are {', '.join(known)}"
            raise InputError(where, f"unknown key {key!r}", rule, "Correct or remove it")
    for key in known:
        if key not in section and key not in optional:
            raise _missing(path, name, key)
    return section


def _missing(path: Path, section: str, key: str) -> InputError:
    where, rule = f"{path.name}, [{section}]", "a parameter set needs it"
    return InputError(where, f"no {key}", rule, f"Add {key} = …")


def _refuse_misspelt(path: Path, content: dict[str, Any]) -> None:
    """Refuse a section whose name resembles that of an absent one: its values would be ignored."""
    absent = [name for name in _OPTIONAL if name not in content]
    for name in content:
        similar = [] if name in absent else get_close_matches(name, absent, n=1, cutoff=0.8)
        if similar:
            remedy = f"Did you mean [{similar[0]}]? Otherwise choose another name"
            raise InputError(path.name, f"[{name}]", "a parameter set has no such section", remedy)


def _parameter(path: Path, section: str, key: str, entry: Any) -> Parameter:
    fields = entry if isinstance(entry, dict) else {"value": entry}
    value, std = _number(path, section, key, fields.get("value")), fields.get("std")
    where = f"{path.name}, [{section}] {key}"
    if std is not None and not (_is_number(std) and 0 <= std <= LARGEST):
        rule = f"a standard deviation must be a number, ≥ 0 and at most {LARGEST:g}"
        raise InputError(where, f"std = {std!r}", rule, "Leave std out if it is not known")
    how = fields.get("how", GIVEN)
    if how not in HOWS:
        rule = f"how must be one of {', '.join(HOWS)}"
        raise InputError(where, f"how = {how!r}", rule, nearest(str(how), HOWS))
    return Parameter(value, how, None if std is None else float(std))


def _number(path: Path, section: str, key: str, value: Any) -> float:
    """A finite number of a size that a tyre can have."""
    where, largest = f"{path.name}, [{section}] {key}", _LARGEST_OF.get(key, LARGEST)
    if not _is_number(value):
        raise InputError(where, repr(value), "it must be a number", f"Write {key} = …")
    if value != 0 and not SMALLEST <= abs(value) <= largest:
        rule = f"it must be zero, or from {SMALLEST:g} to {largest:g}"
        raise InputError(where, repr(value), rule, "Check its exponent and its unit")
    return float(value)


def _is_number(value: object) -> TypeGuard[int | float]:
    return isinstance(value, int | float) and not isinstance(value, bool)
