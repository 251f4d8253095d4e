"""Dataset 58: functions as universal files hold them, and FRFs among them."""

from __future__ import annotations

import contextlib
import io
import math
from array import array
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ema.core.errors import RecordingFormatError
from ema.core.files import mapped
from ema.core.finding import Check, Finding, Verdict
from ema.core.frf import FRF
from ema.core.numerics import constant
from ema.core.recording import DERIVATIVES, FORCE, UNKNOWN
from ema.core.units import FREQUENCY, is_stated, parse_axis, parse_ratio
from ema.io.content import Coherences, note, remark
from ema.io.frf_table import CONVERTED
from ema.io.rates import even_step, step_and_inverse
from ema.io.uff.dataset58_header import Header58, OrdinateUnit, UnitSystem, ordinate_unit
from ema.io.uff.geometry import Surroundings
from ema.io.uff.scan import Dataset, damaged, line_numbers, place

_CHUNK_BYTES = 1 << 19
_LONGEST_LINE = 4096
# Check of the byte order.
_PROBED = 1024  # values at the beginning
_FEWEST = 16  # values other than zero; fewer may be anything
_SENSIBLE = (1e-15, 1e15)  # of motion or force, in whatever unit
_FORTRAN_TO_C = bytes.maketrans(b"Dde", b"EEE")
_SAME_FREQUENCY = 1e-6  # relative
_ROUNDING = 1e-3  # by which a coherence may exceed 1
_SAME_LINE = 1e-3  # of the step between lines


def read_values(
    path: Path, dataset: Dataset, *, form_only: bool = False, padded: list[Dataset] | None = None
) -> tuple[NDArray[np.float64] | None, NDArray[Any]]:
    """Read abscissa (None where the header gives minimum and step) and values of a dataset 58.

    Values are real or complex, and a read-only memory map of the file where the payload is binary.
    With `form_only`, long text of equal lines and even spacing is not read: its samples are NaN.
    A dataset whose last line ends in zeros beyond the stated number joins those `padded`.
    """
    header = dataset.header58
    if form_only and header.even and dataset.is_equal_lines:
        return None, constant(np.nan, (header.n_values,))
    if dataset.layout is None:
        numbers = _read_text(path, dataset, header)
        stated = header.n_values * header.numbers_per_value
        if len(numbers) > stated and padded is not None:
            padded.append(dataset)
        return _split(header, numbers[:stated])
    begin, _ = dataset.payload
    records: NDArray[Any] = mapped(path, dataset.layout, begin, (header.n_values,))
    _check_byte_order(place(path, dataset.index, 2), records if header.even else records["value"])
    if header.even:
        return None, records
    with np.errstate(invalid="ignore"):  # signalling NaNs; the abscissa is checked where used
        return records["abscissa"].astype(np.float64), records["value"]


def about_padding(path: Path, padded: Sequence[Dataset]) -> list[Finding]:
    """What is said of datasets that fill their last line with zeros."""
    if not padded:
        return []
    detail = (
        f"zeros behind the stated values, on the last line of {len(padded)} datasets (first: "
        f"{padded[0].index}), are left out"
    )
    return [note(path, Check.CONTENT, detail)]


def axis_factor(path: Path, dataset: Dataset, kind: str) -> float:
    """Factor from the unit of the abscissa to s or Hz (`kind`), which are taken where none is."""
    text = dataset.header58.abscissa.unit
    if not is_stated(text):
        return 1.0
    unit = parse_axis(text)
    if unit is None or unit.kind != kind:
        found, rule = f"unit {text!r} of the abscissa", f"it must be a unit of {kind}"
        raise damaged(place(path, dataset.index, 10), found, rule)
    return unit.factor


def _split(
    header: Header58, numbers: NDArray[np.float64]
) -> tuple[NDArray[np.float64] | None, NDArray[Any]]:
    """Separate abscissa and values, without a copy; real and imaginary part alternate."""
    table = numbers.reshape(header.n_values, header.numbers_per_value)
    parts = table if header.even else table[:, 1:]
    values = (parts.view(np.complex128) if header.is_complex else parts)[:, 0]
    values.setflags(write=False)
    return None if header.even else table[:, 0], values


