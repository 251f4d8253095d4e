"""What a page shows at one moment, also as JSON: the newest fit beside the automatic result."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy

from ema.checks.corrections import Correction, kept_rows
from ema.core.display import band_text, jsonable
from ema.core.edits import Edit, EditKind, of_kind
from ema.core.errors import FitError, InputError
from ema.core.finding import Finding, Verdict
from ema.core.frf import FRF
from ema.core.modes import ModalModel, Mode
from ema.identify import Identification
from ema.poles.stability import Opinion, StabilityDiagram
from pipelines.process.refit import settings_of
from pipelines.results.result import DrivenMode, Result, driven_modes, edit_records
from pipelines.review.session import Session

_SAME_MODE = 0.05  # farther from each other, relative to their frequency, poles are different modes
_SAME_POLE = 1e-3  # relative distance of a name to the pole that later edits made of its own
#: Settings whose change reads the recordings again.
REREADS = ("window", "block_seconds", "overlap", "averages")
_VERBS = {
    **{EditKind.KEEP: "Keep", EditKind.SET_ASIDE: "Set aside", EditKind.PICK: "Pick"},
    **{EditKind.START: "Start at", EditKind.LOCK: "Lock", EditKind.ONLY_KEPT: "Only what is kept"},
    **{EditKind.NO_PARTNERS: "No partners added", EditKind.CHANNEL_OUT: "Leave out"},
    **{EditKind.CHANNEL_IN: "Use", EditKind.FLIP: "Flip", EditKind.GAIN: "Scale"},
    **{EditKind.RUN_OUT: "Leave out run", EditKind.ORDER_IS: "Order of"},
    **{EditKind.SETTINGS: "Settings", EditKind.NOTE: "Note"},
}


@dataclass(frozen=True, eq=False)
class ModeRow:
    """A mode of the newest fit, of the automatic result, or of both.

    Parameters
    ----------
    mode : Mode
        That of the fit where it is listed there.
    listed : bool
    chosen : str
        Who put it on the list, or why it is not there.
    automatic : Mode or None
        The same mode of the automatic result.
    """

    mode: Mode
    listed: bool
    chosen: str
    automatic: Mode | None

    @property
    def key(self) -> str:
        """Its name in requests, as long as the frequency stays."""
        return f"{self.mode.pole.real:.9g},{self.mode.pole.imag:.9g}"

    @property
    def name(self) -> str:
        """Order and member."""
        return mode_label(self.mode)

    @property
    def called(self) -> str:
        """Its name in a sentence: the frequency where no order is known."""
        return self.name if self.mode.order is not None else f"{self.mode.frequency_hz:.2f} Hz"

    def shift_in_std(self) -> tuple[float, float]:
        """Changes of frequency and damping against the automatic mode in its σ."""
        one, other = self.mode, self.automatic
        if other is None or not self.listed:
            return float("nan"), float("nan")
        moved = one.frequency_hz - other.frequency_hz, one.damping_ratio - other.damping_ratio
        return moved[0] / other.frequency_std_hz, moved[1] / other.damping_std


@dataclass(frozen=True, eq=False)
class Sight:
    """The newest numbers of a review.

    Parameters
    ----------
    result : Result
        As opened.
    session : Session
    automatic : ModalModel
        Without any edit.
    found : Identification or None
        The newest fit; None where only what was opened is known.
    is_current : bool
        Whether it has all edits in force.
    is_fitted : bool
        Whether the modes are of these FRFs.
    """

    result: Result
    session: Session
    automatic: ModalModel
    found: Identification | None
    is_current: bool
    is_fitted: bool = True

    @property
    def revision(self) -> int:
        """Of the session."""
        return self.session.revision

    @property  # kept, it would be a cycle that holds FRFs until the garbage collector comes
    def of_forces(self) -> tuple[Sight, ...]:
        """The same against each of several forces, or this one alone.

        Until what was opened is fitted again, no fit against further forces is known.
        """
        if self.found is not None and self.found.references:
            return tuple(replace(self, found=each) for each in self.found.references)
        opened = (
            replace(
                self,
                result=replace(
                    self.result,
                    frf=each.fitted,
                    measured=each.measured,
                    corrections=each.corrections,
                    sensor_mass=each.sensor_mass,
                ),
                is_fitted=False,
            )
            for each in self.result.further
        )
        return self, *opened

    def has_row(self, row: int) -> bool:
        """Whether there is a row of a number: those of several forces follow each other."""
        return row < sum(each.measured.n_positions for each in self.of_forces)

    def at(self, row: int) -> tuple[Sight, int]:
        """What a row is of, and its number there."""
        for each in self.of_forces:
            if row < each.measured.n_positions:
                return each, row
            row -= each.measured.n_positions
        raise IndexError(row)

    @cached_property
    def driven(self) -> tuple[DrivenMode, ...]:
        """What each of several forces contributes to each mode."""
        return self.result.references if self.found is None else driven_modes(self.found)

    @property
    def _source(self) -> Identification | Result:
        return self.result if self.found is None else self.found

    @property
    def model(self) -> ModalModel:
        """The modes."""
        return self.result.modal_model if self.found is None else self.found.model

    @property
    def is_preview(self) -> bool:
        """Whether numbers can change yet."""
        return self.found is None or self.found.is_preview or not self.is_current

    @property
    def frf(self) -> FRF:
        """What is fitted."""
        return self._source.frf

    @property
    def measured(self) -> FRF:
        """All rows as measured."""
        return self._source.measured

    @property
    def diagram(self) -> StabilityDiagram:
        """Poles of all model orders."""
        return self._source.diagram

    @property
    def corrections(self) -> tuple[Correction, ...]:
        """What is done with single rows."""
        return self._source.corrections

    @property
    def opinions(self) -> tuple[Opinion, ...]:
        """The cross-check."""
        return self._source.opinions

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Of the recordings from the result, of the modes from the newest fit."""
        if self.found is None:
            return self.result.findings
        return tuple(dict.fromkeys([*self.result.findings, *self.found.findings]))

    @cached_property
    def settings(self) -> dict[str, Any]:
        """Settings in force."""
        options = self.result.provenance.get("options", {})
        processing = options.get("processing", {})
        names = "block_seconds", "window", "overlap", "averages"
        known = {name: processing.get(name) for name in names}
        if known["averages"] is None:
            known["averages"] = processing.get("averages_per_run")
        known |= {name: options.get(name) for name in ("method", "max_order", "estimator")}
        known["band_hz"] = list(self.result.modal_model.band_hz)
        return known | settings_of(self.session.edits)

    @property
    def poles_asked(self) -> dict[str, Any]:
        """How the poles of the diagram were found."""
        return {name: self.settings[name] for name in ("method", "max_order")}

    @cached_property
    def listed(self) -> list[ModeRow]:
        """Rows of the modes of the newest fit."""
        return [row for row in self.modes if row.listed]

    @cached_property
    def modes(self) -> list[ModeRow]:
        """All modes, ascending: those that are listed, and those of the automatic result."""
        now, before = self.model.modes, self.automatic.modes
        twins = _twins(now, before)
        rows = [
            ModeRow(mode, True, mode.chosen.value, before[twins[k]] if k in twins else None)
            for k, mode in enumerate(now)
        ]
        left = set(range(len(before))) - set(twins.values())
        gone = [before[k] for k in left]
        rows += [ModeRow(mode, False, self._why_gone(mode, gone), mode) for mode in gone]
        return sorted(rows, key=lambda row: row.mode.frequency_hz)

    def mode_named(self, key: str) -> ModeRow | None:
        """The mode of a key."""
        return next((row for row in self.modes if row.key == key), None)

    def _why_gone(self, mode: Mode, gone: Sequence[Mode]) -> str:
        """Why an automatic mode is not listed; names are of poles as they were when edited."""
        aside = of_kind(self.session.edits, EditKind.SET_ASIDE)
        named = any(_named_by(each, gone) is mode for each in aside)
        only = of_kind(self.session.edits, EditKind.ONLY_KEPT)
        if named or only:
            return "set aside"
        low, high = self.model.band_hz
        return "gone" if low <= mode.frequency_hz <= high else "outside"


