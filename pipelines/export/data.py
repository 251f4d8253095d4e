"""Modal results for other programs: in memory, and as an Excel workbook."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema.core.errors import InputError, inert
from ema.core.frf import FRF
from ema.core.modes import Mode
from ema.io.uff.reader import SYNTHESISED
from model.arguments import ReadonlyArrays
from model.parameters import DAMPING_NAMES, RING_NAMES
from pipelines.results import tables
from pipelines.results.parameter_set import ParameterSet
from pipelines.results.result import Result
from pipelines.results.tables import axis_letters, mode_name, named, numbered, row_names
from pipelines.results.verdict import judge
from pipelines.storage.tables import Columns, plain_rows

MEASURED, BOTH, NONE = "measured", "both", "none"
X, Y, Z = 1, 2, 3  # direction codes of universal files
_SAME_PLACE_DEG = 0.01  # the force is at a sensor within this angle
_UNIT_RADIUS_M = 1.0  # where the radius is unknown
_STEP_M = 0.1  # between nodes on a line
# Number formats of Excel by the ending of a column's name, the longest first; ratios are shown in
# percent and stay ratios.
_FORMATS = {
    **{"damping_ratio_std": "0.0000%", "damping_ratio": "0.000%", "_damping": "0.000%"},
    **{"damping_ratio_band_shift": "0.0000%", "_std_hz": "0.0000", "_shift_hz": "0.0000"},
    **{"_hz": "0.000", "_deg": "0.0##", "_percent": "0.00", "order_purity": "0.0000"},
    **{"mpc": "0.0000", "mac": "0.0000", "chance": "0.0E+00"},
}
_UNITS = {"_hz": "Hz", "_deg": "°", "_percent": "%", "_kg": "kg"}
_LETTERS = ("mpc", "mac")  # words that are written in capitals
_PARAMETER = "0.0000E+00"


@dataclass(frozen=True, eq=False)
class Geometry(ReadonlyArrays):
    """Nodes, and the direction of motion of each row of the FRFs at them."""

    # shape (n_nodes,); numbers from 1, each once; those of the rows of the FRFs come first, then
    # the places of forces, and those that only further forces have
    node: NDArray[np.int_]
    # shape (n_nodes,); angles in the x-z plane, from x towards z; NaN without a circle
    position_deg: NDArray[np.float64]
    xyz_m: NDArray[np.float64]  # shape (n_nodes, 3)
    # shape (n_rows, 3); unit vector of the motion of each row of the first force's FRFs: radial and
    # outward on a circle, else the axis in the file
    direction: NDArray[np.float64]
    direction_code: int  # in a universal file, of rows without an axis: on a circle 1, the radius
    reference_nodes: tuple[int, ...]  # node of each force; 0 where unknown
    is_closed: bool  # whether the nodes form a circle
    notes: tuple[str, ...] = ()  # assumptions
    frfs: tuple[FRF, ...] = ()  # as fitted, of each force, under these node numbers

    @property
    def row_node(self) -> NDArray[np.int_]:
        """Node of each row of the first force's FRFs."""
        return self.frfs[0].node

    @property
    def driving_row(self) -> int | None:
        """Row at the first force and along it; None where there is not one."""
        frf = self.frfs[0]
        along = (frf.axis == frf.force_axis) | (frf.axis == 0) | (frf.force_axis == 0)
        at = np.flatnonzero((frf.node == self.reference_nodes[0]) & along)
        return int(at[0]) if at.size == 1 else None

    def directions(self, frf: FRF) -> list[str]:
        """Direction of each row of FRFs: radial, X, Y, Z, or nothing where unknown."""
        return ["radial"] * frf.n_positions if self.is_closed else axis_letters(frf.axis)

    @property
    def force(self) -> dict[str, Any]:
        """Node and direction of the first force; 0 and nothing where unknown."""
        (axis,) = axis_letters(np.array([self.frfs[0].force_axis]))
        direction = "radial" if self.is_closed else axis
        return {"force_node": self.reference_nodes[0], "force_direction": direction}

    @property
    def path(self) -> list[int]:
        """Nodes in the order of a line through them; closed on a circle."""
        if not self.is_closed:
            return list(self.node.tolist())
        around = self.node[np.argsort(self.position_deg, kind="stable")].tolist()
        return [*around, around[0]]


