"""Content of ``identification.json`` and ``provenance.json``: types, lengths and ranges."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

from pydantic import StrictBool, StrictFloat, TypeAdapter, ValidationError

from ema.checks.corrections import Correction
from ema.core.campaign import Tyre
from ema.core.errors import InputError
from ema.core.files import require_regular
from ema.core.finding import Finding
from ema.core.modes import Chosen, Flag, OrderReport, Pair
from ema.core.recording import BlockPlan, ExponentialWindow
from ema.poles.stability import Opinion
from ema.signals.steadiness import Steadiness
from pipelines.results.result import AutomaticMode, DrivenMode, OtherMode
from pipelines.storage.tables import LARGEST, REMEDY

_MAY_BE_INFINITE = ("std_percent", "n_effective")  # where nothing is known
_HIGHEST_ORDER = 10_000  # far above what sensors around a tyre can resolve
_SLOWEST_RAD_S = 1e-6  # smallest imaginary part of a pole

Two = tuple[float, float]


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
    chosen: Chosen = Chosen.AUTOMATIC
    modal_mass_kg: float = math.nan
    modal_mass_std_kg: float = math.nan
    modal_mass_spread: float = math.nan


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
    slope_percent: tuple[float, ...]
    curvature_percent: tuple[float, ...]
    damping_percent: tuple[float, ...]
    damping_std_percent: tuple[float, ...]
    middle_hz: float
    applied: bool
    chance: float
    number: tuple[int, ...] = ()


@dataclass(frozen=True)
class StoredMass:
    """A `SensorMass`."""

    mass_kg: float
    sensors_deg: dict[str, tuple[float, ...]]
    excitation_deg: float
    live_mass_kg: float
    drift: StoredDrift | None = None
    own_kg: dict[str, tuple[float, ...]] = field(default_factory=dict)
    across: dict[int, tuple[tuple[Two, ...], tuple[Two, ...]]] = field(default_factory=dict)
    upper_hz: float | None = None
    mixed: tuple[tuple[Two, ...], tuple[tuple[Two, ...], ...]] | None = None


@dataclass(frozen=True)
class StoredForce:
    """A `ForceRecord` without its samples."""

    run: str
    channel: str
    plan: BlockPlan


@dataclass(frozen=True)
class StoredFurther:
    """FRFs against a further force, without their table."""

    excitation_deg: float
    force_node: int
    force_axis: int
    blocks: BlockPlan | None
    n_effective: float
    exponential_window: ExponentialWindow | None
    rows: dict[str, tuple[float, ...]]
    forces: tuple[StoredForce, ...]
    corrections: tuple[Correction, ...] = ()
    sensor_mass: StoredMass | None = None


@dataclass(frozen=True)
class StoredSetup:
    """A `Setup`."""

    sensor_mass: StoredMass | None
    findings: tuple[Finding, ...]
    notes: tuple[str, ...]
    steadiness: tuple[Steadiness, ...]
    later: tuple[Finding, ...]


@dataclass(frozen=True)
class Stored:
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
    exponential_window: ExponentialWindow | None
    notes: tuple[str, ...]
    orders: tuple[OrderReport, ...]
    modes: tuple[StoredMode, ...]
    guard_modes: tuple[StoredMode, ...]
    clusters: tuple[StoredCluster, ...]
    indicator_hz: tuple[float, ...]
    indicator: tuple[float, ...]
    corrections: tuple[Correction, ...] = ()
    sensor_mass: StoredMass | None = None
    other_modes: tuple[OtherMode, ...] = ()
    rows: dict[str, tuple[float, ...]] = field(default_factory=dict)
    forces: tuple[StoredForce, ...] = ()
    setup: StoredSetup | None = None
    automatic: tuple[AutomaticMode, ...] = ()
    automatic_misfit: float = math.nan
    references: tuple[DrivenMode, ...] = ()
    cmif: tuple[tuple[float, ...], ...] = ()
    mif: tuple[tuple[float, ...], ...] = ()
    further: tuple[StoredFurther, ...] = ()
    widened_per_s: tuple[float, ...] = ()


def read_identification_json(path: Path) -> Stored:
    """Read ``identification.json``."""
    try:
        text = require_regular(path).read_bytes()
        found = TypeAdapter(Stored).validate_json(text, strict=True)
    except OSError as error:
        reason = error.strerror or "unreadable"
        raise InputError(str(path), reason, "a result needs this file", REMEDY) from error
    except ValidationError as error:
        where, message = _first(error)
        rule = "it must be as it was written"
        raise InputError(str(path), f"{where}: {message}", rule, REMEDY) from error
    for place, number in _numbers(asdict(found)):
        may_be_infinite = place.endswith(_MAY_BE_INFINITE) and math.isinf(number)
        if abs(number) > LARGEST and not may_be_infinite:
            rule = f"numbers must be finite and at most {LARGEST:g}"
            raise InputError(str(path), f"{place}: {number:g}", rule, REMEDY)
    for place, wrong, rule in _rules(found):
        if wrong:
            raise InputError(f"{path}, {place}", str(wrong[0]), rule, REMEDY)
    return found


def _first(error: ValidationError) -> tuple[str, str]:
    """Place and message of the first error."""
    first = error.errors(include_url=False, include_input=False)[0]
    message = "unknown name" if first["type"] == "enum" else first["msg"]  # that lists all names
    return ".".join(map(str, first["loc"])) or "content", message


def _numbers(value: Any, place: str = "") -> Iterator[tuple[str, float]]:
    """All numbers and where they are."""
    if isinstance(value, dict):
        for key, part in value.items():
            yield from _numbers(part, f"{place}.{key}" if place else key)
    elif isinstance(value, list | tuple):
        for part in value:
            yield from _numbers(part, place)
    elif isinstance(value, int | float):
        yield place, value


def _rules(found: Stored) -> Iterator[tuple[str, list[Any], str]]:
    """What must hold beyond the types: place, values that break the rule, rule."""
    modes = (*found.modes, *found.guard_modes)
    yield "modes", [] if found.modes else ["none"], "there must be one or more"
    bands = [band for band in (found.band_hz, found.fit_band_hz) if not 0 <= band[0] < band[1]]
    yield "band_hz", bands, "must rise from 0 Hz or above"
    poles = [each.pole for each in modes] + [each.pole for each in found.clusters]
    outside = [(re, im) for re, im in poles if not (im > _SLOWEST_RAD_S and abs(re) < LARGEST)]
    yield "pole", outside, "must be in the upper half plane"
    orders = [*(mode.order or 0 for mode in modes), *(each.order for each in found.orders)]
    unlikely = [order for order in orders if not 0 <= order <= _HIGHEST_ORDER]
    yield "order", unlikely, f"must be 0 to {_HIGHEST_ORDER}"
    stds = [std for mode in modes for std in (mode.frequency_std_hz, mode.damping_std)]
    yield "modes", [std for std in stds if std < 0], "standard deviations must be ≥ 0"
    size = 2 * len(found.modes)
    sizes = [n for n in (len(found.covariance), *map(len, found.covariance)) if n != size]
    yield "covariance", sizes, f"must be {size} × {size}"
    widened = len(found.widened_per_s)
    each_mode = "needs one value for each mode, or none"
    yield "widened_per_s", [] if widened in (0, len(found.modes)) else [widened], each_mode
    curves = found.indicator, found.indicator_hz, *found.cmif, *found.mif
    lengths = [*map(len, curves)]
    yield "indicator", lengths if len({*lengths}) > 1 else [], "needs one value for each frequency"
    every: tuple[Stored | StoredFurther, ...] = (found, *found.further)
    masses = [each.sensor_mass for each in every if each.sensor_mass]
    for drift in [found.drift, *(mass.drift for mass in masses if mass.drift)]:
        each_run = {**vars(drift), "number": drift.number or drift.run}
        lengths = [len(each) for each in each_run.values() if isinstance(each, tuple)]
        yield "drift", lengths if len({*lengths}) > 1 else [], "needs one value for each run"
        yield "drift", [each for each in drift.percent if not each > -100], "must be > -100 %"
    for held in (mass for mass in masses if mass.own_kg):
        groups = held.sensors_deg, held.own_kg
        seats, own = ({run: len(each) for run, each in group.items()} for group in groups)
        yield "sensor_mass", [own] if own != seats else [], "needs a mass for each sensor"
    plans = [each.blocks for each in every if each.blocks]
    for plan in [*plans, *(force.plan for each in every for force in each.forces)]:
        counts = (plan.sampling_rate_hz, plan.block_samples, plan.step_samples, plan.n_blocks)
        wrong = [plan] if not (min(counts) > 0 and plan.period_samples >= 0) else []
        yield "blocks", wrong, "lengths and rates must be > 0"
    for window in (each.exponential_window for each in every if each.exponential_window):
        bad = [] if window.time_constant_s > 0 and window.std_s >= 0 else [window]
        yield "exponential_window", bad, "its time constant must be > 0"
    if (tyre := found.tyre) is not None:
        given = (tyre.inflation_pressure_pa, tyre.mean_radius_m, tyre.belt_width_m)
        yield "tyre", [each for each in given if each is not None and not each > 0], "must be > 0"


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
    tune: StrictBool
    objective: str
    given: dict[str, StrictFloat]
    processing: dict[str, Any] = field(default_factory=dict)
    tuning: dict[str, str | dict[str, StrictFloat]] = field(default_factory=dict)


@dataclass(frozen=True)
class _Provenance:
    software: _Software
    created: str
    campaign: str
    inputs: list[_Input]
    options: _Options
    settings: dict[str, dict[str, StrictBool | StrictFloat]] = field(default_factory=dict)
    stage_seconds: dict[str, float] = field(default_factory=dict)
    accepted_changes: dict[str, str] = field(default_factory=dict)


def require_provenance(path: Path, content: dict[str, Any]) -> None:
    """Refuse provenance that later stages cannot use."""
    try:
        TypeAdapter(_Provenance).validate_python(content)
    except ValidationError as error:
        (where, message), rule = _first(error), "later stages need inputs and options"
        raise InputError(f"{path}, {where}", message, rule, REMEDY) from error