def _read_text(path: Path, dataset: Dataset, header: Header58) -> NDArray[np.float64]:
    """Numbers of text, and the zeros behind them that fill the last line."""
    begin, end = dataset.payload
    where = place(path, dataset.index)
    widths, per_value = _widths(header), header.numbers_per_value
    wanted = header.n_values * per_value
    most = min(wanted + len(widths), end - begin)  # each takes more than a byte
    numbers, n = np.empty(most), 0
    n_lost = 0
    with path.open("rb") as file:
        file.seek(begin)
        length = len(file.readline(min(_LONGEST_LINE, end - begin))) or 1
        file.seek(begin)
        while file.tell() < end:
            text = file.read(min(_CHUNK_BYTES // length * length, end - file.tell()))
            if not text.endswith(b"\n"):
                text += file.readline(min(_LONGEST_LINE, end - file.tell()))
            block = _convert(text, widths, where)
            fits = min(len(block), len(numbers) - n)
            numbers[n : n + fits] = block[:fits]
            n, n_lost = n + fits, n_lost + len(block) - fits
    beyond = n + n_lost - wanted
    if beyond < 0 or beyond >= len(widths) or numbers[wanted:n].any():
        rule = "the file is truncated" if beyond < 0 else "there are more than stated"
        found = f"{(n + n_lost) // per_value} of {header.n_values} values"
        raise damaged(where, found, rule)
    return numbers[:n]


def _widths(header: Header58) -> tuple[int, ...]:
    """Columns of the numbers on a line: E13.5 and E20.12, abscissae always E13.5."""
    if not header.is_double:
        return (13,) * 6
    if header.even:
        return (20,) * 4
    return (13, 20, 20) if header.is_complex else (13, 20, 13, 20)


def _convert(text: bytes, widths: tuple[int, ...], where: str) -> NDArray[np.float64]:
    """Convert complete lines: equal ones at once, and the last one, which may be shorter."""
    length = (text.find(b"\n") + 1) or len(text)
    end = len(text) - len(text) % length
    numbers = convert_lines(text[:end], length, widths)
    if numbers is None:
        return _irregular(text, widths, where)
    rest = text[end:]
    return np.append(numbers, _irregular(rest, widths, where)) if rest else numbers


def _irregular(text: bytes, widths: tuple[int, ...], where: str) -> NDArray[np.float64]:
    """Convert line by line: separated numbers, or touching ones cut by their columns."""
    numbers = array("d")
    for raw in io.BytesIO(text):
        line = raw.decode("latin-1")
        if len(line) > _LONGEST_LINE:
            found = f"a line of more than {_LONGEST_LINE} characters"
            raise damaged(where, found, "lines of a dataset 58 must have 80 columns")
        numbers.extend(line_numbers(line, widths, where))
    return np.frombuffer(numbers, dtype=np.float64)


def _check_byte_order(where: str, values: NDArray[Any]) -> None:
    """Refuse values of which most are too large or small to be measured, and none if swapped."""
    beginning = np.array(values[:_PROBED])
    stated = beginning.view(beginning.real.dtype)
    swapped = stated.byteswap()
    if _share_sensible(swapped) < 1.0 or _share_sensible(stated) > 0.5:
        return
    first = int(np.flatnonzero(stated)[0])
    found = f"values such as {stated[first]:.3g}, which is {swapped[first]:.3g} in the other order"
    rule = "the byte order is wrong: it must be 1 for little endian, 2 for big endian"
    raise RecordingFormatError(where, found, rule, "Correct the header or export the file again")


def _share_sensible(values: NDArray[Any]) -> float:
    """Share of the values other than zero that can be measured; 0 of too few values."""
    with np.errstate(invalid="ignore"):  # signalling NaNs
        size = np.abs(values[values != 0].astype(np.float64))
    if size.size < _FEWEST:
        return 0.0
    low, high = _SENSIBLE
    return float(np.mean((size > low) & (size < high)))


def convert_lines(text: bytes, length: int, widths: tuple[int, ...]) -> NDArray[np.float64] | None:
    """Convert lines of `length` bytes, ends included, with fields of the given `widths`.

    None where the lines do not have this form, with one number in each field.
    """
    line_width = sum(widths)
    if not text or len(text) % length or length <= line_width or b"_" in text:
        return None
    table = np.frombuffer(text, np.uint8).reshape(-1, length)
    tail = table[0, line_width:]
    if tail.tobytes().strip(b" \r\n") or not (table[:, line_width:] == tail).all():
        return None
    # One point in each field, most often in the same columns: Arrow takes no two in one field.
    points = np.flatnonzero(table[0, :line_width] == ord("."))
    alike = len(points) == len(widths) and (table[:, points] == ord(".")).all()
    if not alike and text.count(b".") != len(table) * len(widths):
        return None
    numbers = _by_arrow(table, widths)
    if numbers is None and (b"+-" not in text):
        plain = text.translate(_FORTRAN_TO_C).replace(b"E ", b"E+")
        numbers = _by_arrow(np.frombuffer(plain, np.uint8).reshape(-1, length), widths, " +")
    return numbers


def _by_arrow(
    table: NDArray[np.uint8], widths: tuple[int, ...], ahead: str = " "
) -> NDArray[np.float64] | None:
    """Numbers of the fields, without the characters that may stand `ahead` of them."""
    same = len(set(widths)) == 1
    numbers, begin = [], 0
    for width in [sum(widths)] if same else widths:
        size = widths[0] if same else width
        fields = table[:, begin : begin + width].reshape(len(table), -1, size)
        begin += width
        if (fields[..., -1] <= ord(" ")).any():
            return None
        n_blank = next((at for at in range(width) if (fields[..., at] != ord(" ")).any()), 0)
        # As one item each they are copied in half the time.
        chars = fields[..., n_blank:].view(f"V{size - n_blank}").copy().view(np.uint8)
        chars = chars.reshape(-1, size - n_blank)
        is_padded = ahead == " " and not (chars[:, min(1, chars.shape[1] - 1)] == ord(" ")).any()
        if is_padded:  # a zero in the place of the sign is far cheaper than trimming
            chars[:, 0] += (chars[:, 0] == ord(" ")) * np.uint8(ord("0") - ord(" "))
        ends = np.arange(0, chars.size + 1, chars.shape[1], dtype=np.int32)
        buffers = [None, pa.py_buffer(ends), pa.py_buffer(chars.ravel())]
        texts = pa.Array.from_buffers(pa.string(), len(chars), buffers)
        try:
            if not is_padded:  # loaded here only: it takes 0.05 s
                texts = import_module("pyarrow.compute").ascii_ltrim(texts, ahead)
            found = texts.cast(pa.float64())
        except pa.ArrowInvalid:
            return None  # reading number by number finds the faulty one
        numbers.append(found.to_numpy())
    return numbers[0] if same else np.column_stack(numbers).ravel()


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
    padded = list[Dataset]()
    for row, dataset in enumerate(datasets):
        abscissa, ordinate = read_values(path, dataset, padded=padded)
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
    findings += about_padding(path, padded)
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