def mode_label(mode: Mode) -> str:
    """Order and member, a dash where the order is not known."""
    return "–" if mode.order is None else f"{mode.order}{mode.member}"


def _named_by(edit: Edit, modes: Sequence[Mode]) -> Mode | None:
    """The mode nearest to the pole of an edit, None where none is that near."""
    if edit.pole is None:
        return None
    wanted = edit.pole.frequency_hz
    near = min(modes, key=lambda mode: abs(mode.frequency_hz - wanted), default=None)
    return near if near and abs(near.frequency_hz / wanted - 1) < _SAME_POLE else None


def _twins(now: tuple[Mode, ...], before: tuple[Mode, ...]) -> dict[int, int]:
    """Which modes are the same: those that make the sum of all distances smallest."""
    if not now or not before:
        return {}
    one, other = (np.array([mode.pole for mode in modes]) for modes in (now, before))
    apart = np.abs(one[:, None] - other) / np.abs(other)
    matched = scipy.optimize.linear_sum_assignment(np.minimum(apart, 2 * _SAME_MODE))
    pairs = zip(*matched, strict=True)
    return {int(k): int(m) for k, m in pairs if apart[k, m] < _SAME_MODE}


def state(sight: Sight) -> dict[str, Any]:
    """Everything but arrays, stage and who is asking."""
    model, result = sight.model, sight.result
    return {
        "name": result.name,
        "title": title(result),
        "revision": sight.revision,
        "cursor": sight.session.cursor,
        "edits": [edit_row(edit, sight) for edit in sight.session.history],
        "band_hz": list(model.band_hz),
        "fit_band_hz": list(model.fit_band_hz),
        "settings": jsonable(sight.settings),
        "rereads": list(REREADS),
        "chi2": _known(model.misfit),
        "chi2_automatic": _known(sight.automatic.misfit),
        "modes": [_mode(row) for row in sight.modes],
        "channels": _channels(sight),
        "forces": _forces(sight),
        "notes": list(model.notes),
        "findings": [
            {
                **{"run": each.run, "channel": each.channel, "check": each.check.value},
                **{"verdict": each.verdict.value, "detail": each.detail},
            }
            for each in sight.findings
            if each.verdict is not Verdict.OK
        ],
        "drift": _drift(sight),
        "excitation_deg": result.excitation_deg,
        "has_force": any(each.measured.forces for each in sight.of_forces),
        "averaged": sight.measured.blocks is not None,  # from recordings
        "on_circle": bool(np.all(np.isfinite(sight.measured.position_deg))),
    }