def geometry_of(result: Result) -> Geometry:
    """Nodes on the circle of the mean radius, or on a line where there are no angles."""
    every = result.frf, *(each.fitted for each in result.further)
    if np.isfinite(result.frf.position_deg).all():
        return _circle(result, every)
    return _line(every)


class _Nodes:
    """Numbers of the first force's rows by angle; other places get the next ones."""

    def __init__(self, frf: FRF, places: Sequence[Hashable]) -> None:
        keeps = frf.node.min() > 0 and np.unique(frf.node).size == frf.n_positions
        self.numbers: list[int] = (frf.node if keeps else np.arange(1, len(places) + 1)).tolist()
        self.of_place: dict[Hashable, int] = dict(zip(places, self.numbers, strict=True))
        self.added = list[Any]()

    def at(self, place: Hashable) -> int:
        """Number of a place."""
        if place not in self.of_place:
            self.of_place[place] = max(self.numbers) + 1
            self.numbers.append(self.of_place[place])
            self.added.append(place)
        return self.of_place[place]

    def of_rows(self, frf: FRF, places: Sequence[Hashable]) -> FRF:
        """FRFs under these numbers."""
        return replace(frf, node=np.array([self.at(place) for place in places]))


def _circle(result: Result, every: Sequence[FRF]) -> Geometry:
    def places(angles_deg: Sequence[float] | NDArray[np.float64]) -> list[float]:
        steps = np.round(np.asarray(angles_deg, dtype=float) / _SAME_PLACE_DEG)
        return list((steps % round(360.0 / _SAME_PLACE_DEG)).tolist())

    frf = every[0]
    nodes = _Nodes(frf, places(frf.position_deg))
    forces_deg = [result.excitation_deg, *(each.excitation_deg for each in every[1:])]
    forces = tuple(
        nodes.at(places([angle])[0]) if angle is not None and np.isfinite(angle) else 0
        for angle in forces_deg
    )
    further = [nodes.of_rows(each, places(each.position_deg)) for each in every[1:]]
    node, added_deg = np.array(nodes.numbers), _SAME_PLACE_DEG * np.array(nodes.added)
    angles, n_rows = np.append(frf.position_deg, added_deg), frf.n_positions
    frfs = replace(frf, node=node[:n_rows]), *further
    notes = ["x-z plane, angles from x towards z; 0 deg is the zero of the grid"]
    radius_m = None if result.tyre is None else result.tyre.mean_radius_m
    if radius_m is None:
        radius_m = _UNIT_RADIUS_M
        notes.append(f"radius not given: drawn with {_UNIT_RADIUS_M:g} m")
    turn = np.deg2rad(angles)
    direction = np.column_stack([np.cos(turn), np.zeros(turn.size), np.sin(turn)])
    return Geometry(
        node=node,
        position_deg=angles,
        xyz_m=radius_m * direction,
        direction=direction[:n_rows],
        direction_code=X,
        reference_nodes=forces,
        is_closed=True,
        notes=tuple(notes),
        # Letters that turn with the circle: all directions are radial.
        frfs=tuple(
            replace(each, axis=np.zeros(each.n_positions, dtype=int), force_axis=0) for each in frfs
        ),
    )


def _line(every: Sequence[FRF]) -> Geometry:
    frfs = numbered(every)
    at_rows = [number for frf in frfs for number in frf.node.tolist()]
    forces = [frf.force_node for frf in frfs]
    node = np.array(list(dict.fromkeys([*at_rows, *(each for each in forces if each > 0)])))
    zeros = np.zeros(node.size)
    return Geometry(
        node=node,
        position_deg=np.full(node.size, np.nan),
        xyz_m=np.column_stack([_STEP_M * np.arange(node.size), zeros, zeros]),
        direction=np.eye(3)[np.where(frfs[0].axis > 0, frfs[0].axis, Z) - 1],
        direction_code=Z,
        reference_nodes=tuple(forces),
        is_closed=False,
        notes=("no angles known: nodes on a line, 0.1 m apart; motion without an axis along z",),
        frfs=frfs,
    )


