"""Campaign: runs, sensors, tyre and settings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np

from ema.core.display import as_typed, counted, facts, number, table
from ema.core.finding import Finding, findings_html
from ema.core.frf import FRF
from ema.core.recording import Channel, ExponentialWindow, Recording, overlap_share, window_name
from ema.core.references import References, frfs_of
from ema.core.settings import CHECKS, IDENTIFICATION, CheckSettings, IdentificationSettings


@dataclass(frozen=True)
class Tyre:
    """Identity and given data of the tyre, from the manifest's ``[tyre]``.

    Examples
    --------
    >>> import ringmodal as rm
    >>> tyre = rm.Tyre("225/55R17", inflation_pressure_pa=2.2e5, mean_radius_m=0.33)
    >>> frf = rm.estimate_frf(rm.read_campaign("sample_data/tyre_225_55R17"))
    >>> rm.process(rm.Campaign("notebook", frf=frf, tyre=tyre, excitation_deg=0.0))
    <Result notebook: 9 modes, ring tuned, 0 warnings>
    """

    designation: str
    inflation_pressure_pa: float | None = None
    mean_radius_m: float | None = None
    belt_width_m: float | None = None
    details: dict[str, str] = field(default_factory=dict)  # anything else, shown in the report


@dataclass(frozen=True)
class Processing:
    """How recordings become FRFs and in which band modes are sought; None means the default.

    Examples
    --------
    >>> import ringmodal as rm
    >>> campaign = rm.read_campaign("sample_data/tyre_225_55R17")
    >>> rm.estimate_frf(campaign, rm.Processing(block_seconds=2.0, window="hann", overlap=0.5))
    <FRF: 72 positions, 0.5 to 999.5 Hz in steps of 0.5 Hz, 6 runs>
    """

    averages: int | None = None
    block_seconds: float | None = None
    window: str | None = None
    overlap: float | None = None
    band_hz: tuple[float, float] | None = None
    exponential_window_s: float | None = None  # time constant of a window the analyser applied
    exponential_window_std_s: float = 0.0
    force_window_s: float | None = None  # length of a window the analyser applied to the force

    def __post_init__(self) -> None:
        if self.window is not None:
            object.__setattr__(self, "window", window_name(self.window))
        if self.overlap is not None:
            object.__setattr__(self, "overlap", overlap_share(self.overlap))

    @property
    def exponential_window(self) -> ExponentialWindow | None:
        """The window that the analyser applied to the responses."""
        if self.exponential_window_s is None:
            return None
        return ExponentialWindow(self.exponential_window_s, self.exponential_window_std_s)


class Direction(StrEnum):
    """Direction of a sensor or of the force on the tyre."""

    RADIAL = "radial"
    TANGENTIAL = "tangential"
    AXIAL = "axial"


Place = tuple[float, int]


@dataclass(frozen=True, eq=False)
class Response:
    """A response channel of a run and where it sits, or a force and where it acts."""

    channel: Channel
    node: int | None
    position_deg: float | None
    direction: Direction = Direction.RADIAL

    @property
    def place(self) -> Place | None:
        """What tells it from others: its angle, or node and axis; None where neither is known."""
        if self.position_deg is not None:
            return round(self.position_deg, 6) % 360.0, 0
        return (float(self.node), self.channel.axis) if self.node else None


@dataclass(frozen=True, eq=False)
class Run:
    """One recording with the roles of its channels."""

    name: str  # of the file, as messages and tables show it
    recording: Recording
    force: Channel
    responses: tuple[Response, ...]  # on the grid (or on nodes), without the reference
    reference: Channel | None = None  # the sensor that stays in place over all runs
    others: tuple[Response, ...] = ()  # on the tyre, but not of the direction evaluated
    forces: tuple[Response, ...] = ()  # `force` and those that act beside it, with their places

    @property
    def references(self) -> tuple[Place | None, ...]:
        """Places of the forces, several where they act at the same time."""
        return tuple(each.place for each in self.forces) or (None,)

    @property
    def sensors(self) -> tuple[Channel, ...]:
        """All sensors on the tyre, the reference last."""
        found = [response.channel for response in (*self.responses, *self.others)]
        return (*found, *([self.reference] if self.reference else []))

    @property
    def channels(self) -> tuple[Channel, ...]:
        """Channels in use: the force, the responses, and the reference sensor last."""
        sensors = [response.channel for response in self.responses]
        return (self.force, *sensors, *([self.reference] if self.reference else []))


class _Findings:
    """Findings of a campaign, some of which may be made when they are first asked for."""

    def __get__(self, campaign: Campaign | None, owner: type[Campaign]) -> tuple[Finding, ...]:
        if campaign is None:
            return ()
        found: tuple[Finding, ...] | Callable[[], tuple[Finding, ...]] = vars(campaign)["findings"]
        if callable(found):
            found = vars(campaign)["findings"] = found()
        return found

    def __set__(self, campaign: Campaign, found: tuple[Finding, ...]) -> None:
        vars(campaign)["findings"] = found


_FINDINGS: Any = _Findings()


@dataclass(frozen=True, eq=False)
class Campaign:
    """Everything the lab handed over, checked and in SI.

    Parameters
    ----------
    name : str
        Folder or file name.
    runs : tuple of Run
        Empty where the files hold FRFs.
    frf : FRF, References or None
        FRFs found in the files, against one force or several; they enter after the FRF estimation.
    tyre : Tyre or None
        None where the object is any structure.
    positions : int or None
        Number of grid positions on the circle; None where there is no grid.
    excitation_deg : float or None
        Angle of the force on the grid; of the first one where runs have forces at several places.
    reference_deg : float or None
        Angle of the reference sensor, where given.
    sensor_mass_kg : float or None
        Mass of one accelerometer.
    own_masses_kg : dict of str to float
        Masses by channel, where they differ from that.
    live_mass_kg : float or None
        Mass between load cell and tyre.
    processing : Processing
        Choices of the manifest.
    tuning : dict
        The manifest's ``[tuning]``: pressure model, and value, std, limits or start of parameters.
    identification, checks : IdentificationSettings, CheckSettings
        Thresholds, changed by the manifest's ``[identification]`` and ``[checks]``.
    direction, force_direction : Direction
        Of the responses and of the force in `runs`.
    others : tuple of Campaign
        What was measured in other directions; kept out of the ring.
    sources : tuple of Path
        Every file read, the manifest first.
    findings : tuple of Finding
        What was assumed, left out or looks odd. What samples tell is found when it is first asked.

    Examples
    --------
    >>> import ringmodal as rm
    >>> campaign = rm.read_campaign("sample_data/tyre_225_55R17")
    >>> campaign
    <Campaign tyre_225_55R17: 6 runs with 72 responses, tyre 225/55R17>
    >>> campaign.runs[1].force.name, campaign.runs[1].recording.sampling_rate_hz
    ('force', 2000.0)
    """

    name: str
    runs: tuple[Run, ...] = ()
    frf: FRF | References | None = None
    tyre: Tyre | None = None
    positions: int | None = None
    excitation_deg: float | None = None
    reference_deg: float | None = None
    sensor_mass_kg: float | None = None
    own_masses_kg: dict[str, float] = field(default_factory=dict)
    live_mass_kg: float | None = None
    processing: Processing = field(default_factory=Processing)
    tuning: dict[str, Any] = field(default_factory=dict)
    identification: IdentificationSettings = IDENTIFICATION
    checks: CheckSettings = CHECKS
    direction: Direction = Direction.RADIAL
    force_direction: Direction = Direction.RADIAL
    others: tuple[Campaign, ...] = ()
    sources: tuple[Path, ...] = ()
    findings: tuple[Finding, ...] = _FINDINGS

    @property
    def has_circle(self) -> bool:
        """Whether the positions lie on a closed circle, so that circumferential orders exist."""
        frfs = () if self.frf is None else frfs_of(self.frf)
        placed = all(np.isfinite(each.position_deg).all() for each in frfs)
        return self.positions is not None or (bool(frfs) and placed)

    def mass_of(self, channel: str) -> float | None:
        """Mass of the sensor of a channel in kg; None where it is not given."""
        return self.own_masses_kg.get(channel, self.sensor_mass_kg)

    @property
    def stated_mass_kg(self) -> float | dict[str, float] | None:
        """Mass of the sensors as in the manifest: one number, or by channel."""
        if not self.own_masses_kg:
            return self.sensor_mass_kg
        default = {} if self.sensor_mass_kg is None else {"default": self.sensor_mass_kg}
        return default | self.own_masses_kg

    def __repr__(self) -> str:
        tyre = "no tyre" if self.tyre is None else f"tyre {self.tyre.designation}"
        return f"<Campaign {self.name}: {self._content()}, {tyre}>"

    def _repr_html_(self) -> str:
        pairs = [("content", self._content())]
        if self.tyre is not None:
            pairs += [
                ("tyre", self.tyre.designation),
                ("inflation pressure", as_typed(self.tyre.inflation_pressure_pa, "Pa")),
                ("mean radius", as_typed(self.tyre.mean_radius_m, "m")),
            ]
        pairs += [
            ("grid positions", "no grid" if self.positions is None else str(self.positions)),
            ("excitation at", as_typed(self.excitation_deg, "°")),
            ("reference sensor at", as_typed(self.reference_deg, "°")),
            ("mass of one sensor", _masses(self)),
        ]
        shown = facts(f"Campaign {self.name}", pairs) + (_runs_html(self.runs) if self.runs else "")
        return shown + findings_html(self.findings)

    def _content(self) -> str:
        if isinstance(self.frf, References):
            return f"FRFs of {counted(len(self.frf), 'force')}"
        if self.frf is not None:
            return f"FRFs of {counted(self.frf.n_positions, 'position')}"
        sensors = sum(len(run.responses) for run in self.runs)
        return f"{counted(len(self.runs), 'run')} with {counted(sensors, 'response')}"


def with_later_findings(campaign: Campaign, make: Callable[[], tuple[Finding, ...]]) -> Campaign:
    """The campaign with the findings that `make` gives once they are first asked for."""
    found = replace(campaign)
    vars(found)["findings"] = make
    return found


def _masses(campaign: Campaign) -> str:
    shown = as_typed(campaign.sensor_mass_kg, "kg")
    own = (f"{name} {as_typed(mass, 'kg')}" for name, mass in campaign.own_masses_kg.items())
    return ", ".join([shown, *own])


def _runs_html(runs: tuple[Run, ...]) -> str:
    head = ("run", "rate / Hz", "length / s", "force", "sensors", "reference")
    rows = [
        (
            run.name,
            number(run.recording.sampling_rate_hz),
            number(run.recording.duration_s),
            run.force.name,
            str(len(run.responses)),
            "–" if run.reference is None else run.reference.name,
        )
        for run in runs
    ]
    return table("Runs", head, rows, words=(0, 3, 5))