def title(result: Result) -> str:
    """Tyre and pressure."""
    tyre = result.tyre
    if tyre is None:
        return ""
    pressure = tyre.inflation_pressure_pa
    return tyre.designation + ("" if pressure is None else f" · {pressure / 1e5:.3g} bar")


def refusal(error: InputError | FitError) -> dict[str, str]:
    """An error as JSON."""
    if isinstance(error, InputError):
        names = "where", "found", "rule", "remedy"
        return {name: str(getattr(error, name)) for name in names}
    return {"where": "fit", "found": str(error), "rule": "", "remedy": ""}


def edit_row(edit: Edit, sight: Sight) -> dict[str, Any]:
    """An edit, and in words."""
    return {
        **{"text": edit_text(edit, sight), "kind": edit.kind.value, "reason": edit.reason},
        **{"by": edit.by, "at": edit.at, "edit": edit_records([edit])[0]},
        "mode": _named_mode(edit, sight) or None,
    }


def edit_text(edit: Edit, sight: Sight) -> str:
    """An edit in words: "Set aside 1b, 79.29 Hz"."""
    parts = [_VERBS[edit.kind]]
    if edit.pole is not None:
        name = _named_mode(edit, sight)
        place = f" at order {edit.pole.model_order}" if edit.pole.model_order is not None else ""
        parts.append(f"{name}, {edit.pole.frequency_hz:.2f} Hz{place}".removeprefix(", "))
    if edit.channel is not None:
        named = edit.channel
        run = f" ({named.run})" if named.run else ""
        force = f" against force {named.reference}" if named.reference else ""
        parts.append(f"{named.channel}{run}{force}")
    parts += [edit.run] if edit.run else []
    if edit.kind is EditKind.ORDER_IS and edit.value is not None:
        parts.append(f"is {edit.value:g}")
    elif edit.value is not None:
        parts.append(f"by {edit.value:g}")
    parts += [", ".join(_setting(name, value) for name, value in edit.settings.items())]
    return " ".join(filter(None, parts))


