"""Result of a campaign in memory: content of the result folder and the report."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ema.checks.corrections import Correction, corrected
from ema.checks.quality import ReferenceCheck
from ema.checks.sensor_mass import SensorMass, without_mass
from ema.circumference.orders import PURE, drive
from ema.core.campaign import Direction, Tyre
from ema.core.display import band_text, facts, table
from ema.core.edits import Edit, PoleName
from ema.core.finding import Finding, findings_html
from ema.core.frf import FRF
from ema.core.modes import COMMON_NAMES, ModalModel, Mode, Pair, modes_html
from ema.core.numerics import columns_of, frame_of
from ema.core.references import References
from ema.fitting.listing import counterpart
from ema.identify import Identification
from ema.poles.stability import Opinion, StabilityDiagram
from ema.signals.steadiness import Steadiness
from model.damping import DampingResult
from model.tuning import TuningResult

if TYPE_CHECKING:
    import pandas as pd

TORSION = COMMON_NAMES[Direction.TANGENTIAL, 0]


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


@dataclass(frozen=True, eq=False)
class Validation:
    """Measured modes against the ring model.

    Parameters
    ----------
    order : ndarray of int, shape (n_orders,)
    measured_hz, model_hz : ndarray, shape (n_orders,)
    measured_damping, model_damping : ndarray, shape (n_orders,)
    mac : ndarray, shape (n_orders, n_orders)
        Measured (rows) against model shapes, aligned in each order's (cos, sin) plane.
    auto_mac : ndarray, shape (n_modes, n_modes)
        The measured shapes among themselves.
    """

    order: NDArray[np.int_]
    measured_hz: NDArray[np.float64]
    model_hz: NDArray[np.float64]
    measured_damping: NDArray[np.float64]
    model_damping: NDArray[np.float64]
    mac: NDArray[np.float64]
    auto_mac: NDArray[np.float64]

    @property
    def error_percent(self) -> NDArray[np.float64]:
        """Deviation of the model's frequencies from the measured ones."""
        return 100 * (self.model_hz / self.measured_hz - 1)


@dataclass(frozen=True)
class OtherMode:
    """A mode that sensors in another direction than the ring's show."""

    direction: Direction
    force_direction: Direction
    frequency_hz: float
    frequency_std_hz: float
    damping_ratio: float
    damping_std: float
    order: int | None
    order_purity: float
    n_positions: int

    @property
    def name(self) -> str:
        """Its name in the field; empty for higher orders."""
        known = self.order is not None and self.order_purity >= PURE
        return COMMON_NAMES.get((self.direction, self.order or 0), "") if known else ""


@dataclass(frozen=True)
class DrivenMode:
    """How one of several forces drives a mode: a row of ``references.csv``."""

    reference: int  # number of the force, from 1
    position_deg: float  # where it acts; NaN off a circle
    node: int  # 0 where unknown
    axis: int
    mode: int  # number of the mode, from 1
    share: float  # of the power with which its order, or it alone, answers this force
    drive: float  # amplitude against that of the force which drives it most
    # residues over those at the force which drives it most; NaN where sensors differ
    participation: tuple[float, float] = (np.nan, np.nan)


def driven_modes(found: Identification) -> tuple[DrivenMode, ...]:
    """What each of several forces contributes to each mode; nothing for one force."""
    models = [each.model for each in found.references]
    rows = []
    for number, (each, model) in enumerate(zip(found.references, models, strict=True), start=1):
        frf = each.frf
        for k, mode in enumerate(found.model.modes):
            alike = [counterpart(k, mode, other) for other in models]
            drives = [0.0 if other is None else drive(other) for other in alike]
            own = alike[number - 1]
            if own is None:
                continue
            beside = [m for m in model.modes if m.member and m.order == own.order and own.member]
            total = sum(drive(m) ** 2 for m in beside) or drive(own) ** 2
            share, relative = drive(own) ** 2 / total, drive(own) / max(drives)
            place = frf.excitation_deg, frf.force_node, frf.force_axis
            most = alike[int(np.argmax(drives))]
            part = _participation(own, most) if most is not None else (np.nan, np.nan)
            rows.append(DrivenMode(number, *place, k + 1, share, relative, part))
    return tuple(rows)


def _participation(own: Mode, most: Mode) -> tuple[float, float]:
    """Real and imaginary part of the factor from one force's residues to another's."""
    if own.residues.size != most.residues.size:
        return np.nan, np.nan
    factor = complex(np.vdot(most.residues, own.residues) / np.vdot(most.residues, most.residues))
    return factor.real, factor.imag


@dataclass(frozen=True, eq=False)
class Stored:
    """FRFs as a folder holds them: as long as they are these, its files can be copied."""

    folder: Path
    sha256: Mapping[str, str]  # by file
    measured: FRF


@dataclass(frozen=True, eq=False)
class Further:
    """FRFs against a further force: as measured, and what was done with them before the fit."""

    measured: FRF
    corrections: tuple[Correction, ...] = ()
    sensor_mass: SensorMass | None = None

    @cached_property
    def fitted(self) -> FRF:
        """The FRFs that were fitted."""
        return without_mass(corrected(self.measured, self.corrections), self.sensor_mass)


