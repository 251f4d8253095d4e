"""FRFs from datasets 58 of function type 4, as inertance on common frequency lines."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema.core.errors import RecordingFormatError
from ema.core.finding import Check, Finding, Verdict
from ema.core.frf import FRF
from ema.core.numerics import constant
from ema.core.recording import DERIVATIVES, FORCE, UNKNOWN
from ema.core.units import FREQUENCY, is_stated, parse_ratio
from ema.io.content import Coherences, remark
from ema.io.frf_table import CONVERTED
from ema.io.rates import even_step, step_and_inverse
from ema.io.uff.dataset58 import axis_factor, read_values
from ema.io.uff.dataset58_header import OrdinateUnit, UnitSystem, ordinate_unit
from ema.io.uff.geometry import Surroundings
from ema.io.uff.scan import Dataset, damaged, place

_SAME_FREQUENCY = 1e-6  # relative
_ROUNDING = 1e-3  # by which a coherence may exceed 1
_SAME_LINE = 1e-3  # of the step between lines

#: Begins the third ID line of FRFs that ringmodal exported from modes.
SYNTHESISED = "synthesised"


def measured_only(path: Path, datasets: list[Dataset], findings: list[Finding]) -> list[Dataset]:
    """FRFs without those marked as synthesised, where there are others."""
    others = [each for each in datasets if not each.header58.id_lines[2].startswith(SYNTHESISED)]
    if len(others) < len(datasets):
        detail = "all FRFs are synthesised, none is measured"
        if others:
            drawn = f"{len(datasets) - len(others)} FRFs synthesised from modes"
            detail = f"{drawn}, left out beside {len(others)} measured ones"
        findings.append(remark(path, "", Check.CONTENT, detail))
    return others or datasets


def read_frf(
    path: Path,
    datasets: Sequence[Dataset],
    coherences: Sequence[Dataset],
    around: Surroundings,
    findings: list[Finding],
) -> tuple[FRF, tuple[tuple[int, int], ...]]:
    """Read the FRFs of a file as inertance in (m/s²)/N, and node and axis of the force of each.

    Mobility is multiplied by jω, receptance by −ω². The deviation is unknown.
    """
    frequency_hz = np.empty(0)
    values = np.empty((0, 0), dtype=np.complex128)
    for row, dataset in enumerate(datasets):
        abscissa, ordinate = read_values(path, dataset)
        lines = _lines(path, dataset, abscissa)
        if row == 0:
            frequency_hz = lines
            values = np.empty((len(datasets), len(lines)), dtype=np.complex128)
        elif not same_lines(lines, frequency_hz):
            found = f"{_described(lines)}; dataset {datasets[0].index}: {_described(frequency_hz)}"
            rule = "all FRFs must have the same frequency lines"
            remedy = "Export them with one resolution, or in separate files"
            raise RecordingFormatError(place(path, dataset.index), found, rule, remedy)
        units = around.units_at(dataset)
        values[row] = _inertance(path, dataset, ordinate, units, frequency_hz, findings)
    ends = np.array([_ends(each) for each in datasets])
    values.setflags(write=False)
    frf = FRF(
        frequency_hz=frequency_hz,
        values=values,
        coherence=_coherence(path, datasets, coherences, frequency_hz, findings),
        std=constant(np.nan, values.shape),
        node=ends[:, 0],
        axis=ends[:, 1],
        position_deg=np.array([around.angle_deg.get(n, np.nan) for n in ends[:, 0].tolist()]),
        run=(path.name,) * len(values),
    )
    return frf, tuple(map(tuple, ends[:, 2:].tolist()))


def _coherence(
    path: Path,
    responses: Sequence[Dataset],
    coherences: Sequence[Dataset],
    frequency_hz: NDArray[np.float64],
    findings: list[Finding],
) -> NDArray[np.float64]:
    """Coherence of the same ends (response and reference) as each FRF; NaN where there is none.

    What belongs to no FRF, or is no coherence on its lines, is left out with a finding.
    """
    unknown = constant(np.nan, (len(responses), len(frequency_hz)))
    if not coherences:
        return unknown
    rows = {_ends(dataset): row for row, dataset in enumerate(responses)}
    if len(rows) < len(responses):
        rows = {}  # ends that do not tell the FRFs apart
    found, odd = unknown.copy(), []
    for dataset in coherences:
        row = rows.get(_ends(dataset))
        values = None if row is None else _coherence_on(path, dataset, frequency_hz)
        if values is None:
            odd.append(dataset)
        else:
            found[row] = values
    if odd:
        detail = (
            f"{len(odd)} of {len(coherences)} coherences left out (first: dataset "
            f"{odd[0].index}): each needs the nodes and lines of one FRF, and values from 0 to 1"
        )
        findings.append(remark(path, "", Check.COHERENCE, detail))
    return found if len(odd) < len(coherences) else unknown


def coherences_alone(path: Path, datasets: Sequence[Dataset]) -> Coherences | None:
    """Coherences of a file without FRFs, on the lines of the first; None where it has none."""
    if not datasets:
        return None
    abscissa = read_values(path, datasets[0])[0]
    lines = _lines(path, datasets[0], abscissa)
    found = {_ends(each): _coherence_on(path, each, lines) for each in datasets}
    return Coherences(lines, {ends: each for ends, each in found.items() if each is not None})


def _coherence_on(
    path: Path, dataset: Dataset, frequency_hz: NDArray[np.float64]
) -> NDArray[np.float64] | None:
    """Coherence on these lines; None where it is on others, damaged or none."""
    try:
        abscissa, values = read_values(path, dataset)
        lines = _lines(path, dataset, abscissa)
    except RecordingFormatError:
        return None
    in_range = not np.iscomplexobj(values) and np.all((values >= 0) & (values <= 1 + _ROUNDING))
    return np.minimum(values, 1.0) if in_range and same_lines(lines, frequency_hz) else None


def _ends(dataset: Dataset) -> tuple[int, ...]:
    """Node and axis of response and reference; the sign of a direction does not matter."""
    header = dataset.header58
    response = header.response_node, abs(header.response_direction)
    return (*response, header.reference_node, abs(header.reference_direction))


def same_lines(lines: NDArray[np.float64], others: NDArray[np.float64]) -> bool:
    """Whether two files have the same frequency lines."""
    if len(lines) != len(others):
        return False
    atol = _SAME_LINE * (others[1] - others[0])
    return np.allclose(lines, others, rtol=_SAME_FREQUENCY, atol=atol)


def _described(lines: NDArray[np.float64]) -> str:
    return f"{len(lines)} lines, {lines[0]:g} to {lines[-1]:g} Hz"


def _lines(
    path: Path, dataset: Dataset, abscissa: NDArray[np.float64] | None
) -> NDArray[np.float64]:
    """Frequency lines of a function, which must be equidistant."""
    header = dataset.header58
    where = place(path, dataset.index, 9)
    hertz = axis_factor(path, dataset, FREQUENCY)
    start = header.abscissa_min * hertz
    steps: tuple[float, float] | None = None
    if abscissa is not None:
        start, even = float(abscissa[0]) * hertz, even_step(abscissa * hertz)
        steps = even and even[:2]
    else:
        with contextlib.suppress(ValueError):
            steps = step_and_inverse(header.abscissa_step, hertz)
    if steps is None or header.n_values < 2:
        found = f"{header.n_values} lines from {start:g} Hz, step {header.abscissa_step}"
        raise damaged(where, found, "an FRF must have at least two lines, equidistant")
    last = start + steps[0] * (header.n_values - 1)
    if start < 0.0 or not math.isfinite(last):
        found = f"lines from {start:g} to {last:g} Hz"
        raise damaged(where, found, "frequencies must be positive and finite")
    return start + steps[0] * np.arange(header.n_values, dtype=np.float64)


def _inertance(
    path: Path,
    dataset: Dataset,
    values: NDArray[Any],
    units: UnitSystem,
    frequency_hz: NDArray[np.float64],
    findings: list[Finding],
) -> NDArray[np.complex128]:
    header = dataset.header58
    if not header.is_complex:
        rule = "an FRF needs real and imaginary part; magnitude, dB or real part is not enough"
        remedy = "Export real and imaginary part (ordinate data type 5 or 6)"
        found = f"{header.id_lines[0]!r} has real values"
        raise RecordingFormatError(place(path, dataset.index, 9), found, rule, remedy)
    name = header.id_lines[0]
    sign = -1.0 if (header.response_direction < 0) != (header.reference_direction < 0) else 1.0
    if states_no_unit(dataset):
        return values.astype(np.complex128) * sign
    motion, force = _motion_and_force(path, dataset, units)
    for each in (motion, force):
        if each.remark:
            findings.append(remark(path, name, Check.UNIT, each.remark))
    power = DERIVATIVES[motion.quantity]
    with np.errstate(over="ignore", invalid="ignore"):  # what is not finite stays so
        scaled = values.astype(np.complex128) * (sign * motion.factor / force.factor)
        if not power:
            return scaled
        scaled *= (2j * np.pi * frequency_hz) ** power
    detail = CONVERTED[power].format(motion.quantity)
    findings.append(Finding(path.name, name, None, Check.QUANTITY, Verdict.OK, detail))
    return scaled


def states_no_unit(dataset: Dataset) -> bool:
    """Whether neither kind nor unit of the motion is stated."""
    axis = dataset.header58.ordinate_axis
    return not axis.data_type and not is_stated(axis.unit)


def _motion_and_force(
    path: Path, dataset: Dataset, units: UnitSystem
) -> tuple[OrdinateUnit, OrdinateUnit]:
    """Units of numerator and denominator, which may share one label."""
    header = dataset.header58
    motion = ordinate_unit(header.ordinate_axis, units)
    force = ordinate_unit(header.denominator_axis, units)
    ratio = parse_ratio(header.ordinate_axis.unit)
    if ratio is not None:
        text = header.ordinate_axis.unit
        motion = OrdinateUnit(ratio[0].quantity, text, ratio[0].factor)
        force = OrdinateUnit(FORCE, text, ratio[1].factor)
    denominator = header.denominator_axis
    if force.quantity == UNKNOWN and not denominator.data_type and not is_stated(denominator.unit):
        force = OrdinateUnit(FORCE, "", 1.0 / units.force, "no denominator given; force assumed")
    if motion.quantity not in DERIVATIVES or force.quantity != FORCE:
        found = f"{header.id_lines[0]!r} is {motion.quantity} over {force.quantity}"
        rule = "an FRF must be acceleration, velocity or displacement over force"
        remedy = "Leave this function out, or export it with data types and units"
        raise RecordingFormatError(place(path, dataset.index, 11), found, rule, remedy)
    return motion, force
