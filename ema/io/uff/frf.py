"""FRFs from datasets 58 of function type 4, as inertance on common frequency lines."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema.core.arrays import constant
from ema.core.errors import RecordingFormatError
from ema.core.finding import Finding
from ema.core.frf import FRF
from ema.core.recording import ACCELERATION, DISPLACEMENT, FORCE, UNKNOWN, VELOCITY
from ema.core.units import is_stated, parse_ratio
from ema.io.content import remark
from ema.io.sampling import even_step, step_and_inverse
from ema.io.uff.dataset58 import read_values
from ema.io.uff.dataset58_header import Header58
from ema.io.uff.scan import COPY_AGAIN, Dataset, place
from ema.io.uff.units import AxisUnit, UnitSystem, ordinate_unit

_TIMES_J_OMEGA = {ACCELERATION: 0, VELOCITY: 1, DISPLACEMENT: 2}  # powers that make it inertance

SYNTHESISED = "synthesised"  # begins the third ID line of FRFs that our export drew from modes


def measured_only(path: Path, datasets: list[Dataset]) -> tuple[list[Dataset], tuple[Finding, ...]]:
    """FRFs without those marked as synthesised, where others stand beside them; and what to say."""
    others = [each for each in datasets if not _header(each).id_lines[2].startswith(SYNTHESISED)]
    n_drawn = len(datasets) - len(others)
    if not n_drawn:
        return datasets, ()
    if not others:
        says = "all FRFs are synthesised, none is measured"
        return datasets, (remark(path, "", "content", says),)
    says = f"{n_drawn} FRFs synthesised from modes, left out beside {len(others)} measured ones"
    return others, (remark(path, "", "content", says),)


def read_frf(
    path: Path, datasets: Sequence[Dataset], units: UnitSystem, angle_deg: Mapping[int, float]
) -> tuple[FRF, tuple[Finding, ...]]:
    """Read the FRFs of a file as inertance in (m/s²)/N; coherence and deviation are unknown.

    Mobility is multiplied by jω, receptance by −ω². Where the response stays and the force
    roves, reciprocity makes the nodes of the force the positions.

    Raises
    ------
    RecordingFormatError
        If a function is no motion over force, the rows differ in their lines, or several
        forces and several responses are mixed.
    """
    frequency_hz = np.empty(0)
    values = np.empty((0, 0), dtype=np.complex128)
    findings: list[Finding] = []
    for row, dataset in enumerate(datasets):
        abscissa, ordinate = read_values(path, dataset)
        lines = _lines(path, dataset, abscissa)
        if row == 0:
            frequency_hz = lines
            values = np.empty((len(datasets), len(lines)), dtype=np.complex128)
        elif not _same_lines(lines, frequency_hz):
            raise _other_lines(path, dataset, lines, datasets[0], frequency_hz)
        values[row], noticed = _inertance(path, dataset, ordinate, units, frequency_hz)
        findings += noticed
    nodes, roving = _nodes(path, datasets)
    if roving:
        detail = "one response, roving force: by reciprocity, the force nodes are used as positions"
        findings.append(remark(path, "", "reciprocity", detail))
    values.setflags(write=False)
    unknown = constant(np.nan, values.shape)
    frf = FRF(
        frequency_hz=frequency_hz,
        values=values,
        coherence=unknown,
        std=unknown,
        node=np.array(nodes),
        position_deg=np.array([angle_deg.get(node, np.nan) for node in nodes]),
        run=(path.name,) * len(values),
    )
    return frf, tuple(findings)


def driven_node(datasets: Sequence[Dataset]) -> int | None:
    """Node of the end that all FRFs share: the force, or by reciprocity the response; or None."""
    headers = [_header(each) for each in datasets]
    for ends in ({h.reference_node for h in headers}, {h.response_node for h in headers}):
        if len(ends) == 1:
            return ends.pop() or None
    return None


def _header(dataset: Dataset) -> Header58:
    assert dataset.header is not None
    return dataset.header


def _same_lines(lines: NDArray[np.float64], others: NDArray[np.float64]) -> bool:
    if len(lines) != len(others):
        return False
    return np.allclose(lines, others, rtol=1e-6, atol=1e-3 * (others[1] - others[0]))


def _lines(
    path: Path, dataset: Dataset, abscissa: NDArray[np.float64] | None
) -> NDArray[np.float64]:
    """Frequency lines of a function; they have to be equidistant."""
    header = _header(dataset)
    if abscissa is not None:
        steps = even_step(abscissa)
        start = float(abscissa[0])
    else:
        start = header.abscissa_min
        try:
            steps = step_and_inverse(header.abscissa_step)
        except ValueError:
            steps = None
    if steps is None or header.n_values < 2:
        found = f"{header.n_values} lines from {start:g} Hz, step {header.abscissa_step}"
        rule = "the lines of an FRF are at least two and equidistant"
        raise RecordingFormatError(place(path, dataset.index, 9), found, rule, COPY_AGAIN)
    last = start + steps[0] * (header.n_values - 1)
    if start < 0.0 or not math.isfinite(last):
        found = f"lines from {start:g} to {last:g} Hz"
        rule = "frequencies must be positive and finite"
        raise RecordingFormatError(place(path, dataset.index, 9), found, rule, COPY_AGAIN)
    return start + steps[0] * np.arange(header.n_values, dtype=np.float64)


def _inertance(
    path: Path,
    dataset: Dataset,
    values: NDArray[Any],
    units: UnitSystem,
    frequency_hz: NDArray[np.float64],
) -> tuple[NDArray[np.complex128], list[Finding]]:
    header = _header(dataset)
    motion, force = _motion_and_force(path, dataset, units)
    sign = -1.0 if (header.response_direction < 0) != (header.reference_direction < 0) else 1.0
    power = _TIMES_J_OMEGA[motion.quantity]
    with np.errstate(over="ignore", invalid="ignore"):  # what is not finite shows as such
        scaled = values.astype(np.complex128) * (sign * motion.factor / force.factor)
        row = scaled if power == 0 else scaled * (2j * np.pi * frequency_hz) ** power
    name = header.id_lines[0]
    notes = [remark(path, name, "unit", each.remark) for each in (motion, force) if each.remark]
    if power:
        factor = "jω" if power == 1 else "−ω²"
        detail = f"{motion.quantity} over force, converted to inertance (factor {factor})"
        notes.append(remark(path, name, "quantity", detail))
    return row, notes


def _motion_and_force(path: Path, dataset: Dataset, units: UnitSystem) -> tuple[AxisUnit, AxisUnit]:
    """Units of numerator and denominator, which may share one label."""
    header = _header(dataset)
    motion = ordinate_unit(header.ordinate_axis, units)
    force = ordinate_unit(header.denominator_axis, units)
    ratio = parse_ratio(header.ordinate_axis.unit)
    if ratio is not None:
        text = header.ordinate_axis.unit
        motion = AxisUnit(ratio[0].quantity, text, ratio[0].factor)
        force = AxisUnit(FORCE, text, ratio[1].factor)
    denominator = header.denominator_axis
    if force.quantity == UNKNOWN and not denominator.data_type and not is_stated(denominator.unit):
        force = AxisUnit(FORCE, "", 1.0 / units.force, "no denominator given; force assumed")
    if motion.quantity not in _TIMES_J_OMEGA or force.quantity != FORCE:
        found = f"{header.id_lines[0]!r} is {motion.quantity} over {force.quantity}"
        rule = "an FRF is acceleration, velocity or displacement over force"
        remedy = "Leave this function out, or export it with data types and units"
        raise RecordingFormatError(place(path, dataset.index, 11), found, rule, remedy)
    return motion, force


def _nodes(path: Path, datasets: Sequence[Dataset]) -> tuple[list[int], bool]:
    """Nodes of the rows, and whether it was the force that roved."""
    headers = [_header(each) for each in datasets]
    responses = [each.response_node for each in headers]
    forces = [each.reference_node for each in headers]
    if len(set(forces)) == 1:
        return responses, False
    if len(set(responses)) == 1:
        return forces, True
    found = f"{len(set(forces))} force nodes and {len(set(responses))} response nodes"
    rule = "one force belongs to all FRFs (or one response, where the force roves)"
    raise RecordingFormatError(path.name, found, rule, "Export one reference per file")


def _other_lines(
    path: Path,
    dataset: Dataset,
    lines: NDArray[np.float64],
    first: Dataset,
    expected: NDArray[np.float64],
) -> RecordingFormatError:
    def describe(values: NDArray[np.float64]) -> str:
        return f"{len(values)} lines, {values[0]:g} to {values[-1]:g} Hz"

    found = f"{describe(lines)}; dataset {first.index} has {describe(expected)}"
    rule = "all FRFs must have the same frequency lines"
    remedy = "Export them with one resolution, or in files of their own"
    return RecordingFormatError(place(path, dataset.index), found, rule, remedy)
