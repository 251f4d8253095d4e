"""Write universal files: time series and FRFs as dataset 58 or 58b, modal models around them.

pyuff writes everything but dataset 58; the architecture page has the measurements.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, BinaryIO, Literal

import numpy as np
import pyuff
from numpy.typing import NDArray

from ema.core.errors import InputError, visible_line
from ema.core.frf import FRF
from ema.core.recording import Channel
from ema.core.references import References, frfs_of
from ema.core.units import SI_UNIT, parse_unit
from ema.io.uff import dataset58_header as codes
from ema.io.uff.dataset58_header import (
    DELIMITER,
    FORCE_DEG,
    QUANTITY,
    Axis,
    Header58,
    format_header,
)

Precision = Literal["single", "double"]
ByteOrder = Literal["little", "big"]

RADIAL = 1  # first axis of a cylindrical system, as modal programs expect it
_SAME_PLACE_DEG, _OFF_GRID = 1e-2, 100_000  # nodes of forces between positions
_DATA_TYPE = {quantity: code for code, quantity in QUANTITY.items()}
_ASCII_FIELD = {False: ("%13.5E", 6), True: ("%20.12E", 4)}  # double precision: width, per line
_KELVIN_AT_0_C = 273.15
_LONGEST_LINE = 125  # nodes of a trace line that every program accepts
_MONTHS = ("Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec")


def write_time_series(
    path: Path | str,
    channels: Sequence[Channel],
    sampling_rate_hz: float,
    *,
    precision: Precision | None = None,
    byte_order: ByteOrder = "little",
    binary: bool = True,
    directions: Sequence[int] | None = None,
) -> None:
    """Write channels that share one clock as datasets 58b (or 58), function type 1.

    Samples are written in their own unit, or in SI where that does not explain the channel's
    factor. The default precision is single for float32 samples, double for all others. Without
    `binary`, ASCII has 6 (single) or 13 (double) digits. `directions` has a code 1 to 3 (X, Y, Z)
    for each channel, by default 1; a channel with a negative factor gets the negative code.
    `InputError` if there are no channels, their lengths differ, or the rate is not positive.
    """
    check_time_series(path, channels, sampling_rate_hz, directions)
    with Path(path).open("wb") as file:
        for index, channel in enumerate(channels):
            samples, unit, sense = in_own_unit(channel)
            single = samples.dtype == np.float32 if precision is None else precision == "single"
            data_type, label = _DATA_TYPE.get(channel.quantity, 0), channel.quantity.capitalize()
            header = Header58(
                id_lines=(_one_line(channel.name), "NONE", "NONE", "NONE", "NONE"),
                function_type=codes.TIME_RESPONSE,
                ordinate=codes.REAL_SINGLE if single else codes.REAL_DOUBLE,
                n_values=len(samples),
                abscissa_step=f"{1.0 / sampling_rate_hz:.6E}",
                response_node=channel.node or 0,
                response_direction=sense * (directions[index] if directions else RADIAL),
                abscissa=Axis(codes.DATA_TIME, label="Time", unit="s"),
                ordinate_axis=Axis(data_type, label=label, unit=_one_line(unit)),
            )
            _write_dataset(file, header, samples, byte_order if binary else None)


def write_frfs(
    path: Path | str,
    frf: FRF | References,
    *,
    reference_node: int = 0,
    note: str = "NONE",
    precision: Precision = "double",
    byte_order: ByteOrder = "little",
    binary: bool = True,
) -> None:
    """Write inertances as datasets 58b (or 58), function type 4, acceleration over force.

    Lines are equidistant; coherence and deviation are not written. `reference_node` is that of the
    force; each of several has its own, and its angle, if any, in the fourth ID line. `note` is the
    third ID line. `InputError` if the FRF has no rows or fewer than two lines.
    """
    order = byte_order if binary else None
    with Path(path).open("wb") as file:
        for each in frfs_of(frf):
            node, angle = reference_node, float("nan")
            if isinstance(frf, References):
                node, angle = _force_node(each), each.excitation_deg
            append_frfs(
                *(file, each),
                reference_node=node,
                force_deg=angle,
                note=note,
                precision=precision,
                byte_order=order,
            )


def _force_node(frf: FRF) -> int:
    """Node of one of several forces: that of the position there, or else one of its own; never 0.

    In a file, 0 states none.
    """
    angle = frf.excitation_deg
    if frf.force_node or not np.isfinite(angle):
        return frf.force_node
    away = np.abs((frf.position_deg - angle + 180.0) % 360.0 - 180.0)
    there = frf.node[away < _SAME_PLACE_DEG]
    if there.size and there[0] >= 0:
        # Position 0 is also the one behind the last.
        return int(there[0]) or int(frf.node.max()) + 1
    return _OFF_GRID + round(angle % 360.0 / _SAME_PLACE_DEG)


def append_frfs(
    file: BinaryIO,
    frf: FRF,
    *,
    reference_node: int = 0,
    force_deg: float = float("nan"),
    direction: int = RADIAL,
    note: str = "NONE",
    precision: Precision = "double",
    byte_order: ByteOrder | None = "little",
) -> None:
    """Write inertances to an open file, as `write_frfs` does.

    `force_deg` goes into the fourth ID line. `direction` is the code of force and response (1 to 3)
    in FRFs without axes of their own, `note` the third ID line of each dataset. Without a byte
    order, text is written.
    """
    lines = frf.frequency_hz
    if len(lines) < 2 or not len(frf.values):
        shape = f"{len(frf.values)} FRFs of {len(lines)} lines"
        raise InputError(str(file.name), shape, "an FRF must have two lines", "Check the band")
    step = (lines[-1] - lines[0]) / (len(lines) - 1)
    place = f"{FORCE_DEG} = {force_deg:.9g}" if np.isfinite(force_deg) else "NONE"
    template = Header58(
        id_lines=(),
        function_type=codes.FREQUENCY_RESPONSE,
        ordinate=codes.COMPLEX_DOUBLE if precision == "double" else codes.COMPLEX_SINGLE,
        n_values=len(lines),
        abscissa_min=float(lines[0]),
        abscissa_step=f"{step:.6E}",
        response_direction=direction,
        reference_node=reference_node or frf.force_node,
        reference_direction=frf.force_axis or (0 if frf.axis.any() else direction),
        abscissa=Axis(codes.DATA_FREQUENCY, label="Frequency", unit="Hz"),
        ordinate_axis=Axis(codes.DATA_ACCELERATION, label="Acceleration", unit="m/s^2"),
        denominator_axis=Axis(codes.DATA_FORCE, label="Excitation force", unit="N"),
    )
    for row, values in enumerate(frf.values):
        named = _row_name(frf, row), _one_line(frf.run[row]), _one_line(note), place, "NONE"
        header = replace(
            template,
            id_lines=named,
            response_node=max(int(frf.node[row]), 0),
            response_direction=int(frf.axis[row]) or direction,
        )
        _write_dataset(file, header, values, byte_order)


def check_time_series(
    path: Path | str,
    channels: Sequence[Channel],
    sampling_rate_hz: float,
    directions: Sequence[int] | None = None,
) -> None:
    """Refuse channels that cannot be written as one recording."""
    lengths = sorted({channel.n_samples for channel in channels})
    if len(lengths) != 1 or lengths[0] == 0:
        rule = "all channels must have the same length, at least one sample"
        raise InputError(str(path), f"channel lengths {lengths}", rule, "Cut them to one length")
    if not 0 < sampling_rate_hz < np.inf:
        found = f"sampling rate {sampling_rate_hz} Hz"
        raise InputError(str(path), found, "it must be positive", "Give the rate in Hz")
    if directions is not None and len(directions) != len(channels):
        found = f"{len(directions)} directions for {len(channels)} channels"
        raise InputError(str(path), found, "one per channel is needed", "Give one code per channel")


def in_own_unit(channel: Channel) -> tuple[NDArray[np.floating], str, int]:
    """Find the samples to write, the unit they are in, and the sign of their direction."""
    sense = -1 if channel.scale_to_si < 0 else 1
    unit = parse_unit(channel.unit)
    explained = 1.0 if unit is None else unit.factor
    samples, in_si = np.asarray(channel.samples), SI_UNIT.get(channel.quantity, "NONE")
    if samples.dtype.kind != "f":
        samples = samples.astype(np.float64)
    if sense * channel.scale_to_si == explained:
        return samples, channel.unit or in_si, sense
    return samples * abs(channel.scale_to_si), in_si, sense


def _one_line(text: str) -> str:
    return " ".join(text.split()) or "NONE"


def _row_name(frf: FRF, row: int) -> str:
    position = frf.position_deg[row]
    place = f"node {frf.node[row]}" if frf.node[row] >= 0 else f"response {row + 1}"
    return place if np.isnan(position) else f"{place} at {position:g} deg"


def _write_dataset(
    file: BinaryIO, header: Header58, values: NDArray[np.inexact], byte_order: ByteOrder | None
) -> None:
    """Header, payload (binary where a byte order is given) and closing delimiter."""
    if byte_order is None:
        file.write(format_header(header))
        _write_text(file, values, header.is_double)
    else:
        order = "<" if byte_order == "little" else ">"
        kind = "c" if header.is_complex else "f"
        size = (8 if header.is_double else 4) * (2 if header.is_complex else 1)
        payload = np.ascontiguousarray(values, dtype=f"{order}{kind}{size}")
        code = codes.LITTLE_ENDIAN if byte_order == "little" else codes.BIG_ENDIAN
        header = replace(header, binary=True, byte_order=code, n_bytes=payload.nbytes)
        file.write(format_header(header))
        file.write(payload.data)
    file.write(DELIMITER + b"\n")


def _write_text(file: BinaryIO, values: NDArray[np.inexact], double: bool) -> None:
    """Lines of numbers in fixed columns; real and imaginary parts alternate."""
    pattern, per_line = _ASCII_FIELD[double]
    if np.iscomplexobj(values):
        values = np.ascontiguousarray(values, dtype=np.complex128).view(np.float64)
    full = len(values) - len(values) % per_line
    np.savetxt(file, values[:full].reshape(-1, per_line), pattern, delimiter="")
    if full < len(values):
        np.savetxt(file, values[np.newaxis, full:], pattern, delimiter="")


CARTESIAN, CYLINDRICAL = 1, 2  # numbers of the coordinate systems: the global one, the wheel's

_NODE_COLOUR, _LINE_COLOUR = 11, 8
_STRUCTURAL, _TRANSLATION, _DISPLACEMENT = 1, 2, 8
_NORMAL_MODE, _COMPLEX_EIGENVALUE = 2, 3


@dataclass(frozen=True, eq=False)
class ShapeDataset:
    """One mode of a dataset 55."""

    number: int  # of the mode, from 1
    id_lines: tuple[str, ...]  # up to five
    pole: complex  # rad/s, upper half plane
    node: NDArray[np.int_]
    values: NDArray[np.inexact]  # (n_nodes, 3) along the axes of motion; complex for a complex mode
    modal_a: complex = 0.0  # of a complex mode in N s/m, 0 where unknown
    modal_mass_kg: float = 0.0  # of a normal mode, 0 where unknown


def header_151(name: str, description: str, program: str, written: datetime) -> bytes:
    """Dataset 151: description of the file, program, and date."""
    day = f"{written.day:02d}-{_MONTHS[written.month - 1]}-{written:%y}"
    texts = {"model_name": name, "description": description, "db_app": program, "program": program}
    events = "db_created", "db_saved", "file_written"
    dates = {f"date_{event}": day for event in events}
    times = {f"time_{event}": f"{written:%H:%M:%S}" for event in events}
    texts = {key: _text(text) for key, text in texts.items()}
    return _written({"type": 151, **texts, **dates, **times})


def units_164() -> bytes:
    """Dataset 164: everything in SI."""
    units = {"units_code": 1, "units_description": "SI: Meter (newton)  ", "temp_mode": 2}
    factors = {"length": 1.0, "force": 1.0, "temp": 1.0, "temp_offset": _KELVIN_AT_0_C}
    return _written({"type": 164, **units, **factors})


def coordinate_systems_2420(*, is_wheel: bool) -> bytes:
    """Dataset 2420: the global Cartesian system, and for a wheel in x-z a cylindrical one."""
    axes = [np.vstack([np.eye(3), np.zeros(3)])]
    labels, kinds, names = [CARTESIAN], [0], ["global"]
    if is_wheel:
        axes.append(np.array([(1.0, 0, 0), (0, 0, 1.0), (0, -1.0, 0), (0, 0, 0)]))
        labels, kinds, names = [*labels, CYLINDRICAL], [0, 1], [*names, "radial, tangential, axial"]
    system = {"CS_sys_labels": labels, "CS_types": kinds, "CS_colors": [_LINE_COLOUR] * len(labels)}
    named = {"CS_names": list(map(_text, names)), "Part_UID": 1, "Part_Name": _text("ringmodal")}
    return _written({"type": 2420, **named, **system, "CS_matrices": axes})


def nodes_2411(node: NDArray[np.int_], xyz_m: NDArray[np.float64], moving: int) -> bytes:
    """Dataset 2411: nodes in Cartesian coordinates, m; they move along the system `moving`."""
    system, colour = np.full(len(node), CARTESIAN), np.full(len(node), _NODE_COLOUR)
    points = dict(zip("xyz", xyz_m.T, strict=True))
    labels = {"node_nums": node, "def_cs": system, "disp_cs": np.full(len(node), moving)}
    return _written({"type": 2411, **labels, "color": colour, **points})


def trace_lines_82(name: str, path: Sequence[int]) -> bytes:
    """Dataset 82: a line through the nodes, in pieces that every program accepts."""
    step = _LONGEST_LINE - 1  # each piece begins where the one before it ended
    starts = range(0, max(len(path) - 1, 1), step)
    shared = {"type": 82, "color": _LINE_COLOUR, "id": _text(name)}
    pieces = [
        {**shared, "trace_num": number, "nodes": np.array(path[start : start + step + 1])}
        for number, start in enumerate(starts, start=1)
    ]
    return _written(*pieces)


def shape_55(mode: ShapeDataset) -> bytes:
    """Dataset 55: a mode shape, as a complex eigenvalue or, where it is real, a normal mode."""
    is_complex = np.iscomplexobj(mode.values)
    parameters: dict[str, complex]
    if is_complex:
        modal_a = complex(mode.modal_a)
        parameters = {"eig": mode.pole, "modal_a": modal_a, "modal_b": -mode.pole * modal_a}
    else:
        size = abs(mode.pole)
        parameters = {"freq": size / (2 * np.pi), "modal_damp_vis": -mode.pole.real / size}
        parameters["modal_m"] = mode.modal_mass_kg
    texts = map(_text, (*mode.id_lines, *("NONE",) * 5)[:5])
    return _written(
        {
            "type": 55,
            **{f"id{number}": text for number, text in enumerate(texts, start=1)},
            "model_type": _STRUCTURAL,
            "analysis_type": _COMPLEX_EIGENVALUE if is_complex else _NORMAL_MODE,
            "data_ch": _TRANSLATION,
            "spec_data_type": _DISPLACEMENT,
            "load_case": 1,
            "mode_n": mode.number,
            **parameters,
            "node_nums": mode.node,
            **dict(zip(("r1", "r2", "r3"), mode.values.T, strict=True)),
        }
    )


def _written(*datasets: dict[str, Any]) -> bytes:
    """Datasets as written by pyuff, which writes to files only."""
    with TemporaryDirectory(prefix="ringmodal-") as folder:
        path = Path(folder) / "datasets.uff"
        try:
            pyuff.UFF(str(path)).write_sets(list(datasets), "overwrite")
        except Exception as error:  # pyuff raises nothing else, and hides the error of a full drive
            if isinstance(error.__context__, OSError):
                raise error.__context__ from None
            raise
        return path.read_text(encoding="ascii").encode("ascii")  # with line feeds everywhere


def _text(line: str) -> str:
    """80 columns of ASCII, never blank."""
    plain = " ".join(visible_line(line).encode("ascii", "replace").decode().split())
    return f"{plain[:80] or 'NONE':<80}"