@dataclass(frozen=True, eq=False)
class Result:
    """Result of `pipelines.process.run`; stages that did not apply are None.

    Parameters
    ----------
    name : str
        Campaign name.
    tyre : Tyre or None
        None for a structure that is not a tyre.
    frf : FRF
        The FRFs that were fitted: `measured` with `corrections` applied and the mass compensated.
    measured : FRF
        The FRFs as measured, with all rows: what the result folder holds.
    diagram : StabilityDiagram
    modal_model : ModalModel
    reference : ReferenceCheck or None
        None without a reference sensor.
    tuning, damping, validation : or None
        None where the ring steps were left out; `notes` gives the reason.
    excitation_deg, reference_deg : float or None
        Angles of the force and of the reference sensor.
    opinions : tuple of Opinion
        Results of the cross-check by another pole estimator.
    findings : tuple of Finding
        Rows of ``quality.csv``.
    notes : tuple of str
        Remarks for readers of the report.
    corrections : tuple of Correction
        What is done with single rows before the fit.
    sensor_mass : SensorMass or None
        The mass that is compensated.
    other_modes : tuple of OtherMode
        Modes of tangential and axial sensors, kept out of the ring.
    provenance : dict
        Content of ``provenance.json``: versions, inputs with SHA-256, options, stage times.
    setup : Setup or None
        What a refit needs beside the FRFs; None for a result of an earlier version.
    edits : tuple of Edit
        What a person decided.
    automatic : tuple of AutomaticMode
        The modes before any of it; empty where nothing was decided.
    automatic_misfit : float
        Reduced χ² of their fit.
    stored : Stored or None
        Where the FRFs were read from.
    references : tuple of DrivenMode
        What each of several forces contributes; `frf`, `measured` and the residues of the modes
        are of the first one. Empty for one force.
    further : tuple of Further
        FRFs against the other forces.

    Examples
    --------
    >>> import ringmodal as rm
    >>> result = rm.load("result")
    >>> result.modal_model.frequencies_hz[:3].round(1)
    array([ 78.7, 100.3, 121.4])
    >>> sorted({finding.verdict.value for finding in result.findings})
    ['ok']
    """

    name: str
    tyre: Tyre | None
    frf: FRF
    measured: FRF
    diagram: StabilityDiagram
    modal_model: ModalModel
    reference: ReferenceCheck | None = None
    tuning: TuningResult | None = None
    damping: DampingResult | None = None
    validation: Validation | None = None
    excitation_deg: float | None = None
    reference_deg: float | None = None
    opinions: tuple[Opinion, ...] = ()
    findings: tuple[Finding, ...] = ()
    notes: tuple[str, ...] = ()
    corrections: tuple[Correction, ...] = ()
    sensor_mass: SensorMass | None = None
    other_modes: tuple[OtherMode, ...] = ()
    provenance: dict[str, Any] = field(default_factory=dict)
    setup: Setup | None = None
    edits: tuple[Edit, ...] = ()
    automatic: tuple[AutomaticMode, ...] = ()
    automatic_misfit: float = float("nan")
    stored: Stored | None = None
    references: tuple[DrivenMode, ...] = ()
    further: tuple[Further, ...] = ()

    @property
    def frfs(self) -> FRF | References:
        """FRFs as measured, of one force or of several."""
        others = (each.measured for each in self.further)
        return References((self.measured, *others)) if self.further else self.measured

    @property
    def torsion(self) -> OtherMode | None:
        """Torsion of the belt against the rim, where sensors and force are tangential."""
        return next(iter(self.torsions), None)

    @property
    def torsions(self) -> tuple[OtherMode, ...]:
        """All modes of order 0 of tangential sensors and force, the purest first."""
        found = (
            mode
            for mode in self.other_modes
            if mode.name == TORSION and mode.force_direction == Direction.TANGENTIAL
        )
        return tuple(sorted(found, key=lambda mode: -mode.order_purity))

    def to_frame(self) -> pd.DataFrame:
        """Table of the quality checks, one row for each; modes and FRFs have their own `to_frame`.

        Returns
        -------
        pandas.DataFrame
            ``run``, ``channel``, ``position_deg`` (degrees, missing where a finding is about no
            position), ``check``, ``verdict`` (ok, warning or excluded) and ``detail``.
        """
        return frame_of(self.to_columns())

    def to_columns(self) -> dict[str, list[Any]]:
        """Columns of `to_frame` by name."""
        names = "run", "channel", "position_deg", "check", "verdict", "detail"
        return columns_of(self.findings, dict(zip(names, names, strict=True)))

    def save(self, folder: Path | str, **options: Any) -> None:
        """Write a result folder, as `ringmodal.save` with the same options."""
        # Files and report are above results: loaded by name, as plots are.
        import_module("pipelines.report.write").save(self, folder, **options)

    def __repr__(self) -> str:
        n_modes = len(self.modal_model.modes)
        ring = "no ring" if self.tuning is None else "ring tuned"
        n_warnings = sum(not finding.is_ok for finding in self.findings)
        return f"<Result {self.name}: {n_modes} modes, {ring}, {n_warnings} warnings>"

    def _repr_html_(self) -> str:
        title = self.name if self.tyre is None else f"{self.name}, {self.tyre.designation}"
        model = self.modal_model
        parts = [modes_html(model.modes, f"{title}: modes, {band_text(model.band_hz)}")]
        if self.tuning is not None:
            parts.append(self.tuning._repr_html_())
        if self.validation is not None:
            parts.append(_validation_html(self.validation))
        parts.append(findings_html(self.findings))
        if self.notes:
            parts.append(facts("Notes", [("", note) for note in self.notes]))
        return "".join(parts)


def _validation_html(found: Validation) -> str:
    """Damping and MAC, which the tuning does not show."""
    rows = [
        (str(order), f"{100 * measured:.2f}", f"{100 * ring:.2f}", f"{found.mac[row, row]:.3f}")
        for row, (order, measured, ring) in enumerate(
            zip(found.order, found.measured_damping, found.model_damping, strict=True)
        )
    ]
    head = ("order n", "measured damping / %", "ring damping / %", "MAC of the shapes")
    return table("Validation", head, rows, words=())
