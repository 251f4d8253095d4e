"""What ``identification.json`` must hold, down to types, lengths and what numbers can be."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

from pydantic import TypeAdapter, ValidationError

from ema.core.block_plan import BlockPlan
from ema.core.campaign import Tyre
from ema.core.errors import InputError
from ema.core.files import require_regular
from ema.core.finding import EXCLUDED, OK, WARNING, Finding
from ema.core.modes import Flag, OrderReport, Pair
from ema.poles.cross_check import Opinion
from pipelines.storage.tables import LARGEST

Two = tuple[float, float]

_MAY_BE_INFINITE = ("std_percent", "n_effective")  # where nothing is known
_HIGHEST_ORDER = 10_000  # far above what sensors around a tyre can tell
_SLOWEST_RAD_S = 1e-6  # a pole has a frequency


@dataclass(frozen=True)
class StoredMode:
    """A `Mode` without its residues."""

    pole: Two
    frequency_std_hz: float
    damping_std: float
    order: int | None
    member: Literal["", "a", "b"]
    order_purity: float
    pair: Pair
    flags: tuple[Flag, ...]
    remark: str
    frequency_band_shift_hz: float
    damping_band_shift: float


@dataclass(frozen=True)
class StoredCluster:
    """A `Cluster`."""

    label: int
    pole: Two
    size: int
    kept: bool
    reason: str


@dataclass(frozen=True)
class StoredDrift:
    """A `Drift`."""

    run: tuple[str, ...]
    percent: tuple[float, ...]
    std_percent: tuple[float, ...]
    applied: bool
    chance: float


@dataclass(frozen=True)
class StoredIdentification:
    """Content of ``identification.json``."""

    name: str
    tyre: Tyre | None
    excitation_deg: float | None
    reference_deg: float | None
    findings: tuple[Finding, ...]
    opinions: tuple[Opinion, ...]
    blocks: BlockPlan | None
    n_effective: float
    band_hz: Two
    fit_band_hz: Two
    misfit: float
    covariance: tuple[tuple[float, ...], ...]
    frac: tuple[float, ...]
    drift: StoredDrift
    notes: tuple[str, ...]
    orders: tuple[OrderReport, ...]
    modes: tuple[StoredMode, ...]
    guard_modes: tuple[StoredMode, ...]
    clusters: tuple[StoredCluster, ...]
    indicator_hz: tuple[float, ...]
    indicator: tuple[float, ...]


def read_stored(path: Path) -> StoredIdentification:
    """Read ``identification.json``.

    Raises
    ------
    InputError
        If it cannot be read or holds what no identification gives; says where.
    """
    try:
        text = require_regular(path).read_bytes()
        found = TypeAdapter(StoredIdentification).validate_json(text, strict=True)
    except OSError as error:
        raise _unusable(path, error.strerror or "unreadable", "a result needs it") from error
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        where = ".".join(map(str, first["loc"])) or "the whole file"
        raise _unusable(path, f"{where}: {first['msg']}", "every part has its type") from error
    for place, number in _numbers(asdict(found), ""):
        may_be_infinite = place.split(".")[1] in _MAY_BE_INFINITE or "std_percent" in place
        if abs(number) > LARGEST and not (math.isinf(number) and may_be_infinite):
            rule = f"numbers are finite and at most {LARGEST:g}"
            raise _unusable(path, f"{place[1:]}: {number:g}", rule)
    for found_wrong, rule in _faults(found):
        raise _unusable(path, found_wrong, rule)
    return found


def _numbers(value: Any, place: str) -> Iterator[tuple[str, float]]:
    """All numbers with their places; NaN is smaller than any limit."""
    if isinstance(value, dict):
        for key, part in value.items():
            yield from _numbers(part, f"{place}.{key}")
    elif isinstance(value, list | tuple):
        for part in value:
            yield from _numbers(part, place)
    elif isinstance(value, int | float) and not isinstance(value, bool):
        yield place, value


def _faults(found: StoredIdentification) -> Iterator[tuple[str, str]]:
    """What is wrong although every part has its type, and the rule it breaks."""
    for low, high in (found.band_hz, found.fit_band_hz):
        if not 0 <= low < high:
            yield f"a band from {low:g} to {high:g} Hz", "a band begins at 0 Hz or above and rises"
    for mode in (*found.modes, *found.guard_modes):
        yield from _faults_of_pole(mode.pole)
        if not 0 <= (mode.order or 0) <= _HIGHEST_ORDER:
            yield f"order {mode.order}", f"an order is 0 to {_HIGHEST_ORDER}"
        if mode.frequency_std_hz < 0 or mode.damping_std < 0:
            yield "a standard deviation below zero", "it is zero or more"
    for cluster in found.clusters:
        yield from _faults_of_pole(cluster.pole)
    if not found.modes:
        yield "no modes", "an identification has modes"
    size = 2 * len(found.modes)
    if len(found.covariance) != size or any(len(row) != size for row in found.covariance):
        yield "another number of covariances", f"{len(found.modes)} modes have {size} × {size}"
    if len(found.indicator) != len(found.indicator_hz):
        yield "an indicator of other length than its frequencies", "each frequency has one value"
    yield from _faults_of_drift(found.drift)
    yield from _faults_of_campaign(found)


def _faults_of_pole(pole: Two) -> Iterator[tuple[str, str]]:
    if not (pole[1] > _SLOWEST_RAD_S and abs(pole[0]) < LARGEST):
        yield f"pole {pole[0]:g} + {pole[1]:g}j", "a pole lies in the upper half plane"


def _faults_of_drift(drift: StoredDrift) -> Iterator[tuple[str, str]]:
    if not len(drift.run) == len(drift.percent) == len(drift.std_percent):
        yield "drift of another number of runs", "each run has a drift and its deviation"
    if not all(percent > -100 for percent in drift.percent):
        yield f"drift {min(drift.percent):g} %", "frequencies stay above zero"


def _faults_of_campaign(found: StoredIdentification) -> Iterator[tuple[str, str]]:
    for finding in found.findings:
        if finding.verdict not in (OK, WARNING, EXCLUDED):
            yield f"verdict {finding.verdict!r}", f"it is {OK}, {WARNING} or {EXCLUDED}"
    for report in found.orders:
        if not 0 <= report.order <= _HIGHEST_ORDER:
            yield f"order {report.order}", f"an order is 0 to {_HIGHEST_ORDER}"
    plan = found.blocks
    if plan is not None:
        sizes = (plan.sampling_rate_hz, plan.block_samples, plan.step_samples, plan.n_blocks)
        if not (min(sizes) > 0 and plan.period_samples >= 0):
            yield f"blocks of {plan.block_samples} samples", "lengths and rates are above zero"
    tyre = found.tyre
    if tyre is not None:
        for name in ("inflation_pressure_pa", "mean_radius_m", "belt_width_m"):
            value = getattr(tyre, name)
            if value is not None and not value > 0:
                yield f"{name} = {value:g}", "it is above zero"


def _unusable(path: Path, found: str, rule: str) -> InputError:
    return InputError(str(path), found, rule, "Process the recordings again")


@dataclass(frozen=True)
class _Input:
    file: str
    bytes: int
    sha256: str


@dataclass(frozen=True)
class _Software:
    ringmodal: str


@dataclass(frozen=True)
class _Options:
    tune: bool
    objective: str
    given: dict[str, float]
    processing: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class _Provenance:
    software: _Software
    created: str
    campaign: str
    inputs: list[_Input]
    options: _Options
    stage_seconds: dict[str, float] = field(default_factory=dict)
    accepted_changes: dict[str, str] = field(default_factory=dict)


def require_provenance(path: Path, content: dict[str, Any]) -> None:
    """Refuse provenance from which no later stage can go on.

    Raises
    ------
    InputError
        If a part is missing or of another type; names it.
    """
    try:
        TypeAdapter(_Provenance).validate_python(content)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        where = ".".join(map(str, first["loc"]))
        rule = "later stages need what is told of the recordings and the options"
        raise InputError(
            f"{path}, {where}", first["msg"], rule, "Process the recordings again"
        ) from error