@dataclass(frozen=True, eq=False)
class ModalExport(ReadonlyArrays):
    """A result as exported to other programs."""

    result: Result
    geometry: Geometry
    # shape (n_modes, n_rows); along the measured directions, largest part 1; complex or real
    shapes: NDArray[np.inexact]
    # shape (n_modes,); modal A of these shapes in N s/m: residue = shape × shape at the force / A;
    # NaN where the force is not at a sensor or at a node of the mode, or the modal mass would be
    # negative
    modal_a: NDArray[np.complex128]
    # inertances (accelerances) in (m/s²)/N under the exported node numbers
    measured: FRF | None
    synthesised: FRF | None
    # the same against each further force
    further_measured: tuple[FRF, ...] = ()
    further_synthesised: tuple[FRF, ...] = ()
    ring: ParameterSet | None = None  # as in ``tyre.toml``
    # whether CSV has semicolons and decimal commas, as Excel expects it in many countries
    decimal_comma: bool = False
    # whether a universal file has the FRFs as text (58) instead of binary (58b)
    frfs_as_text: bool = False
    # whether a universal file has shapes and FRFs along the axes of a cylindrical system; else
    # shapes are in x, y, z
    is_cylindrical: bool = False

    @property
    def modes(self) -> tuple[Mode, ...]:
        """The modes of the result."""
        return self.result.modal_model.modes

    @property
    def frfs(self) -> list[tuple[str, int, FRF]]:
        """All FRFs, each with its kind and the number of its force."""
        measured = MEASURED, (self.measured, *self.further_measured)
        synthesised = SYNTHESISED, (self.synthesised, *self.further_synthesised)
        return [
            (kind, number, frf)
            for kind, every in (measured, synthesised)
            for number, frf in enumerate(every, start=1)
            if frf is not None
        ]

    @property
    def references(self) -> dict[str, NDArray[Any]]:
        """Where each of several forces acts, and how it drives the modes: (n_modes, n_forces)."""
        frfs = self.geometry.frfs
        participation = np.full((len(self.modes), len(frfs)), complex(np.nan, np.nan))
        for each in self.result.references:
            participation[each.mode - 1, each.reference - 1] = complex(*each.participation)
        return {
            "node": np.array(self.geometry.reference_nodes),
            "position_deg": np.array([frf.excitation_deg for frf in frfs]),
            "direction": np.array([frf.force_axis for frf in frfs]),
            "participation": participation,
        }

    @property
    def is_real(self) -> bool:
        """Whether the shapes are real."""
        return not np.iscomplexobj(self.shapes)

    @property
    def modal_mass_kg(self) -> NDArray[np.float64]:
        """Modal mass A/(2j ω_d) of the shapes as real shapes; NaN where unknown."""
        damped = np.array([mode.pole.imag for mode in self.modes])
        return np.asarray((self.modal_a / (2j * damped)).real)


def of_force(kind: str, number: int) -> str:
    """Name of the FRFs of a force; those of the first one have no number."""
    return kind if number == 1 else f"{kind}_{number}"


_WIDEST, _NARROWEST = 70, 9  # of a column, in characters
_SUMMARY, _FINDINGS = "Summary", "Findings"


@dataclass(frozen=True)
class _Sheet:
    """A table for a sheet: titles with units, formats of the columns, and rows of plain values."""

    title: str
    head: Sequence[str]
    rows: Sequence[Sequence[Any]]
    formats: Sequence[str] = ()  # one for each column; without any, numbers are shown as they are
    frozen: str = "A2"


