"""Edits: what a person decided about poles, channels, runs and settings, as data."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from ema.core.errors import InputError


class EditKind(StrEnum):
    """What an edit does: the value of ``kind`` in ``edits.toml``."""

    KEEP = "keep"  # a mode of the fit stays listed, whatever the checks say of it
    SET_ASIDE = "set_aside"  # a mode is fitted with the rest but no part of the result
    PICK = "pick"  # a further pole of the stability diagram is fitted and listed
    START = "start"  # a pole starts the fit elsewhere
    LOCK = "lock"  # a pole stays where it is
    ONLY_KEPT = "only_kept"  # nothing is listed but what was kept or picked
    NO_PARTNERS = "no_partners"  # no second pole is added to an order
    CHANNEL_OUT = "channel_out"  # an FRF row is left out
    CHANNEL_IN = "channel_in"  # a row that was left out automatically is used
    FLIP = "flip"  # a row changes its sign
    GAIN = "gain"  # a row is multiplied with `value`
    RUN_OUT = "run_out"  # all rows of a run are left out
    ORDER_IS = "order_is"  # a mode belongs to the order `value`
    SETTINGS = "settings"  # band, model order, estimator or processing are changed
    NOTE = "note"  # a remark


#: Kinds that name a pole.
OF_POLES = frozenset(
    {
        EditKind.KEEP,
        EditKind.SET_ASIDE,
        EditKind.PICK,
        EditKind.START,
        EditKind.LOCK,
        EditKind.ORDER_IS,
    }
)
#: Kinds that name an FRF row.
OF_CHANNELS = frozenset({EditKind.CHANNEL_OUT, EditKind.CHANNEL_IN, EditKind.FLIP, EditKind.GAIN})


@dataclass(frozen=True)
class PoleName:
    """Which pole is meant: found again by frequency and, where given, damping.

    `method` and `model_order` name a pole of the stability diagram; without them a mode of the
    fit is meant.
    """

    frequency_hz: float
    damping_ratio: float | None = None
    method: str | None = None
    model_order: int | None = None

    def __post_init__(self) -> None:
        """Refuse numbers that are no frequency or damping ratio."""
        hz, ratio = self.frequency_hz, self.damping_ratio
        if not (math.isfinite(hz) and hz > 0):
            raise InputError("pole", f"{hz:g} Hz", "a frequency must be > 0", "Correct it")
        if ratio is not None and not abs(ratio) < 1:
            rule = "a damping ratio lies between −1 and 1"
            raise InputError("pole", f"damping ratio {ratio:g}", rule, "Correct it")


@dataclass(frozen=True)
class ChannelName:
    """Which FRF row is meant; without run those of all runs, without reference those of all forces.

    `reference` is the number of the force, from 1.
    """

    channel: str
    run: str | None = None
    reference: int | None = None


@dataclass(frozen=True)
class Edit:
    """One decision, with who took it, when and why.

    Parameters
    ----------
    kind : EditKind
    pole : PoleName, optional
        For `OF_POLES`.
    channel : ChannelName, optional
        For `OF_CHANNELS`.
    run : str, optional
        For ``run_out``.
    value : float, optional
        Gain, or order.
    settings : mapping
        Options of the same names as in `Options` and the manifest's ``[processing]``.
    by, reason : str
    at : str
        Time, ISO 8601 with offset.
    """

    kind: EditKind
    pole: PoleName | None = None
    channel: ChannelName | None = None
    run: str | None = None
    value: float | None = None
    settings: Mapping[str, Any] = field(default_factory=dict)
    by: str = ""
    at: str = ""
    reason: str = ""

    def __post_init__(self) -> None:
        """Refuse an edit that does not say what it acts on."""
        given = {
            "pole": (self.pole, OF_POLES),
            "channel": (self.channel, OF_CHANNELS),
            "run": (self.run, {EditKind.RUN_OUT}),
            "value": (self.value, {EditKind.GAIN, EditKind.ORDER_IS}),
        }
        for name, (value, kinds) in given.items():
            if self.kind in kinds and value is None:
                raise InputError(f"edit {self.kind}", f"no {name}", "it needs one", f"Add {name}")
        if self.kind is EditKind.GAIN and not (self.value and math.isfinite(self.value)):
            rule = "a row is multiplied with a finite number that is not 0"
            raise InputError("edit gain", f"value {self.value}", rule, "Correct it")
        if self.kind is EditKind.ORDER_IS and self.value not in range(1000):
            raise InputError(
                "edit order_is", f"value {self.value}", "it is an order 0, 1, 2 …", "Correct it"
            )


def of_kind(edits: Iterable[Edit], *kinds: EditKind) -> tuple[Edit, ...]:
    """The edits of some kinds, in their order."""
    return tuple(edit for edit in edits if edit.kind in kinds)


def shorthand(
    pinned_hz: Iterable[float] | None = None, excluded_hz: Iterable[float] = ()
) -> tuple[Edit, ...]:
    """What frequencies alone say: nothing but the pinned modes, and none of the excluded ones."""
    pins = [Edit(EditKind.KEEP, PoleName(hz)) for hz in pinned_hz or ()]
    excluded = [Edit(EditKind.SET_ASIDE, PoleName(hz)) for hz in excluded_hz]
    only = [] if pinned_hz is None else [Edit(EditKind.ONLY_KEPT)]
    return (*pins, *only, *excluded)
