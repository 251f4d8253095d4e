"""What a person decided on a result, and what a refit needs to know of a campaign."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from ema.checks.sensor_mass import SensorMass
from ema.core.edits import Edit, PoleName
from ema.core.finding import Finding
from ema.core.modes import ModalModel, Pair
from ema.signals.steadiness import Steadiness


@dataclass(frozen=True)
class Setup:
    """What is said of the recordings, whatever modes are found.

    Parameters
    ----------
    sensor_mass : SensorMass or None
        Stated masses, which are compensated where the angles are known.
    findings : tuple of Finding
        About the recordings, before those of the modes.
    notes : tuple of str
        About masses and other directions.
    steadiness : tuple of Steadiness
        Of each run, against the automatic modes.
    later : tuple of Finding
        About other directions.
    """

    sensor_mass: SensorMass | None = None
    findings: tuple[Finding, ...] = ()
    notes: tuple[str, ...] = ()
    steadiness: tuple[Steadiness, ...] = ()
    later: tuple[Finding, ...] = ()


@dataclass(frozen=True)
class AutomaticMode:
    """A row of ``modes.csv`` as it was before any decision."""

    frequency_hz: float
    frequency_std_hz: float
    damping_ratio: float
    damping_std: float
    order: int | None
    member: str
    pair: Pair
    status: str


def automatic_modes(model: ModalModel) -> tuple[AutomaticMode, ...]:
    """The list of modes to keep beside one that was edited."""
    names = AutomaticMode.__dataclass_fields__
    return tuple(
        AutomaticMode(**{name: getattr(mode, name) for name in names}) for mode in model.modes
    )


def edit_records(edits: Iterable[Edit]) -> list[dict[str, Any]]:
    """Edits as in ``edits.toml`` and ``provenance.json``: only what each of them says."""
    found = []
    for edit in edits:
        of_channel = vars(edit.channel) if edit.channel else {"run": edit.run}
        pole = {} if edit.pole is None else {"pole": _said(_pole_record(edit.pole))}
        rest = {"value": edit.value, "settings": dict(edit.settings)}
        who = {"by": edit.by, "at": edit.at, "reason": edit.reason}
        found.append(_said({"kind": edit.kind.value, **pole, **of_channel, **rest, **who}))
    return found


def _pole_record(pole: PoleName) -> dict[str, Any]:
    named = {"method": pole.method, "order": pole.model_order}
    return {**named, "frequency_hz": pole.frequency_hz, "damping_ratio": pole.damping_ratio}


def _said(record: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in record.items() if value not in (None, "", {})}