def _setting(name: str, value: Any) -> str:
    if name == "band_hz" and value is not None:
        return band_text(tuple(value))
    return f"{name.replace('_', ' ')} {value}"


def _named_mode(edit: Edit, sight: Sight) -> str:
    """Name of the mode nearest to the pole of an edit, empty where none is that near."""
    if edit.pole is None or edit.pole.model_order is not None:
        return ""
    near = _named_by(edit, [*sight.automatic.modes, *sight.model.modes])
    return "" if near is None or near.order is None else mode_label(near)


def _mode(row: ModeRow) -> dict[str, Any]:
    mode, before = row.mode, row.automatic
    sigma = row.shift_in_std()
    return {
        **{"key": row.key, "name": row.name, "order": mode.order, "member": mode.member},
        **{"listed": row.listed, "chosen": row.chosen, "status": mode.status},
        **{"frequency_hz": mode.frequency_hz, "damping_ratio": mode.damping_ratio},
        "frequency_std_hz": _known(mode.frequency_std_hz),
        "damping_std": _known(mode.damping_std),
        "purity": _known(mode.order_purity),
        **{"mpc": _known(mode.mpc), "mpd_deg": _known(mode.mpd_deg)},
        **{"pair": mode.pair.value, "remark": mode.remark, "common_name": mode.common_name},
        "automatic_hz": None if before is None else before.frequency_hz,
        "delta_hz": None
        if before is None or not row.listed
        else mode.frequency_hz - before.frequency_hz,
        **{"delta_sigma": _known(sigma[0]), "damping_delta_sigma": _known(sigma[1])},
        "pole": {"frequency_hz": mode.frequency_hz, "damping_ratio": mode.damping_ratio},
    }


def _channels(sight: Sight) -> list[dict[str, Any]]:
    """All rows, those of several forces one after the other."""
    rows = list[dict[str, Any]]()
    for force, each in enumerate(sight.of_forces, start=1):
        rows += _channels_of(each, force, len(rows))
    return rows


def _channels_of(sight: Sight, force: int, first: int) -> list[dict[str, Any]]:
    frf = sight.measured
    changes = {each.row: each for each in sight.corrections}
    kept = kept_rows(frf, sight.corrections)
    known = sight.model.frac if sight.is_fitted else np.full(kept.size, np.nan)
    frac = dict(zip(kept.tolist(), map(_known, known.tolist()), strict=True))
    rows = []
    for row in range(frf.n_positions):
        change = changes.get(row)
        factor = 1.0 if change is None else change.factor
        angle = float(frf.position_deg[row])
        rows.append(
            {
                **{"row": first + row, "position_deg": _known(angle), "node": int(frf.node[row])},
                **{"run": frf.run[row], "channel": frf.channel[row], "frac": frac.get(row)},
                **{"used": row in frac, "sign": -1 if factor < 0 else 1, "gain": abs(factor)},
                **{"by_hand": change is not None and change.is_by_hand, "force": force},
                "why": "" if change is None else change.check.value,
            }
        )
    return rows


def _forces(sight: Sight) -> list[str]:
    """Where several forces act, in the order of their numbers; nothing for one."""
    every = sight.of_forces if sight.of_forces[1:] else ()
    places = [(each.measured.force_node, each.measured.excitation_deg) for each in every]
    return [f"{at:g}°" if np.isfinite(at) else f"node {node}" for node, at in places]


def _drift(sight: Sight) -> str:
    drift = sight.model.drift
    if not drift.applied or not drift.run:
        return "none"
    return f"{drift.percent[-1]:+.2f} % in frequency over {len(drift.run)} runs"


def _known(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