def write_workbook(
    path: Path, result: Result, ring: ParameterSet | None = None, frfs: Mapping[str, FRF] = {}
) -> None:
    """Write a workbook; numbers are numbers, and no text is taken for a formula.

    `InputError` where openpyxl is not installed.
    """
    require_excel()
    book = import_module("openpyxl").Workbook(write_only=True)
    for sheet in _sheets(result, ring, frfs):
        _write(book, sheet)
    book.save(path)


def require_excel() -> None:
    """Refuse to write workbooks without the library that writes them."""
    try:
        import_module("openpyxl")
    except ImportError as error:
        rule = "Excel workbooks need openpyxl, which is not installed"
        raise InputError("xlsx", "not available", rule, "Run: pip install openpyxl") from error


def _sheets(result: Result, ring: ParameterSet | None, frfs: Mapping[str, FRF]) -> Iterator[_Sheet]:
    yield _summary(result)
    found = tables.csv_tables(result)
    yield _of_table("Modes", found["modes.csv"])
    if ring is not None:
        yield _ring(ring)
        yield _of_table("Validation", found["validation.csv"])
    yield from _shapes(result)
    for title in ("Orders", "References", "Other modes", "Corrections"):
        table = found.get(f"{title.lower().replace(' ', '_')}.csv")
        sheet = None if table is None else _of_table(title, table)
        if sheet is not None and sheet.rows:
            yield sheet
    yield _of_table(_FINDINGS, found["quality.csv"])
    for name, frf in frfs.items():
        yield from _responses(name, frf)
    inputs = [(each["file"], each["sha256"]) for each in result.provenance.get("inputs", ())]
    yield _Sheet("Files", ("file", "SHA-256"), inputs)


def _summary(result: Result) -> _Sheet:
    """What the reader should know first, and the notes."""
    rows: list[tuple[str, Any]] = []
    if result.tyre is not None:
        rows += [
            ("Tyre", result.tyre.designation),
            ("Inflation pressure [Pa]", result.tyre.inflation_pressure_pa),
            ("Mean radius [m]", result.tyre.mean_radius_m),
            ("Belt width [m]", result.tyre.belt_width_m),
            *(named(key, text) for key, text in result.tyre.details.items()),
        ]
    overall = judge(result)
    rows.append(("Verdict", overall.line))
    rows += [("", remark.text) for remark in overall.remarks]
    rows += [
        ("Angle of the force [°]", result.excitation_deg),
        ("Positions", result.frf.n_positions),
        ("Band from [Hz]", result.modal_model.band_hz[0]),
        ("Band to [Hz]", result.modal_model.band_hz[1]),
        ("Software", f"ringmodal {result.provenance.get('software', {}).get('ringmodal', '')}"),
        ("Created", result.provenance.get("created", "")),
        ("±", "one standard deviation (columns with std)"),
    ]
    rows += [("Note", note) for note in result.notes]
    return _Sheet(_SUMMARY, ("Result of", result.name), rows, ("", ""))


def _of_table(title: str, table: Columns) -> _Sheet:
    names = [str(name) for name in table]
    formats = [_by_ending(name, _FORMATS) for name in names]
    return _Sheet(title, [_title(name) for name in names], plain_rows(table), formats)


def _title(name: str) -> str:
    """Name of a column with its unit in brackets, as recordings have it."""
    unit = _by_ending(name, _UNITS)
    if unit:
        return f"{name[: name.rindex('_')].replace('_', ' ')} [{unit}]"
    return name.upper() if name in _LETTERS else name.replace("_", " ")


def _by_ending(name: str, known: Mapping[str, str]) -> str:
    return next((known[end] for end in sorted(known, key=len)[::-1] if name.endswith(end)), "")


def _ring(ring: ParameterSet) -> _Sheet:
    known = RING_NAMES | DAMPING_NAMES
    rows: list[tuple[Any, ...]] = [
        (*known[key], each.value, each.std, each.how)
        for key, each in {**ring.ring, **ring.damping}.items()
    ]
    pressure_pa = ring.conditions["inflation_pressure_pa"]
    rows.append((*known["inflation_pressure_pa"], pressure_pa, None, "given"))
    head = ("parameter", "symbol", "unit", "value", "std (in the same unit)", "how obtained")
    formats = ("", "", "", _PARAMETER, _PARAMETER, "")
    return _Sheet("Ring", head, rows, formats)


