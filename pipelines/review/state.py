"""The state of a review as JSON: modes against the automatic ones, channels, edits."""

from __future__ import annotations

from typing import Any

import numpy as np

from ema.checks.corrections import kept_rows
from ema.core.display import band_text, jsonable
from ema.core.edits import Edit, EditKind
from ema.core.errors import FitError, InputError
from ema.core.finding import Verdict
from pipelines.results.decided import edit_records
from pipelines.results.result import Result
from pipelines.review.sight import ModeRow, Sight, mode_label

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
        run = f" ({edit.channel.run})" if edit.channel.run else ""
        parts.append(f"{edit.channel.channel}{run}")
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
    wanted = edit.pole.frequency_hz
    modes = [*sight.automatic.modes, *sight.model.modes]
    near = min(modes, key=lambda mode: abs(mode.frequency_hz - wanted), default=None)
    if near is None or abs(near.frequency_hz / wanted - 1) > 1e-3 or near.order is None:
        return ""
    return mode_label(near)


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
    frf = sight.measured
    changes = {each.row: each for each in sight.corrections}
    kept = kept_rows(frf, sight.corrections)
    frac = dict(zip(kept.tolist(), sight.model.frac.tolist(), strict=True))
    rows = []
    for row in range(frf.n_positions):
        change = changes.get(row)
        factor = 1.0 if change is None else change.factor
        angle = float(frf.position_deg[row])
        rows.append(
            {
                **{"row": row, "position_deg": _known(angle), "node": int(frf.node[row])},
                **{"run": frf.run[row], "channel": frf.channel[row], "frac": frac.get(row)},
                **{"used": row in frac, "sign": -1 if factor < 0 else 1, "gain": abs(factor)},
                "by_hand": change is not None and change.is_by_hand,
                "why": "" if change is None else change.check.value,
            }
        )
    return rows


def _drift(sight: Sight) -> str:
    drift = sight.model.drift
    if not drift.applied or not drift.run:
        return "none"
    return f"{drift.percent[-1]:+.2f} % in frequency over {len(drift.run)} runs"


def _known(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
