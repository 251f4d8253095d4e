"""Why a mode is listed: the evidence for it, as lines of a panel."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ema.circumference.ring_modes import PURE
from ema.core.display import chance_text, value_with_std
from ema.core.modes import Mode
from ema.core.settings import IDENTIFICATION
from pipelines.review.sight import ModeRow, Sight

_REAL_SHAPE = 0.9  # MPC below which a shape is complex (Heylen, Lammens, Sas 1997)
_FAR_SIGMA = 3.0


@dataclass(frozen=True)
class Line:
    """One piece of evidence."""

    label: str
    value: str
    doubtful: bool | None = None  # None where it is neither good nor bad


def evidence(row: ModeRow, sight: Sight) -> list[Line]:
    """What speaks for and against a mode."""
    mode = row.mode
    return [
        *_poles(mode, sight),
        *_second_opinion(mode, sight),
        *_shape(mode),
        *_strength(mode),
        *_pair(mode, sight),
        *_band(mode),
        *([Line("Remark", f"{mode.status}: {mode.remark}", True)] if mode.flags else []),
        *_change(row),
    ]


def _poles(mode: Mode, sight: Sight) -> Iterator[Line]:
    clusters = sight.diagram.clusters
    near = min(clusters, key=lambda each: abs(each.pole - mode.pole), default=None)
    highest = int(sight.diagram.model_order.max(initial=0))
    reach = IDENTIFICATION.exclude_reach
    if near is None or abs(near.frequency_hz / mode.frequency_hz - 1) > reach:
        yield Line("Seen at", "no model order; the order by itself shows it", True)
        return
    yield Line("Seen at", f"{near.size} of {highest} model orders", not near.kept)
    if not near.kept:
        yield Line("Not chosen because", near.reason, True)


def _second_opinion(mode: Mode, sight: Sight) -> Iterator[Line]:
    for each in sight.opinions:
        if not np.isfinite(each.mode_hz) or abs(each.mode_hz / mode.frequency_hz - 1) > 1e-6:
            continue
        method = each.method.upper()
        if not np.isfinite(each.frequency_hz):
            yield Line(f"{method} finds", "nothing there", True)
        else:
            text = f"{each.frequency_hz:.2f} Hz, {100 * each.damping_ratio:.2f} %"
            yield Line(f"{method} finds", text, not each.agrees)


def _shape(mode: Mode) -> Iterator[Line]:
    if np.isfinite(mode.order_purity):
        text = f"{mode.order_purity:.3f} in order {mode.order}"
        yield Line("Purity", text, mode.order_purity < PURE)
    text = f"MPC {mode.mpc:.3f}, phases within {mode.mpd_deg:.1f}°"
    yield Line("Phase", text, mode.mpc < _REAL_SHAPE)


def _strength(mode: Mode) -> Iterator[Line]:
    known = mode.residues_std > 0
    if np.any(known):
        ratio = float(np.max(np.abs(mode.residues[known]) / mode.residues_std[known]))
        yield Line("Residue", f"{ratio:.0f} σ at its largest", ratio < _FAR_SIGMA)


def _pair(mode: Mode, sight: Sight) -> Iterator[Line]:
    if mode.order is None:
        return
    for report in sight.model.orders:
        if report.order == mode.order:
            pair = report.pair
            yield Line("Pair", f"{pair.verdict.value or 'not looked for'}. {pair.evidence}".strip())
            if np.isfinite(pair.chance):
                yield Line("Second mode by chance", chance_text(pair.chance))


def _band(mode: Mode) -> Iterator[Line]:
    shift, std = mode.frequency_band_shift_hz, mode.frequency_std_hz
    if np.isfinite(shift) and np.isfinite(std) and std > 0:
        ratio = abs(shift) / std
        text = f"{value_with_std(shift, None)} Hz ({ratio:.1f} σ)"
        yield Line("With a narrower band", text, ratio > _FAR_SIGMA)


def _change(row: ModeRow) -> Iterator[Line]:
    frequency, damping = row.shift_in_std()
    if np.isfinite(frequency) and np.isfinite(damping):
        text = f"{frequency:+.1f} σ in frequency, {damping:+.1f} σ in damping"
        yield Line("Against automatic", text, max(abs(frequency), abs(damping)) > _FAR_SIGMA)