def _shapes(result: Result) -> Iterator[_Sheet]:
    """Shapes side by side, for charts: a row for each position, a column for each mode."""
    model = result.modal_model
    if not model.modes:
        return
    if np.all(np.isfinite(model.position_deg)):
        places, formats = {"position [°]": model.position_deg.tolist()}, ["0.0##"]
    else:
        places, formats = {"node": model.node.tolist()}, ["0"]
        if result.frf.axis.any():
            places, formats = places | {"direction": axis_letters(result.frf.axis)}, ["0", ""]
    head = (*places, *(f"{k}: {mode_name(mode)}" for k, mode in enumerate(model.modes, 1)))
    shapes, frozen = np.array([mode.shape for mode in model.modes]).T, f"{'ABC'[len(places)]}2"
    formats += ["0.0000"] * len(model.modes)
    for title, part in (("Shapes", shapes.real), ("Shapes, imaginary part", shapes.imag)):
        rows = [[*at, *cells] for *at, cells in zip(*places.values(), part.tolist(), strict=True)]
        yield _Sheet(title, head, rows, formats, frozen=frozen)


def _responses(name: str, frf: FRF) -> Iterator[_Sheet]:
    """FRFs side by side: a row for each frequency, a column for each position."""
    angles = np.isfinite(frf.position_deg)
    names = row_names(frf, np.arange(frf.n_positions))
    places = [each if k else f"node {each}" for each, k in zip(names, angles, strict=True)]
    head = ("frequency [Hz]", *(f"{place} [(m/s²)/N]" for place in places))
    for part, values in (("real", frf.values.real), ("imaginary", frf.values.imag)):
        rows = np.column_stack([frf.frequency_hz, values.T]).tolist()
        yield _Sheet(f"FRF {name}, {part}", head, rows, frozen="B2")


def _write(book: Any, sheet: _Sheet) -> None:
    """Write a sheet; an unknown number is an empty cell."""
    cell = import_module("openpyxl.cell").WriteOnlyCell
    styles = import_module("openpyxl.styles")
    letter = import_module("openpyxl.utils").get_column_letter
    page = book.create_sheet(sheet.title)
    wraps = sheet.title in (_SUMMARY, _FINDINGS)
    for column, width in enumerate(_widths(sheet), 1):
        page.column_dimensions[letter(column)].width = width
    page.freeze_panes = sheet.frozen
    if sheet.title != _SUMMARY:
        page.auto_filter.ref = f"A1:{letter(len(sheet.head))}{len(sheet.rows) + 1}"

    bold, top = styles.Font(bold=True), styles.Alignment(vertical="top", wrap_text=wraps)
    wrapped = styles.Alignment(vertical="top", wrap_text=True)

    def styled(value: Any, number_format: str) -> Any:
        found = cell(page, value=_plain(value))
        found.alignment = top
        if number_format and not isinstance(value, str):
            found.number_format = number_format
        return found

    head = [cell(page, value=inert(title)) for title in sheet.head]
    for title in head:
        title.font, title.alignment = bold, wrapped
    page.append(head)
    for row in sheet.rows:
        # A style for each of the many cells of FRFs would take a minute.
        cells = map(styled, row, sheet.formats) if sheet.formats else map(_plain, row)
        page.append(list(cells))


def _plain(value: Any) -> Any:
    """The value of a cell; none where a number is unknown."""
    return inert(value) if value is not None and value == value else None


def _widths(sheet: _Sheet) -> Iterable[int]:
    for column, title in enumerate(sheet.head):
        texts = (str(row[column]) for row in sheet.rows if isinstance(row[column], str))
        longest = max(map(len, (*texts, title[:22])), default=0) + 2
        yield min(max(longest, _NARROWEST), _WIDEST)
