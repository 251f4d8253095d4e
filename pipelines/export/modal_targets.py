"""Modal targets for an FTire-style parameter fit, as a small text file."""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import nan
from pathlib import Path

from ema.core.errors import InputError, visible_line
from model.damping import damping_ratios
from model.errors import InstabilityError
from model.ring import natural_frequencies_hz
from pipelines.export.tir_belt import (
    Belt,
    rotation_damping_ratio,
    rotation_hz,
    translation_damping_ratio,
    translation_hz,
)
from pipelines.results.parameter_set import ParameterSet
from pipelines.results.provenance import software_version

_UNKNOWN = "-"
_COLUMNS = ("mode", "order", "frequency_hz", "damping_ratio")
_MEASURED = ("measured_hz", "measured_damping")
_ABOUT = """\
# Modal targets for an FTire-style parameter fit
# Free tyre on a fixed rim: no load, not rolling. Frequencies are undamped, damping ratios are of
# critical. Values are those of a flexible ring with the parameters of this tyre.
# in_plane_rotation: the belt turns against the rim, under a pressure normal to it; the sensors of a
#   modal test on the tread do not see it, so there is no measured value.
# in_plane_translation: order 1; first_bending: order 2; second_bending: order 3.
"""


@dataclass(frozen=True)
class ModalTarget:
    """A mode that a tyre model has to show.

    Parameters
    ----------
    mode : str
    order : int
        Circumferential order.
    frequency_hz : float
        Undamped; NaN where this ring has no such mode.
    damping_ratio : float
        NaN where the set holds no damping.
    measured_hz, measured_damping : float
        NaN where not measured.
    """

    mode: str
    order: int
    frequency_hz: float
    damping_ratio: float
    measured_hz: float = nan
    measured_damping: float = nan


def _bending(order: int) -> tuple[Callable[[Belt], float], Callable[[Belt], float]]:
    def frequency_hz(belt: Belt) -> float:
        return float(natural_frequencies_hz(belt.ring, order))

    def damping_ratio(belt: Belt) -> float:
        return float(damping_ratios(belt.ring, belt.known_damping, order))

    return frequency_hz, damping_ratio


_MODES = {
    ("in_plane_rotation", 0): (rotation_hz, rotation_damping_ratio),
    ("in_plane_translation", 1): (translation_hz, translation_damping_ratio),
    ("first_bending", 2): _bending(2),
    ("second_bending", 3): _bending(3),
}


def modal_targets(
    parameters: ParameterSet, measured: Mapping[int, tuple[float, float]] | None = None
) -> tuple[ModalTarget, ...]:
    """Rotation, translation and the first two bendings of the belt on a fixed rim.

    Parameters
    ----------
    parameters : ParameterSet
    measured : mapping of int to (float, float), optional
        Frequency in Hz and damping ratio of measured orders; order 0 is not the rotation, which a
        radial sensor does not see, and is passed over.
    """
    belt = Belt(parameters.ring_parameters, parameters.ring_damping)
    seen = {order: pair for order, pair in (measured or {}).items() if order > 0}
    return tuple(
        ModalTarget(name, order, *_values(belt, *functions), *seen.get(order, (nan, nan)))
        for (name, order), functions in _MODES.items()
    )


def write_modal_targets(
    parameters: ParameterSet, path: Path, measured: Mapping[int, tuple[float, float]] | None = None
) -> tuple[ModalTarget, ...]:
    """Write modal targets as text: comment lines with #, then columns separated by blanks.

    Parameters
    ----------
    parameters : ParameterSet
    path : Path
    measured : mapping of int to (float, float), optional
        As `modal_targets`; columns for it are left out where it is not given.

    Returns
    -------
    tuple of ModalTarget
    """
    targets = modal_targets(parameters, measured)
    columns = (*_COLUMNS, *(_MEASURED if measured else ()))
    rows = [columns, *([_cell(getattr(each, name)) for name in columns] for each in targets)]
    text = f"{_ABOUT}{_conditions(parameters)}{_aligned(rows)}"
    path.write_text(text, encoding="utf-8", newline="\n")
    return targets


def measured_modes(result: Path) -> dict[int, tuple[float, float]] | None:
    """Measured frequency and damping ratio by order; None where `result` is no result folder.

    Raises
    ------
    InputError
        If its table is damaged.
    """
    path = result / "validation.csv"
    if not path.is_file():
        return None
    try:
        with path.open(encoding="utf-8", newline="") as file:
            return {
                int(row["order"]): (float(row["measured_hz"]), float(row["measured_damping"]))
                for row in csv.DictReader(file)
            }
    except (KeyError, ValueError) as error:
        rule = "each line has an order, measured_hz and measured_damping"
        raise InputError(str(path), str(error), rule, "Process the campaign again") from error


def _values(
    belt: Belt, frequency_of: Callable[[Belt], float], damping_of: Callable[[Belt], float]
) -> tuple[float, float]:
    try:
        frequency_hz = frequency_of(belt)
    except InstabilityError:  # a torsion without enough k_θ
        return nan, nan
    return frequency_hz, nan if belt.damping is None else damping_of(belt)


def _conditions(parameters: ParameterSet) -> str:
    conditions = {"tyre": parameters.designation, **parameters.conditions}
    conditions["software"] = f"ringmodal {software_version()}"
    lines = (f"# {name}: {_in_one_line(value)}\n" for name, value in conditions.items())
    return "".join(lines)


def _in_one_line(value: object) -> str:
    return visible_line(f"{value:.10g}" if isinstance(value, float) else str(value))


def _cell(value: object) -> str:
    if isinstance(value, float):
        return _UNKNOWN if value != value else f"{value:.6g}"
    return str(value)


def _aligned(rows: Sequence[Sequence[str]]) -> str:
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = (
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    )
    return "\n".join(lines) + "\n"
