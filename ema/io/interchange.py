"""Time series as SEP-005 objects, poles for sdypy-EMA."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema.core.errors import InputError
from ema.core.modes import ModalModel
from ema.core.numerics import ReadonlyArrays
from ema.core.recording import (
    ACCELERATION,
    DISPLACEMENT,
    FORCE,
    UNKNOWN,
    VELOCITY,
    Channel,
    Recording,
)
from ema.core.units import SI_UNIT, parse_unit
from ema.io.rates import even_step, uneven

_QUANTITY = {"f": FORCE, "a": ACCELERATION, "v": VELOCITY, "d": DISPLACEMENT}
_LETTER = {quantity: letter for letter, quantity in _QUANTITY.items()}
_SAME_RATE = 1e-6  # relative


def to_sep005(recording: Recording) -> list[dict[str, Any]]:
    """Time series as SEP-005 objects, one dictionary per channel.

    Parameters
    ----------
    recording : Recording
        All samples are read into memory.

    Returns
    -------
    list of dict
        ``name``, ``data`` (SI), ``fs`` in Hz, ``unit_str``, ``quantity`` where it is known,
        ``group`` (the file), and ``node`` where the channel has one.

    Raises
    ------
    InputError
        If the recording does not state its sampling rate.
    """
    if not recording.sampling_rate_hz > 0:
        rule, remedy = "SEP-005 needs a sampling rate", "Set it with dataclasses.replace"
        raise InputError(str(recording.path), "no sampling rate", rule, remedy)
    return [_series(recording, channel) for channel in recording.channels]


def from_sep005(series: Sequence[Mapping[str, Any]]) -> Recording:
    """Recording from SEP-005 objects, such as those of ``sep005-io-…`` packages.

    Parameters
    ----------
    series : sequence of mapping
        Each with ``name``, ``data``, ``unit_str`` and ``fs`` in Hz or ``time`` in s; all of the
        same rate and length. None in the data counts as missing. Where the unit is not known, the
        quantity is not known either and values stay as they are.

    Raises
    ------
    InputError
        If something is missing or differs.
    """
    if not series:
        raise InputError("SEP-005", "no channels", "channels are needed", "Give at least one")
    channels = tuple(_channel(each, number) for number, each in enumerate(series, start=1))
    rates = [_rate_hz(each, channel) for each, channel in zip(series, channels, strict=True)]
    lengths = {channel.n_samples for channel in channels}
    if len(lengths) > 1 or not np.allclose(rates, rates[0], rtol=_SAME_RATE, atol=0):
        found = f"rates {_few(rates)} Hz, lengths {_few(lengths)}"
        rule = "all channels of a recording must have the same rate and length"
        raise InputError("SEP-005", found, rule, "Resample or cut them, or pass them separately")
    return Recording(Path(str(series[0].get("group") or "sep005")), rates[0], channels)


@dataclass(frozen=True, eq=False)
class SdypyModes(ReadonlyArrays):
    """Poles and modal constants under the names of ``sdypy.EMA.Model``."""

    nat_freq: NDArray[np.float64]  # undamped, Hz
    nat_xi: NDArray[np.float64]  # damping ratios
    all_poles: list[NDArray[np.complex128]]  # one model order with all poles, rad/s
    pole_ind: list[list[int]]  # [model order, pole] of each mode
    A: NDArray[np.complex128]  # modal constants of the receptance; columns are shapes

    def put_into(self, target: Any) -> None:
        """Set these poles and constants in a ``sdypy.EMA.Model``, as if it had found them."""
        for name in ("nat_freq", "nat_xi", "all_poles", "pole_ind", "A"):
            setattr(target, name, getattr(self, name))


def poles_and_shapes_for_sdypy(model: ModalModel) -> SdypyModes:
    """Modes as in ``sdypy.EMA.Model``: same pole sign, same modal constants."""
    poles = np.array([mode.pole for mode in model.modes])
    return SdypyModes(
        nat_freq=model.frequencies_hz,
        nat_xi=model.damping_ratios,
        all_poles=[poles],
        pole_ind=[[0, number] for number in range(poles.size)],
        A=np.array([mode.residues for mode in model.modes]).reshape(poles.size, -1).T,
    )


def _series(recording: Recording, channel: Channel) -> dict[str, Any]:
    found = {
        "name": channel.name,
        "data": channel.block(0, channel.n_samples),
        "fs": float(recording.sampling_rate_hz),
        "unit_str": SI_UNIT.get(channel.quantity, channel.unit).replace("^2", "²"),
        "group": recording.path.name,
        "quantity": _LETTER.get(channel.quantity),
        "node": channel.node,
    }
    return {name: value for name, value in found.items() if value is not None}


def _channel(series: Mapping[str, Any], number: int) -> Channel:
    where = f"SEP-005, channel {number}"
    missing = [key for key in ("name", "data", "unit_str") if series.get(key) is None]
    if missing:
        rule = "each channel needs name, data and unit_str"
        raise InputError(where, f"no {', no '.join(missing)}", rule, "Add what is missing")
    try:
        samples = np.asarray(series["data"], dtype=np.float64)  # None becomes NaN
    except (TypeError, ValueError) as error:
        rule = "data must be numbers"
        raise InputError(where, str(error), rule, "Pass a list of floats") from error
    if samples.ndim != 1 or not samples.size:
        found, rule = f"data of shape {samples.shape}", "a channel must be one row of samples"
        raise InputError(where, found, rule, "Split it into channels")
    unit = parse_unit(str(series["unit_str"]))
    stated = _QUANTITY.get(str(series.get("quantity", "")).lower())
    if unit is not None and stated not in (None, unit.quantity):
        found = f"quantity {series['quantity']!r} in {series['unit_str']}"
        raise InputError(where, found, "quantity and unit contradict each other", "Correct one")
    node = series.get("node")
    return Channel(
        name=str(series["name"]),
        quantity=UNKNOWN if unit is None else unit.quantity,
        unit=str(series["unit_str"]),
        samples=samples,
        scale_to_si=1.0 if unit is None else unit.factor,
        node=None if node is None else int(node),
    )


def _rate_hz(series: Mapping[str, Any], channel: Channel) -> float:
    where = f"SEP-005, channel {channel.name}"
    rate_hz, time_s = series.get("fs"), series.get("time")
    if rate_hz is None and time_s is not None and len(time_s) == channel.n_samples > 1:
        stamps = np.asarray(time_s, dtype=np.float64)
        steps = even_step(stamps)
        if steps is None:
            raise InputError(where, uneven(stamps), "steps must be even", "Resample the channel")
        rate_hz = steps[1]
    if rate_hz is None or not 0 < float(rate_hz) < np.inf:
        rule = "a channel needs a positive rate fs in Hz, or a time vector as long as its data"
        raise InputError(where, f"fs {series.get('fs')}", rule, "Add fs")
    return float(rate_hz)


def _few(values: Any) -> str:
    return ", ".join(f"{value:g}" for value in sorted(set(values))[:4])
